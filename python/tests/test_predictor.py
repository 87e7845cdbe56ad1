"""Datasets and influence predictors of one's own."""

import json
import os
import signal
import sys

import numpy as np
import pytest

import dials_traffic

from conftest import ROOT, path_of_program, program
from test_learner import Softmax, children

sys.path.insert(0, str(ROOT / "examples"))

SETTINGS = {"policy.hidden": [16], "aip.hidden": [16]}

# Predictors learn at 0 and at 128 steps; their loss on new episodes is measured at 0, 64, 128 and 192.
INSIDE = {
    "total_steps": 192,
    "local_simulators.copies": 2,
    "policy.hidden": [16],
    "ppo.rollout_steps": 8,
    "ppo.memory": 16,
    "ppo.minibatch": 8,
    "aip.retrain_every_steps": 128,
    "evaluation.every_steps": 64,
    "evaluation.aip_loss_episodes": 1,
}
FILES = ["returns.csv", "training.csv", "aip_loss.csv", "aip_drift.csv", "episodes.csv"]


@pytest.fixture(autouse=True)
def built(monkeypatch):
    """The program of this build, and not one that is installed."""
    monkeypatch.setenv("DIALS_TRAFFIC", path_of_program())


class Constants:
    """Our marginals, written in numpy: how often each class came, whatever the d-set shows."""

    def __init__(self):
        self.probabilities = np.zeros(0)

    def fit(self, datasets):
        widest = max(int(dataset.classes.max()) for dataset in datasets)
        counts = [
            [(dataset.sources == number).mean(axis=(0, 1), dtype=np.float64) for number in range(widest)] for dataset in datasets
        ]
        # [agents, sources, classes]
        self.probabilities = np.array(counts).swapaxes(1, 2).astype(np.float32)

    def loss(self, dataset):
        p = np.maximum(self.probabilities[dataset.number].astype(np.float64), 5e-7)
        seen = np.arange(p.shape[1]) == dataset.sources.reshape(-1, len(p))[..., None]
        return -(seen.mean(axis=0) * np.log(p)).sum(axis=1)[: dataset.own_sources]

    def begin(self, agents, rows):
        self.agents = agents

    def sample(self, d_set, uniform):
        # The first class at which nothing is left of the number, as ours draw.
        rest, drawn = uniform.copy(), np.full(uniform.shape, -1)
        for number in range(self.probabilities.shape[2]):
            p = self.probabilities[self.agents, :, number]
            rest -= p
            drawn[(drawn < 0) & (rest < 0)] = number
        last = self.probabilities.shape[2] - 1 - (self.probabilities[..., ::-1] > 0).argmax(axis=2)
        return np.where(drawn < 0, last[self.agents], drawn)

    def state(self, saved=None):
        if saved is not None:
            self.probabilities = saved["probabilities"]
        return {"probabilities": self.probabilities}


def contents(path):
    return {name: (path / name).read_bytes() for name in FILES}


def test_our_constants_in_python_give_the_numbers_of_ours_with_one_worker_and_with_two(warehouse, tmp_path, capfd):
    ours = {**INSIDE, "simulator": "marginal-dials"}
    dials_traffic.train(warehouse, out=tmp_path / "ours", settings=ours, workers=1, quiet=True)
    expected = contents(tmp_path / "ours")
    run = dials_traffic.train(warehouse, out=tmp_path / "one", settings=INSIDE, predictor=Constants(), workers=1)
    assert contents(run.path) == expected
    assert "of the time of the steps; fits and losses of the predictor" in capfd.readouterr().err
    assert run.own_cost.functions_s > 0 and run.own_cost.fits_s > 0 and 0 < run.own_cost.share < 1
    dials_traffic.train(warehouse, out=tmp_path / "two", settings=INSIDE, predictor=Constants(), workers=2, quiet=True)
    assert contents(tmp_path / "two") == expected
    (about,) = json.loads((run.path / "run.json").read_text())["python"]
    assert (about["kind"], about["name"]) == ("predictor", "Constants") and "Our marginals" in about["source"]
    program("report", run.path, tmp_path / "ours", "--out", tmp_path / "report.html")


def test_a_run_with_a_predictor_that_was_killed_or_failed_goes_on_to_the_same_files(warehouse, tmp_path):
    def train(name, predictor, **options):
        return dials_traffic.train(out=tmp_path / name, predictor=predictor, quiet=True, **options)

    expected = contents(train("whole", Constants(), config=warehouse, settings=INSIDE, workers=1).path)

    class Killed(Constants):
        asked = 0

        def sample(self, d_set, uniform):
            Killed.asked += 1
            if Killed.asked == 40:
                (run,) = children(os.getpid(), "train")
                os.kill(children(run, "worker")[0], signal.SIGKILL)
            return super().sample(d_set, uniform)

    assert contents(train("killed", Killed(), config=warehouse, settings=INSIDE, workers=2).path) == expected

    class Fails(Constants):
        asked = 0

        def sample(self, d_set, uniform):
            Fails.asked += 1
            if Fails.asked == 90:
                raise ArithmeticError("the 90th")
            return super().sample(d_set, uniform)

    with pytest.raises(ArithmeticError, match="the 90th") as raised:
        train("failed", Fails(), config=warehouse, settings=INSIDE, workers=1)
    assert raised.traceback[-1].name == "sample", "its traceback leads to the user's line"
    resumed = Constants()
    assert contents(train("failed", resumed, resume=True).path) == expected
    assert resumed.probabilities.size > 0, "it went on from what the other one had learnt"


