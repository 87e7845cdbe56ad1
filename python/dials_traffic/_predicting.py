"""An influence predictor of the user inside a run: where its questions arrive.

It stays in this process. The run's coordinator lets it learn, and every worker asks for the samples of its own rows. Workers
are at different steps, so each of their connections has a shallow copy: what `begin` assigns is the copy's own.
"""

from __future__ import annotations

import copy
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, TypeVar

import numpy as np

from ._link import Arrays
from ._state import from_bytes, to_bytes
from .own import OwnCost
from .predictor import Dataset, checked

#: What a predictor has inside a run.
METHODS = ("begin", "sample", "fit", "loss", "state")

_Result = TypeVar("_Result")


class PredictorSeat:
    """Where the predictor of a run sits."""

    def __init__(self, predictor: Any, cost: OwnCost) -> None:
        missing = [name for name in METHODS if not callable(getattr(predictor, name, None))]
        if missing or isinstance(predictor, type):
            what = "is a class; make an object of it" if isinstance(predictor, type) else f"has no method {missing[0]}"
            raise TypeError(f"predictor: {getattr(predictor, '__name__', type(predictor).__name__)} {what}")
        self.predictor, self.cost = predictor, cost
        self._fitted = False
        self._agents: List[Dict[str, Any]] = []
        # Whole datasets, and the number of their episodes to learn from.
        self._datasets: List[Dataset] = []
        self._training = 0

    def open(self, about: Dict[str, Any]) -> Any:
        if "rows_of" in about:
            watches = callable(getattr(self.predictor, "watch", None))
            return _Rows(self, about["rows_of"], about["classes"]).answer, {"watches": watches}
        self._agents = about["agents"]
        return self._answer

    def _answer(self, call: str, values: Any, arrays: Arrays) -> Tuple[None, Optional[Mapping[str, np.ndarray]]]:
        if call == "dataset":
            self._take(values["agent"], values["training"], arrays)
            return None, None
        begun = time.perf_counter()
        try:
            return None, self._work(call, arrays)
        finally:
            self.cost.fits_s += time.perf_counter() - begun

    def _work(self, call: str, arrays: Arrays) -> Optional[Mapping[str, np.ndarray]]:
        if call == "state":
            return {"state": to_bytes(self.predictor.state())}
        if call == "load":
            self.predictor.state(from_bytes(arrays["state"]))
            self._fitted = True
            return None
        datasets, self._datasets = self._datasets, []
        if call == "measure":
            return {"losses": self._losses(datasets)}
        seen = [_episodes(dataset, slice(self._training)) for dataset in datasets]
        unseen = [_episodes(dataset, slice(self._training, None)) for dataset in datasets]
        before = [self._losses(part) for part in (seen, unseen)]
        self.predictor.fit(seen)
        self._fitted = True
        after = [self._losses(part) for part in (seen, unseen)]
        return {"losses": np.array([before, after])}

    def _take(self, agent: int, training: int, arrays: Arrays) -> None:
        about = self._agents[agent]
        if agent == 0:
            self._datasets = []
        self._training = training
        self._datasets.append(
            Dataset(
                about["name"], arrays["d_set"], arrays["sources"], np.array(about["classes"]), about["own_sources"], agent
            )
        )

    def _losses(self, datasets: List[Dataset]) -> np.ndarray:
        """Return the loss of each source that an agent has, one agent after another."""
        return np.concatenate([np.zeros(0), *(self._loss(dataset) for dataset in datasets)])

    def _loss(self, dataset: Dataset) -> np.ndarray:
        own = dataset.own_sources
        if not self._fitted:
            # As before the first training of constants: all classes are equally probable.
            return np.log(dataset.classes[:own].astype(np.float64))
        if own == 0:
            return np.zeros(0)
        loss = np.asarray(self.predictor.loss(dataset))
        if loss.dtype.kind not in "fiu":
            raise TypeError(f"loss: returned {loss.dtype} instead of numbers, for agent {dataset.agent!r}")
        if loss.shape not in ((), (own,)):
            raise ValueError(
                f"loss: returned the shape {loss.shape} instead of ({own},), one number per source that agent "
                f"{dataset.agent!r} has, or one for all"
            )
        if not np.isfinite(loss).all():
            raise ValueError(f"loss: of agent {dataset.agent!r}: {loss}; must be finite numbers; has it diverged?")
        # No sign for a loss of nothing.
        return np.broadcast_to(loss, (own,)).astype(np.float64) + 0.0


class _Rows:
    """Rows of some agents of one kind, ordered by agent, then by copy."""

    def __init__(self, seat: PredictorSeat, agents: List[int], classes: List[int]) -> None:
        self._seat, self._numbers, self._classes = seat, np.array(agents), np.array(classes)
        self._predictor: Any = None
        self._agents = np.zeros(0, int)

    def answer(self, call: str, values: Any, arrays: Arrays) -> Tuple[None, Optional[Mapping[str, np.ndarray]]]:
        if call == "begin":
            # What was learnt by now drives the rows from now on.
            self._predictor = copy.copy(self._seat.predictor)
            self._agents = np.repeat(self._numbers, values)
            self._timed(lambda: self._predictor.begin(self._agents.copy(), np.arange(len(self._agents))))
            return None, None
        if call == "forget":
            self._timed(lambda: self._predictor.begin(self._agents.copy(), arrays["rows"]))
            return None, None
        if call == "watch":
            self._timed(lambda: self._predictor.watch(arrays["d_set"]))
            return None, None
        self._seat.cost.steps_s += values
        shape = arrays["uniform"].shape
        sources = self._timed(lambda: self._predictor.sample(arrays["d_set"], arrays["uniform"]))
        return None, {"sources": checked(sources, shape, self._classes)}

    def _timed(self, work: Callable[[], _Result]) -> _Result:
        begun = time.perf_counter()
        try:
            return work()
        finally:
            self._seat.cost.functions_s += time.perf_counter() - begun


def _episodes(dataset: Dataset, chosen: slice) -> Dataset:
    d_set, sources = dataset.d_set[chosen], dataset.sources[chosen]
    return Dataset(dataset.agent, d_set, sources, dataset.classes, dataset.own_sources, dataset.number)


def with_predictor(settings: Optional[Mapping[str, Any]]) -> Dict[str, Any]:
    """Return the settings of a run with a predictor of the user. Others than local simulators are an error."""
    changed = dict(settings or {})
    named = changed.pop("simulator", "local")
    if named not in ("local", "dials", "outside-dials"):
        raise ValueError(f"settings: simulator = {named!r}: a predictor drives local simulators; leave the key out")
    if changed.pop("predictor", "outside") != "outside":
        raise ValueError("settings: predictor: predictor= is the one; leave the key out")
    # A word for both keys.
    return {"simulator": "outside-dials", **changed}


def check_resumed(run: str) -> None:
    """Raise an error if the run in a directory goes on without a predictor of the user: it was begun without one."""
    try:
        config = (Path(run) / "config.toml").read_text(encoding="utf-8")
    except OSError:
        # The program says what is wrong.
        return
    if 'predictor = "outside"' not in config.splitlines():
        raise ValueError(f"predictor: the run in {run!r} was begun without one; leave it out")
