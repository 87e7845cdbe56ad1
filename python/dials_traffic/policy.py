"""The policy of one agent in numpy: weights in, actions out."""

from __future__ import annotations

from typing import Any, Dict, Optional, Sequence

import numpy as np

from . import _checks
from ._channel import yes_or_no

Weights = Dict[str, np.ndarray]


class Policy:
    """The policy of one agent. It sees one observation at a time.

    Its outputs are those of the program up to rounding; :meth:`Run.controller` has them to the bit. What is refused, such
    as NaN or a mask that allows nothing, changes nothing. A policy is for one thread; others make their own.
    """

    def __init__(
        self,
        weights: Weights,
        *,
        greedy: bool = False,
        seed: Optional[int] = None,
        agent: str = "",
        columns: Sequence[str] = (),
        actions: Sequence[str] = (),
    ) -> None:
        """``agent``, ``columns`` and ``actions``: names for errors, of the agent, of what it sees and of what it does."""
        check_weights(weights)
        self.weights = weights
        self.greedy = yes_or_no("greedy", greedy)
        self._agent, self._columns, self._actions = agent, columns, actions
        self._towers = ["", "critic."] if "critic.layers.0.weight" in weights else [""]
        first = "gru.input_weight" if "gru.input_weight" in weights else "layers.0.weight"
        self._width: int = weights[first].shape[0]
        outputs = sum(_outputs(weights, tower) for tower in self._towers)
        self._n_actions = outputs - 1
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
        allowed = None
        if action_mask is not None:
            # Before the policy remembers the observation.
            allowed = _checks.action_mask(self._agent, action_mask, self._n_actions, self._actions)
        logits, _ = self.judge(obs)
        if allowed is not None:
            logits = np.where(self._left_of(allowed, obs), logits, -np.inf)
        if self.greedy:
            return int(np.argmax(logits))
        # The largest of logits plus Gumbel noise is a draw from their softmax.
        return int(np.argmax(logits + self._random.gumbel(size=logits.shape)))

    def _left_of(self, allowed: np.ndarray, obs: Any) -> np.ndarray:
        """Return from which of the allowed actions it chooses."""
        return allowed

    def judge(self, obs: Any) -> "tuple[np.ndarray, float]":
        """Return the logits of all actions and the value, and remember what was seen if the policy has a memory."""
        shown = _checks.observation(self._agent, obs, self._width, self._columns)
        states = dict(self._states)
        # What overflows is an error below, and no warning here.
        with np.errstate(all="ignore"):
            outputs = np.concatenate([self._tower(tower, shown, states) for tower in self._towers])
        if not np.isfinite(outputs).all():
            raise ValueError(f"agent {self._agent!r}: the outputs of its policy are not finite; its weights are too large")
        self._states = states
        return outputs[:-1], float(outputs[-1])

    def _tower(self, prefix: str, hidden: np.ndarray, states: Weights) -> np.ndarray:
        """Return the outputs, and put the next state into ``states``."""
        weights = self.weights
        if prefix in states:
            state = states[prefix]
            from_obs = hidden @ weights[prefix + "gru.input_weight"] + weights[prefix + "gru.input_bias"][0]
            from_state = state @ weights[prefix + "gru.state_weight"] + weights[prefix + "gru.state_bias"][0]
            r_obs, z_obs, n_obs = np.split(from_obs, 3)
            r_state, z_state, n_state = np.split(from_state, 3)
            reset, update = (1 / (1 + np.exp(-gate)) for gate in (r_obs + r_state, z_obs + z_state))
            hidden = states[prefix] = (1 - update) * np.tanh(n_obs + reset * n_state) + update * state
        layer = 0
        while f"{prefix}layers.{layer}.weight" in weights:
            if layer > 0:
                hidden = np.maximum(hidden, 0)
            hidden = hidden @ weights[f"{prefix}layers.{layer}.weight"] + weights[f"{prefix}layers.{layer}.bias"][0]
            layer += 1
        return hidden


def check_weights(weights: Any) -> None:
    """Raise an error if these are no weights, as :meth:`Run.weights` returns them."""
    if not isinstance(weights, dict):
        raise TypeError(f"weights {type(weights).__name__}: must be a dict of arrays by name")
    for name, table in weights.items():
        if not isinstance(table, np.ndarray) or table.dtype.kind != "f":
            raise TypeError(f"weights: {name!r}: must be an array of floats")
        if table.ndim != 2:
            raise ValueError(f"weights: {name!r}: of shape {table.shape} instead of [in, out]")


def _outputs(weights: Weights, prefix: str) -> int:
    """Return the number of outputs of the last layer."""
    layer, outputs = 0, 0
    while f"{prefix}layers.{layer}.weight" in weights:
        outputs = weights[f"{prefix}layers.{layer}.weight"].shape[1]
        layer += 1
    return outputs


def in_torch(weights: Weights) -> Weights:
    """Return weights with the names and shapes of torch's `GRUCell` and `Linear`. Gates have the same order there."""
    names = {"input_weight": "weight_ih", "state_weight": "weight_hh", "input_bias": "bias_ih", "state_bias": "bias_hh"}
    named = {}
    for name, value in weights.items():
        module, last = name.rsplit(".", 1)
        named[f"{module}.{names.get(last, last)}"] = value.T if last.endswith("weight") else value[0]
    return named
