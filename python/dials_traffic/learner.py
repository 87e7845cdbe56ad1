"""DIALS with an algorithm of one's own: the program's simulators, influence predictors, evaluations and checkpoints around
a learner that is written in Python.

The learner stays in this process, and the run asks it over a :mod:`~dials_traffic._link`.
"""

from __future__ import annotations

import contextlib
import csv
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

import numpy as np

from ._channel import PathLike, path_text, request_of, yes_or_no
from ._link import Arrays, Link
from ._predicting import PredictorSeat, check_resumed, with_predictor
from ._state import from_bytes, to_bytes
from .own import OwnCost
from .training import PATIENCE_S, opened, source


@dataclass(frozen=True)
class Team:
    """What a learner learns for: it gets this when it is made."""

    #: Names of the agents. An agent's number is its place here.
    agents: List[str]
    #: The kind of each agent. Agents of one kind have observations and actions of the same meaning.
    kinds: np.ndarray
    #: Width of the observations. Those of a kind that needs less have zeros at the end.
    obs_dim: int
    #: Number of actions. Masks forbid those that an agent does not have.
    n_actions: int
    #: Number of simulators per agent.
    copies: int
    #: Whether the policies learn on the global simulator. Then all agents of a copy act together.
    on_gs: bool
    #: Number of steps of an episode on the global simulator, and of one that policies learn from.
    horizon: int
    training_horizon: int
    #: Timesteps per agent between two calls of ``learn``, and of the whole run.
    update_every_steps: int
    total_steps: int
    seed: int


@dataclass(frozen=True)
class Rows:
    """Rows that wait for an action, ordered by agent, then by copy."""

    #: Number of the agent, and of its copy, ``[rows]``.
    agents: np.ndarray
    copies: np.ndarray
    #: ``[rows, obs_dim]``, float32.
    obs: np.ndarray
    #: Actions that are allowed, ``[rows, n_actions]``, bool.
    masks: np.ndarray
    #: A number from 0 to 1 for each row, ``[rows]``. Actions that are drawn with these are the same after a kill and a resume.
    uniform: np.ndarray
    #: Timesteps per agent so far, in training. ``None``: an episode for an evaluation or for datasets.
    steps: Optional[int]


@dataclass(frozen=True)
class Experience:
    """What some decisions brought, ``[decisions, rows, ...]``, rows ordered by agent, then by copy."""

    #: ``[rows]``
    agents: np.ndarray
    copies: np.ndarray
    obs: np.ndarray
    masks: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    #: Whether the episode ended with the decision. Nothing terminates: the time is up.
    ends: np.ndarray
    #: What the decision led to. At an end it is the last observation, and the next row of ``obs`` the first of a new episode.
    next_obs: np.ndarray
    next_masks: np.ndarray
    #: Timesteps per agent so far, with these.
    steps: int
    #: Random numbers for minibatches, the same after a kill and a resume.
    rng: np.random.Generator


@dataclass(frozen=True)
class Training:
    """A run that has ended. ``dials-traffic report`` shows it, and :meth:`table` reads its files."""

    #: The run directory.
    path: Path
    #: The learner as it was at the end.
    learner: Any
    #: What the predictor of the user took, if there was one. Its ``steps_s`` is the time between two samples.
    own_cost: OwnCost

    def table(self, name: str) -> Dict[str, np.ndarray]:
        """Return the columns of a CSV file of the run, such as ``"returns"``: numbers where all are numbers, else text."""
        with open(self.path / f"{name}.csv", newline="") as file:
            head, *lines = list(csv.reader(file))
        columns = {column: [line[place] for line in lines] for place, column in enumerate(head)}
        return {column: _numbers(texts) for column, texts in columns.items()}


#: Makes a learner: a class, or a function.
Learner = Callable[[Team], Any]


