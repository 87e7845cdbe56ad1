"""Learners that are written in Python, inside DIALS."""

import json
import os
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

import dials_traffic
from dials_traffic._state import from_bytes, to_bytes

from conftest import SHORT, path_of_program, program

# Several periods: AIPs are trained at 0 and at 128, and evaluations are at 0, 64, 128 and 192.
WAREHOUSE = {
    "total_steps": 192,
    "local_simulators.copies": 2,
    "aip.retrain_every_steps": 128,
    "evaluation.every_steps": 64,
    "evaluation.aip_loss_episodes": 1,
    "outside.update_every_steps": 16,
}
FILES = ["returns.csv", "training.csv", "aip_loss.csv", "episodes.csv"]


@pytest.fixture(autouse=True)
def built(monkeypatch):
    """The program of this build, and not one that is installed."""
    monkeypatch.setenv("DIALS_TRAFFIC", path_of_program())


class Softmax:
    """A policy gradient of one layer in numpy: it learns a bias for each action, of each agent."""

    metrics = ("reward",)

    def __init__(self, team):
        self.team = team
        self.biases = np.zeros((len(team.agents), team.n_actions))

    def probabilities(self, agents, masks):
        p = np.exp(self.biases[agents]) * masks
        return p / p.sum(axis=1, keepdims=True)

    def act(self, rows, explore):
        p = self.probabilities(rows.agents, rows.masks)
        return np.minimum((p.cumsum(axis=1) <= rows.uniform[:, None]).sum(axis=1), self.team.n_actions - 1)

    def learn(self, experience):
        better = experience.rewards - experience.rewards.mean()
        noise = 0.01 * experience.rng.standard_normal(self.biases.shape)
        np.add.at(self.biases, (np.tile(experience.agents, len(better)), experience.actions.ravel()), better.ravel())
        self.biases += noise
        return {"reward": experience.rewards.mean(axis=0)}

    def state(self, saved=None):
        if saved is not None:
            self.biases = saved["biases"]
        return {"biases": self.biases}


def contents(run):
    return {name: (run.path / name).read_bytes() for name in FILES}


def test_a_run_that_ended_with_an_error_of_the_learner_goes_on_to_the_same_files(warehouse, tmp_path):
    whole = dials_traffic.dials(warehouse, learner=Softmax, out=tmp_path / "whole", settings=WAREHOUSE, quiet=True)

    class Fails(Softmax):
        def learn(self, experience):
            if experience.steps == 160:
                raise ArithmeticError("160")
            return super().learn(experience)

    out = tmp_path / "parts"
    with pytest.raises(ArithmeticError, match="160") as raised:
        dials_traffic.dials(warehouse, learner=Fails, out=out, settings=WAREHOUSE, quiet=True)
    assert raised.traceback[-1].name == "learn", "its traceback leads to the user's line"
    parts = dials_traffic.dials(warehouse, learner=Softmax, out=out, resume=True, quiet=True)
    assert contents(parts) == contents(whole)
    assert np.array_equal(parts.learner.biases, whole.learner.biases)
    assert whole.table("training")["reward"].size > 0
    about = json.loads((whole.path / "learner.json").read_text())
    assert about["learner"] == "Softmax" and "A policy gradient of one layer" in about["source"]
    with pytest.raises(FileExistsError, match="resume=True goes on with it"):
        dials_traffic.dials(warehouse, learner=Softmax, out=whole.path, quiet=True)
    program("report", whole.path, "--out", tmp_path / "report.html")


def test_a_run_whose_worker_is_killed_or_that_ctrl_c_stops_comes_to_the_same_files(warehouse, tmp_path):
    whole = dials_traffic.dials(warehouse, learner=Softmax, out=tmp_path / "whole", settings=WAREHOUSE, quiet=True)
    made = []

    class Killed(Softmax):
        def __init__(self, team):
            super().__init__(team)
            made.append(self)

        def learn(self, experience):
            if len(made) == 1 and experience.steps == 160:
                (run,) = children(os.getpid(), "train")
                for worker in children(run, "worker"):
                    os.kill(worker, signal.SIGKILL)
            return super().learn(experience)

    killed = dials_traffic.dials(warehouse, learner=Killed, out=tmp_path / "killed", settings=WAREHOUSE, quiet=True)
    assert len(made) == 2, "the second worker got a new learner, with the saved state"
    assert contents(killed) == contents(whole)
    assert np.array_equal(killed.learner.biases, whole.learner.biases)

    class Stopped(Softmax):
        def learn(self, experience):
            if experience.steps == 80:
                os.kill(os.getpid(), signal.SIGINT)
            return super().learn(experience)

    with pytest.raises(KeyboardInterrupt, match="the run was stopped; it can be resumed"):
        dials_traffic.dials(warehouse, learner=Stopped, out=tmp_path / "stopped", settings=WAREHOUSE, quiet=True)
    stopped = dials_traffic.dials(warehouse, learner=Softmax, out=tmp_path / "stopped", resume=True, quiet=True)
    assert contents(stopped) == contents(whole)


