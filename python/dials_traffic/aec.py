"""All agents of a config, one after another, as an environment of PettingZoo."""

from __future__ import annotations

from typing import Any, Optional

from pettingzoo.utils import BaseWrapper, parallel_to_aec

from ._channel import Channel, Remade, alone
from .errors import SimulatorError
from .own import OwnCost
from .parallel import GlobalEnv
from .roads import Neighbours


class GlobalAecEnv(Remade, BaseWrapper):  # type: ignore[misc]
    """PettingZoo's wrapper around a :class:`GlobalEnv`. Make one with :func:`dials_traffic.aec_env`.

    Its calls exclude each other, as those of the :class:`GlobalEnv` do. But an agent's turn takes several, ``last`` and
    ``step``: threads that share one agree among themselves whose turn it is. An action that is refused leaves the turn
    where it was.
    """

    def __init__(self, env: GlobalEnv) -> None:
        if not isinstance(env, GlobalEnv):
            raise TypeError(f"env {env!r}: must be a GlobalEnv, which parallel_env makes")
        super().__init__(parallel_to_aec(env))
        self._made_of = {"env": env}
        self._parallel = env
        self._begun = False

    @property
    def _channel(self) -> Channel:
        return self._parallel._channel

    @alone
    def reset(self, seed: Optional[int] = None, options: Optional[Any] = None) -> None:
        super().reset(seed=seed, options=options)
        self._begun = True

    @property
    def own_cost(self) -> OwnCost:
        """Time that own functions took since the environment was made, beside that of all steps."""
        return self._parallel.own_cost

    def neighbours(self) -> Neighbours:
        """Return which light feeds which, as :meth:`GlobalEnv.neighbours` does."""
        return self._parallel.neighbours()

    def _check_begun(self) -> None:
        # Before the first reset, PettingZoo's wrapper has failed assertions and missing attributes.
        if not self._begun:
            raise SimulatorError("there is no episode under way; call reset() first")

    @alone
    def step(self, action: Any) -> None:
        self._check_begun()
        if self._parallel.agents:
            # PettingZoo's wrapper would only look at the actions when all agents have chosen.
            self._parallel.check_action(self.agent_selection, action)
        elif self.agents and action is not None:
            raise ValueError(f"agent {self.agent_selection!r}: action {action!r}; its episode is over, so it must be None")
        super().step(action)

    @alone
    def last(self, observe: bool = True) -> Any:
        self._check_begun()
        return super().last(observe)

    @alone
    def observe(self, agent: str) -> Any:
        self._check_begun()
        return super().observe(agent)
