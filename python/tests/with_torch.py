"""What needs torch: stable-baselines3, PPO, the notebook, policies as modules.

.ci/run names this file, because torch is not everywhere.
"""

import json
import os
import sys
import warnings

import notebook
import numpy as np
import pytest
import torch
from conftest import ROOT, path_of_program
from stable_baselines3.common.env_checker import check_env

import dials_traffic
from dials_traffic.policy import in_torch
from dials_traffic.torch_policy import TorchPolicy

sys.path.insert(0, str(ROOT / "examples"))


def test_stable_baselines3_takes_a_single_simulator(grid_run, warehouse_run):
    for path, agent in ((grid_run, "r0c0"), (warehouse_run, "r0c0")):
        env = dials_traffic.local_env(path, agent, seed=1)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_env(env)
        env.close()


def test_the_example_trains_an_intersection_and_plays_it(grid, capsys):
    import sb3_local

    # Datasets of 3000 steps are 75 episodes of this config.
    sb3_local.main([str(grid), "r0c0", "--steps", "2048", "--copies", "4"])
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["trained", "random"]
    # The mean speed of 40 steps is between 0 and 40.
    assert all(0 < float(line.split()[2]) < 40 for line in lines), lines


def test_the_ppo_in_one_file_learns(warehouse, capsys):
    import ppo

    # A robot that moves at random collects little; the best of an early and a late tenth differ by far.
    returns = ppo.main([str(warehouse), "--steps", "24000", "--envs", "4", "--seed", "1"])
    tenth = len(returns) // 10
    early, late = (sum(part) / tenth for part in (returns[:tenth], returns[-tenth:]))
    assert late > 1.5 * early, (early, late)
    assert "mean return" in capsys.readouterr().out


#: Runs of the examples inside DIALS that take seconds.
BRIEF = {"evaluation.episodes": 1, "evaluation.final_episodes": 1, "evaluation.every_steps": 240}


def test_mappo_in_one_file_learns_inside_dials_and_goes_on_after_a_stop(grid, tmp_path, monkeypatch):
    import mappo

    monkeypatch.setenv("DIALS_TRAFFIC", path_of_program())
    whole = mappo.train(grid, tmp_path / "whole", 480, copies=2, settings=BRIEF, quiet=True)

    class Stops(mappo.Mappo):
        def learn(self, experience):
            if experience.steps > 360:
                raise InterruptedError
            return super().learn(experience)

    monkeypatch.setattr(mappo, "Mappo", Stops)
    with pytest.raises(InterruptedError):
        mappo.train(grid, tmp_path / "parts", 480, copies=2, settings=BRIEF, quiet=True)
    monkeypatch.undo()
    monkeypatch.setenv("DIALS_TRAFFIC", path_of_program())
    parts = mappo.train(grid, tmp_path / "parts", 480, copies=2, resume=True, quiet=True)
    for name in ("returns.csv", "training.csv"):
        assert (parts.path / name).read_bytes() == (whole.path / name).read_bytes(), name


def test_dqn_in_one_file_learns_inside_dials(grid, tmp_path, monkeypatch):
    import dqn

    monkeypatch.setenv("DIALS_TRAFFIC", path_of_program())
    settings = {**BRIEF, "aip.dataset_steps": 80, "aip.batch": 16, "aip.hidden": [16], "aip.epochs": 1}
    run = dqn.train(grid, tmp_path / "run", 480, settings=settings, quiet=True)
    training = run.table("training")
    assert np.isfinite(training["td_loss"]).any() and (run.learner.calls == 30).all()


def test_the_notebook_runs_from_its_first_cell_to_its_last_and_has_its_outputs(monkeypatch):
    monkeypatch.chdir(ROOT / "examples")
    path = ROOT / "examples/train_and_compare.ipynb"
    if os.environ.get("UPDATE"):
        made, _ = notebook.executed(path)
        path.write_text(notebook.written(made))
    kept = json.loads(path.read_text())
    # Enough to beat random switching, and no more.
    made, names = notebook.executed(path, lambda source: source.replace("120_000", "24_000"))
    means = {name: totals.mean() for name, (totals, _) in names["results"].items()}
    assert means["learned"] > means["random"] + 5, means
    assert notebook.kinds(kept) == notebook.kinds(made), "a count, and outputs of the same kinds, for each cell"
    # Only what was learnt depends on torch and on the number of steps.
    same = [[line for line in text.splitlines() if not line.startswith("learned")] for text in notebook.printed(made)[2:]]
    assert same == [
        [line for line in text.splitlines() if not line.startswith("learned")] for text in notebook.printed(kept)[2:]
    ]
    assert f"fixed time: {means['fixed time']:.1f}" in notebook.printed(kept)[3]
    assert str(ROOT) not in path.read_text() and path.stat().st_size < 200_000


@pytest.mark.parametrize("gru", [False, True])
@pytest.mark.parametrize("critic", [False, True])
def test_a_policy_in_torch_says_what_the_policy_in_numpy_says(gru, critic):
    dice = np.random.default_rng(1)
    weights = {}

    def add(name, inputs, outputs):
        weights[f"{name}weight"] = dice.normal(size=(inputs, outputs)).astype("f4")
        weights[f"{name}bias"] = dice.normal(size=(1, outputs)).astype("f4")

    for tower, last in (("", 3), ("critic.", 1)) if critic else (("", 4),):
        if gru:
            add(f"{tower}gru.input_", 5, 24)
            add(f"{tower}gru.state_", 8, 24)
        add(f"{tower}layers.0.", 8 if gru else 5, 6)
        add(f"{tower}layers.1.", 6, last)
    ours = dials_traffic.Policy(weights)
    theirs = TorchPolicy(in_torch(weights))
    assert theirs.memory == (8 if gru else 0) * (2 if critic else 1)
    states = torch.zeros(1, theirs.memory)
    for obs in dice.normal(size=(4, 5)).astype("f4"):
        logits, value = ours.judge(obs)
        with torch.no_grad():
            said = theirs(torch.tensor(obs)[None], *([states] if gru else []))
        states = said[2] if gru else states
        assert np.allclose(said[0][0].numpy(), logits, atol=1e-5) and said[0].shape == (1, 3)
        assert said[1][0].item() == pytest.approx(value, abs=1e-5)


def test_the_policy_of_a_run_is_a_module_of_torch(grid_run, tmp_path):
    run = dials_traffic.load(grid_run)
    torch.save(run.torch_policy("r0c0").state_dict(), tmp_path / "r0c0.pt")
    saved = torch.load(tmp_path / "r0c0.pt")
    assert saved.keys() == run.state_dict("r0c0").keys()
    assert all(np.array_equal(saved[name].numpy(), weights) for name, weights in run.state_dict("r0c0").items())
    obs = np.linspace(0, 1, 40, dtype=np.float32)
    logits, _ = run.torch_policy("r0c0")(torch.tensor(obs)[None])
    assert np.allclose(logits[0].detach().numpy(), run.policy("r0c0").judge(obs)[0], atol=1e-5)
