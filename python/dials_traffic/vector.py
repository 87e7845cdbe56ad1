"""Copies of agents' local simulators, as a Gymnasium vector environment and as a single one."""

from __future__ import annotations

import time
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ._channel import (
    Channel,
    PathLike,
    Remade,
    alone,
    fresh_seed,
    no_memory,
    path_text,
    refuse_unknown_options,
    request_of,
    whole_number,
    yes_or_no,
)
from ._process import Process
from .errors import SimulatorError
from .own import Observation, Own, OwnCost, Reward, chosen
from .predictor import Driver, is_own
from .roads import Layout

Agents = Union[str, Sequence[str], None]


class LocalVectorEnv(Remade, VectorEnv):
    """Local simulators of some agents of one kind, side by side in one process. Make one with
    :func:`dials_traffic.vector_env`.

    Rows are ordered by agent, then by copy. An episode ends as a truncation, and the next one begins in the same step:
    ``infos["final_obs"]`` has the observations before that, valid where ``infos["_final_obs"]`` is true.
    ``infos["action_mask"]`` is ``[rows, actions]``, int8. As with Gymnasium's own vector environments, every key has a
    second one with ``_`` before it that says which rows have it, and ``infos["final_info"]`` is of the end.
    """

    def __init__(
        self,
        config: PathLike,
        agents: Agents,
        copies: int,
        predictor: Any = None,
        *,
        seed: Optional[int] = None,
        stagger: bool = False,
        reward: Union[Reward, str, None] = None,
        observation: Union[Observation, str, None] = None,
        settings: Optional[Mapping[str, Any]] = None,
    ) -> None:
        copies, first_seed = whole_number("copies", copies, 1), fresh_seed(seed)
        self._made_of = {
            "config": config,
            "agents": agents,
            "copies": copies,
            "predictor": predictor,
            "seed": first_seed,
            "stagger": stagger,
            "reward": reward,
            "observation": observation,
            "settings": settings,
        }
        names = [agents] if isinstance(agents, str) else list([] if agents is None else agents)
        if agents is not None and not names:
            raise ValueError("agents: there is none in the list; None stands for all agents")
        local = {
            "agents": names,
            "copies": copies,
            "predictor": _predictor(config if predictor is None else predictor),
            "stagger": yes_or_no("stagger", stagger),
            "watches_roads": reward is not None or observation is not None,
        }
        request = request_of(config, settings, {"local": local})
        self._process = Process(f"the local simulators of {config}", request)
        about = self._process.about
        self._own: Optional[Own] = None
        # When the step under way began.
        self._begun = 0.0
        try:
            self._take_functions(reward, observation)
        except BaseException:
            self._process.close()
            raise
        #: Names of the agents. Row ``i`` belongs to agent ``i // copies``.
        self.agents: List[str] = about["agents"]
        self.copies = copies
        #: Number of steps of an episode.
        self.horizon: int = about["horizon"]
        self.num_envs: int = about["rows"]
        self._n_actions: int = about["n_actions"]
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}
        self.single_observation_space = Box(-np.inf, np.inf, (self._width(),), np.float32)
        self.single_action_space = Discrete(self._n_actions)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        #: Seed of the episodes. A run of `dials-traffic train` with this seed begins with the same ones.
        self.seed, self._resets = first_seed, 0
        # Whether the last call came to its end.
        self._whole = True
        array = self._process.array
        self._obs, self._last_obs = (array(name).reshape(self.num_envs, -1) for name in ("obs", "last_obs"))
        if about["masks"]:
            masks, last_masks = (array(name).view(np.int8) for name in ("masks", "last_masks"))
        else:
            masks = last_masks = np.ones(self.num_envs * self._n_actions, np.int8)
        self._masks, self._last_masks = (of_rows.reshape(self.num_envs, -1) for of_rows in (masks, last_masks))
        self._rewards, self._ends, self._actions = array("rewards"), array("ends"), array("actions")
        self._never = np.zeros(self.num_envs, bool)
        #: What drives the rows, if it is an object of the user.
        self._driver = Driver(predictor, self._process, copies) if is_own(predictor) else None

    @property
    def _channel(self) -> Channel:
        return self._process

    def _take_functions(self, reward: Any, observation: Any) -> None:
        """Take the functions that were given, or those that the config names."""
        about = self._process.about
        reward = chosen("reward", reward, about["own"]["reward"])
        observation = chosen("observation", observation, about["own"]["observation"])
        if reward is not None or observation is not None:
            copies = about["rows"] // len(about["agent_numbers"])
            layout = Layout(about["roads"], np.repeat(about["agent_numbers"], copies).tolist())
            self._own = Own(layout, reward, observation)

    def _width(self) -> int:
        own: int = 0 if self._own is None else self._own.width
        width: int = self._process.about["obs_dim"]
        return own or width

    @property
    def own_cost(self) -> OwnCost:
        """Time that own functions took since the environment was made, beside that of all steps."""
        return OwnCost() if self._own is None else self._own.cost

    @alone
    def action_masks(self) -> np.ndarray:
        """Return which actions are allowed now, `[rows, actions]`, as sb3-contrib's MaskablePPO asks for them."""
        allowed: np.ndarray = self._masks != 0
        return allowed

    @alone
    def reset(
        self, *, seed: Union[int, List[Optional[int]], None] = None, options: Optional[Dict[str, Any]] = None
    ) -> Tuple[np.ndarray, Dict[str, Any]]:
        """Begin episodes in all rows: the first ones of a ``seed``, or others if there is none.

        All rows follow from one seed, so a list of seeds is refused.
        """
        refuse_unknown_options(options, [])
        if isinstance(seed, (list, tuple)):
            raise ValueError("seed: all rows follow from one seed; name one number")
        if seed is not None:
            self.seed, self._resets = fresh_seed(seed), 0
            super().reset(seed=self.seed)
        now = self.seed
        if self._resets > 0:
            now = int(np.random.SeedSequence((self.seed, self._resets)).generate_state(1, np.uint64)[0])
        self._whole = False
        payload = self._process.reset(now)
        if self._driver is not None:
            self._driver.reset(now)
        self._resets += 1
        of_own = None if self._own is None else self._own.begin(self._process.roads(payload)[1])
        obs, infos = self._obs.copy() if of_own is None else of_own, self._infos()
        self._whole = True
        return obs, infos

    @alone
    def step(
        self, actions: Any
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, Dict[str, Any]]:
        """Make a step in all rows; ``actions``: one for each."""
        # Not the public methods: each would take the lock again, which costs a microsecond.
        self._begin_step(actions)
        return self._end_step()

    @alone
    def step_async(self, actions: Any) -> None:
        """Begin a step and do not wait for it. :meth:`step_wait` ends it."""
        self._begin_step(actions)

    def _begin_step(self, actions: Any) -> None:
        if not self._whole:
            raise SimulatorError("the last call was not finished; call reset() first")
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs,):
            raise ValueError(f"actions: of shape {actions.shape} instead of ({self.num_envs},)")
        if actions.dtype.kind not in "iub":
            raise TypeError(f"actions: must be whole numbers, not {actions}")
        if not np.all((actions >= 0) & (actions < self._n_actions)):
            raise ValueError(f"actions: all must be from 0 to {self._n_actions - 1}, not {actions}")
        self._whole = False
        if self._driver is not None:
            self._driver.give()
        self._actions[:] = actions
        self._begun = time.perf_counter()
        self._process.send_step()

    @alone
    def step_wait(self) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, Dict[str, Any]]:
        """Wait for the end of the step that :meth:`step_async` began."""
        return self._end_step()

    def _end_step(self) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, Dict[str, Any]]:
        payload = self._process.receive_step()
        infos, ends = self._infos(), self._ends.copy()
        if self._driver is not None:
            self._driver.ended(ends)
        # Copies: the memory changes with the next step, and what was returned must not.
        rewards, obs, last_obs = self._rewards.astype(np.float64), None, None
        if self._own is not None:
            of_own, obs, last_obs = self._step_own(payload, ends)
            rewards = rewards if of_own is None else of_own
        if ends.any():
            infos["final_obs"] = self._last_obs.copy() if last_obs is None else last_obs
            infos["_final_obs"] = ends.copy()
            final_masks = np.where(ends[:, None], self._last_masks, 0).astype(np.int8)
            infos["final_info"] = {"action_mask": final_masks, "_action_mask": ends.copy()}
            infos["_final_info"] = ends.copy()
        shown = self._obs.copy() if obs is None else obs, rewards, self._never.copy(), ends, infos
        self._whole = True
        return shown

    def _step_own(
        self, payload: bytes, ends: np.ndarray
    ) -> Tuple[Optional[np.ndarray], Optional[np.ndarray], Optional[np.ndarray]]:
        """Return own rewards, own observations, and those of the episodes that are over."""
        own = self._own
        assert own is not None
        own.cost.steps_s += time.perf_counter() - self._begun
        now, begun = self._process.roads(payload)
        rewards, last_obs = own.step(now)
        if not begun:
            return rewards, last_obs, last_obs
        # Rewards of the next step are of the episodes that have begun.
        obs = own.begin(begun)
        if obs is None or last_obs is None:
            return rewards, None, None
        # Other rows go on, and their function may be one that draws.
        return rewards, np.where(ends[:, None], obs, last_obs), np.where(ends[:, None], last_obs, 0)

    def _infos(self) -> Dict[str, Any]:
        return {"action_mask": self._masks.copy(), "_action_mask": np.ones(self.num_envs, bool)}

    @alone
    def counters(self) -> Dict[str, int]:
        """Return totals since the last reset, such as predicted cars that found no room."""
        return self._process.measure()

    @property
    def pid(self) -> int:
        """Number of the process in which the simulators live."""
        return self._process.pid

    def close_extras(self, **kwargs: Any) -> None:
        """End the process. Called by :meth:`close`, also if the environment could not be made."""
        if hasattr(self, "_process"):
            self._process.close()
        if hasattr(self, "_never"):
            tables = ["_obs", "_last_obs", "_masks", "_last_masks", "_rewards", "_ends", "_actions"]
            no_memory(self, *tables)
            if self._driver is not None:
                self._driver.close()


