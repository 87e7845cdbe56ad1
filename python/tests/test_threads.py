"""Several threads use one environment, and close it."""

import gc
import os
import signal
import threading
import time

import numpy as np
import pytest

import dials_traffic

THREADS, CALLS = 4, 8


def joint(grid, grid_run):
    env = dials_traffic.parallel_env(grid, seed=1)
    env.reset()
    return env, lambda: pack(env.step(dict.fromkeys(env.possible_agents, 0))[0])


def one_by_one(grid, grid_run):
    env = dials_traffic.aec_env(grid, seed=1)
    env.reset()

    def call():
        env.step(0)
        return env.last()[0].tobytes()[:0]

    return env, call


def many(grid, grid_run):
    envs = dials_traffic.vector_parallel_env(grid, 2, seed=1)
    envs.reset()
    return envs, lambda: pack(envs.step({agent: [0, 0] for agent in envs.agents})[0])


def local(grid, grid_run):
    env = dials_traffic.local_env(grid_run, "r0c0", seed=1)
    env.reset()
    return env, lambda: env.step(0)[0].tobytes()


def copies(grid, grid_run):
    env = dials_traffic.vector_env(grid_run, "r0c0", 3, seed=1)
    env.reset()
    return env, lambda: env.step([0, 0, 0])[0].tobytes()


def controller(grid, grid_run):
    made = dials_traffic.load(grid_run).controller()
    made.begin(1)
    shown = {agent: np.full(40, 0.5) for agent in ("r0c0", "r0c1", "r1c0", "r1c1")}
    return made, lambda: bytes(made.act(shown, dict.fromkeys(shown, {})).values())


def pack(table):
    return b"".join(table[agent].tobytes() for agent in sorted(table))


KINDS = [joint, one_by_one, many, local, copies, controller]