def children(parent, word):
    """Return the numbers of the children of a process whose command line has a word."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            status, words = (folder / "stat").read_text(), (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if int(status.rsplit(")", 1)[1].split()[1]) == parent and word.encode() in words:
            found.append(int(folder.name))
    return found


def test_what_a_learner_sees_fits_together(warehouse, tmp_path):
    seen = []

    class Looks(Softmax):
        def act(self, rows, explore):
            assert explore == (rows.steps is not None)
            actions = super().act(rows, explore)
            if explore:
                seen.append(("act", rows, actions))
            return actions

        def learn(self, experience):
            seen.append(("learn", experience, None))
            return None

    settings = {**WAREHOUSE, "total_steps": 64}
    run = dials_traffic.dials(warehouse, learner=Looks, out=tmp_path / "run", settings=settings, quiet=True)
    team = run.learner.team
    assert (len(team.agents), team.copies, team.on_gs, team.seed) == (4, 2, False, 1)
    assert team.training_horizon == team.horizon == 16
    decisions = [(rows, actions) for call, rows, actions in seen if call == "act"]
    assert len(decisions) == 32, "64 timesteps per agent in two copies"
    experiences = [experience for call, experience, _ in seen if call == "learn"]
    assert [experience.steps for experience in experiences] == [16, 32, 48, 64]
    obs = np.concatenate([experience.obs for experience in experiences])
    next_obs = np.concatenate([experience.next_obs for experience in experiences])
    ends = np.concatenate([experience.ends for experience in experiences])
    actions = np.concatenate([experience.actions for experience in experiences])
    assert np.array_equal(obs, [rows.obs for rows, _ in decisions])
    assert np.array_equal(actions, [actions for _, actions in decisions])
    assert decisions[0][0].agents.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert decisions[0][0].copies.tolist() == [0, 1] * 4
    # An episode has 16 steps, and nothing staggers them.
    assert np.flatnonzero(ends[:, 0]).tolist() == [15, 31] and np.array_equal(ends, ends[:, :1].repeat(8, axis=1))
    goes_on = ~ends[:-1]
    assert np.array_equal(next_obs[:-1][goes_on], obs[1:][goes_on])
    assert not np.array_equal(next_obs[15], obs[16]), "the last observation of an episode is not the first of the next one"
    uniform = np.array([rows.uniform for rows, _ in decisions])
    assert (uniform >= 0).all() and (uniform < 1).all() and len(np.unique(uniform)) > 200


@pytest.mark.parametrize("simulator", ["dials", "gs"])
def test_the_same_actions_give_the_same_predictors_and_evaluations_as_our_algorithm(grid, tmp_path, simulator):
    # PPO whose steps are too small to change a number. Both draw with the same dice.
    settings = {
        **{key: value for key, value in SHORT.items() if not key.endswith("hidden")},
        "aip.hidden": [16],
        "policy.hidden": [16],
        "simulator": simulator,
        "local_simulators.copies": 2,
        "total_steps": 256,
        "aip.dataset_steps": 80,
        "aip.batch": 16,
        "aip.retrain_every_steps": 128,
        "evaluation.every_steps": 128,
        "ppo.memory": 128,
        "ppo.rollout_steps": 16,
        "ppo.minibatch": 32,
        "ppo.learning_rate": 1e-30,
    }
    words = []
    for key, value in settings.items():
        words += ["--set", f"{key}={value}"]
    ours = tmp_path / "ours"
    program("train", grid, "--out", ours, "--workers", 0, *words)
    run = dials_traffic.load(ours)
    weights = [run.weights(agent) for agent in run.agents]

    class Plays:
        update_every_steps = 128

        def __init__(self, team):
            self.team = team

        def act(self, rows, explore):
            logits = np.array([self.logits(weights[agent], obs) for agent, obs in zip(rows.agents, rows.obs)])
            logits = np.where(rows.masks, logits, -np.inf)
            p = np.exp(logits - logits.max(axis=1, keepdims=True))
            p /= p.sum(axis=1, keepdims=True)
            return np.minimum((p.cumsum(axis=1) <= rows.uniform[:, None]).sum(axis=1), p.shape[1] - 1)

        def logits(self, of_agent, obs):
            policy = {name: value for name, value in of_agent.items() if not name.startswith("critic")}
            layers = sorted({name.rsplit(".", 1)[0] for name in policy})
            hidden = obs[None]
            for number, layer in enumerate(layers):
                hidden = hidden @ policy[f"{layer}.weight"] + policy[f"{layer}.bias"]
                if number + 1 < len(layers):
                    hidden = np.maximum(hidden, 0)
            return hidden[0, : self.team.n_actions]

        def learn(self, experience):
            return None

        def state(self, saved=None):
            return {}

    theirs = tmp_path / "theirs"
    dials_traffic.dials(grid, learner=Plays, out=theirs, settings=settings, quiet=True)
    files = ["returns.csv", "episodes.csv"] + (["aip_loss.csv"] if simulator == "dials" else [])
    for name in files:
        assert (theirs / name).read_text() == (ours / name).read_text(), name


def test_what_a_learner_does_wrong_is_said(warehouse, tmp_path):
    class Idle(Softmax):
        def act(self, rows, explore):
            return np.zeros(3, int)

    class Floats(Softmax):
        def act(self, rows, explore):
            return np.zeros(len(rows.agents))

    class Wild(Softmax):
        def act(self, rows, explore):
            return np.full(len(rows.agents), 99)

    class Silent(Softmax):
        def learn(self, experience):
            return {"loss": 0.0}

    class Diverges(Softmax):
        def learn(self, experience):
            return {"reward": np.nan}

    class Half:
        def __init__(self, team):
            pass

    settings = {**WAREHOUSE, "total_steps": 16}
    for number, (learner, error, words) in enumerate([
        (Idle, ValueError, r"act: returned the shape \(3,\) instead of \(4,\), one per row"),
        (Floats, TypeError, "act: returned float64 instead of whole numbers"),
        (Wild, ValueError, r"act: action 99 of agent 'r0c0' \(row 0\): allowed now are \[0, 1"),
        (Silent, ValueError, r"learn: returned \['loss'\], but its attribute `metrics` names \['reward'\]"),
        (Diverges, ValueError, "learn: 'reward' is nan: it must be a finite number; has it diverged?"),
        (Half, TypeError, "learner: Half has no method act"),
    ]):
        with pytest.raises(error, match=words):
            dials_traffic.dials(warehouse, learner=learner, out=tmp_path / str(number), settings=settings, quiet=True)
    with pytest.raises(dials_traffic.SimulatorError, match="outside.update_every_steps = 3: must be a multiple of"):
        wrong = {**settings, "outside.update_every_steps": 3}
        dials_traffic.dials(warehouse, learner=Softmax, out=tmp_path / "wrong", settings=wrong, quiet=True)


def test_a_run_of_a_learner_in_python_says_how_to_run_it(warehouse, tmp_path):
    command = [path_of_program(), "train", str(warehouse), "--set", "algorithm=outside", "--out", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and "run it with dials_traffic.dials(...)" in done.stderr, done.stderr
    settings = {**WAREHOUSE, "total_steps": 16}
    run = dials_traffic.dials(warehouse, learner=Softmax, out=tmp_path / "run", settings=settings, quiet=True)
    with pytest.raises(dials_traffic.SimulatorError, match="its policies are in Python"):
        dials_traffic.load(run.path)


def test_states_are_written_and_read_without_pickle():
    state = {"half": np.arange(3, dtype=np.float16), "none": np.zeros((0, 2)), "count": np.array(7)}
    back = from_bytes(to_bytes(state))
    assert {name: (value.dtype, value.shape) for name, value in back.items()} == {
        name: (value.dtype, value.shape) for name, value in state.items()
    }
    assert all(np.array_equal(back[name], state[name]) for name in state)
    with pytest.raises(TypeError, match="state: 'what' is no array of numbers"):
        to_bytes({"what": [None]})
