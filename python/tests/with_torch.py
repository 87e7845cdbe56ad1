"""stable-baselines3 on our environments. .ci/run names this file, because torch is not everywhere."""

import sys
import warnings

from conftest import ROOT
from stable_baselines3.common.env_checker import check_env

import dials_traffic

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
