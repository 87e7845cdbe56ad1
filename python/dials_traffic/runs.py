"""Trained policies of a run directory: weights in numpy, and decisions without torch."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional

import numpy as np

from ._process import PathLike, Process

Weights = Dict[str, np.ndarray]


class Run:
    """The policies of a run directory. Make one with :func:`dials_traffic.load`."""

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        process = _policies(self.path, greedy=False)
        try:
            about, parameters = process.about, process.array("parameters").copy()
        finally:
            process.close()
        #: Names of the agents, in order.
        self.agents: List[str] = [agent["name"] for agent in about["agents"]]
        #: Timesteps per agent of these policies, if somebody is still training the run.
        self.still_trained_at: Optional[int] = about["still_trained_at"]
        self._weights: Dict[str, Weights] = {}
        begin = 0
        for agent in about["agents"]:
            weights = self._weights[agent["name"]] = {}
            for name, shape in agent["tensors"]:
                end = begin + int(np.prod(shape))
                weights[name] = parameters[begin:end].reshape(shape)
                begin = end

    def weights(self, agent: str) -> Weights:
        """Return the weights of an agent's policy: arrays ``[in, out]`` and biases ``[1, out]``, float32.

        The last layer has one output per action, and then the value.
        """
        return self._weights[agent]

    def policy(self, agent: str, *, greedy: bool = False, seed: Optional[int] = None) -> "Policy":
        """Return the policy of one agent, which computes in numpy."""
        return Policy(self._weights[agent], greedy=greedy, seed=seed)

    def controller(self, *, greedy: bool = False) -> "Controller":
        """Return the policies of all agents, which act as `dials-traffic evaluate` lets them act, to the bit."""
        return Controller(self.path, greedy=greedy)


class Policy:
    """The policy of one agent. It sees one observation at a time.

    Its outputs are those of the program up to rounding; :meth:`Run.controller` has them to the bit.
    """

    def __init__(self, weights: Weights, *, greedy: bool = False, seed: Optional[int] = None) -> None:
        self.weights = weights
        self.greedy = greedy
        self._towers = ["", "critic."] if "critic.layers.0.weight" in weights else [""]
        self.reset(seed)

    def reset(self, seed: Optional[int] = None) -> None:
        """Begin an episode: the memory is cleared. A ``seed`` also begins new random numbers."""
        if seed is not None or not hasattr(self, "_random"):
            self._random = np.random.default_rng(seed)
        self._states = {
            tower: np.zeros(self.weights[tower + "gru.state_weight"].shape[0], np.float32)
            for tower in self._towers
            if tower + "gru.state_weight" in self.weights
        }

    def __call__(self, obs: Any, action_mask: Any = None) -> int:
        """Choose an action; ``action_mask``: 1 for each action that is allowed, or nothing if all are."""
        logits, _ = self.judge(obs)
        if action_mask is not None:
            logits = np.where(np.asarray(action_mask, bool), logits, -np.inf)
        if self.greedy:
            return int(np.argmax(logits))
        # The largest of logits plus Gumbel noise is a draw from their softmax.
        return int(np.argmax(logits + self._random.gumbel(size=logits.shape)))

    def judge(self, obs: Any) -> "tuple[np.ndarray, float]":
        """Return the logits of all actions and the value, and remember what was seen if the policy has a memory."""
        outputs = np.concatenate([self._tower(tower, np.asarray(obs, np.float32)) for tower in self._towers])
        return outputs[:-1], float(outputs[-1])

    def _tower(self, prefix: str, hidden: np.ndarray) -> np.ndarray:
        weights = self.weights
        if prefix in self._states:
            state = self._states[prefix]
            from_obs = hidden @ weights[prefix + "gru.input_weight"] + weights[prefix + "gru.input_bias"][0]
            from_state = state @ weights[prefix + "gru.state_weight"] + weights[prefix + "gru.state_bias"][0]
            r_obs, z_obs, n_obs = np.split(from_obs, 3)
            r_state, z_state, n_state = np.split(from_state, 3)
            reset, update = (1 / (1 + np.exp(-gate)) for gate in (r_obs + r_state, z_obs + z_state))
            hidden = self._states[prefix] = (1 - update) * np.tanh(n_obs + reset * n_state) + update * state
        layer = 0
        while f"{prefix}layers.{layer}.weight" in weights:
            if layer > 0:
                hidden = np.maximum(hidden, 0)
            hidden = hidden @ weights[f"{prefix}layers.{layer}.weight"] + weights[f"{prefix}layers.{layer}.bias"][0]
            layer += 1
        return hidden


class Controller:
    """The policies of all agents, in a process of their own. Make one with :meth:`Run.controller`."""

    def __init__(self, path: Path, *, greedy: bool = False) -> None:
        self._process = _policies(path, greedy)
        self._obs, self._masks = self._process.array("obs"), self._process.array("masks").view(np.int8)
        self._actions = self._process.array("actions")
        self._places: Dict[str, "tuple[int, slice, slice]"] = {}
        obs = masks = 0
        for row, agent in enumerate(self._process.about["agents"]):
            next_obs = obs + agent["obs_dim"]
            next_masks = masks + (agent["n_actions"] if agent["masks"] else 0)
            self._places[agent["name"]] = row, slice(obs, next_obs), slice(masks, next_masks)
            obs, masks = next_obs, next_masks
        self._obs[:], self._masks[:] = 0, 1

    def begin(self, seed: int, episode: int = 0) -> None:
        """Begin an episode: that of ``env.seed`` and ``env.episode`` of a :func:`parallel_env`."""
        self._process.reset(seed, episode)

    def act(self, observations: Mapping[str, np.ndarray], infos: Mapping[str, Mapping[str, Any]]) -> Dict[str, int]:
        """Decide for all agents that are shown, from what ``reset`` or ``step`` of a :func:`parallel_env` returned."""
        for agent, obs in observations.items():
            _, place, mask_place = self._places[agent]
            self._obs[place] = obs
            if mask_place.start < mask_place.stop:
                self._masks[mask_place] = infos[agent]["action_mask"]
        self._process.step()
        actions = self._actions.tolist()
        return {agent: actions[self._places[agent][0]] for agent in observations}

    def close(self) -> None:
        """End the process."""
        self._process.close()


def _policies(path: Path, greedy: bool) -> Process:
    request = {"config": str(path), "settings": [], "environment": {"policies": {"greedy": greedy}}}
    return Process(f"the policies of {path}", request)