def dials(
    config: PathLike,
    *,
    learner: Learner,
    out: PathLike,
    predictor: Any = None,
    settings: Optional[Mapping[str, Any]] = None,
    resume: bool = False,
    force: bool = False,
    quiet: bool = False,
) -> Training:
    """Train with a learner that is written in Python, and return when the run has ended.

    The run is one of `dials-traffic train`: simulators, influence predictors, evaluations, checkpoints and files are the
    program's. Only what decides and learns is the learner's. ``simulator`` of the config says on what it learns: local
    simulators or the global one.

    ``learner``: a class or a function that gets a :class:`Team` and returns an object with three methods:

    - ``act(rows, explore)``: returns an action for each of :class:`Rows`. ``explore`` is true in training. In evaluations and
      where datasets are collected it is false, and nothing may be changed.
    - ``learn(experience)``: learns from an :class:`Experience`. Returns numbers by name for `training.csv`, each one for all
      agents or an array with one per row; or ``None`` if it has not learnt anything yet.
    - ``state(saved=None)``: returns a dict of arrays from which it can go on, for a checkpoint. With ``saved``, it goes on
      from that.

    The class may have ``metrics``, the names of the numbers that ``learn`` returns, and ``update_every_steps``, the timesteps
    per agent between two calls of ``learn``, which is 128 otherwise.

    One learner has all agents, so there is one worker process. Agents of one kind are asked together. If there are several
    kinds in local simulators, one kind learns after the other, each for a whole period.

    ``predictor``: an object that drives the local simulators instead of our AIPs, as for :func:`train`.

    ``out``: the run directory, which must not exist; `learner.json` in it has the source of the learner. With ``force`` an
    old one is moved aside. With ``resume`` the run in it goes on; then ``config`` and ``settings`` are those of the run. An
    error in the learner ends the run and is raised here. Ctrl-C stops the run where nothing is lost.
    """
    place = path_text("out", out)
    yes_or_no("force", force)
    if yes_or_no("resume", resume):
        if predictor is not None:
            check_resumed(place)
        words = ["train", "--resume", place]
    else:
        chosen = settings or {} if predictor is None else with_predictor(settings)
        sets: Dict[str, Any] = {"policy.hidden": [1], **chosen, "algorithm": "outside"}
        every = getattr(learner, "update_every_steps", None)
        if every is not None:
            sets.setdefault("outside.update_every_steps", every)
        request = request_of(config, sets, {})
        if not force and Path(place).exists():
            raise FileExistsError(f"out {place!r}: exists already; resume=True goes on with it, force=True moves it aside")
        words = ["train", request["config"], "--out", place]
        words += [word for text in request["settings"] for word in ("--set", text)]
        if force:
            words.append("--force")
    words += ["--patience", str(PATIENCE_S)]
    seat, cost = _Seat(learner, Path(place).absolute()), OwnCost()
    objects = {"learner": learner}
    makers = {"learner": seat.open, "functions": lambda about: opened(about, {}, cost, objects)}
    if predictor is not None:
        makers["predictor"] = PredictorSeat(predictor, cost).open
        objects["predictor"] = predictor
    with Link(makers) as link:
        link.run(words, quiet=quiet)
    if cost.functions_s > 0 and not quiet:
        print(f"{cost} (all processes together)", file=sys.stderr)
    return Training(Path(place).absolute(), seat.learner, cost)


