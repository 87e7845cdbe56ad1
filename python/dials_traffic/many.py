"""Several environments of all agents, stepped together."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Optional, Tuple

import gymnasium
import numpy as np

from ._channel import Channel, PathLike, Remade, alone, check_dict, free_memory, fresh_seed, whole_number
from .errors import SimulatorError
from .own import OwnCost
from .parallel import GlobalEnv, Infos, Observations
from .roads import Neighbours

Table = Dict[str, np.ndarray]
#: Memory of a copy in bytes, less than any needs: a Python and SUMO.
LEAST_PER_COPY = 16 << 20


class GlobalVectorEnv(Remade):
    """``n`` copies of a config's global simulator, each in a process of its own. Make one with
    :func:`dials_traffic.vector_parallel_env`.

    All tables are dicts from agents to arrays whose first dimension is the copy. All copies end together; the next
    episodes begin in the same step. Then ``infos`` has ``"final_obs"`` (a table) and ``"episodes"`` (a list with the
    last infos of each copy, with the metrics).
    """

    def __init__(self, config: PathLike, n: int, *, seed: Optional[int] = None, **options: Any) -> None:
        """Start the copies. Copy ``i`` has the seed ``seed + i``; ``options``: as for :func:`parallel_env`."""
        n, first_seed = whole_number("n", n, 1), fresh_seed(seed)
        self._made_of = {"config": config, "n": n, "seed": first_seed, **options}
        most = max(1, free_memory() // LEAST_PER_COPY)
        if n > most:
            raise ValueError(f"n {n}: each copy is a process, and there is memory for at most {most}")
        self.envs: List[GlobalEnv] = []
        try:
            for copy in range(n):
                self.envs.append(GlobalEnv(config, seed=(first_seed + copy) % 2**64, **options))
                self.envs[copy]._channel.label = f"copy {copy} of the environment of {config}"
        except BaseException:
            self.close()
            raise
        first = self.envs[0]
        self.num_envs = n
        self.agents: List[str] = list(first.possible_agents)
        self.horizon = first.horizon
        # Whether the last call came to its end in all copies.
        self._whole = True

    @property
    def _channel(self) -> Channel:
        """What :func:`alone` waits for: the first copy stands for all."""
        return self.envs[0]._channel

    def state(self) -> np.ndarray:
        """Return what a central critic sees in every copy, `[copies, width]`: all observations, one after another."""
        return np.stack([env.state() for env in self.envs])

    def neighbours(self) -> Neighbours:
        """Return which light feeds which, as :meth:`GlobalEnv.neighbours` does."""
        return self.envs[0].neighbours()

    @property
    def own_cost(self) -> OwnCost:
        """Time that own functions took in all copies, and the time of all steps."""
        costs = [env.own_cost for env in self.envs]
        return OwnCost(sum(cost.functions_s for cost in costs), sum(cost.steps_s for cost in costs))

    def observation_space(self, agent: str) -> "gymnasium.Space[Any]":
        """Return the space of one copy's observations."""
        return self.envs[0].observation_space(agent)

    def action_space(self, agent: str) -> "gymnasium.Space[Any]":
        """Return the space of one copy's actions."""
        return self.envs[0].action_space(agent)

    @alone
    def reset(self, seed: Optional[int] = None) -> Tuple[Table, Dict[str, Any]]:
        """Begin an episode in every copy."""
        first_seed = None if seed is None else fresh_seed(seed)
        self._whole = False
        for copy, env in enumerate(self.envs):
            env.send_reset(None if first_seed is None else (first_seed + copy) % 2**64)
        shown = self._joined([env.receive_reset() for env in self.envs])
        self._whole = True
        return shown

    @alone
    def step(self, actions: Mapping[str, Any]) -> Tuple[Table, Table, Table, Table, Dict[str, Any]]:
        """Make a step in every copy; ``actions``: for each agent one action per copy. If one is refused, none steps."""
        if not self._whole:
            raise SimulatorError("the last call was not finished; call reset() first")
        check_dict("actions", actions)
        for agent, chosen in actions.items():
            if len(chosen) != self.num_envs:
                raise ValueError(f"agent {agent!r}: {len(chosen)} actions for {self.num_envs} copies")
        codes = [
            env.checked({agent: chosen[copy] for agent, chosen in actions.items()})
            for copy, env in enumerate(self.envs)
        ]
        self._whole = False
        for env, code in zip(self.envs, codes):
            env.send_checked(code)
        results = [env.receive_step() for env in self.envs]
        rewards = {agent: np.array([result[1][agent] for result in results]) for agent in self.agents}
        terminations = {agent: np.zeros(self.num_envs, bool) for agent in self.agents}
        over = not self.envs[0].agents
        truncations = {agent: np.full(self.num_envs, over) for agent in self.agents}
        obs, infos = self._joined([(result[0], result[4]) for result in results])
        if over:
            final = {"final_obs": obs, "episodes": [result[4] for result in results]}
            obs, infos = self.reset()
            infos.update(final)
        self._whole = True
        return obs, rewards, terminations, truncations, infos

    def _joined(self, shown: List[Tuple[Observations, Infos]]) -> Tuple[Table, Dict[str, Any]]:
        """Return what the copies show as tables."""
        obs = {agent: np.stack([observations[agent] for observations, _ in shown]) for agent in self.agents}
        masks = {agent: np.stack([infos[agent]["action_mask"] for _, infos in shown]) for agent in self.agents}
        return obs, {"action_mask": masks}

    def close(self) -> None:
        """End all copies."""
        for env in self.envs:
            env._channel.hang_up()
        for env in self.envs:
            env.close()
