"""Datasets and influence predictors of one's own."""

import sys

import numpy as np
import pytest

import dials_traffic

from conftest import ROOT

sys.path.insert(0, str(ROOT / "examples"))

SETTINGS = {"policy.hidden": [16], "aip.hidden": [16]}


class Never:
    """Nothing ever comes. It notes where episodes begin."""

    def __init__(self):
        self.begun, self.uniform = [], []

    def begin(self, agents, rows):
        self.agents = agents
        self.begun.append(rows.tolist())

    def sample(self, d_set, uniform):
        self.uniform.append(uniform)
        return np.zeros(uniform.shape, int)


def test_datasets_are_of_whole_episodes_and_the_same_ones_for_a_seed(grid):
    made = dials_traffic.datasets(grid, 2, settings=SETTINGS)
    assert [dataset.agent for dataset in made] == ["r0c0", "r0c1", "r1c0", "r1c1"]
    for dataset in made:
        episodes, steps, sources = dataset.sources.shape
        assert (episodes, steps, sources) == (2, 40, len(dataset.classes)) and dataset.d_set.shape[:2] == (2, 40)
        assert (dataset.sources < dataset.classes).all()
    assert sum(int(dataset.sources.sum()) for dataset in made) > 20, "cars enter"
    again = dials_traffic.datasets(grid, 2, settings=SETTINGS)
    assert all(np.array_equal(one.d_set, other.d_set) for one, other in zip(made, again))
    others = dials_traffic.datasets(grid, 2, settings={**SETTINGS, "seed": 2})
    assert not all(np.array_equal(one.sources, other.sources) for one, other in zip(made, others))


def test_a_predictor_of_ones_own_says_what_comes(grid):
    def occupied(predictor):
        env = dials_traffic.vector_env(grid, ["r0c0", "r1c1"], 2, predictor, seed=1)
        obs, infos = env.reset()
        total = 0.0
        for _ in range(env.horizon + 2):
            obs, _, _, _, infos = env.step(infos["action_mask"].argmax(axis=1))
            total += float(obs.sum())
        env.close()
        return total

    class Always(Never):
        def sample(self, d_set, uniform):
            return np.ones(uniform.shape, int)

    never = Never()
    assert occupied(never) < occupied(Always())
    assert never.agents.tolist() == [0, 0, 3, 3]
    assert never.begun == [[0, 1, 2, 3], [0, 1, 2, 3]], "at the reset, and where the episodes ended"
    assert len(never.uniform) == 42 and 0 <= np.min(never.uniform) and np.max(never.uniform) < 1
    again = Never()
    occupied(again)
    assert np.array_equal(never.uniform, again.uniform), "they follow from the seed"


def test_one_copy_takes_a_predictor_of_ones_own_too(grid):
    env = dials_traffic.local_env(grid, "r0c0", Never(), seed=1)
    env.reset()
    assert env.step(0)[1] is not None
    env.close()


def test_what_a_predictor_does_wrong_is_said(grid):
    class Wide(Never):
        def sample(self, d_set, uniform):
            return np.zeros((1, 1), int)

    class Half(Never):
        def sample(self, d_set, uniform):
            return np.full(uniform.shape, 0.5)

    class Third(Never):
        def sample(self, d_set, uniform):
            return np.full(uniform.shape, 2)

    for predictor, error, words in [
        (Wide(), ValueError, r"sample: returned the shape \(1, 1\) instead of \(2, "),
        (Half(), TypeError, "sample: returned float64 instead of whole numbers"),
        (Third(), ValueError, "sample: returned class 2 for source 0 of row 0, which has 2 classes"),
    ]:
        env = dials_traffic.vector_env(grid, "r0c0", 2, predictor, seed=1)
        env.reset()
        with pytest.raises(error, match=words):
            env.step([0, 0])
        with pytest.raises(dials_traffic.SimulatorError, match="call reset"):
            env.step([0, 0])
        env.reset()
        env.close()


def test_the_example_predicts_better_than_constants(grid):
    import own_predictor

    predictor, own, constant = own_predictor.losses(grid, settings=SETTINGS, episodes=60, seen=45)
    assert own < constant, (own, constant)
