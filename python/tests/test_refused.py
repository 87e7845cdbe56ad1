"""Arguments and files that an attack tried: each is an error that says what is wrong, where, and what is right."""

import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file
from test_process import ends, is_alive

import dials_traffic


@pytest.mark.parametrize("copies", [10**9, 10**15, 2**63, 2**64 - 1])
def test_more_copies_than_fit_into_memory_are_refused_with_the_largest_number(copies, warehouse_run):
    with pytest.raises(ValueError, match=f"copies {copies}: there is memory for at most [0-9]+") as error:
        dials_traffic.vector_env(warehouse_run, "r0c0", copies)
    most = int(re.search("at most ([0-9]+)", str(error.value))[1])
    assert 1000 < most < 10**9


def test_more_processes_than_fit_into_memory_are_refused_before_the_first(warehouse, monkeypatch):
    monkeypatch.setattr(subprocess, "Popen", None)
    for n in (10**7, 2**63):
        with pytest.raises(ValueError, match=f"n {n}: each copy is a process, and there is memory for at most [0-9]+"):
            dials_traffic.vector_parallel_env(warehouse, n)


def test_a_path_that_is_not_utf8_is_refused_with_a_reason(grid, grid_run, tmp_path):
    folder = os.fsencode(tmp_path) + b"/\xff"
    shutil.copytree(grid_run, os.fsdecode(folder))
    path = os.fsdecode(folder)
    (tmp_path / "fine").mkdir()
    for make in (
        lambda: dials_traffic.load(path),
        lambda: dials_traffic.parallel_env(path),
        lambda: dials_traffic.vector_env(path, "r0c0", 1),
        lambda: dials_traffic.vector_env(grid_run, "r0c0", 1, path),
        lambda: dials_traffic.load(grid_run).play(replay=path + "/new"),
    ):
        with pytest.raises(ValueError, match=r"\\udcff.*: this path is not UTF-8; rename"):
            make()
    for wrong in (None, 3, os.fsencode(grid), [grid]):
        with pytest.raises(TypeError, match="config .*: must be a path"):
            dials_traffic.parallel_env(wrong)
    for make in (
        lambda: dials_traffic.vector_env(grid_run, "r\udcff", 1),
        lambda: dials_traffic.parallel_env(grid, controller_for={"r0c0": "\udcff"}),
        lambda: dials_traffic.parallel_env(grid, settings={"traffic.horizon\udcff": 1}),
    ):
        with pytest.raises(ValueError, match="half of a pair"):
            make()
    umlaut = tmp_path / "Straße 1"
    shutil.copytree(grid_run, umlaut)
    assert dials_traffic.load(umlaut).agents == ["r0c0", "r0c1", "r1c0", "r1c1"]


@pytest.mark.parametrize("stopped", [False, True])
def test_a_stopped_child_ends_with_python_too(stopped, grid, grid_run):
    code = f"""
        import os, signal, time, dials_traffic
        envs = [
            dials_traffic.parallel_env({str(grid)!r}, seed=1),
            dials_traffic.vector_env({str(grid_run)!r}, "r0c0", 1),
            dials_traffic.load({str(grid_run)!r}).controller(),
        ]
        pids = [env._channel.pid if hasattr(env, "_channel") else env._process.pid for env in envs]
        if {stopped}:
            [os.kill(pid, signal.SIGSTOP) for pid in pids]
        print(*pids, flush=True)
        time.sleep(600)
    """
    python = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True)
    with python.stdout:
        pids = [int(pid) for pid in python.stdout.readline().split()]
    try:
        assert len(pids) == 3 and all(map(is_alive, pids))
        python.kill()
        python.wait()
        assert all(ends(pid, 5.0) for pid in pids)
    finally:
        for pid in filter(is_alive, pids):
            os.kill(pid, signal.SIGKILL)


@pytest.fixture
def damaged(grid_run, tmp_path):
    """Return a function that makes a copy of a run with other tensors and metadata."""

    def make(tensors=None, metadata=None, name="policies.safetensors"):
        run = tmp_path / "run"
        shutil.rmtree(run, ignore_errors=True)
        shutil.copytree(grid_run, run)
        shutil.rmtree(run / "checkpoints", ignore_errors=True)
        own = load_file(run / name)
        save_file({**own, **(tensors(own) if tensors else {})}, run / name, metadata)
        return run

    return make


