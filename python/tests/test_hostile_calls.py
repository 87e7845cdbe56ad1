"""Random wrong values at every public function and method: an answer or an exception that is documented, nothing else.

`DIALS_HOSTILE_SECONDS` says for how long, and `DIALS_HOSTILE_SEED` with which values. A failure prints the seed and the
calls before it.
"""

import os
import subprocess
import sys

import pytest

SECONDS = float(os.environ.get("DIALS_HOSTILE_SECONDS", "6"))
SEED = int(os.environ.get("DIALS_HOSTILE_SEED", "1"))
#: Time in which a call must be over, in seconds. Opening an environment is the longest.
CALL_S = 60


@pytest.mark.parametrize("in_process", [False, True])
def test_hostile_calls_are_answered_or_refused_and_nothing_crashes_or_hangs(
    in_process, warehouse, grid, warehouse_run, grid_run, tmp_path
):
    words = [sys.executable, "-X", "faulthandler", __file__, str(int(in_process)), str(SEED), str(SECONDS)]
    runs = [str(path) for path in (warehouse, grid, warehouse_run, grid_run)]
    done = subprocess.run(
        [*words, *runs], cwd=tmp_path, capture_output=True, text=True, timeout=SECONDS + 4 * CALL_S, errors="replace"
    )
    assert done.returncode == 0, f"seed {SEED}: {done.returncode}\n{done.stdout[-10000:]}\n{done.stderr[-6000:]}"
    # Every call was made, and both outcomes were seen.
    outcomes = done.stdout.splitlines()[-1]
    assert "answered" in outcomes and "refused" in outcomes and ": 0" not in outcomes, outcomes


# From here on: the child.


