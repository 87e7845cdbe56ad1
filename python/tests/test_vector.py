"""Local simulators of one agent or of all."""

import copy
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from conftest import SCENARIO_SETTINGS
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import DictInfoToList

import dials_traffic

#: Settings with which constants are measured in a moment.
FEW = {"aip.dataset_steps": 80, "aip.batch": 16}
RUNS = ["warehouse_run", "grid_run", "scenario_run"]
AGENT = {"warehouse_run": "r0c1", "grid_run": "r0c1"}


def agent_of(kind, path):
    return AGENT.get(kind) or dials_traffic.load(path).agents[0]


def played(env, steps, seed=None):
    """Play some steps with the first allowed action. Return all that was shown, with the rewards and the ends."""
    obs, infos = env.reset(seed=seed)
    shown = [(obs, None, None, infos)]
    for _ in range(steps):
        obs, rewards, terminations, truncations, infos = env.step(infos["action_mask"].argmax(axis=1))
        assert not terminations.any()
        shown.append((obs, rewards, truncations, infos))
    return shown


@pytest.mark.parametrize("kind", RUNS)
def test_copies_follow_from_their_seed_and_begin_again_by_themselves(kind, request):
    path = request.getfixturevalue(kind)
    env = dials_traffic.vector_env(path, agent_of(kind, path), 4, seed=3)
    assert isinstance(env, gymnasium.vector.VectorEnv) and env.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    steps = 2 * env.horizon + 1
    one, other, again = played(env, steps), played(env, steps), played(env, steps, seed=3)
    env.close()
    same = [all(np.array_equal(a[0], b[0]) for a, b in zip(one, two)) for two in (other, again)]
    assert same == [False, True], "a seed repeats, and the episodes after it are others"
    for number, (obs, rewards, truncations, infos) in enumerate(one[1:], 1):
        assert obs.shape == env.observation_space.shape and env.observation_space.contains(obs)
        assert rewards.dtype == np.float64 and rewards.shape == (4,)
        over = number % env.horizon == 0
        assert truncations.tolist() == [over] * 4 and ("final_obs" in infos) == over
        assert infos["action_mask"].shape == (4, env.single_action_space.n)
        if over:
            assert infos["final_obs"].shape == obs.shape and infos["_final_obs"].all()
            # Another episode begins: for these domains with empty roads and shelves.
            assert not np.array_equal(infos["final_obs"], obs)
    rows = np.stack([obs for obs, *_ in one])
    assert any(not np.array_equal(rows[:, 0], rows[:, copy]) for copy in (1, 2, 3)), "copies meet different influences"


def test_what_is_copied_or_pickled_is_a_new_environment_of_the_same(grid_run):
    """Before its first episode, whatever the one that is copied has played."""
    rows = dials_traffic.vector_env(grid_run, "r0c1", 2, seed=3)
    one = dials_traffic.local_env(grid_run, "r0c1", seed=3)
    many = dials_traffic.vector_parallel_env(grid_run / "config.toml", 2, seed=3)
    turns = dials_traffic.aec_env(grid_run / "config.toml", seed=3)
    shown = [played(rows, 3)[-1][0], one.reset()[0], many.reset()[0]["r0c1"]]
    turns.reset()
    shown.append(turns.last()[0])
    turns.step(0)
    for again in (copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))):
        copies = [again(env) for env in (rows, one, many, turns)]
        with pytest.raises(dials_traffic.SimulatorError, match="call reset"):
            copies[3].last()
        copies[3].reset()
        seen = [played(copies[0], 3)[-1][0], copies[1].reset()[0], copies[2].reset()[0]["r0c1"], copies[3].last()[0]]
        assert all(np.array_equal(before, now) for before, now in zip(shown, seen))
        for env in copies:
            env.close()
    for env in (rows, one, many, turns):
        env.close()


def test_staggered_copies_end_at_different_times(warehouse_run):
    env = dials_traffic.vector_env(warehouse_run, "r0c0", 4, seed=1, stagger=True)
    ends = np.stack([ends for _, _, ends, _ in played(env, env.horizon)[1:]])
    env.close()
    # Copy c begins as if c / 4 of the 16 steps had passed.
    assert [np.flatnonzero(ends[:, copy])[0] + 1 for copy in range(4)] == [16, 12, 8, 4]