def test_absurd_weights_are_refused_with_their_file_and_tensor(damaged):
    def absurd(value):
        def tensors(own):
            weights = own["layers.0.weight"].copy()
            weights[1, 2, 3] = value
            return {"layers.0.weight": weights}

        return tensors

    for value, told in [(1e30, "1e30"), (-2e6, "-2e6"), (np.nan, "NaN")]:
        run = damaged(absurd(value))
        with pytest.raises(dials_traffic.SimulatorError, match=f"policies.safetensors: `layers.0.weight` of .*{told}"):
            dials_traffic.load(run)
        run = damaged(absurd(value), name="aips.safetensors")
        with pytest.raises(dials_traffic.SimulatorError, match=f"aips.safetensors: `layers.0.weight` of .*{told}"):
            dials_traffic.vector_env(run, "r0c0", 1)
    assert dials_traffic.load(damaged(absurd(9e5))).weights("r0c1")["layers.0.weight"][2, 3] == np.float32(9e5)


def test_tensors_that_no_network_has_are_refused(damaged):
    run = damaged(lambda own: {"layers.9.weight": np.zeros((4, 1, 1), np.float32)})
    with pytest.raises(dials_traffic.SimulatorError, match="policies.safetensors: the tensor `layers.9.weight` belongs"):
        dials_traffic.load(run)


def test_a_tensor_that_comes_twice_is_refused(damaged):
    run = damaged()
    file = run / "policies.safetensors"
    data = file.read_bytes()
    (length,) = struct.unpack_from("<Q", data)
    header = data[8 : 8 + length].decode().rstrip()
    bias = json.dumps(json.loads(header)["layers.0.bias"])
    doubled = f'{header[:-1]},"layers.0.bias":{bias}}}'.encode()
    file.write_bytes(struct.pack("<Q", len(doubled)) + doubled + data[8 + length :])
    with pytest.raises(dials_traffic.SimulatorError, match="policies.safetensors: .*`layers.0.bias` comes twice"):
        dials_traffic.load(run)


@pytest.mark.parametrize("steps", ["1e99", "-1", "", "12.5", "many", "99999999999999999999999"])
def test_steps_that_are_no_whole_number_are_refused(steps, damaged):
    run = damaged(metadata={"steps": steps})
    told = rf"policies.safetensors: its metadata `steps` is \"{re.escape(steps)}\" instead of a whole number"
    with pytest.raises(dials_traffic.SimulatorError, match=told):
        dials_traffic.load(run)
    assert dials_traffic.load(damaged(metadata={"steps": "12"})).agents


def test_a_controller_acts_with_the_weights_that_were_loaded(damaged):
    """The file of a run that is being trained is replaced at any moment."""
    path = damaged()
    run = dials_traffic.load(path)
    shown = {agent: np.linspace(0, 1, 40) for agent in run.agents}
    infos = dict.fromkeys(shown, {})

    def chosen(controller):
        controller.begin(1)
        actions = [controller.act(shown, infos) for _ in range(20)]
        controller.close()
        return actions

    before = chosen(run.controller())
    # Now all policies choose action 1.
    other = load_file(path / "policies.safetensors")
    last = max(name for name in other if name.endswith("bias"))
    other[last][..., 0], other[last][..., 1] = -1e5, 1e5
    save_file(other, path / "policies.safetensors")
    assert chosen(run.controller()) == before
    assert {action for step in chosen(dials_traffic.load(path).controller()) for action in step.values()} == {1}
    assert {action for step in before for action in step.values()} == {0, 1}
    (path / "policies.safetensors").unlink()
    assert chosen(run.controller()) == before
    # And nobody changes them here.
    with pytest.raises(ValueError, match="read-only"):
        run.weights("r0c0")[last][:] = 0
    run.weights("r0c0").clear()
    assert run.weights("r0c0")


def test_a_stopped_child_that_a_thread_started_ends_with_python_too_and_not_before(grid):
    """The system counts the thread that starts a child as its parent."""
    code = f"""
        import os, signal, threading, time, dials_traffic
        envs = []
        thread = threading.Thread(target=lambda: envs.append(dials_traffic.parallel_env({str(grid)!r}, seed=1)))
        thread.start()
        thread.join()
        time.sleep(0.2)
        envs[0].reset()
        os.kill(envs[0].pid, signal.SIGSTOP)
        print(envs[0].pid, flush=True)
        time.sleep(600)
    """
    python = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True)
    with python.stdout:
        pid = int(python.stdout.readline())
    assert is_alive(pid)
    python.kill()
    python.wait()
    assert ends(pid, 5.0)