def main(in_process, seed, seconds, *configs):
    import faulthandler
    import inspect
    import itertools
    import random
    import time
    import warnings
    from pathlib import Path

    import numpy as np

    import dials_traffic

    warnings.simplefilter("ignore")
    dice = random.Random(seed)
    # What the page of the package lists. All else, such as an AttributeError from inside, is a failure.
    # ImportError: torch may be missing.
    documented = (ValueError, TypeError, KeyError, IndexError, RuntimeError, OSError, ImportError)

    class Liar:
        """Claims to be a number, a path and a sequence, and is none."""

        def __index__(self):
            raise ValueError("a liar")

        def __fspath__(self):
            return 3

        def __len__(self):
            return -1

        def __iter__(self):
            raise RuntimeError("a liar")

    def values():
        numbers = [0, 1, -1, 2, 255, 256, 2**31, 2**63, 2**64 - 1, 2**64, 2**200, -(2**63), 10**6, 0.5, 1e300]
        tables = [np.zeros(shape) for shape in ((), (0,), (1,), (2,), (37,), (40,), (1, 40), (3, 40), (2, 2, 2))]
        tables += [np.full(40, np.nan), np.full(37, np.inf), np.full(40, 1e30), np.array(["a"] * 40), np.zeros(40, "O")]
        tables += [np.zeros(40, complex), np.array([np.datetime64("NaT")]), np.zeros(4, "V3"), np.ma.masked_all(40)]
        texts = ["", "r0c0", "nobody", "\0", "\udcff", "ß" * 5000, "/", ".", "/dev/null", "/proc/self/mem", "marginals"]
        others = [None, True, float("nan"), float("inf"), -float("inf"), b"", b"r0c0", b"\xff", object(), Liar(), len]
        others += [Path("x"), Path("/no/such"), 1j, {1, 2}, range(3), slice(1), Ellipsis, type, iter([1, 2])]
        others += [np.float64("nan"), np.int8(-1), np.uint64(2**64 - 1), np.bool_(True), np.str_("r0c0")]
        return numbers + tables + texts + others

    def hostile(depth=0):
        kind = dice.random()
        if depth < 2 and kind < 0.12:
            return [hostile(depth + 1) for _ in range(dice.randrange(4))]
        if depth < 2 and kind < 0.28:
            keys = ["r0c0", "r0c1", "r1c0", "r1c1", "action_mask", "episode", "traffic.horizon", "seed", "nobody", 3, None]
            return {dice.choice(keys): hostile(depth + 1) for _ in range(dice.randrange(5))}
        return dice.choice(values())

    agents = ["r0c0", "r0c1", "r1c0", "r1c1"]

    def horizon():
        """An episode of a million steps is right, and takes longer than a call may here."""
        drawn = hostile(1)
        return 1000 if isinstance(drawn, (int, float)) and 1000 < drawn < 1e18 else drawn

    def mostly_right(name):
        """Return what an argument of this name may be: hostile values far inside see more than those at the door."""
        right = {
            "config": lambda: dice.choice(configs),
            "path": lambda: dice.choice(configs),
            "agent": lambda: dice.choice(agents),
            "copies": lambda: dice.choice([1, 2, 3]),
            "n": lambda: dice.choice([1, 2]),
            "episodes": lambda: dice.choice([1, 2]),
            "seed": lambda: dice.randrange(2**64),
            "episode": lambda: dice.randrange(5),
            "actions": lambda: {agent: dice.choice([0, 1, hostile(1)]) for agent in agents},
            "action": lambda: dice.choice([0, 1]),
            "observations": lambda: {agent: dice.choice([np.zeros(40), np.zeros(37), hostile(1)]) for agent in agents},
            "infos": lambda: {agent: {"action_mask": dice.choice([np.ones(2), np.ones(5), hostile(1)])} for agent in agents},
            "obs": lambda: dice.choice([np.zeros(40), np.zeros(37)]),
            "folder": lambda: f"kept-{dice.randrange(10**9)}",
            "options": lambda: {"episode": hostile(2)},
            "greedy": lambda: dice.choice([True, False]),
            "predictor": lambda: dice.choice([None, "untrained", configs[-1]]),
            "replay": lambda: None,
            "settings": lambda: {"traffic.horizon": horizon()},
            "render_mode": lambda: dice.choice([None, "rgb_array"]),
            "controller_for": lambda: {"r0c0": "gap-out"},
        }.get(name)
        return right() if right is not None and dice.random() < 0.7 else hostile()

    outcomes = {"answered": 0, "refused": 0}

    def call(name, function):
        """Call with random arguments, and return the answer, or None if it was refused."""
        arguments, options = [], {}
        try:
            parameters = list(inspect.signature(function).parameters.values())
        except (TypeError, ValueError):
            parameters = []
        for parameter in parameters:
            if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                continue
            if parameter.default is not parameter.empty and dice.random() < 0.5:
                continue
            value = mostly_right(parameter.name)
            whole = isinstance(value, (int, np.integer))
            if parameter.name in ("n", "copies", "episodes") and whole and 3 < value < 10**12:
                value = 10**12  # those between would be made, and take the machine's memory or more time than a call has
            if parameter.kind == parameter.KEYWORD_ONLY:
                options[parameter.name] = value
            elif parameter.default is parameter.empty:
                arguments.append(value)
            else:
                options[parameter.name] = value
        if name in ("parallel_env", "aec_env", "GlobalEnv") and in_process and dice.random() < 0.8:
            options["in_process"] = True
        # Before the call: if it hangs, faulthandler ends this process.
        print(f"{name}(*{arguments!r:.500}, **{options!r:.500})".encode("ascii", "backslashreplace").decode(), flush=True)
        faulthandler.dump_traceback_later(CALL_S, exit=True)
        try:
            answer = function(*arguments, **options)
            outcomes["answered"] += 1
            return answer
        except dials_traffic.ProcessDied:
            # A panic or a crash of the child.
            raise
        except documented:
            outcomes["refused"] += 1
            return None
        finally:
            faulthandler.cancel_dump_traceback_later()

    def methods(thing):
        """Return the public methods of our own classes, those that end it last."""
        ours = [name for name in dir(type(thing)) if not name.startswith("_")]
        ours = [name for name in ours if inspect.isroutine(getattr(type(thing), name))]
        own = {name for kind in type(thing).__mro__ if kind.__module__.startswith("dials_traffic") for name in vars(kind)}
        return [name for name in ours if name in own]

    def use(name, thing, calls):
        if not type(thing).__module__.startswith("dials_traffic") or isinstance(thing, Exception):
            return
        names = methods(thing)
        if callable(thing):
            names.append("__call__")
        if dice.random() < 0.8:
            for begin, arguments in (("reset", {}), ("begin", {"seed": 1})):
                if hasattr(thing, begin):
                    try:
                        getattr(thing, begin)(**arguments)
                    except documented:
                        pass
        for _ in range(calls if names else 0):
            chosen = dice.choice(names)
            # A closed one refuses all: seldom.
            if chosen in ("close", "close_extras") and dice.random() < 0.9:
                continue
            answer = call(f"{name}.{chosen}", getattr(thing, chosen))
            if type(answer).__module__ in ("dials_traffic.runs", "dials_traffic.policy") and answer is not thing:
                use(f"{name}.{chosen}()", answer, 10)
        if hasattr(thing, "close"):
            thing.close()
            thing.close()

    def right_ones():
        """Make one of everything, so that methods are always reached."""
        yield "parallel_env", lambda: dials_traffic.parallel_env(dice.choice(configs), seed=1, in_process=in_process)
        short = {"record": True, "render_mode": "rgb_array", "settings": {"traffic.horizon": 2}}
        yield "parallel_env", lambda: dials_traffic.parallel_env(configs[1], seed=1, **short)
        yield "aec_env", lambda: dials_traffic.aec_env(configs[0], seed=1)
        yield "vector_parallel_env", lambda: dials_traffic.vector_parallel_env(configs[0], 2, seed=1)
        yield "vector_env", lambda: dials_traffic.vector_env(dice.choice(configs[2:]), "r0c0", 2, seed=1)
        yield "local_env", lambda: dials_traffic.local_env(dice.choice(configs[2:]), "r0c0", seed=1)
        yield "load", lambda: dials_traffic.load(dice.choice(configs[2:]))
        yield "controller", lambda: dials_traffic.load(dice.choice(configs[2:])).controller()
        yield "policy", lambda: dials_traffic.load(dice.choice(configs[2:])).policy("r0c0", seed=1)

    public = [name for name in dials_traffic.__all__ if callable(getattr(dials_traffic, name))]
    over = time.monotonic() + seconds
    # At least one round, however slow the machine is.
    for turn in itertools.count():
        for name, make in right_ones():
            if turn > 0 and time.monotonic() > over:
                break
            use(name, make(), 25)
            for _ in range(2):
                chosen = dice.choice(public)
                use(chosen, call(chosen, getattr(dials_traffic, chosen)), 10)
        if time.monotonic() > over:
            break
    print(outcomes)


if __name__ == "__main__":
    main(sys.argv[1] == "1", int(sys.argv[2]), float(sys.argv[3]), *sys.argv[4:])