def test_all_agents_at_once_are_rows_of_one_table(warehouse_run):
    env = dials_traffic.vector_env(warehouse_run, None, 3, seed=1)
    assert env.agents == ["r0c0", "r0c1", "r1c0", "r1c1"] and env.num_envs == 12
    together = np.stack([obs for obs, *_ in played(env, 16)])
    env.close()
    two = dials_traffic.vector_env(warehouse_run, ["r0c1", "r1c0"], 3, seed=1)
    of_two = np.stack([obs for obs, *_ in played(two, 16)])
    two.close()
    assert together.shape == (17, 12, 37) and of_two.shape == (17, 6, 37)
    assert np.array_equal(together[:, 3:9], of_two), "a row depends on its agent and copy, not on the other rows"


@pytest.mark.parametrize("predictor", ["marginals", "untrained"])
def test_simulators_run_without_a_run(predictor, grid):
    env = dials_traffic.vector_env(grid, "r0c0", 2, predictor, seed=1, settings=FEW)
    cars = sum(obs[:, :36].sum() for obs, *_ in played(env, 40))
    assert cars > 0, "cars come in"
    counters = env.counters()
    assert counters and all(isinstance(count, int) for count in counters.values())
    env.close()


def test_marginals_are_measured_on_the_global_simulator(grid):
    """A car comes every 10 s to each end of a road. Where nobody measured, one comes every other second."""
    cars = {}
    for predictor in ("marginals", "untrained"):
        env = dials_traffic.vector_env(grid, "r0c0", 8, predictor, seed=1, settings=FEW)
        # The cars that have just come in: the cells next to the entry cell, of each of the four lanes.
        cars[predictor] = np.mean([obs[:, [8, 17, 26, 35]].sum(axis=1) for obs, *_ in played(env, 40)])
        env.close()
    assert cars["marginals"] < cars["untrained"], cars


def test_a_single_simulator_is_an_env_of_gymnasium(grid_run, warehouse_run, scenario_run):
    for path, agent in ((grid_run, "r0c0"), (warehouse_run, "r0c0"), (scenario_run, None)):
        env = dials_traffic.local_env(path, agent or dials_traffic.load(path).agents[0], seed=1)
        with warnings.catch_warnings():
            # It is made without gymnasium.make and draws no pictures.
            warnings.simplefilter("ignore")
            check_env(env, skip_render_check=True, skip_close_check=True)
        env.close()


def test_a_single_simulator_is_a_row_of_a_table_of_one(warehouse_run):
    table = dials_traffic.vector_env(warehouse_run, "r0c0", 1, seed=9)
    expected = played(table, 40)
    table.close()
    env = dials_traffic.local_env(warehouse_run, "r0c0", seed=9)
    obs, info = env.reset()
    for before, (of_table, rewards, ends, infos) in zip(expected, expected[1:]):
        assert np.array_equal(obs, before[0][0]) and np.array_equal(info["action_mask"], before[3]["action_mask"][0])
        obs, reward, terminated, truncated, info = env.step(info["action_mask"].argmax())
        assert (reward, terminated, truncated) == (rewards[0], False, ends[0])
        if truncated:
            assert np.array_equal(obs, infos["final_obs"][0])
            with pytest.raises(RuntimeError, match="call reset"):
                env.step(0)
            obs, info = env.reset()
    env.close()


def test_the_last_mask_of_an_episode_is_of_its_own_end(scenario_run):
    """At the end a light may have to keep its green. At the beginning of the next episode it is another one."""
    env = dials_traffic.vector_env(scenario_run, None, 2, seed=1)
    dice, others = np.random.default_rng(1), 0
    _, infos = env.reset()
    for step in range(1, 6 * env.horizon + 1):
        masks = infos["action_mask"]
        *_, infos = env.step((dice.random(masks.shape) * masks).argmax(axis=1))
        if step % env.horizon == 0:
            last = infos["final_info"]["action_mask"]
            assert last.any(axis=1).all()
            others += np.any(last != infos["action_mask"], axis=1).sum()
    env.close()
    assert others > 0


def test_a_reset_that_failed_shows_no_earlier_episode(warehouse_run, monkeypatch):
    env = dials_traffic.local_env(warehouse_run, "r0c0", seed=1)
    env.reset()
    while not env.step(0)[3]:
        pass
    with monkeypatch.context() as patched:
        patched.setattr(env._rows, "reset", None)
        with pytest.raises(TypeError):
            env.reset(seed=5)
    env.reset()
    env.step(0)
    env.close()