class _Seat:
    """Where the learner of a run sits. A worker that was lost comes back and gets a new learner, with the saved state."""

    def __init__(self, make: Learner, run: Path) -> None:
        self._make, self._run = make, run
        self.learner: Any = None

    def open(self, about: Dict[str, Any]) -> Tuple[Any, Dict[str, Any]]:
        agents, on_gs = about["agents"], about["on_gs"]
        self._own_actions = np.array([agent["n_actions"] for agent in agents])
        self._metrics: List[str] = []
        self.team = Team(
            agents=[agent["name"] for agent in agents],
            kinds=np.array(about["kinds"]),
            obs_dim=max(agent["obs_dim"] for agent in agents),
            n_actions=int(self._own_actions.max()),
            copies=about["copies"],
            on_gs=on_gs,
            horizon=about["horizon"],
            training_horizon=about["horizon" if on_gs else "local_horizon"],
            update_every_steps=about["update_every_steps"],
            total_steps=about["total_steps"],
            seed=about["seed"],
        )
        self._note_source()
        self.learner = self._make(self.team)
        for method in ("act", "learn", "state"):
            if not callable(getattr(self.learner, method, None)):
                raise TypeError(f"learner: {type(self.learner).__name__} has no method {method}")
        self._metrics = list(getattr(self.learner, "metrics", ()))
        return self._answer, {"metrics": self._metrics}

    def _note_source(self) -> None:
        """Write into the run directory what the learner is called, and its source. It is for people: nothing reads it."""
        about = {"learner": getattr(self._make, "__qualname__", repr(self._make)), "source": source(self._make)}
        with contextlib.suppress(OSError):
            (self._run / "learner.json").write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")

    def _answer(self, call: str, values: Any, arrays: Arrays) -> Tuple[Any, Optional[Mapping[str, np.ndarray]]]:
        if call == "act":
            return None, {"actions": self._act(values["steps"], arrays)}
        if call == "learn":
            return self._learn(values["steps"], arrays)
        if call == "state":
            return None, {"state": to_bytes(self.learner.state())}
        self.learner.state(from_bytes(arrays["state"]))
        return None, None

    def _act(self, steps: Optional[int], arrays: Arrays) -> np.ndarray:
        rows = Rows(
            arrays["agents"],
            arrays["copies"],
            self._wide(arrays["obs"], self.team.obs_dim),
            self._wide(arrays["masks"], self.team.n_actions),
            arrays["uniform"],
            steps,
        )
        actions = np.asarray(self.learner.act(rows, steps is not None))
        if actions.shape != rows.agents.shape:
            raise ValueError(f"act: returned the shape {actions.shape} instead of {rows.agents.shape}, one per row")
        if actions.dtype.kind not in "iu":
            raise TypeError(f"act: returned {actions.dtype} instead of whole numbers")
        wrong = (actions < 0) | (actions >= self._own_actions[rows.agents])
        wrong |= ~np.take_along_axis(rows.masks, np.where(wrong, 0, actions)[:, None].astype(np.int64), 1)[:, 0]
        if wrong.any():
            row = int(wrong.argmax())
            agent = self.team.agents[rows.agents[row]]
            allowed = np.flatnonzero(rows.masks[row]).tolist()
            raise ValueError(f"act: action {actions[row]} of agent {agent!r} (row {row}): allowed now are {allowed}")
        return actions.astype(np.uint8)

    def _learn(self, steps: int, arrays: Arrays) -> Tuple[bool, Optional[Mapping[str, np.ndarray]]]:
        agents = arrays["agents"]
        experience = Experience(
            agents,
            arrays["copies"],
            self._wide(arrays["obs"], self.team.obs_dim),
            self._wide(arrays["masks"], self.team.n_actions),
            arrays["actions"].astype(np.int64),
            arrays["rewards"],
            arrays["ends"],
            self._wide(arrays["next_obs"], self.team.obs_dim),
            self._wide(arrays["next_masks"], self.team.n_actions),
            steps,
            np.random.default_rng([self.team.seed, steps, int(agents[0])]),
        )
        said = self.learner.learn(experience)
        if said is None:
            return False, None
        if set(said) != set(self._metrics):
            raise ValueError(f"learn: returned {sorted(said)}, but its attribute `metrics` names {sorted(self._metrics)}")
        values = np.empty((len(self._metrics), len(agents)))
        for place, name in enumerate(self._metrics):
            values[place] = np.asarray(said[name], dtype=np.float64)
            if not np.isfinite(values[place]).all():
                raise ValueError(f"learn: {name!r} is {said[name]}: it must be a finite number; has it diverged?")
        return True, {"metrics": values}

    @staticmethod
    def _wide(table: np.ndarray, width: int) -> np.ndarray:
        """Return a table with zeros at the end of its rows, if it is narrower."""
        missing = width - table.shape[-1]
        return np.pad(table, [(0, 0)] * (table.ndim - 1) + [(0, missing)]) if missing else table


def _numbers(texts: List[str]) -> np.ndarray:
    try:
        return np.array([float(text) if text else np.nan for text in texts])
    except ValueError:
        return np.array(texts)


__all__ = ["Experience", "Rows", "Team", "Training", "dials"]