def _predictor(predictor: Any) -> Union[str, Dict[str, str]]:
    if is_own(predictor):
        return "own"
    if isinstance(predictor, str) and predictor in ("marginals", "untrained"):
        return predictor
    return {"run": path_text("predictor", predictor)}


class LocalEnv(Remade, gymnasium.Env):
    """The local simulator of one agent. Make one with :func:`dials_traffic.local_env`.

    ``info["action_mask"]`` says which actions are allowed (int8, one per action).
    """

    metadata: Dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        config: PathLike,
        agent: str,
        predictor: Any = None,
        *,
        seed: Optional[int] = None,
        reward: Union[Reward, str, None] = None,
        observation: Union[Observation, str, None] = None,
        settings: Optional[Mapping[str, Any]] = None,
    ) -> None:
        if not isinstance(agent, str):
            raise TypeError(f"agent {agent!r}: must be the name of one agent; vector_env takes several")
        made_of = {
            "config": config,
            "predictor": predictor,
            "seed": fresh_seed(seed),
            "reward": reward,
            "observation": observation,
            "settings": settings,
        }
        self._made_of = {"agent": agent, **made_of}
        self._rows = LocalVectorEnv(agents=agent, copies=1, **made_of)
        # The mask of what was shown last.
        self._mask: np.ndarray = self._rows._masks[0] != 0
        self.observation_space = self._rows.single_observation_space
        self.action_space = self._rows.single_action_space
        #: Number of steps of an episode.
        self.horizon = self._rows.horizon
        # What the next episode shows first, if it has begun already.
        self._begun: Optional[Tuple[np.ndarray, Dict[str, Any]]] = None

    @property
    def _channel(self) -> Channel:
        return self._rows._process

    @alone
    def reset(
        self, *, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None
    ) -> Tuple[np.ndarray, Dict[str, Any]]:
        """Begin the first episode of a ``seed``, or the next one."""
        refuse_unknown_options(options, [])
        super().reset(seed=None if seed is None else fresh_seed(seed))
        if self._begun is None or seed is not None:
            self._begun = None
            obs, infos = self._rows.reset(seed=seed)
            self._begun = obs[0], _of_row(infos)
        begun, self._begun = self._begun, None
        self._mask = begun[1]["action_mask"] != 0
        return begun

    @alone
    def step(self, action: Any) -> Tuple[np.ndarray, float, bool, bool, Dict[str, Any]]:
        if self._begun is not None:
            raise SimulatorError("the episode is over; call reset() first")
        obs, rewards, _, ends, infos = self._rows.step(np.asarray([action]))
        info = _of_row(infos)
        if ends[0]:
            self._begun = obs[0], info
            last = _of_row(infos["final_info"])
            self._mask = last["action_mask"] != 0
            return infos["final_obs"][0], float(rewards[0]), False, True, last
        self._mask = info["action_mask"] != 0
        return obs[0], float(rewards[0]), False, False, info

    def action_masks(self) -> np.ndarray:
        """Return which actions are allowed now, `[actions]`, as sb3-contrib's MaskablePPO asks for them."""
        return self._mask

    @property
    def own_cost(self) -> OwnCost:
        """Time that own functions took since the environment was made, beside that of all steps."""
        return self._rows.own_cost

    def close(self) -> None:
        """End the environment and its process."""
        self._rows.close()


def _of_row(infos: Dict[str, Any]) -> Dict[str, Any]:
    return {"action_mask": infos["action_mask"][0]}
