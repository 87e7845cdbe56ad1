"""All agents of a config on the global simulator (GS), as a PettingZoo environment."""

from __future__ import annotations

import operator
import time
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple, Union

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv

from ._channel import (
    Channel,
    PathLike,
    Remade,
    alone,
    check_dict,
    first_names,
    fresh_seed,
    no_memory,
    path_text,
    refuse_unknown_options,
    request_of,
    whole_number,
    yes_or_no,
)
from ._in_process import InProcess
from ._process import Process
from .errors import SimulatorError
from .own import Observation, Own, OwnCost, Reward, chosen
from .roads import Layout, Neighbours

Observations = Dict[str, np.ndarray]
Infos = Dict[str, Dict[str, Any]]
RENDER_MODES = ["rgb_array"]
Steps = Tuple[Observations, Dict[str, float], Dict[str, bool], Dict[str, bool], Infos]


class GlobalEnv(Remade, ParallelEnv):  # type: ignore[misc]
    """All agents on the global simulator. Make one with :func:`dials_traffic.parallel_env`.

    An episode has ``horizon`` steps and ends for all agents at once, as a truncation. ``infos[agent]["action_mask"]``
    says which actions are allowed (int8, one per action). At the end, ``infos[agent]["metrics"]`` has the agent's
    figures and ``infos[agent]["system"]`` those of the whole system.
    """

    def __init__(
        self,
        config: PathLike,
        *,
        seed: Optional[int] = None,
        controller_for: Optional[Mapping[str, str]] = None,
        full_metrics: bool = False,
        observation: Union[Observation, str, None] = None,
        reward: Union[Reward, str, None] = None,
        settings: Optional[Mapping[str, Any]] = None,
        render_mode: Optional[str] = None,
        record: bool = False,
        in_process: bool = False,
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ValueError(f"render_mode {render_mode!r}: this environment has {RENDER_MODES}")
        first_seed = fresh_seed(seed)
        _check_names("controller_for", controller_for)
        self._made_of = {
            "config": config,
            "seed": first_seed,
            "controller_for": controller_for,
            "full_metrics": full_metrics,
            "observation": observation,
            "reward": reward,
            "settings": settings,
            "render_mode": render_mode,
            "record": record,
            "in_process": in_process,
        }
        self._own: Optional[Own] = None
        # When the step under way began.
        self._begun = 0.0
        joint = {
            "controller_for": dict(controller_for or {}),
            "full_metrics": yes_or_no("full_metrics", full_metrics),
            "draws": render_mode is not None,
            "watches_roads": observation is not None or reward is not None,
            "records": yes_or_no("record", record),
        }
        request = request_of(config, settings, {"joint": joint})
        make = InProcess if yes_or_no("in_process", in_process) else Process
        self._channel: Channel = make(f"the environment of {config}", request)
        about = self._channel.about
        self.metadata = {
            "name": f"dials_traffic_{Path(config).stem}",
            "render_modes": RENDER_MODES,
            "is_parallelizable": True,
        }
        self.render_mode = render_mode
        #: Number of steps of an episode.
        self.horizon: int = about["horizon"]
        #: Seed of the episodes, and the number of the episode under way. `dials-traffic evaluate RUN --seed SEED` plays
        #: the same episodes.
        self.seed, self.episode = first_seed, -1
        try:
            self._take_functions(reward, observation)
        except BaseException:
            self._channel.close()
            raise
        self._lay_out(about["agents"])

    def _take_functions(self, reward: Any, observation: Any) -> None:
        """Take the functions that were given, or those that the config names."""
        own = self._channel.about["own"]
        reward = chosen("reward", reward, own["reward"])
        observation = chosen("observation", observation, own["observation"])
        if reward is not None or observation is not None:
            tables = self._channel.look()
            layout = Layout(tables, range(len(tables["agents"])))
            self._own = Own(layout, reward, observation)

    def _lay_out(self, agents: List[Dict[str, Any]]) -> None:
        """Work out the place of every agent in the shared memory."""
        seen = [(row, agent) for row, agent in enumerate(agents) if not agent["hand_coded"]]
        self.possible_agents = [agent["name"] for _, agent in seen]
        self.agents: List[str] = []
        self._n_actions = [agent["n_actions"] for _, agent in seen]
        self._rows = np.array([row for row, _ in seen])
        self._observation_spaces: Dict[str, gymnasium.Space[Any]] = {}
        self._action_spaces: Dict[str, Discrete] = {}
        # Places of each agent that decides in the observations and in the masks, and the mask if it is constant.
        self._obs_places: List[Tuple[str, slice]] = []
        self._mask_places: List[Tuple[str, slice, Optional[np.ndarray]]] = []
        obs = masks = 0
        for agent in agents:
            name, width, n_actions = agent["name"], agent["obs_dim"], agent["n_actions"]
            mask_width = n_actions if agent["masks"] else 0
            if not agent["hand_coded"]:
                own_width = self._own.width if self._own is not None else 0
                self._observation_spaces[name] = Box(-np.inf, np.inf, (own_width or width,), np.float32)
                self._action_spaces[name] = Discrete(n_actions)
                self._obs_places.append((name, slice(obs, obs + width)))
                always = None if agent["masks"] else _all_allowed(n_actions)
                self._mask_places.append((name, slice(masks, masks + mask_width), always))
            obs, masks = obs + width, masks + mask_width
        array = self._channel.array
        self._obs, self._masks = array("obs"), array("masks").view(np.int8)
        self._rewards, self._actions = array("rewards"), array("actions")
        self._actions[:] = 0
        self._steps = 0
        #: Space of :meth:`state`: all observations, one after another.
        self.state_space = Box(-np.inf, np.inf, (sum(self._widths()),), np.float32)
        # What the agents saw last.
        self._seen: Optional[Observations] = None
        # Whether the last reset or step came to its end. If not, what this process knows of the episode may be old.
        self._whole = True

    def observation_space(self, agent: str) -> "gymnasium.Space[Any]":
        """Return the space of an agent's observations."""
        return self._observation_spaces[agent]

    def _widths(self) -> List[int]:
        return [space.shape[0] for space in self._observation_spaces.values() if space.shape is not None]

    def state(self) -> np.ndarray:
        """Return what a central critic sees: the observations of all agents, one after another in the order of
        ``possible_agents``. It is that of the last reset or step.
        """
        if self._seen is None:
            raise SimulatorError("there is no episode under way; call reset() first")
        return np.concatenate([self._seen[agent] for agent in self.possible_agents])

    @alone
    def neighbours(self) -> Neighbours:
        """Return which light feeds which, and how far they are apart. Only traffic has lights."""
        tables = self._channel.look()
        ways = tables["adjacency"]
        numbers = {key: np.array([way[key] for way in ways], int) for key in ("from", "to")}
        lengths = {key: np.array([way[key] for way in ways], float) for key in ("metres", "seconds")}
        names = [agent["name"] for agent in tables["agents"]]
        return Neighbours(names, numbers["from"], numbers["to"], lengths["metres"], lengths["seconds"])

    @property
    def own_cost(self) -> OwnCost:
        """Time that own functions took since the environment was made, beside that of all steps."""
        return OwnCost() if self._own is None else self._own.cost

    def action_space(self, agent: str) -> "gymnasium.Space[Any]":
        return self._action_spaces[agent]

    @alone
    def reset(
        self, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None
    ) -> Tuple[Observations, Infos]:
        """Begin an episode.

        With a ``seed``, the first episode of that seed; without one, the next episode. ``options={"episode": 3}`` names
        the episode.
        """
        self.send_reset(seed, options)
        return self.receive_reset()

    @alone
    def send_reset(self, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None) -> None:
        """Begin an episode and do not wait for it. :meth:`receive_reset` ends it."""
        # PettingZoo's tests pass an option that is called "options".
        refuse_unknown_options(options, ["episode", "options"])
        begun = self.seed if seed is None else fresh_seed(seed)
        following = self.episode + 1 if seed is None else 0
        episode = whole_number("episode", (options or {}).get("episode", following))
        self.seed, self.episode = begun, episode
        self._whole, self.agents = False, []
        self._channel.send_reset(self.seed, self.episode)

    @alone
    def receive_reset(self) -> Tuple[Observations, Infos]:
        """Wait for the episode that :meth:`send_reset` began."""
        payload = self._channel.receive_reset()
        self._steps = 0
        own = self._own
        observations, infos = self._perceive(None if own is None else own.begin(self._channel.roads(payload)[0]))
        self.agents = list(self.possible_agents)
        self._whole = True
        return observations, infos

    @alone
    def step(self, actions: Mapping[str, int]) -> Steps:
        """Make a step; ``actions``: one for each agent."""
        # Not the public methods: each would take the lock again, which costs a microsecond.
        self._send_checked(self._checked(actions))
        return self._receive_step()

    @alone
    def send_actions(self, actions: Mapping[str, int]) -> None:
        """Begin a step and do not wait for it. :meth:`receive_step` ends it."""
        self._send_checked(self._checked(actions))

    @alone
    def checked(self, actions: Mapping[str, int]) -> bytes:
        """Return actions as :meth:`send_checked` takes them, or raise an error. Nothing changes."""
        return self._checked(actions)

    def _checked(self, actions: Mapping[str, int]) -> bytes:
        if not self._whole:
            raise SimulatorError("the last call was not finished; call reset() first")
        if not self.agents:
            raise SimulatorError("there is no episode under way; call reset() first")
        check_dict("actions", actions)
        chosen = [actions[name] for name in self.possible_agents if name in actions]
        if not len(chosen) == len(actions) == len(self.possible_agents):
            self._refuse_names(actions)
        try:
            code = bytes(chosen)
        except (TypeError, ValueError):
            code = b""
        if not code or any(map(operator.ge, code, self._n_actions)):
            self._refuse(chosen)
        return code

    @alone
    def send_checked(self, code: bytes) -> None:
        """Begin a step with actions that were :meth:`checked`."""
        self._send_checked(code)

    def _send_checked(self, code: bytes) -> None:
        self._whole = False
        self._actions[self._rows] = np.frombuffer(code, np.uint8)
        self._begun = time.perf_counter()
        self._channel.send_step()

    def _refuse_names(self, actions: Mapping[str, int]) -> None:
        """Raise the error that names the agents without an action, or those that do not exist."""
        missing = [name for name in self.possible_agents if name not in actions]
        unknown = [name for name in actions if name not in self.possible_agents]
        told = f"there is none for {first_names(missing)}" if missing else f"there is no agent {first_names(unknown)}"
        raise SimulatorError(f"actions: {told}")

    def _refuse(self, chosen: List[Any]) -> None:
        """Raise the error that names the agent whose action is none of its own."""
        for name, action in zip(self.possible_agents, chosen):
            self.check_action(name, action)

    def check_action(self, agent: str, action: Any) -> None:
        """Raise an error if an agent has no such action."""
        n_actions = self._action_spaces[agent].n
        try:
            number = operator.index(action)
        except TypeError:
            raise TypeError(f"agent {agent!r}: action {action!r}; must be a whole number") from None
        if not 0 <= number < n_actions:
            raise ValueError(f"agent {agent!r}: action {action}; its actions are 0 to {n_actions - 1}")

    @alone
    def receive_step(self) -> Steps:
        """Wait for the end of the step that :meth:`send_actions` began."""
        return self._receive_step()

    def _receive_step(self) -> Steps:
        payload = self._channel.receive_step()
        self._steps += 1
        over = self._steps == self.horizon
        paid, obs, own = self._rewards, None, self._own
        if own is not None:
            own.cost.steps_s += time.perf_counter() - self._begun
            of_own, obs = own.step(self._channel.roads(payload)[0])
            paid = paid if of_own is None else of_own
        rewards = dict(zip(self.possible_agents, paid[self._rows].tolist()))
        observations, infos = self._perceive(obs)
        terminations = dict.fromkeys(self.possible_agents, False)
        truncations = dict.fromkeys(self.possible_agents, over)
        if over:
            self._add_metrics(infos)
            self.agents = []
        self._whole = True
        return observations, rewards, terminations, truncations, infos

    def _perceive(self, own: Optional[np.ndarray]) -> Tuple[Observations, Infos]:
        """Return what all agents see. ``own``: own observations, one row for each."""
        # One copy for all agents: the memory changes with the next step, and what was returned must not.
        masks = self._masks.copy()
        if own is None:
            obs = self._obs.copy()
            observations = {name: obs[place] for name, place in self._obs_places}
        else:
            observations = {name: own[row] for name, row in zip(self.possible_agents, self._rows)}
        self._seen = observations
        infos: Infos = {
            name: {"action_mask": masks[place] if always is None else always}
            for name, place, always in self._mask_places
        }
        return observations, infos

    def _add_metrics(self, infos: Infos) -> None:
        figures = self._channel.measure()
        system = {name: _number(value) for name, value in figures["system"].items()}
        for name, row in zip(self.possible_agents, self._rows):
            own = {figure: _number(values[row]) for figure, values in figures["per_agent"].items()}
            infos[name].update(metrics=own, system=dict(system))

    def render(self) -> Optional[np.ndarray]:
        """Return a picture of the state, ``[height, width, 3]``, if ``render_mode`` is ``"rgb_array"``."""
        return None if self.render_mode is None else self._drawn()

    @alone
    def _drawn(self) -> np.ndarray:
        return self._channel.draw()

    @alone
    def save_replay(self, folder: PathLike) -> Path:
        """Write the episode, which must be over, into a new folder, and return the file that sumo-gui opens.

        The environment must have been made with ``record=True``. Plain SUMO plays the folder, car by car, without any
        decision in it.
        """
        if self.agents or self._steps == 0 or not self._whole:
            raise SimulatorError("save_replay: play an episode to its end first")
        refuse_existing(folder)
        return self._channel.keep(Path(folder).absolute())

    @property
    def pid(self) -> int:
        """Number of the process in which the environment lives."""
        return self._channel.pid

    def close(self) -> None:
        """End the environment and its process."""
        self._channel.close()
        self.agents = []
        if hasattr(self, "_whole"):
            no_memory(self, "_obs", "_masks", "_rewards", "_actions")


def refuse_existing(folder: PathLike) -> None:
    """Raise an error if the folder of a replay exists."""
    path_text("folder", folder)
    if Path(folder).exists():
        raise FileExistsError(f"{folder}: exists already; name a new folder for the replay")


def _check_names(name: str, table: Any) -> None:
    """Raise an error if this is neither a dict of texts nor nothing."""
    if table is None:
        return
    if not isinstance(table, Mapping) or not all(isinstance(text, str) for pair in table.items() for text in pair):
        raise TypeError(f"{name} {table!r}: must be a dict of names")


def _all_allowed(n_actions: int) -> np.ndarray:
    """Return the mask of an agent that may do everything. All steps show the same one, so nobody may change it."""
    mask = np.ones(n_actions, np.int8)
    mask.flags.writeable = False
    return mask


def _number(value: Optional[float]) -> float:
    """Return a figure. JSON has no NaN, so one that is not defined comes as nothing."""
    return float("nan") if value is None else value
