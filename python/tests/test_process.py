"""Each environment is a process of its own: how it starts, ends and dies."""

import gc
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import pytest

import dials_traffic


def is_alive(pid):
    """Return whether a process is there and not only waited for."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def ends(pid, within_s=20.0):
    """Wait until a process has ended, and return whether it did."""
    begun = time.monotonic()
    while is_alive(pid) and time.monotonic() - begun < within_s:
        time.sleep(0.05)
    return not is_alive(pid)


def test_ten_environments_of_sumo_live_in_one_python_process(grid):
    envs = [dials_traffic.parallel_env(grid, seed=seed) for seed in range(10)]
    assert len({env.pid for env in envs}) == 10 and os.getpid() not in {env.pid for env in envs}
    for env in envs:
        env.reset()
    for _ in range(3):
        for env in envs:
            env.step(dict.fromkeys(env.agents, 0))
    pids = [env.pid for env in envs]
    for env in envs:
        env.close()
    assert not any(is_alive(pid) for pid in pids)


def test_the_users_process_never_loads_the_native_module(grid):
    """libsumo brings hundreds of libraries, and another libsumo may be there. Another test here loads pip's."""
    code = """
        import sys, dials_traffic
        env = dials_traffic.parallel_env(sys.argv[1], seed=1)
        env.reset()
        maps = open("/proc/self/maps").read()
        env.close()
        assert "sumo" not in maps and "_native" not in maps, maps
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code), str(grid)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "number, told",
    [(signal.SIGKILL, r"signal 9 \(SIGKILL; out of memory\?\)"), (signal.SIGSEGV, r"signal 11 \(SIGSEGV\)")],
)
def test_the_death_of_a_process_is_an_exception_that_names_it(grid, number, told):
    env = dials_traffic.parallel_env(grid, seed=1)
    env.reset()
    os.kill(env.pid, number)
    with pytest.raises(dials_traffic.ProcessDied, match=f"grid.toml: its process {env.pid} died of {told}"):
        while True:
            env.step(dict.fromkeys(env.agents, 0))
    with pytest.raises(dials_traffic.SimulatorError, match="is closed"):
        env.reset()
    env.close()


def test_a_dead_process_takes_its_last_words_with_it(grid, monkeypatch):
    from dials_traffic import _process

    monkeypatch.setattr(_process, "_CODE", "import sys; print('no room on the road'); sys.exit(3)")
    with pytest.raises(dials_traffic.ProcessDied, match="ended with exit code 3; its last words: no room on the road"):
        dials_traffic.parallel_env(grid)


def test_a_forgotten_environment_ends(grid):
    env = dials_traffic.parallel_env(grid, seed=1)
    pid = env.pid
    del env
    assert ends(pid)


@pytest.mark.parametrize("forks", [False, True])
def test_environments_end_with_python_however_it_ends(grid, forks):
    """Also if a copy of the Python process, made by a fork, holds the channel open."""
    code = f"""
        import os, time, dials_traffic
        env = dials_traffic.parallel_env({str(grid)!r}, seed=1)
        env.reset()
        other = os.fork() if {forks} else -1
        if other == 0:
            time.sleep(600)
        print(env.pid, other, flush=True)
        time.sleep(600)
    """
    python = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True)
    with python.stdout:
        pid, copy = map(int, python.stdout.readline().split())
    assert is_alive(pid)
    python.kill()
    python.wait()
    try:
        assert ends(pid)
    finally:
        if copy > 0:
            os.kill(copy, signal.SIGKILL)


def test_an_environment_outlives_the_thread_that_made_it(grid):
    made = []
    thread = threading.Thread(target=lambda: made.append(dials_traffic.parallel_env(grid, seed=1)))
    thread.start()
    thread.join()
    time.sleep(0.1)
    made[0].reset()
    made[0].step(dict.fromkeys(made[0].agents, 0))
    made[0].close()


def test_a_copy_of_the_python_process_cannot_use_it_and_does_not_end_it(grid):
    env = dials_traffic.parallel_env(grid, seed=1)
    env.reset()
    copy = os.fork()
    if copy == 0:
        code = 1
        try:
            env.step(dict.fromkeys(env.agents, 0))
        except dials_traffic.SimulatorError as error:
            code = 0 if "make it anew after a fork" in str(error) else 2
        env.close()
        os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(copy, 0)[1]) == 0
    env.reset()
    env.step(dict.fromkeys(env.agents, 0))
    env.close()


def test_an_interrupted_step_needs_a_reset_and_nothing_else(grid):
    env = dials_traffic.parallel_env(grid, seed=1)
    expected, _ = env.reset()
    env.send_actions(dict.fromkeys(env.agents, 0))
    # As if Ctrl-C had come before the answer.
    with pytest.raises(dials_traffic.SimulatorError, match="was not finished; call reset"):
        env.step(dict.fromkeys(env.agents, 0))
    again, _ = env.reset(seed=1)
    assert all((again[agent] == expected[agent]).all() for agent in expected)
    env.step(dict.fromkeys(env.agents, 0))
    env.close()


def test_ctrl_c_may_come_at_any_place(grid):
    """An alarm stands for Ctrl-C. A call that waits for an answer that does not come would never end."""
    code = """
        import random, signal, sys, dials_traffic
        env = dials_traffic.parallel_env(sys.argv[1], seed=1)
        expected, _ = env.reset(seed=1)

        def interrupt(number, frame):
            raise KeyboardInterrupt

        signal.signal(signal.SIGALRM, interrupt)
        dice, interrupted = random.Random(1), 0
        for _ in range(400):
            try:
                signal.setitimer(signal.ITIMER_REAL, dice.uniform(1e-5, 3e-3))
                while True:
                    if not env.agents:
                        env.reset()
                    env.step(dict.fromkeys(env.agents, 0))
            except KeyboardInterrupt:
                interrupted += 1
            shown, _ = env.reset(seed=1)
            assert all((shown[agent] == expected[agent]).all() for agent in expected)
        env.step(dict.fromkeys(env.agents, 0))
        env.close()
        print(interrupted)
    """
    words = [sys.executable, "-c", textwrap.dedent(code), str(grid)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (0, "400\n"), done.stderr


def test_what_was_not_begun_cannot_be_waited_for(grid, warehouse_run, monkeypatch):
    env = dials_traffic.parallel_env(grid, seed=1)
    with pytest.raises(dials_traffic.SimulatorError, match="no reset was begun"):
        env.receive_reset()
    env.send_reset()
    with pytest.raises(dials_traffic.SimulatorError, match="no step was begun"):
        env.receive_step()
    env.receive_reset()
    env.close()
    table = dials_traffic.vector_env(warehouse_run, "r0c0", 2, seed=1)
    table.reset()
    table.step([0, 0])
    with pytest.raises(dials_traffic.SimulatorError, match="no step was begun"):
        table.step_wait()
    # As if Ctrl-C had come before the step was sent.
    with monkeypatch.context() as patched:
        patched.setattr(table._process, "_send", None)
        with pytest.raises(TypeError):
            table.step_async([0, 0])
    with pytest.raises(dials_traffic.SimulatorError, match="was not finished; call reset"):
        table.step_wait()
    table.reset()
    table.step_async([0, 0])
    table.close()
    with pytest.raises(dials_traffic.SimulatorError, match="is closed"):
        table.step_wait()


def test_a_closed_environment_ends_by_itself_also_if_a_copy_of_python_lives(grid):
    env = dials_traffic.parallel_env(grid, seed=1)
    env.reset()
    copy = os.fork()
    if copy == 0:
        time.sleep(600)
    env.close()
    os.kill(copy, signal.SIGKILL)
    os.waitpid(copy, 0)
    assert env._channel._child.returncode == 0, "it was not killed"


def test_a_dead_process_is_an_exception_where_broken_pipes_are_deadly(grid):
    code = """
        import os, signal, sys, dials_traffic
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        env = dials_traffic.parallel_env(sys.argv[1], seed=1)
        env.reset()
        os.kill(env.pid, signal.SIGKILL)
        try:
            while True:
                env.step(dict.fromkeys(env.agents, 0))
        except dials_traffic.ProcessDied:
            print("told")
    """
    words = [sys.executable, "-c", textwrap.dedent(code), str(grid)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "told\n"), done.stderr


def descriptors():
    return len(os.listdir("/proc/self/fd"))


def test_a_process_that_cannot_start_leaves_no_descriptors(grid, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    gc.collect()
    before = descriptors()
    for _ in range(3):
        with pytest.raises(dials_traffic.SimulatorError, match="cannot be started: .*/no/such/python"):
            dials_traffic.parallel_env(grid)
    gc.collect()
    assert descriptors() == before


def test_no_process_starts_with_a_seed_that_is_refused(grid, grid_run, monkeypatch):
    monkeypatch.setattr(subprocess, "Popen", None)
    for make in (
        lambda: dials_traffic.parallel_env(grid, seed=-1),
        lambda: dials_traffic.vector_env(grid_run, "r0c0", 2, seed=-1),
        lambda: dials_traffic.vector_parallel_env(grid, 2, seed=-1),
    ):
        with pytest.raises(ValueError, match="seed -1: must be from 0"):
            make()


def test_standard_input_may_be_closed(grid):
    code = """
        import sys, dials_traffic
        env = dials_traffic.parallel_env(sys.argv[1], seed=1)
        env.reset()
        env.close()
    """
    words = [sys.executable, "-c", textwrap.dedent(code), str(grid)]
    done = subprocess.run(["/bin/sh", "-c", 'exec "$@" <&-', "sh", *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
