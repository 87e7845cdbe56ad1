"""Policies that see a light as sets of lanes and greens, so that one fits any light."""

from __future__ import annotations

from typing import Any, Mapping, Optional, Tuple

import numpy as np

from . import _checks
from ._channel import PathLike, path_text, request_of, whole_number, yes_or_no
from ._process import Process
from ._sets import OverSets
from .policy import Policy, Weights, check_weights


class LightPolicy(Policy):
    """A policy over lanes and greens. Make one with :func:`dials_traffic.any_light` or :meth:`Run.policy`.

    It plays every agent of an environment with ``settings={"traffic.observation": "lanes"}``. It remembers nothing, so one
    policy may decide for all of them.
    """

    def __init__(
        self,
        weights: Weights,
        sets: Mapping[str, int],
        *,
        n_actions: Optional[int] = None,
        greedy: bool = False,
        seed: Optional[int] = None,
        agent: str = "",
        longest_red_s: Optional[int] = None,
        hold_s: int = 1,
    ) -> None:
        """``sets``: numbers of features. ``n_actions``: of the agent; without it, each call needs an action mask, which has as many.
        ``longest_red_s``: seconds of red after which cars and people who stand come next. ``hold_s``: seconds for which a green stays
        while several cars stand on a lane that it opens, if there is a longest red.

        ``agent``: its name, for errors.
        """
        check_weights(weights)
        self.weights = weights
        self.greedy = yes_or_no("greedy", greedy)
        self._agent, self._columns, self._actions, self._towers = agent, (), (), [""]
        self._network, self._own_actions = OverSets(weights, sets), n_actions
        self._n_actions = n_actions or 0
        self._longest_red_s, self._hold_s = longest_red_s, hold_s
        self.reset(seed)

    def __call__(self, obs: Any, action_mask: Any = None) -> int:
        """Choose an action. ``action_mask``: 1 for each action that is allowed, of the infos of the environment."""
        if self._own_actions is None:
            if action_mask is None:
                raise TypeError("action_mask: a policy for any light needs it: infos[agent]['action_mask']")
            self._n_actions = np.size(action_mask)
        return super().__call__(obs, action_mask)

    def _left_of(self, allowed: np.ndarray, obs: Any) -> np.ndarray:
        if self._longest_red_s is None:
            return allowed
        return self._network.by_the_rules(np.asarray(obs), allowed, self._longest_red_s, self._hold_s)

    def judge(self, obs: Any, n_actions: Optional[int] = None) -> Tuple[np.ndarray, float]:
        """Return the logits of all actions, and the value. ``n_actions``: how many there are, if the policy is for any light."""
        choices = n_actions or self._n_actions
        width = np.size(obs)
        if self._network.items(width, choices) == 0:
            raise ValueError(
                f"observations: {width} columns are no lanes and {choices} greens; make the environment with "
                'settings={"traffic.observation": "lanes"}'
            )
        shown = _checks.observation(self._agent, obs, width)
        with np.errstate(all="ignore"):
            outputs = self._network.outputs(shown, choices)
        if not np.isfinite(outputs).all():
            raise ValueError("the outputs of the policy are not finite; its weights are too large")
        return outputs[:-1], float(outputs[-1])


def any_light(
    file: Optional[PathLike] = None,
    *,
    greedy: bool = False,
    seed: Optional[int] = None,
    longest_red_s: int = 120,
    hold_s: int = 30,
    partial: bool = False,
) -> LightPolicy:
    """Read a policy that plays any light, also on networks that it has never seen.

    ``file``: what `dials-traffic export RUN --out FILE.safetensors` wrote; without it, one that comes with the program.
    It decides for every agent of ``parallel_env(config, settings={"traffic.observation": "lanes", "traffic.decision_s": 2})``, or
    every 5 s if it is ``partial``::

        policy(observations[agent], infos[agent]["action_mask"])

    ``greedy``: take the most likely action instead of drawing one. ``seed``: of the draws. ``longest_red_s``: seconds of red after
    which cars and people who stand come next, whatever the network says. ``hold_s``: seconds for which a green stays while three
    or more cars stand on a lane that it opens and nobody waits to walk. ``partial``: without ``file``, take the policy for lights
    that see a part of the cars (``"traffic.seen_cars"``).
    """
    whole_number("longest_red_s", longest_red_s, 1)
    whole_number("hold_s", hold_s, 1)
    path = None if file is None else path_text("file", file)
    label = "the policy for any light" if path is None else f"the policy of {path}"
    process = Process(label, request_of(".", None, {"any_light": {"file": path, "partial": bool(partial)}}))
    try:
        about, parameters = process.about, process.array("parameters").copy()
    finally:
        process.close()
    parameters.flags.writeable = False
    weights: Weights = {}
    begin = 0
    for name, shape in about["tensors"]:
        end = begin + int(np.prod(shape))
        weights[name] = parameters[begin:end].reshape(shape)
        begin = end
    return LightPolicy(weights, about["sets"], greedy=greedy, seed=seed, longest_red_s=longest_red_s, hold_s=hold_s)
