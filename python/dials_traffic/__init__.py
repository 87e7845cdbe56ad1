"""Traffic lights and warehouse robots as PettingZoo and Gymnasium environments.

- :func:`parallel_env`: all agents of a config on the global simulator (GS), for PettingZoo; :func:`aec_env`: the same,
  one agent after another.
- :func:`vector_parallel_env`: several of these, stepped together.
- :func:`vector_env`: copies of one agent's local simulator, for Gymnasium; :func:`local_env`: one copy.
- :func:`datasets`: what influence predictors learn from.
- :func:`train`: a training run of the program, with rewards and observations of your own.
- :func:`load`: the trained policies of a run directory, and their episodes.
- :func:`any_light`: one policy that plays any light, without training.
- :func:`dials`: a run of `dials-traffic train` with a learner that is written in Python.

``config`` is always a config of dials-traffic, any ``.sumocfg``, or a run directory. ``settings`` change keys of it,
such as ``{"traffic.horizon": 100}``. Every environment lives in a process of its own, unless ``in_process`` says
otherwise.
"""

from __future__ import annotations

from typing import Any, Mapping, Optional, Union

from ._channel import PathLike
from .aec import GlobalAecEnv
from .errors import ProcessDied, SimulatorError
from .learner import Experience, Rows, Team, Training, dials
from .light import LightPolicy, any_light
from .many import GlobalVectorEnv
from .own import Observation, OwnCost, Reward, register_observation, register_reward
from .parallel import GlobalEnv
from .policy import Policy
from .predictor import Dataset, datasets
from .roads import Lanes, Neighbours, Roads, Vehicles
from .runs import Controller, Episode, Run
from .training import train
from .vector import Agents, LocalEnv, LocalVectorEnv

__all__ = [
    "Controller",
    "Dataset",
    "Episode",
    "Experience",
    "GlobalAecEnv",
    "GlobalEnv",
    "GlobalVectorEnv",
    "Lanes",
    "LightPolicy",
    "LocalEnv",
    "LocalVectorEnv",
    "Neighbours",
    "OwnCost",
    "Policy",
    "ProcessDied",
    "Roads",
    "Rows",
    "Run",
    "SimulatorError",
    "Team",
    "Training",
    "Vehicles",
    "aec_env",
    "any_light",
    "datasets",
    "dials",
    "load",
    "local_env",
    "parallel_env",
    "register_observation",
    "register_reward",
    "train",
    "vector_env",
    "vector_parallel_env",
]


def parallel_env(
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
) -> GlobalEnv:
    """Make a PettingZoo environment of all agents on the global simulator.

    ``seed``: of the episodes, from the system if there is none. ``controller_for``: the hand-coded controller that
    decides for some agents, such as ``{"A0": "gap-out"}``; these agents are not seen. ``full_metrics``: measure all
    that `dials-traffic evaluate` prints, which costs time. ``observation`` and ``reward``: functions that replace ours, or
    their registered names. They get :class:`Roads` with a row for each light, the reward those before the step and those
    after it, and return a line or a number per row. ``record``: :meth:`GlobalEnv.save_replay` can write episodes for
    sumo-gui. ``in_process``: no child process. That saves microseconds per step, but Python has room for one such
    environment, and dies with it.
    """
    return GlobalEnv(
        config,
        seed=seed,
        controller_for=controller_for,
        full_metrics=full_metrics,
        observation=observation,
        reward=reward,
        settings=settings,
        render_mode=render_mode,
        record=record,
        in_process=in_process,
    )


def aec_env(config: PathLike, **options: Any) -> GlobalAecEnv:
    """Make the environment of :func:`parallel_env` in which agents act one after another, with PettingZoo's wrapper."""
    return GlobalAecEnv(parallel_env(config, **options))


def vector_parallel_env(config: PathLike, n: int, *, seed: Optional[int] = None, **options: Any) -> GlobalVectorEnv:
    """Make ``n`` environments of :func:`parallel_env` that are stepped together, each in a process of its own."""
    return GlobalVectorEnv(config, n, seed=seed, **options)


def vector_env(
    config: PathLike,
    agent: Agents,
    copies: int,
    predictor: Any = None,
    *,
    seed: Optional[int] = None,
    stagger: bool = False,
    reward: Union[Reward, str, None] = None,
    observation: Union[Observation, str, None] = None,
    settings: Optional[Mapping[str, Any]] = None,
) -> LocalVectorEnv:
    """Make a Gymnasium vector environment of ``copies`` local simulators of an agent.

    ``agent``: its name, a list of names, or ``None`` for all agents, which must then be of one kind. ``predictor``:
    what drives the simulators. It is a run directory, whose influence predictors are used; ``"marginals"``: constants
    that are measured on the global simulator now; or ``"untrained"``. Without one, ``config`` must be a run directory.
    It may also be an object of your own with two methods. ``begin(agents, rows)``: episodes begin in these rows; ``agents``
    has the number of the agent of every row. ``sample(d_set, uniform)``: returns a class for each source, ``[rows, sources]``;
    ``uniform`` has a number from 0 to 1 for each. :func:`datasets` has what it learns from.
    ``stagger``: the first episodes of the copies have different lengths, so that they do not all end at once.
    ``reward`` and ``observation``: functions that replace ours, as for :func:`parallel_env`; they see all rows at once.
    """
    return LocalVectorEnv(
        config,
        agent,
        copies,
        predictor,
        seed=seed,
        stagger=stagger,
        reward=reward,
        observation=observation,
        settings=settings,
    )


def local_env(
    config: PathLike,
    agent: str,
    predictor: Any = None,
    *,
    seed: Optional[int] = None,
    reward: Union[Reward, str, None] = None,
    observation: Union[Observation, str, None] = None,
    settings: Optional[Mapping[str, Any]] = None,
) -> LocalEnv:
    """Make a Gymnasium environment of one local simulator of an agent, with parameters as for :func:`vector_env`."""
    return LocalEnv(
        config, agent, predictor, seed=seed, reward=reward, observation=observation, settings=settings
    )


def load(path: PathLike) -> Run:
    """Read the trained policies of a run directory."""
    return Run(path)
