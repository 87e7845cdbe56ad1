"""Trained policies of a run directory: their weights, their decisions and whole episodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional

import numpy as np

from . import _checks
from ._channel import (
    Channel,
    PathLike,
    alone,
    check_dict,
    first_names,
    no_memory,
    path_text,
    request_of,
    whole_number,
    yes_or_no,
)
from ._process import Process
from .errors import SimulatorError
from .light import LightPolicy
from .own import OwnCost
from .parallel import GlobalEnv, refuse_existing
from .policy import Policy, Weights, in_torch

if TYPE_CHECKING:
    from .torch_policy import TorchPolicy


class Run:
    """The policies of a run directory. Make one with :func:`dials_traffic.load`.

    The file of the policies is read once, here: a run that is still being trained replaces it at any moment. So weights
    and controllers of one ``Run`` are of the same step.
    """

    def __init__(self, path: PathLike) -> None:
        path_text("path", path)
        # The working directory may change later.
        self.path = Path(path).absolute()
        process = _policies(self.path, "read")
        try:
            about, parameters = process.about, process.array("parameters").copy()
        finally:
            process.close()
        # All weights refer to it, and controllers copy it.
        parameters.flags.writeable = False
        self._parameters = parameters
        #: What own functions took, if :func:`dials_traffic.train` has trained it in this process.
        self.own_cost = OwnCost()
        # Functions with which it was trained in this process, by kind.
        self._functions: Dict[str, Any] = {}
        #: Names of the agents, in order.
        self.agents: List[str] = [agent["name"] for agent in about["agents"]]
        #: Timesteps per agent of these policies, if somebody is still training the run.
        self.still_trained_at: Optional[int] = about["still_trained_at"]
        self._weights: Dict[str, Weights] = {}
        # Names of the columns of an agent's observation, and of its actions.
        self._names = {agent["name"]: (agent["columns"], agent["actions"]) for agent in about["agents"]}
        # How the sets lie that an agent sees, and its number of actions, if it sees lanes and greens as sets.
        self._sets = {agent["name"]: agent["sets"] and (agent["sets"], agent["n_actions"]) for agent in about["agents"]}
        begin = 0
        for agent in about["agents"]:
            weights = self._weights[agent["name"]] = {}
            for name, shape in agent["tensors"]:
                end = begin + int(np.prod(shape))
                weights[name] = parameters[begin:end].reshape(shape)
                begin = end

    def weights(self, agent: str) -> Weights:
        """Return the weights of an agent's policy: arrays ``[in, out]`` and biases ``[1, out]``, float32.

        The last layer has one output per action, and then the value. The arrays are read-only; change copies of them.
        """
        if agent not in self._names:
            raise _no_agent(agent, self.agents)
        return dict(self._weights[agent])

    def state_dict(self, agent: str) -> Weights:
        """Return the weights as modules of torch have them: the state dict of :meth:`torch_policy`, in numpy."""
        return in_torch(self.weights(agent))

    def torch_policy(self, agent: str) -> "TorchPolicy":
        """Return the policy of one agent as a module of torch, which must be installed."""
        if agent in self._sets and self._sets[agent] is not None:
            raise SimulatorError(f"agent {agent!r}: sees lanes and greens as sets; policy() has its network in numpy, not in torch")
        from .torch_policy import TorchPolicy

        return TorchPolicy(self.state_dict(agent))

    def policy(self, agent: str, *, greedy: bool = False, seed: Optional[int] = None) -> Policy:
        """Return the policy of one agent, which computes in numpy."""
        weights = self.weights(agent)
        columns, actions = self._names[agent]
        sets = self._sets[agent]
        if sets is not None:
            return LightPolicy(weights, sets[0], n_actions=sets[1], greedy=greedy, seed=seed, agent=agent)
        return Policy(weights, greedy=greedy, seed=seed, agent=agent, columns=columns, actions=actions)

    def controller(self, *, greedy: bool = False) -> "Controller":
        """Return the policies of all agents, which act as `dials-traffic evaluate` lets them act, to the bit."""
        return Controller(self.path, self._parameters, greedy=greedy)

    def play(
        self,
        *,
        seed: int = 0,
        episode: int = 0,
        greedy: bool = False,
        replay: Optional[PathLike] = None,
        settings: Optional[Mapping[str, Any]] = None,
    ) -> "Episode":
        """Play an episode of `dials-traffic evaluate` with the same ``seed`` on the global simulator.

        ``replay``: a new folder, in which sumo-gui then shows the episode.
        """
        if replay is not None:
            refuse_existing(replay)
        env = GlobalEnv(
            self.path,
            seed=seed,
            full_metrics=True,
            settings=settings,
            record=replay is not None,
            **self._functions,
        )
        controller = self.controller(greedy=greedy)
        try:
            observations, infos = env.reset(options={"episode": episode})
            controller.begin(env.seed, env.episode)
            returns = dict.fromkeys(env.agents, 0.0)
            while env.agents:
                observations, rewards, _, _, infos = env.step(controller.act(observations, infos))
                returns = {agent: total + rewards[agent] for agent, total in returns.items()}
            saved = None if replay is None else env.save_replay(replay)
        finally:
            controller.close()
            env.close()
        metrics = {agent: info["metrics"] for agent, info in infos.items()}
        return Episode(returns, metrics, next(iter(infos.values()))["system"], saved)


@dataclass(frozen=True)
class Episode:
    """An episode that was played. Its figures are those of `dials-traffic evaluate`."""

    #: Sum of rewards, by agent.
    returns: Dict[str, float]
    #: Other figures of the agents, by agent and name.
    metrics: Dict[str, Dict[str, float]]
    #: Figures of the whole system, by name.
    system: Dict[str, float]
    #: The file that `sumo-gui -c` opens, if a replay was asked for.
    replay: Optional[Path]


class Controller:
    """The policies of all agents, in a process of their own. Make one with :meth:`Run.controller`."""

    def __init__(self, path: Path, parameters: np.ndarray, *, greedy: bool = False) -> None:
        """``parameters``: the weights of all agents, as :class:`Run` read them."""
        self._process = _policies(path, {"act": {"greedy": yes_or_no("greedy", greedy)}})
        try:
            self._give(path, parameters)
        except BaseException:
            self._process.close()
            raise
        self._obs, self._masks = self._process.array("obs"), self._process.array("masks").view(np.int8)
        self._actions = self._process.array("actions")
        self._agents: Dict[str, Dict[str, Any]] = {}
        self._places: Dict[str, "tuple[int, slice, slice]"] = {}
        obs = masks = 0
        for row, agent in enumerate(self._process.about["agents"]):
            self._agents[agent["name"]] = agent
            next_obs = obs + agent["obs_dim"]
            next_masks = masks + (agent["n_actions"] if agent["masks"] else 0)
            self._places[agent["name"]] = row, slice(obs, next_obs), slice(masks, next_masks)
            obs, masks = next_obs, next_masks
        self._obs[:], self._masks[:] = 0, 1
        # Whether the last call came to its end. If not, what the policies remember may be of a step more.
        self._whole = True

    def _give(self, path: Path, parameters: np.ndarray) -> None:
        """Let the process take these weights."""
        shared = self._process.array("parameters")
        if not isinstance(parameters, np.ndarray) or parameters.dtype != np.float32:
            raise TypeError("parameters: must be those of a Run; call its controller()")
        if shared.shape != parameters.shape:
            raise SimulatorError(f"{path}: is another run than the one that was loaded; load it again")
        shared[:] = parameters
        self._process.take()

    @property
    def _channel(self) -> Channel:
        return self._process

    @alone
    def begin(self, seed: int, episode: int = 0) -> None:
        """Begin an episode: that of ``env.seed`` and ``env.episode`` of a :func:`parallel_env`."""
        seed, episode = whole_number("seed", seed), whole_number("episode", episode)
        self._whole = False
        self._process.reset(seed, episode)
        self._whole = True

    @alone
    def act(self, observations: Mapping[str, np.ndarray], infos: Mapping[str, Mapping[str, Any]]) -> Dict[str, int]:
        """Decide for all agents that are shown, from what ``reset`` or ``step`` of a :func:`parallel_env` returned.

        What is refused, such as NaN or a mask that allows nothing, changes nothing: the next right call works.
        """
        if not self._whole:
            raise SimulatorError("the last call was not finished; call begin() first")
        check_dict("observations", observations)
        check_dict("infos", infos)
        shown = []
        for agent, obs in observations.items():
            if agent not in self._places:
                raise _no_agent(agent, list(self._places))
            if agent not in infos:
                raise SimulatorError(f"infos: there is none for {agent!r}")
            _, place, mask_place = self._places[agent]
            about, info = self._agents[agent], infos[agent]
            check_dict(f"infos: of agent {agent!r}:", info)
            shown.append((self._obs, place, _checks.observation(agent, obs, about["obs_dim"], about["columns"])))
            mask = self._mask(agent, info)
            if mask is not None and about["masks"]:
                shown.append((self._masks, mask_place, mask))
        self._whole = False
        for memory, place, values in shown:
            memory[place] = values
        self._process.step()
        actions = self._actions.tolist()
        chosen = {agent: actions[self._places[agent][0]] for agent in observations}
        self._whole = True
        return chosen

    def _mask(self, agent: str, info: Mapping[str, Any]) -> Optional[np.ndarray]:
        """Return the mask of an agent. An agent that never had one may do without."""
        about = self._agents[agent]
        if "action_mask" not in info:
            if about["masks"]:
                raise SimulatorError(f"infos: of agent {agent!r}: there is no 'action_mask'")
            return None
        mask = _checks.action_mask(agent, info["action_mask"], about["n_actions"], about["actions"])
        if not about["masks"] and not mask.all():
            raise ValueError(f"action masks: of agent {agent!r}: its policy knows no masks; all actions must be allowed")
        return mask

    def close(self) -> None:
        """End the process."""
        self._process.close()
        no_memory(self, "_obs", "_masks", "_actions")


def _policies(path: Path, what: Any) -> Process:
    """Start the process of a run's policies. ``what``: what it does."""
    return Process(f"the policies of {path}", request_of(path, None, {"policies": what}))


def _no_agent(agent: str, agents: List[str]) -> SimulatorError:
    """Return the error for the name of an agent that does not exist."""
    return SimulatorError(f"agent {agent!r}: there is none; the agents are {first_names(agents)}")
