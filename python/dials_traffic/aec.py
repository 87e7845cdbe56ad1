"""All agents of a config, one after another, as an environment of PettingZoo."""

from __future__ import annotations

from typing import Any, Optional

from pettingzoo.utils import BaseWrapper, parallel_to_aec

from ._channel import Channel, alone
from .parallel import GlobalEnv


class GlobalAecEnv(BaseWrapper):  # type: ignore[misc]
    """PettingZoo's wrapper around a :class:`GlobalEnv`. Make one with :func:`dials_traffic.aec_env`.

    Its calls exclude each other, as those of the :class:`GlobalEnv` do. But an agent's turn takes several, ``last`` and
    ``step``: threads that share one agree among themselves whose turn it is. An action that is refused leaves the turn
    where it was.
    """

    def __init__(self, env: GlobalEnv) -> None:
        super().__init__(parallel_to_aec(env))
        self._parallel = env

    @property
    def _channel(self) -> Channel:
        return self._parallel._channel

    @alone
    def reset(self, seed: Optional[int] = None, options: Optional[Any] = None) -> None:
        super().reset(seed=seed, options=options)

    @alone
    def step(self, action: Any) -> None:
        # PettingZoo's wrapper would only look at the actions when all agents have chosen.
        if self._parallel.agents and action is not None:
            self._parallel.check_action(self.agent_selection, action)
        super().step(action)

    @alone
    def last(self, observe: bool = True) -> Any:
        return super().last(observe)

    @alone
    def observe(self, agent: str) -> Any:
        return super().observe(agent)
