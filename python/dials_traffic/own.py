"""Rewards and observations of your own: functions over :class:`Roads`, their names, and what they cost."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Callable, Dict, Optional, Tuple, TypeVar, Union

import numpy as np

from .roads import Layout, Roads

#: A function of what is on the roads. It returns one line of numbers per row, `[rows, width]`, always of the same width.
Observation = Callable[[Roads], Any]
#: A function of the roads before a step and after it. It returns one number per row, `[rows]`.
Reward = Callable[[Roads, Roads], Any]

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Result = TypeVar("_Result")

_REGISTERED: Dict[str, Dict[str, Callable[..., Any]]] = {"reward": {}, "observation": {}}


def register_reward(name: str, function: Reward) -> Reward:
    """Give a reward a name, so that a config or ``settings`` may say `traffic.reward = "python:NAME"`. Returns it."""
    return _register("reward", name, function)


def register_observation(name: str, function: Observation) -> Observation:
    """Give an observation a name, so that a config or ``settings`` may say `traffic.observation = "python:NAME"`. Returns
    it.
    """
    return _register("observation", name, function)


def _register(kind: str, name: str, function: _Function) -> _Function:
    if not isinstance(name, str):
        raise TypeError(f"register_{kind}: name {name!r}: must be a text")
    if not name or not all(letter.isalnum() or letter in "_-." for letter in name):
        raise ValueError(f"register_{kind}: name {name!r}: must have letters, digits, _, - and dots")
    check_function(kind, function)
    _REGISTERED[kind][name] = function
    return function


def registered(kind: str, name: str) -> Callable[..., Any]:
    """Return the function of a name. ``kind``: reward or observation."""
    if name not in _REGISTERED[kind]:
        known = ", ".join(sorted(_REGISTERED[kind])) or "none"
        raise ValueError(
            f"{kind} {name!r}: no function of this name is registered (registered: {known}); call "
            f"dials_traffic.register_{kind}({name!r}, ...) first"
        )
    return _REGISTERED[kind][name]


def check_function(kind: str, function: Any) -> None:
    """Raise an error if this is neither nothing nor a function."""
    if function is not None and not callable(function):
        raise TypeError(f"{kind} {function!r}: must be a function")


@dataclass
class OwnCost:
    """Time that own functions took, and that the steps took beside them."""

    functions_s: float = 0.0
    steps_s: float = 0.0
    #: Time in which an own predictor learnt and measured its losses.
    fits_s: float = 0.0

    @property
    def share(self) -> float:
        """Share of the steps' whole time that the functions took, from 0 to 1."""
        whole = self.functions_s + self.steps_s
        return self.functions_s / whole if whole > 0 else 0.0

    def __str__(self) -> str:
        steps = f"own functions took {self.functions_s:.3g} s, {self.share:.1%} of the time of the steps"
        return f"{steps}; fits and losses of the predictor {self.fits_s:.3g} s" if self.fits_s > 0 else steps


class Own:
    """The functions of one simulator, and the roads that they saw last."""

    def __init__(
        self,
        layout: Layout,
        reward: Optional[Reward],
        observation: Optional[Observation],
        cost: Optional[OwnCost] = None,
    ) -> None:
        self.layout, self.reward, self.observation = layout, reward, observation
        self.cost = OwnCost() if cost is None else cost
        self._before: Optional[Roads] = None
        #: Number of columns of the own observation, which it shows on empty roads.
        self.width = 0
        if observation is not None:
            self.width = self._see(layout.empty()).shape[1]

    def begin(self, data: Any) -> Optional[np.ndarray]:
        """Take the roads at the beginning of episodes. Return observations, `[rows, width]`, if they are own ones."""
        return self._timed(self._begin, data)

    def _begin(self, data: Any) -> Optional[np.ndarray]:
        self._before = Roads._read(self.layout, data)
        return None if self.observation is None else self._see(self._before)

    def step(self, data: Any) -> Tuple[Optional[np.ndarray], Optional[np.ndarray]]:
        """Take the roads after a step. Return rewards `[rows]` and observations, those that are own ones."""
        return self._timed(self._step, data)

    def _step(self, data: Any) -> Tuple[Optional[np.ndarray], Optional[np.ndarray]]:
        now = Roads._read(self.layout, data)
        rewards = None if self.reward is None else self._pay(now)
        obs = None if self.observation is None else self._see(now)
        self._before = now
        return rewards, obs

    def _timed(self, work: Callable[[Any], _Result], data: Any) -> _Result:
        begun = time.perf_counter()
        try:
            return work(data)
        finally:
            self.cost.functions_s += time.perf_counter() - begun

    def _pay(self, now: Roads) -> np.ndarray:
        assert self.reward is not None and self._before is not None, "an episode has begun"
        rewards = _numbers("reward", self.reward(self._before, now))
        if rewards.shape != (now.rows,):
            raise ValueError(f"reward: of shape {rewards.shape} instead of ({now.rows},), one number per row")
        self._check_finite("reward", rewards)
        return rewards.astype(np.float64)

    def _see(self, now: Roads) -> np.ndarray:
        assert self.observation is not None
        obs = _numbers("observation", self.observation(now))
        width = self.width or (obs.shape[1] if obs.ndim == 2 else 0)
        if width == 0 or obs.shape != (now.rows, width):
            wanted = f"({now.rows}, {width or 'width'}), one line per row"
            always = "; it must always be the same" if self.width else ""
            raise ValueError(f"observation: of shape {obs.shape} instead of {wanted}{always}")
        self._check_finite("observation", obs)
        # A copy: the function may use an array of its own again.
        return np.array(obs, np.float32)

    def _check_finite(self, kind: str, values: np.ndarray) -> None:
        if np.isfinite(values).all():
            return
        row = int(np.argwhere(~np.isfinite(values))[0][0])
        column = "" if values.ndim == 1 else f", column {int(np.argwhere(~np.isfinite(values[row]))[0][0])}"
        value = values[row] if values.ndim == 1 else values[row][~np.isfinite(values[row])][0]
        raise ValueError(f"{kind}: {self.layout.of_row(row)}{column}: {value}; must be a finite number")


def _numbers(kind: str, value: Any) -> np.ndarray:
    try:
        table = np.asarray(value)
    except ValueError:
        raise ValueError(f"{kind}: of no regular shape") from None
    if table.dtype.kind not in "fiub":
        raise TypeError(f"{kind}: must return numbers, not {table.dtype}")
    return table


Named = Union[str, Callable[..., Any], None]


def chosen(kind: str, given: Named, of_config: Optional[str]) -> Optional[Callable[..., Any]]:
    """Return the function that was given, by itself or by its name, or else the one that the config names."""
    if isinstance(given, str):
        return registered(kind, given.removeprefix("python:"))
    check_function(kind, given)
    if given is None and of_config is not None:
        return registered(kind, of_config)
    return given