def test_what_cannot_be_done_is_an_error_that_says_so(grid, grid_run, scenario, tmp_path):
    make = dials_traffic.vector_env
    for arguments, reason in [
        ((grid_run, "nobody", 2), "agent `nobody`: there is none"),
        ((grid, "r0c0", 2, tmp_path), "not a run directory"),
        ((grid, "r0c0", 2), "not a run directory"),
        ((grid_run, ["r0c1", "r0c0"], 2), "name each once, in the order"),
        ((scenario, None, 2, grid_run), "is a run of other agents"),
    ]:
        with pytest.raises(dials_traffic.SimulatorError, match=reason):
            make(*arguments)
    for copies, error in [(0, ValueError), (-1, ValueError), (2.0, TypeError)]:
        with pytest.raises(error, match=f"copies {copies}: must be"):
            make(grid_run, "r0c0", copies)
    with pytest.raises(ValueError, match="agents: there is none in the list"):
        make(grid_run, [], 2)
    for agent in (None, [], ["r0c0"]):
        with pytest.raises(TypeError, match="must be the name of one agent"):
            dials_traffic.local_env(grid_run, agent)
    with pytest.raises(TypeError, match="stagger 1: must be True or False"):
        make(grid_run, "r0c0", 2, stagger=1)
    env = make(grid_run, "r0c0", np.int64(2), seed=1)
    with pytest.raises(dials_traffic.SimulatorError, match="no episode under way; call reset"):
        env.step([0, 0])
    with pytest.raises(ValueError, match="one number"):
        env.reset(seed=[1, 2])
    env.reset()
    with pytest.raises(ValueError, match="of shape"):
        env.step([0])
    with pytest.raises(ValueError, match="from 0 to 1"):
        env.step([0, -1])
    for actions in ([0.9, 0.9], ["0", "1"], [None, None]):
        with pytest.raises(TypeError, match="must be whole numbers"):
            env.step(actions)
    env.step([True, False])
    with pytest.raises(ValueError, match="'episode': there is none; known: none"):
        env.reset(options={"episode": 1})
    env.reset(seed=np.uint64(2**63))
    assert env.np_random_seed == env.seed == 2**63
    env.step_async([0, 0])
    with pytest.raises(dials_traffic.SimulatorError, match="was not finished; call reset"):
        env.step([0, 0])
    env.reset()
    env.step([0, 0])
    env.close()


def test_scenario_settings_reach_the_simulators(scenario):
    settings = {**SCENARIO_SETTINGS, "aip.batch": 16}
    env = dials_traffic.vector_env(scenario, None, 1, "untrained", seed=1, settings=settings)
    assert env.horizon == SCENARIO_SETTINGS["traffic.local_horizon"]
    env.close()


def test_infos_are_those_of_gymnasiums_own_vector_environments(warehouse_run):
    ours = dials_traffic.vector_env(warehouse_run, "r0c0", 1, seed=2)
    theirs = SyncVectorEnv(
        [lambda: dials_traffic.local_env(warehouse_run, "r0c0", seed=2)], autoreset_mode=AutoresetMode.SAME_STEP
    )
    lists = DictInfoToList(dials_traffic.vector_env(warehouse_run, "r0c0", 2, seed=2))
    (_, infos), (_, expected), (_, listed) = ours.reset(), theirs.reset(), lists.reset()
    horizon = ours.horizon
    for step in range(1, horizon + 2):
        assert infos.keys() == expected.keys()
        for key in expected.keys() - {"final_obs", "final_info"}:
            assert np.array_equal(infos[key], expected[key]), (step, key)
        assert [of_row.keys() for of_row in listed] == [{key for key in infos if key[0] != "_"}] * 2
        if step == horizon + 1:
            assert np.array_equal(infos["final_obs"][0], expected["final_obs"][0])
            one, other = infos["final_info"], expected["final_info"]
            assert one.keys() == other.keys() and all(np.array_equal(one[key], other[key]) for key in one)
        _, _, _, _, infos = ours.step([0])
        _, _, _, _, expected = theirs.step([0])
        _, _, _, _, listed = lists.step([0, 0])
    for env in (ours, theirs, lists):
        env.close()
