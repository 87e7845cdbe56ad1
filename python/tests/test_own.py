"""Rewards and observations of one's own: what they see, where they work, and what is refused."""

import json
import pickle

import numpy as np
import pytest

import dials_traffic
from conftest import ROOT, SCENARIO_SETTINGS

TOWN = ROOT / "configs/town.toml"


def mean_speed(before, now):
    """Ours on a grid: the mean speed of the cars on the approaches, as a share of the limit; 0 without cars."""
    shares = now.cars.per_row(now.cars.speed_mps / now.cars.limit_mps)
    return shares / np.maximum(now.cars.per_row(), 1)


def queue(before, now):
    """Ours on a scenario by default: 0.1 times minus the standing cars in tens."""
    return -0.01 * now.cars.per_row(now.cars.speed_mps < 0.1)


def counts(roads):
    """One column: the cars of the row. Two more: the green, and the row's agent."""
    return np.stack([roads.cars.per_row(), roads.green, roads.agent], axis=1)


def cells(roads):
    """Ours on a grid: cells of 10 m from the stop line, nine on each of four approaches."""
    bits = np.zeros((roads.rows, 4, 9))
    first = np.searchsorted(roads.approaches.row, np.arange(roads.rows))
    lane = roads.cars.lane - first[roads.cars.row]
    cell = (roads.cars.to_stop_line_m // 10).astype(int)
    seen = cell < 9
    bits[roads.cars.row[seen], lane[seen], cell[seen]] = 1
    return bits.reshape(roads.rows, -1)


def play(env, steps, seed=0):
    """Play random actions and return observations and rewards of all steps."""
    random = np.random.default_rng(seed)
    obs, infos = env.reset()
    shown = [obs]
    paid = []
    for _ in range(steps):
        masks = infos["action_mask"]
        actions = np.array([random.choice(np.flatnonzero(mask)) for mask in masks])
        obs, rewards, _, ends, infos = env.step(actions)
        shown.append((obs, infos.get("final_obs"), ends))
        paid.append(rewards)
    return shown, np.array(paid)


def test_an_own_reward_and_observation_on_the_gs_see_what_ours_are_made_of(grid):
    ours = dials_traffic.parallel_env(grid, seed=1)
    own = dials_traffic.parallel_env(grid, seed=1, observation=cells, reward=mean_speed)
    assert own.observation_space("r0c0").shape == (36,)
    (expected, _), (observations, _) = ours.reset(), own.reset()
    cars = 0
    for step in range(own.horizon):
        for agent, obs in observations.items():
            assert obs.dtype == np.float32 and own.observation_space(agent).contains(obs)
            assert np.array_equal(obs, expected[agent][:36])
            cars += obs.sum()
        assert np.array_equal(own.state(), np.concatenate([observations[agent] for agent in own.possible_agents]))
        actions = dict.fromkeys(own.agents, int(step % 10 == 0))
        expected, paid, _, _, _ = ours.step(actions)
        observations, rewards, _, _, _ = own.step(actions)
        assert all(rewards[agent] == pytest.approx(paid[agent], abs=1e-6) for agent in paid)
    assert cars > 100
    assert 0 < own.own_cost.share < 1 and ours.own_cost.functions_s == 0
    ours.close()
    own.close()


def test_local_simulators_pay_an_own_reward_as_they_pay_ours(grid_run):
    """Also in the step in which episodes end: the reward and the last observation are of the old episode."""
    options = {"copies": 3, "seed": 5, "stagger": True}
    ours = dials_traffic.vector_env(grid_run, ["r0c0", "r1c1"], **options)
    own = dials_traffic.vector_env(grid_run, ["r0c0", "r1c1"], reward=mean_speed, observation=cells, **options)
    assert own.single_observation_space.shape == (36,)
    steps = 2 * ours.horizon + 5
    (shown, paid), (own_shown, own_paid) = play(ours, steps), play(own, steps)
    np.testing.assert_allclose(own_paid, paid, atol=1e-6)
    ended = 0
    for (obs, final, ends), (own_obs, own_final, own_ends) in zip(shown[1:], own_shown[1:]):
        assert np.array_equal(ends, own_ends) and np.array_equal(own_obs, obs[:, :36])
        if ends.any():
            assert np.array_equal(own_final[ends], final[ends, :36])
            ended += ends.sum()
    assert ended >= 12 and paid.max() > 0
    assert np.array_equal(own.action_masks(), own._infos()["action_mask"] == 1)
    ours.close()
    own.close()


def test_local_simulators_of_a_scenario_know_types_and_exits(scenario_run):
    seen = []

    def look(before, now):
        seen.append(now)
        return queue(before, now)

    options = {"copies": 2, "seed": 1}
    ours = dials_traffic.vector_env(scenario_run, None, **options)
    own = dials_traffic.vector_env(scenario_run, None, reward=look, **options)
    (_, paid), (_, own_paid) = play(ours, 11), play(own, 11)
    np.testing.assert_allclose(own_paid, paid, atol=1e-6)
    assert paid.min() < 0
    last = seen[-1]
    assert last.rows == 32 and len(last.cars) > 20
    known = last.cars.exit >= 0
    assert known.mean() > 0.9
    assert np.array_equal(last.exits.row[last.cars.exit[known]], last.cars.row[known])
    assert set(last.type_classes[kind] for kind in last.cars.type) == {"passenger"}
    ours.close()
    own.close()


def test_the_gs_of_a_scenario_shows_lanes_vehicles_and_waiting(scenario):
    seen = []

    def look(before, now):
        seen.append((before, now))
        return queue(before, now)

    settings = {"traffic.end_s": 180}
    ours = dials_traffic.parallel_env(scenario, seed=1, settings=settings)
    own = dials_traffic.parallel_env(scenario, seed=1, reward=look, settings=settings)
    for env in (ours, own):
        env.reset()
    while own.agents:
        zeros = dict.fromkeys(own.agents, 0)
        _, paid, _, _, _ = ours.step(zeros)
        _, rewards, _, _, _ = own.step(zeros)
        assert all(rewards[agent] == pytest.approx(paid[agent], abs=1e-6) for agent in paid)
    assert all(now is before for (_, now), (before, _) in zip(seen, seen[1:]))
    now = seen[-1][1]
    cars, lanes = now.cars, now.approaches
    assert now.rows == 16 and list(now.agent) == list(range(16)) and now.agents == own.possible_agents
    assert np.all((0 <= cars.position_m) & (cars.position_m <= lanes.length_m[cars.lane] + 1e-3))
    assert np.array_equal(cars.per_lane(), np.bincount(cars.lane, minlength=len(lanes)))
    assert np.array_equal(cars.per_row(), lanes.per_row(cars.per_lane()))
    assert len(now.leaving) > 0 and np.all(now.leaving.waited_s == 0) and np.all(now.leaving.exit == -1)
    # Red for minutes: somebody stands for a minute, and nobody longer than the episode.
    assert 60 < cars.waited_s[cars.speed_mps < 0.1].max() <= 180
    assert (cars.exit >= 0).mean() > 0.9
    assert lanes.serves.any(axis=1).all() and not now.exits.serves.any()
    with pytest.raises(ValueError, match="read-only"):
        cars.position_m[0] = 0
    ours.close()
    own.close()


def test_neighbours_say_who_feeds_whom_and_how_far_away(grid):
    """The smoke config is a grid of two by two with roads of 100 m and 10 m/s."""
    env = dials_traffic.parallel_env(grid, seed=1)
    neighbours = env.neighbours()
    names = [(neighbours.agents[one], neighbours.agents[other]) for one, other in zip(neighbours.feeds, neighbours.fed)]
    beside = {"r0c0": ["r0c1", "r1c0"], "r0c1": ["r0c0", "r1c1"], "r1c0": ["r0c0", "r1c1"], "r1c1": ["r0c1", "r1c0"]}
    assert sorted(names) == sorted((one, other) for one in beside for other in beside[one])
    assert np.all(neighbours.metres == 100) and np.allclose(neighbours.seconds, 10)
    assert neighbours.matrix().sum() == 8 and np.array_equal(neighbours.matrix(), neighbours.matrix().T)
    env.close()


def test_the_state_is_all_observations_one_after_another(grid):
    env = dials_traffic.parallel_env(grid, seed=1)
    with pytest.raises(dials_traffic.SimulatorError, match="call reset"):
        env.state()
    observations, _ = env.reset()
    assert env.state_space.contains(env.state())
    assert np.array_equal(env.state(), np.concatenate(list(observations.values())))
    env.close()


def test_copies_of_the_gs_and_turns_have_own_rewards_too(grid):
    envs = dials_traffic.vector_parallel_env(grid, 2, seed=1, reward=mean_speed, observation=counts)
    observations, infos = envs.reset()
    assert observations["r0c0"].shape == (2, 3) and envs.state().shape == (2, 12)
    actions = {agent: masks.argmax(axis=1) for agent, masks in infos["action_mask"].items()}
    for _ in range(20):
        _, rewards, _, _, _ = envs.step(actions)
    assert all(paid.shape == (2,) for paid in rewards.values()) and max(paid.max() for paid in rewards.values()) > 0
    assert envs.own_cost.functions_s > 0
    envs.close()
    env = dials_traffic.aec_env(grid, seed=1, observation=counts)
    env.reset()
    assert env.last()[0].shape == (3,) and env.state().shape == (12,)
    env.close()


def test_a_registered_function_has_a_name_for_settings_and_configs(grid, tmp_path):
    dials_traffic.register_reward("test-speed", mean_speed)
    dials_traffic.register_observation("test-counts", counts)
    named = tmp_path / "named.toml"
    text = grid.read_text().replace("[traffic]", '[traffic]\nreward = "python:test-speed"')
    named.write_text(text)
    names = {"traffic.reward": "python:test-speed"}
    made = [
        dials_traffic.parallel_env(named, seed=1),
        dials_traffic.parallel_env(grid, seed=1, settings=names),
        dials_traffic.parallel_env(grid, seed=1, reward="test-speed"),
        dials_traffic.parallel_env(grid, seed=1, reward=mean_speed),
    ]
    paid = []
    for env in made:
        env.reset()
        rewards = [env.step(dict.fromkeys(env.agents, 0))[1] for _ in range(20)]
        paid.append(rewards)
        env.close()
    assert paid[0] == paid[1] == paid[2] == paid[3] and max(paid[0][-1].values()) > 0
    env = dials_traffic.local_env(grid, "r0c0", "untrained", settings={"traffic.observation": "python:test-counts"})
    assert env.observation_space.shape == (3,)
    env.reset()
    assert env.step(0)[0].shape == (3,)
    env.close()


def test_a_name_that_nobody_registered_is_a_value_error_that_says_what_to_call(grid):
    with pytest.raises(ValueError, match=r"reward 'nobody': no function of this name .*\.register_reward"):
        dials_traffic.parallel_env(grid, settings={"traffic.reward": "python:nobody"})
    with pytest.raises(ValueError, match="observation 'nobody': no function of this name"):
        dials_traffic.local_env(grid, "r0c0", "untrained", observation="nobody")
    with pytest.raises(ValueError, match="must have letters"):
        dials_traffic.register_reward("a b", mean_speed)
    with pytest.raises(TypeError, match="must be a function"):
        dials_traffic.register_reward("mine", 3)


@pytest.mark.parametrize(
    "reward, error, message",
    [
        (lambda before, now: np.where(now.agent == 2, np.nan, 0.0), ValueError, r"reward: row 2 \(agent 'r1c0'\): nan"),
        (lambda before, now: 0.0, ValueError, r"reward: of shape \(\) instead of \(4,\), one number per row"),
        (lambda before, now: np.zeros((4, 1)), ValueError, r"of shape \(4, 1\)"),
        (lambda before, now: ["a"] * 4, TypeError, "reward: must return numbers, not <U1"),
    ],
)
def test_what_is_no_reward_is_refused_and_named(grid, reward, error, message):
    env = dials_traffic.parallel_env(grid, seed=1, reward=reward)
    env.reset()
    with pytest.raises(error, match=message):
        env.step(dict.fromkeys(env.agents, 0))
    with pytest.raises(dials_traffic.SimulatorError, match="was not finished; call reset"):
        env.step(dict.fromkeys(env.agents, 0))
    env.close()


def test_an_observation_of_another_width_or_of_infinities_is_refused(grid):
    width = [3]
    env = dials_traffic.parallel_env(grid, seed=1, observation=lambda roads: np.zeros((roads.rows, width[0])))
    env.reset()
    width[0] = 2
    with pytest.raises(ValueError, match=r"observation: of shape \(4, 2\) instead of \(4, 3\), .* always be the same"):
        env.step(dict.fromkeys(env.agents, 0))
    env.close()
    with pytest.raises(ValueError, match=r"row 1 \(agent 'r0c1'\), column 0: inf; must be a finite number"):
        dials_traffic.parallel_env(grid, observation=lambda roads: np.where(roads.agent == 1, np.inf, 0)[:, None])


def test_a_wrong_setting_is_a_value_error_that_names_its_key(grid):
    for settings, key in [
        ({"traffic.horizon": "long"}, "traffic.horizon"),
        ({"traffic.reward": "nonsense"}, "traffic.reward"),
        ({"traffic.horizont": 3}, "horizont"),
        ({"traffic.horizon": 0}, "traffic.horizon"),
    ]:
        with pytest.raises(ValueError, match=f"settings: .*{key}"):
            dials_traffic.parallel_env(grid, settings=settings)
    with pytest.raises(ValueError, match="settings: .*ppo.clip"):
        dials_traffic.local_env(grid, "r0c0", "untrained", settings={"ppo.clip": "x"})


def test_the_warehouse_has_no_roads(warehouse):
    for make in (
        lambda: dials_traffic.parallel_env(warehouse, reward=lambda before, now: 0),
        lambda: dials_traffic.local_env(warehouse, "robot", "untrained", reward=lambda before, now: 0),
    ):
        with pytest.raises(dials_traffic.SimulatorError, match="has no roads|there is none"):
            make()
    env = dials_traffic.parallel_env(warehouse)
    with pytest.raises(dials_traffic.SimulatorError, match="has no roads"):
        env.neighbours()
    env.close()


def test_an_environment_with_own_functions_is_copied_with_them(grid):
    env = dials_traffic.parallel_env(grid, seed=1, observation=counts, reward=mean_speed)
    copy = pickle.loads(pickle.dumps(env))
    (one, _), (other, _) = env.reset(), copy.reset()
    assert all(np.array_equal(one[agent], other[agent]) for agent in one)
    env.close()
    copy.close()


SHORT = {
    **SCENARIO_SETTINGS,
    "simulator": "dials",
    "total_steps": 128,
    "policy.hidden": [16],
    "aip.hidden": [16],
    "aip.epochs": 1,
    "aip.batch": 16,
    "local_simulators.copies": 4,
    "ppo.memory": 64,
    "ppo.rollout_steps": 16,
    "ppo.minibatch": 32,
    "evaluation.every_steps": 128,
    "evaluation.episodes": 1,
    "evaluation.final_episodes": 1,
    "evaluation.aip_loss_episodes": 0,
}


def test_training_with_a_reward_of_ones_own_is_the_same_for_one_and_two_workers(scenario, tmp_path, capfd):
    seen = set()

    def squares(before, now):
        seen.add(len(set(now.agent)) < now.rows)
        waits = now.cars.per_row(now.cars.speed_mps < 0.1)
        return -0.001 * waits**2

    runs = [
        dials_traffic.train(
            scenario, out=tmp_path / f"{workers}", reward=squares, observation=counts, settings=SHORT, workers=workers
        )
        for workers in (1, 2)
    ]
    assert "own functions took" in capfd.readouterr().err
    assert runs[0].own_cost.functions_s > 0
    # Local simulators have several copies of a light, and the GS has one.
    assert seen == {True, False}
    for agent in runs[0].agents:
        one, two = (run.weights(agent) for run in runs)
        assert one["layers.0.weight"].shape[0] == 3
        assert all(np.array_equal(one[name], two[name]) for name in one)
    about = json.loads((runs[0].path / "run.json").read_text())
    assert [function["name"] for function in about["python"]] == ["squares", "counts"]
    assert "waits**2" in about["python"][0]["source"]
    played = runs[0].play(settings={"traffic.end_s": 60})
    assert set(played.returns) == set(runs[0].agents)


def test_a_reward_that_fails_ends_the_run_with_its_own_error(scenario, tmp_path):
    calls = []

    def fails(before, now):
        calls.append(None)
        return 1 / 0 if len(calls) > 20 else np.zeros(now.rows)

    with pytest.raises(ZeroDivisionError):
        dials_traffic.train(scenario, out=tmp_path / "run", reward=fails, settings=SHORT, workers=0, quiet=True)
