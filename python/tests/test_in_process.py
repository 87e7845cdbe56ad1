"""Environments in the Python process itself. Each test has a process of its own, which may load our libsumo."""

import subprocess
import sys
import textwrap

import pytest

SETUP = """
import gc, os, sys, threading
import numpy as np
import dials_traffic

def played(env):
    observations, infos = env.reset(seed=3)
    shown = []
    while env.agents:
        actions = {agent: int(np.flatnonzero(info["action_mask"])[-1]) for agent, info in infos.items()}
        observations, rewards, _, _, infos = env.step(actions)
        shown.append((np.concatenate(list(observations.values())).tolist(), rewards))
    metrics = infos[env.possible_agents[0]]["system"]
    env.close()
    return shown, metrics

def refused(make):
    try:
        make()
    except (dials_traffic.SimulatorError, ValueError) as error:
        return str(error)
    raise AssertionError("it was not refused")
"""


def run(code, *words):
    script = SETUP + textwrap.dedent(code)
    done = subprocess.run([sys.executable, "-c", script, *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("kind", ["warehouse", "grid"])
def test_it_plays_the_same_episodes_as_a_process(kind, request):
    code = """
        here = dials_traffic.parallel_env(sys.argv[1], in_process=True)
        there = dials_traffic.parallel_env(sys.argv[1])
        assert here.pid != there.pid
        assert played(here) == played(there)
    """
    run(code, request.getfixturevalue(kind))


def test_there_is_one_at_a_time_and_it_stays_in_its_thread(grid):
    code = """
        make = lambda: dials_traffic.parallel_env(sys.argv[1], in_process=True, seed=1)
        env = make()
        assert "another environment lives in this process" in refused(make)
        told = []
        thread = threading.Thread(target=lambda: told.append(refused(env.reset)))
        thread.start()
        thread.join()
        assert "lives in another thread" in told[0]
        env.reset()
        env.close()
        assert "is closed" in refused(env.reset)
        again = make()
        again.reset()
        again.close()
    """
    run(code, grid)


def test_only_its_own_thread_closes_it(grid):
    code = """
        env = dials_traffic.parallel_env(sys.argv[1], in_process=True, seed=1)
        env.reset()
        told = []
        thread = threading.Thread(target=lambda: told.append(refused(env.close)))
        thread.start()
        thread.join()
        assert "lives in another thread" in told[0]
        env.step(dict.fromkeys(env.agents, 0))
        env.close()
        thread = threading.Thread(target=env.close)
        thread.start()
        thread.join()
        dials_traffic.parallel_env(sys.argv[1], in_process=True).close()
    """
    run(code, grid)


def test_one_that_was_forgotten_in_another_thread_leaves_room_for_the_next(grid):
    code = """
        make = lambda: dials_traffic.parallel_env(sys.argv[1], in_process=True, seed=1)
        held = [make()]
        sys.unraisablehook = lambda told: held.append(told)
        thread = threading.Thread(target=held.clear)
        thread.start()
        thread.join()
        make().close()
        assert held == []
    """
    run(code, grid)


def test_a_forgotten_one_leaves_no_descriptors(grid):
    code = """
        def forgotten():
            dials_traffic.parallel_env(sys.argv[1], in_process=True, seed=1)
            gc.collect()
            return len(os.listdir("/proc/self/fd"))

        assert forgotten() == forgotten() == forgotten()
    """
    run(code, grid)


def test_what_cannot_be_done_is_an_error_that_says_so(grid):
    code = """
        make = lambda **settings: dials_traffic.parallel_env(sys.argv[1], in_process=True, settings=settings)
        assert "traffic.horizon = 0" in refused(lambda: make(**{"traffic.horizon": 0}))
        # A failure leaves room for the next one.
        make().close()
        sys.modules["libsumo"] = sys
        assert "another libsumo" in refused(make)
    """
    run(code, grid)
