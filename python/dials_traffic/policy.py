"""The policy of one agent in numpy: weights in, actions out."""

from __future__ import annotations

from typing import Any, Dict, Optional

import numpy as np

Weights = Dict[str, np.ndarray]


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


def in_torch(weights: Weights) -> Weights:
    """Return weights with the names and shapes of torch's `GRUCell` and `Linear`. Gates have the same order there."""
    names = {"input_weight": "weight_ih", "state_weight": "weight_hh", "input_bias": "bias_ih", "state_bias": "bias_hh"}
    named = {}
    for name, value in weights.items():
        module, last = name.rsplit(".", 1)
        named[f"{module}.{names.get(last, last)}"] = value.T if last.endswith("weight") else value[0]
    return named