def test_a_learner_and_a_predictor_of_ones_own_go_together(warehouse, tmp_path):
    settings = {**INSIDE, "outside.update_every_steps": 16}
    settings = {key: value for key, value in settings.items() if not key.startswith("ppo.")}
    ours = {**settings, "simulator": "marginal-dials"}
    plain = dials_traffic.dials(warehouse, learner=Softmax, out=tmp_path / "plain", settings=ours, quiet=True)
    both = dials_traffic.dials(
        warehouse, learner=Softmax, predictor=Constants(), out=tmp_path / "both", settings=settings, quiet=True
    )
    assert contents(both.path) == contents(plain.path) and both.own_cost.functions_s > 0
    about = json.loads((both.path / "run.json").read_text())["python"]
    assert [(part["kind"], part["name"]) for part in about] == [("learner", "Softmax"), ("predictor", "Constants")]
    with pytest.raises(ValueError, match="was begun without one; leave it out"):
        dials_traffic.dials(warehouse, learner=Softmax, predictor=Constants(), out=plain.path, resume=True, quiet=True)
    program("report", both.path, plain.path, "--out", tmp_path / "report")
    report = (tmp_path / "report" / "report.md").read_text()
    assert "learner Softmax, predictor Constants" in report and "in Python" in report
    with pytest.raises(dials_traffic.SimulatorError, match="its influence predictor is in Python"):
        dials_traffic.vector_env(both.path, "r0c0", 1)


def test_a_predictor_with_a_memory_sees_what_came_before(warehouse, tmp_path):
    """Each row remembers at which step of its episode it is."""
    longest = []

    class Counts(Constants):
        def begin(self, agents, rows):
            if len(rows) == len(agents):
                self.steps = np.zeros(len(agents), int)
            self.steps[rows] = 0
            super().begin(agents, rows)

        def watch(self, d_set):
            self.steps += 1

        def sample(self, d_set, uniform):
            self.steps += 1
            longest.append(self.steps.max())
            return super().sample(d_set, uniform)

    # Periods end at 64, after 32 steps of each copy: in the middle of episodes of 20 steps.
    settings = {**INSIDE, "warehouse.horizon": 20, "total_steps": 128}
    dials_traffic.train(warehouse, out=tmp_path / "run", settings=settings, predictor=Counts(), workers=1, quiet=True)
    assert max(longest) == 20, "a new period goes on in the middle of an episode, and an episode ends after 20 steps"


def test_what_a_predictor_does_wrong_inside_a_run_is_said(warehouse, tmp_path):
    class NoLoss(Constants):
        loss = None

    class Diverged(Constants):
        def loss(self, dataset):
            return float("nan")

    class WideLoss(Constants):
        def loss(self, dataset):
            return np.zeros(1000)

    class Wide(Constants):
        def sample(self, d_set, uniform):
            return super().sample(d_set, uniform)[:1]

    for number, (predictor, error, words) in enumerate(
        [
            (Constants, TypeError, "predictor: Constants is a class; make an object of it"),
            (NoLoss(), TypeError, "predictor: NoLoss has no method loss"),
            (Diverged(), ValueError, "loss: of agent 'r0c0': nan; must be finite numbers; has it diverged"),
            (WideLoss(), ValueError, r"loss: returned the shape \(1000,\) instead of \("),
            (Wide(), ValueError, r"sample: returned the shape \(1, "),
        ]
    ):
        with pytest.raises(error, match=words):
            dials_traffic.train(warehouse, out=tmp_path / str(number), settings=INSIDE, predictor=predictor, quiet=True)
    with pytest.raises(ValueError, match="simulator = 'gs': a predictor drives local simulators"):
        dials_traffic.train(warehouse, out=tmp_path / "gs", settings={"simulator": "gs"}, predictor=Constants())
    with pytest.raises(ValueError, match="the config has a predictor in Python, and none was given: predictor="):
        dials_traffic.train(warehouse, out=tmp_path / "none", settings={"simulator": "outside-dials"}, quiet=True)


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


def test_more_episodes_than_the_memory_holds_are_refused_at_once(grid):
    with pytest.raises(ValueError, match="episodes 1000000000000: there is memory for at most"):
        dials_traffic.datasets(grid, 10**12)


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
