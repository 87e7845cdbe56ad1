"""Runs of `dials-traffic train`, with rewards and observations that are functions of this process."""

from __future__ import annotations

import inspect
import re
import sys
import textwrap
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Union

import numpy as np

from ._channel import PathLike, path_text, request_of, whole_number, yes_or_no
from ._link import Link
from ._predicting import PredictorSeat, check_resumed, with_predictor
from .own import Named, Observation, Own, OwnCost, Reward, chosen, registered
from .roads import Layout
from .runs import Run

Functions = Dict[str, Tuple[str, Callable[..., Any]]]

#: Time in which a run may be silent, in seconds: a debugger may hold an object of the user for hours.
PATIENCE_S = 10_000_000


def train(
    config: Optional[PathLike] = None,
    *,
    out: PathLike,
    reward: Union[Reward, str, None] = None,
    observation: Union[Observation, str, None] = None,
    predictor: Any = None,
    settings: Optional[Mapping[str, Any]] = None,
    seed: Optional[int] = None,
    workers: Optional[int] = None,
    resume: bool = False,
    force: bool = False,
    quiet: bool = False,
) -> Run:
    """Train the policies of a config with `dials-traffic train` into the run directory ``out``, and return the run.

    ``reward`` and ``observation``: functions that replace those of the config, as for :func:`parallel_env`, in all
    simulators of the run. They stay in this process and are called here, in the thread that waits.

    ``predictor``: an object that drives the local simulators instead of our influence predictors. Beside ``begin`` and
    ``sample``, as for :func:`vector_env`, it has ``fit(datasets)``, which is called whenever ours would be trained, with a
    :class:`Dataset` of the training episodes per agent; ``loss(dataset)``, which returns a number per source of that agent, or
    one; and ``state(saved=None)``, which returns a dict of arrays for the checkpoint, or goes on from ``saved``. If it has
    ``watch(d_set)``, that is called instead of ``sample`` where sources are known already: for predictors with a memory.
    Worker processes are at different steps, so each gets a shallow copy of it; what ``begin`` assigns is the copy's own.

    ``workers``: number of processes; it does not change the results. ``resume``: go on with the run in ``out``; functions must
    then be the same. ``force``: move a run directory that exists aside. ``quiet``: print nothing. Without functions it is the plain
    command. ``run.own_cost`` says what the functions took.
    """
    functions = _functions(reward, observation)
    cost = OwnCost()
    makers: Dict[str, Any] = {"functions": lambda about: opened(about, functions, cost, {"predictor": predictor})}
    if predictor is not None:
        makers["predictor"] = PredictorSeat(predictor, cost).open
        if resume:
            check_resumed(path_text("out", out))
        else:
            settings = with_predictor(settings)
    words = _words(config, out, functions, settings, seed, workers, yes_or_no("resume", resume), force)
    if predictor is not None:
        words += ["--patience", str(PATIENCE_S)]
    with Link(makers) as link:
        link.run(words, quiet=yes_or_no("quiet", quiet))
    run = Run(out)
    run.own_cost = cost
    run._functions = {kind: function for kind, (_, function) in functions.items()}
    if cost.functions_s > 0 and not quiet:
        print(f"{cost} (all processes together)", file=sys.stderr)
    return run


def _functions(reward: Named, observation: Named) -> Functions:
    """Return name and function of each kind that is given."""
    found: Functions = {}
    for kind, given in (("reward", reward), ("observation", observation)):
        function = chosen(kind, given, None)
        if function is not None:
            name = given.removeprefix("python:") if isinstance(given, str) else getattr(given, "__name__", "")
            found[kind] = re.sub(r"[^\w.-]", "", name) or kind, function
    return found


def _words(
    config: Optional[PathLike],
    out: PathLike,
    functions: Functions,
    settings: Optional[Mapping[str, Any]],
    seed: Optional[int],
    workers: Optional[int],
    resume: bool,
    force: bool,
) -> List[str]:
    """Return the words of the command."""
    folder = path_text("out", out)
    number = [] if workers is None else ["--workers", str(whole_number("workers", workers))]
    if resume:
        if settings or seed is not None or force:
            raise ValueError("resume: a run goes on with the settings and the seed that it has; leave them out")
        return ["train", "--resume", folder, *number]
    if config is None:
        raise ValueError("config: there is none; name one, or resume a run with resume=True")
    changed = {**(settings or {}), **{f"traffic.{kind}": f"python:{name}" for kind, (name, _) in functions.items()}}
    request = request_of(config, changed, {})
    words = ["train", request["config"], "--out", folder, *number]
    words += [] if seed is None else ["--seed", str(whole_number("seed", seed))]
    words += ["--force"] if yes_or_no("force", force) else []
    return words + [word for setting in request["settings"] for word in ("--set", setting)]


def opened(about: Dict[str, Any], functions: Functions, cost: OwnCost, objects: Mapping[str, Any]) -> Any:
    """Return what answers a simulator, and what it needs to know. ``objects``: a learner and a predictor, by kind."""
    found = {}
    for kind in ("reward", "observation"):
        name = about.get(kind)
        given = functions.get(kind)
        found[kind] = given[1] if name and given and given[0] == name else registered(kind, name) if name else None
    if "rows" not in about:
        taking_part = [(kind, about[kind], function) for kind, function in found.items() if function is not None]
        for kind in about.get("objects", []):
            given = objects.get(kind)
            if given is None:
                raise ValueError(f"the config has a {kind} in Python, and none was given: {kind}=...")
            maker = given if hasattr(given, "__qualname__") else type(given)
            taking_part.append((kind, maker.__qualname__, maker))
        return _refuse, [{"kind": kind, "name": name, "source": source(of)} for kind, name, of in taking_part]
    own = Own(Layout(about["tables"], about["rows"]), found["reward"], found["observation"], cost)

    def answer(call: str, values: Any, arrays: Dict[str, np.ndarray]) -> Tuple[None, Dict[str, np.ndarray]]:
        if call == "begin":
            obs = own.begin(arrays["roads"])
            return None, {} if obs is None else {"obs": obs}
        cost.steps_s += values
        rewards, obs = own.step(arrays["roads"])
        made = {} if obs is None else {"obs": obs}
        if rewards is not None:
            made["rewards"] = rewards.astype(np.float32)
        return None, made

    return answer, {"width": own.width}


def _refuse(call: str, values: Any, arrays: Any) -> Any:
    raise ValueError(f"{call}: nothing is asked here")


def source(function: Any) -> str:
    """Return the text of a function, for `run.json`. Empty: it has none, as one that was typed at a prompt."""
    try:
        return textwrap.dedent(inspect.getsource(function))
    except (OSError, TypeError):
        return ""