def at_once(*works):
    """Do all works at once, each in a thread of its own. None may hang."""
    threads = [threading.Thread(target=work, daemon=True) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert not any(thread.is_alive() for thread in threads), "a thread hangs"


@pytest.mark.parametrize("make", KINDS)
def test_every_thread_gets_an_answer_of_its_own_and_none_is_lost(make, grid, grid_run):
    env, call = make(grid, grid_run)
    expected = [call() for _ in range(THREADS * CALLS)]
    env.close()
    env, call = make(grid, grid_run)
    got, errors = [], []

    def work():
        try:
            got.extend([call() for _ in range(CALLS)])
        except BaseException as error:
            errors.append(error)

    at_once(*[work] * THREADS)
    env.close()
    assert errors == []
    assert sorted(got) == sorted(expected)


@pytest.mark.parametrize("make", KINDS)
def test_a_close_during_another_threads_calls_is_an_error_there_that_says_so(make, grid, grid_run):
    for wait_s in (0, 0.003, 0.02):
        env, call = make(grid, grid_run)
        errors = []

        def work():
            try:
                while True:
                    try:
                        call()
                    except (dials_traffic.SimulatorError, ValueError) as error:
                        # The other thread has made the last step of the episode.
                        if "call reset" not in str(error) and "episode is over" not in str(error):
                            raise
                        env.reset()
            except BaseException as error:
                errors.append(error)

        def close():
            time.sleep(wait_s)
            env.close()
            env.close()

        at_once(work, work, close, close)
        assert [type(error) for error in errors] == [dials_traffic.SimulatorError] * 2, errors
        assert all("is closed" in str(error) for error in errors), errors


@pytest.mark.parametrize("make", KINDS)
def test_nothing_hangs_if_the_child_is_stopped_while_it_is_closed(make, grid, grid_run):
    env, call = make(grid, grid_run)
    pids = [one.pid for one in env.envs] if make is many else [env._channel.pid]
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    errors = []

    def work():
        try:
            while True:
                call()
        except BaseException as error:
            errors.append(error)

    def close():
        time.sleep(0.2)
        env.close()

    at_once(work, close)
    assert len(errors) == 1 and isinstance(errors[0], dials_traffic.SimulatorError) and "is closed" in str(errors[0])


@pytest.mark.parametrize("make", KINDS)
def test_a_closed_environment_refuses_every_call_with_one_reason(make, grid, grid_run):
    env, call = make(grid, grid_run)
    env.close()
    env.close()
    calls = [call, getattr(env, "reset", None) or (lambda: env.begin(1))]
    if make is joint:
        calls += [env.send_reset, env.receive_reset, env.receive_step, lambda: env.send_actions({})]
        calls += [lambda: env.checked({}), lambda: env.save_replay("/no/such/folder")]
    if make is one_by_one:
        calls += [env.last, lambda: env.observe("r0c0"), lambda: env.step(None)]
    if make is copies:
        calls += [lambda: env.step_async([0, 0, 0]), env.step_wait, env.counters]
    for refused in calls:
        with pytest.raises(dials_traffic.SimulatorError, match="is closed; make a new one"):
            refused()


def test_an_episode_that_has_begun_already_is_not_shown_after_a_close(warehouse_run):
    env = dials_traffic.local_env(warehouse_run, "r0c0", seed=1)
    env.reset()
    while not env.step(0)[3]:
        pass
    env.close()
    with pytest.raises(dials_traffic.SimulatorError, match="is closed"):
        env.reset()


def test_a_close_does_not_wait_for_a_function_of_the_user(grid):
    inside, over = threading.Event(), threading.Event()

    def slow(before, after):
        inside.set()
        over.wait(60)
        return np.zeros(after.rows)

    env = dials_traffic.parallel_env(grid, seed=1, reward=slow)
    env.reset()
    said = []

    def step():
        try:
            env.step(dict.fromkeys(env.agents, 0))
        except dials_traffic.SimulatorError as error:
            said.append(str(error))

    stepping = threading.Thread(target=step, daemon=True)
    stepping.start()
    assert inside.wait(20)
    at_once(env.close)
    over.set()
    stepping.join(20)
    assert not stepping.is_alive()


def test_a_signal_handler_may_close_what_waits_for_an_answer(grid):
    """Python calls handlers in the thread that waits. The lock is its own already."""
    env = dials_traffic.parallel_env(grid, seed=1)
    env.reset()
    earlier = signal.signal(signal.SIGALRM, lambda number, frame: env.close())
    os.kill(env.pid, signal.SIGSTOP)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with pytest.raises(dials_traffic.SimulatorError, match="is closed"):
            while True:
                env.step(dict.fromkeys(env.possible_agents, 0))
    finally:
        signal.signal(signal.SIGALRM, earlier)


def test_a_copy_of_python_does_not_wait_for_threads_that_it_does_not_have(grid):
    env = dials_traffic.parallel_env(grid, seed=1)
    env.reset()
    with env._channel.lock:
        copy = os.fork()
        if copy == 0:
            threading.Thread(target=lambda: (time.sleep(20), os._exit(3)), daemon=True).start()
            code = []

            def step():
                try:
                    env.step({})
                except dials_traffic.SimulatorError as error:
                    code.append(0 if "make it anew after a fork" in str(error) else 2)

            step_in_thread = threading.Thread(target=step)
            step_in_thread.start()
            step_in_thread.join()
            env.close()
            os._exit(code[0])
    assert os.waitstatus_to_exitcode(os.waitpid(copy, 0)[1]) == 0
    env.close()


@pytest.mark.parametrize("make", KINDS)
def test_a_close_gives_all_descriptors_back_at_once(make, grid, grid_run):
    gc.collect()
    before = os.listdir("/proc/self/fd")
    gc.disable()
    try:
        env, call = make(grid, grid_run)
        call()
        env.close()
        assert os.listdir("/proc/self/fd") == before
    finally:
        gc.enable()
    assert env is not None
