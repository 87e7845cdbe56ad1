"""Influence predictors of one's own: what they learn from, and how they drive local simulators.

An influence source is a choice of a few classes, such as whether a car enters on a lane. Class 0 means that nothing happens.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Mapping, Optional, Sequence

import numpy as np

from ._channel import PathLike, path_text, request_of, whole_number
from ._process import Process


@dataclass(frozen=True)
class Dataset:
    """What the global simulator showed of the influence on one agent's region, whole episodes."""

    #: Name of the agent.
    agent: str
    #: What a predictor sees at each decision, ``[episodes, steps, d_set_dim]``, float32.
    d_set: np.ndarray
    #: What then came, ``[episodes, steps, sources]``, uint8. Sources that the agent does not have are always 0.
    sources: np.ndarray
    #: Number of classes of each source.
    classes: np.ndarray
    #: Number of sources that the agent has: the first ones.
    own_sources: int
    #: Number of the agent: that of ``agents`` in ``begin``.
    number: int


def datasets(
    config: PathLike,
    episodes: int,
    *,
    run: Optional[PathLike] = None,
    settings: Optional[Mapping[str, Any]] = None,
) -> List[Dataset]:
    """Play episodes on the global simulator, and return what influence predictors learn from: one dataset per agent.

    ``run``: the run directory whose policies act; without one, policies that were not trained. The episodes follow from
    ``seed`` of the config, and are those that a run begins with.
    """
    request = {
        "episodes": whole_number("episodes", episodes, 1),
        "run": None if run is None else path_text("run", run),
    }
    process = Process(f"the datasets of {config}", request_of(config, settings, {"datasets": request}))
    try:
        about = process.about
        d_sets, sources = process.array("d_sets").copy(), process.array("sources").copy()
    finally:
        process.close()
    steps = about["horizon"]
    made: List[Dataset] = []
    first_d_set = first_source = 0
    for agent in about["agents"]:
        width, count = agent["d_set_dim"], len(agent["classes"])
        next_d_set, next_source = first_d_set + episodes * steps * width, first_source + episodes * steps * count
        made.append(
            Dataset(
                agent["name"],
                d_sets[first_d_set:next_d_set].reshape(episodes, steps, width),
                sources[first_source:next_source].reshape(episodes, steps, count),
                np.array(agent["classes"]),
                agent["own_sources"],
                len(made),
            )
        )
        first_d_set, first_source = next_d_set, next_source
    return made


def is_own(predictor: Any) -> bool:
    """Return whether a predictor is an object of the user, and neither a name nor a path."""
    return callable(getattr(predictor, "begin", None)) and callable(getattr(predictor, "sample", None))


class Driver:
    """Lets a predictor of the user drive the rows of local simulators."""

    def __init__(self, predictor: Any, process: Process, copies: int) -> None:
        about = process.about
        self._predictor = predictor
        self._agents = np.repeat(np.array(about["agent_numbers"]), copies)
        self._classes = np.array(about["classes"])
        rows = len(self._agents)
        self._d_set = process.array("d_set").reshape(rows, -1)
        self._sources = process.array("sources").reshape(rows, -1)
        self._dice = np.random.default_rng()

    def reset(self, seed: int) -> None:
        """Episodes begin in all rows."""
        self._dice = np.random.default_rng([seed, 0x1A1])
        self._predictor.begin(self._agents.copy(), np.arange(len(self._agents)))

    def give(self) -> None:
        """Put the sources of the next step into the memory."""
        uniform = self._dice.random(self._sources.shape, dtype=np.float32)
        self._sources[:] = checked(self._predictor.sample(self._d_set.copy(), uniform), self._sources.shape, self._classes)

    def ended(self, ends: np.ndarray) -> None:
        """Episodes have ended in some rows, and the next ones begin."""
        if ends.any():
            self._predictor.begin(self._agents.copy(), np.flatnonzero(ends))

    def close(self) -> None:
        """Let go of the memory."""
        self._d_set, self._sources = self._d_set.copy(), self._sources.copy()


def checked(sources: Any, shape: Sequence[int], classes: np.ndarray) -> np.ndarray:
    """Return what ``sample`` has returned, or raise an error that says what is wrong with it."""
    sources = np.asarray(sources)
    if sources.shape != tuple(shape):
        raise ValueError(f"sample: returned the shape {sources.shape} instead of {tuple(shape)}, [rows, sources]")
    if sources.dtype.kind not in "iub":
        raise TypeError(f"sample: returned {sources.dtype} instead of whole numbers, the class of each source")
    wrong = (sources < 0) | (sources >= classes)
    if wrong.any():
        row, source = np.argwhere(wrong)[0]
        raise ValueError(
            f"sample: returned class {sources[row, source]} for source {source} of row {row}, which has {classes[source]} classes"
        )
    right: np.ndarray = sources.astype(np.uint8)
    return right
