"""All agents on the global simulator."""

import os
import pickle
import signal
import warnings
from copy import deepcopy

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import dials_traffic

SHORT_SCENARIO = {"traffic.end_s": 180, "traffic.local_horizon": 12}


def first_allowed(infos):
    return {agent: int(np.flatnonzero(info["action_mask"])[0]) for agent, info in infos.items()}


def played(env, seed=None, choose=first_allowed):
    """Play an episode and return all that it showed."""
    observations, infos = env.reset(seed=seed)
    shown = [observations]
    rewards = dict.fromkeys(env.agents, 0.0)
    while env.agents:
        observations, of_step, _, _, infos = env.step(choose(infos))
        shown.append(observations)
        for agent, reward in of_step.items():
            rewards[agent] += reward
    return shown, rewards, infos


@pytest.fixture(params=["warehouse", "grid", "scenario"])
def env(request):
    settings = SHORT_SCENARIO if request.param == "scenario" else None
    env = dials_traffic.parallel_env(request.getfixturevalue(request.param), seed=5, settings=settings)
    yield env
    env.close()


def test_it_is_a_parallel_env_of_pettingzoo(env):
    with warnings.catch_warnings():
        # Its agents all end at once, and it draws actions without masks: lights and robots bear both.
        warnings.simplefilter("ignore")
        parallel_api_test(env, num_cycles=2 * env.horizon + 3)


def test_two_environments_of_a_seed_show_the_same(warehouse, grid):
    for config in (warehouse, grid):
        made = []

        def make():
            made.append(dials_traffic.parallel_env(config))
            return made[-1]

        parallel_seed_test(make)
        for env in made:
            env.close()


def test_a_copy_is_made_of_the_same_and_plays_the_same(env):
    shown, rewards, _ = played(env)
    for copy in [pickle.loads(pickle.dumps(env)), deepcopy(env)]:
        try:
            again, of_copy, _ = played(copy)
        finally:
            copy.close()
        assert rewards == of_copy
        assert all(np.array_equal(shown[-1][agent], again[-1][agent]) for agent in env.possible_agents)


def test_an_episode_follows_from_its_seed_and_number(env):
    def same(one, other):
        return all(np.array_equal(a[agent], b[agent]) for a, b in zip(one, other) for agent in a)

    first, of_first, _ = played(env, seed=1)
    second, _, _ = played(env)
    again, of_again, _ = played(env, seed=1)
    assert same(first, again) and of_first == of_again
    assert not same(first, second), "the next episode of a seed is another one"
    env.reset(seed=1)
    observations, infos = env.reset(options={"episode": 1})
    assert env.episode == 1
    later = [observations] + [env.step(first_allowed(infos))[0]]
    assert same(second[:2], later)


def test_what_was_returned_does_not_change_with_later_steps(env):
    observations, infos = env.reset(seed=1)
    kept = {agent: obs.copy() for agent, obs in observations.items()}
    masks = {agent: info["action_mask"].copy() for agent, info in infos.items()}
    later = infos
    for _ in range(10):
        _, _, _, _, later = env.step(first_allowed(later))
    assert all(np.array_equal(observations[agent], kept[agent]) for agent in kept)
    assert all(np.array_equal(infos[agent]["action_mask"], masks[agent]) for agent in masks)


def test_the_end_is_a_truncation_of_all_with_metrics(warehouse):
    env = dials_traffic.parallel_env(warehouse, seed=1)
    _, infos = env.reset()
    for step in range(env.horizon):
        assert "metrics" not in infos["r0c0"]
        _, _, terminations, truncations, infos = env.step(first_allowed(infos))
        over = step + 1 == env.horizon
        assert not any(terminations.values()) and list(truncations.values()) == [over] * 4
    assert env.agents == []
    assert infos["r0c0"]["metrics"].keys() == {"items"}
    assert infos["r0c0"]["system"].keys() == {"waiting_items", "mean_item_age"}
    with pytest.raises(RuntimeError, match="call reset"):
        env.step({})
    env.close()


def test_agents_are_named_as_in_sumo_and_have_their_own_spaces(scenario):
    env = dials_traffic.parallel_env(scenario, settings={"traffic.end_s": 60})
    text = scenario.with_suffix(".net.xml").read_text()
    assert all(f'<tlLogic id="{agent}"' in text for agent in env.possible_agents)
    observations, infos = env.reset(seed=1)
    for agent in env.agents:
        assert env.observation_space(agent).contains(observations[agent])
        assert infos[agent]["action_mask"].shape == (env.action_space(agent).n,)
        assert env.observation_space(agent) is env.observation_space(agent)
    env.close()


def test_a_controller_decides_for_some_agents(grid):
    """Under gap-out, the light of the agent changes though nobody switches it."""
    names = ["r0c0", "r0c1", "r1c0", "r1c1"]
    never = lambda infos: dict.fromkeys(infos, 0)  # noqa: E731
    env = dials_traffic.parallel_env(grid, seed=1, controller_for={"r0c0": "gap-out", "r1c1": "gap-out"})
    assert env.possible_agents == ["r0c1", "r1c0"]
    _, some, _ = played(env, choose=never)
    env.close()
    alone = dials_traffic.parallel_env(grid, seed=1)
    assert alone.possible_agents == names
    _, nobody, _ = played(alone, choose=never)
    alone.close()
    assert some.keys() == {"r0c1", "r1c0"} and any(some[agent] != nobody[agent] for agent in some)
    for wrong, reason in [
        ({"nobody": "gap-out"}, "agent `nobody`: there is none; the agents are `r0c0`"),
        ({"r0c0": "gap-out", "r0c1": "actuated"}, "need the same controller"),
        (dict.fromkeys(names, "gap-out"), "names all agents"),
        ({"r0c0": "no-such"}, "no-such"),
    ]:
        with pytest.raises(dials_traffic.SimulatorError, match=reason):
            dials_traffic.parallel_env(grid, controller_for=wrong)


def test_pictures_are_arrays_that_change_with_the_state(env_with_pictures):
    env = env_with_pictures
    _, infos = env.reset(seed=1)
    pictures = [env.render()]
    while env.agents and len(pictures) < 30:
        _, _, _, _, infos = env.step(first_allowed(infos))
        pictures.append(env.render())
    for picture in pictures:
        assert picture.dtype == np.uint8 and picture.shape == pictures[0].shape and picture.shape[2] == 3
        assert max(picture.shape) in (800, 272), "50 units, or the 17 cells of the warehouse, of 16 pixels each"
    assert len({picture.tobytes() for picture in pictures}) > 5
    blue = (pictures[-1] == [0x1F, 0x5F, 0xA8]).all(axis=2)
    assert blue.any(), "the colour of robots and of cars that drive"


@pytest.fixture(params=["warehouse", "grid", "scenario"])
def env_with_pictures(request):
    settings = SHORT_SCENARIO if request.param == "scenario" else None
    env = dials_traffic.parallel_env(request.getfixturevalue(request.param), settings=settings, render_mode="rgb_array")
    yield env
    env.close()


def test_pictures_are_drawn_only_if_they_were_asked_for(grid):
    env = dials_traffic.parallel_env(grid)
    env.reset(seed=1)
    assert env.render() is None
    env.close()
    with pytest.raises(ValueError, match="render_mode"):
        dials_traffic.parallel_env(grid, render_mode="human")


def test_what_cannot_be_done_is_an_error_that_says_so(grid, tmp_path):
    with pytest.raises(dials_traffic.SimulatorError, match="no.toml: cannot be read"):
        dials_traffic.parallel_env(tmp_path / "no.toml")
    with pytest.raises(dials_traffic.SimulatorError, match="neither a config nor a run directory"):
        dials_traffic.parallel_env(tmp_path)
    with pytest.raises(ValueError, match="settings: .*traffic.horizon = 0"):
        dials_traffic.parallel_env(grid, settings={"traffic.horizon": 0})
    with pytest.raises(TypeError, match="settings"):
        dials_traffic.parallel_env(grid, settings={"traffic.horizon": None})
    with pytest.raises(ValueError, match="2\\*\\*64"):
        dials_traffic.parallel_env(grid, seed=-1)
    env = dials_traffic.parallel_env(grid, seed=1)
    env.reset()
    for action in (2, -1, 256):
        with pytest.raises(ValueError, match=f"agent 'r0c0': action {action}; its actions are 0 to 1"):
            env.step({**dict.fromkeys(env.agents, 0), "r0c0": action})
    with pytest.raises(TypeError, match="agent 'r0c0': action 0.5; must be a whole number"):
        env.step(dict.fromkeys(env.agents, 0.5))
    env.reset()
    for options, reason in [
        ({"episode": -1}, "episode -1: must be from 0"),
        ({"Episode": 3}, "'Episode': there is none; known: episode"),
    ]:
        with pytest.raises(ValueError, match=reason):
            env.reset(options=options)
    with pytest.raises(TypeError, match="episode 1.5: must be a whole number"):
        env.reset(seed=9, options={"episode": 1.5})
    assert (env.seed, env.episode) == (1, 1)
    all_agents = dict.fromkeys(env.agents, 0)
    with pytest.raises(dials_traffic.SimulatorError, match="actions: there is none for 'r0c1', 'r1c0', 'r1c1'$"):
        env.step({"r0c0": 0})
    with pytest.raises(dials_traffic.SimulatorError, match="actions: there is no agent 'R0c0'"):
        env.step({**all_agents, "R0c0": 0})
    # Nothing of all that ended the episode.
    env.step(all_agents)
    env.close()
    for name in ("full_metrics", "record", "in_process"):
        with pytest.raises(TypeError, match=f"{name} 'yes': must be True or False"):
            dials_traffic.parallel_env(grid, **{name: "yes"})
    with pytest.raises(dials_traffic.SimulatorError, match="is closed"):
        env.reset()


def test_an_own_observation_may_use_its_array_again(grid):
    array = np.zeros((4, 1), np.float32)

    def counts(roads):
        array[:, 0] = roads.cars.per_row()
        return array

    def fresh(roads):
        return roads.cars.per_row()[:, None]

    shown = []
    for observation in (counts, fresh):
        env = dials_traffic.parallel_env(grid, seed=1, observation=observation)
        shown.append(played(env, choose=lambda infos: dict.fromkeys(infos, 0))[0])
        env.close()
    assert all(np.array_equal(one[agent], other[agent]) for one, other in zip(*shown) for agent in one)


@pytest.mark.parametrize("where", ["observation", "reward", "reset"])
def test_after_a_call_that_failed_or_was_interrupted_an_episode_begins_anew(grid, where):
    """Also in the last step, and if the simulator has answered already."""
    fails = []

    def mine(kind):
        if fails and where in (kind, "reset"):
            raise fails.pop()
        return np.zeros(4)

    env = dials_traffic.parallel_env(
        grid,
        seed=1,
        observation=lambda roads: mine("observation")[:, None],
        reward=lambda before, after: mine("reward"),
        settings={"traffic.horizon": 3},
    )
    env.reset()
    zeros = dict.fromkeys(env.agents, 0)
    for error in (KeyboardInterrupt(), ValueError("mine")):
        for _ in range(2):
            env.step(zeros)
        fails.append(error)
        with pytest.raises(type(error)):
            env.reset() if where == "reset" else env.step(zeros)
        with pytest.raises(dials_traffic.SimulatorError, match="was not finished; call reset"):
            env.step(zeros)
        with pytest.raises(RuntimeError, match="play an episode to its end"):
            env.save_replay("none")
        env.reset()
        steps = 0
        while env.agents:
            env.step(zeros)
            steps += 1
        assert steps == 3
        env.reset()
    env.close()


def test_settings_reach_the_simulator_in_every_type(grid):
    def at_first(settings):
        env = dials_traffic.parallel_env(grid, seed=1, settings={"traffic.horizon": np.int64(3), **settings})
        env.reset()
        rewards = [env.step(dict.fromkeys(env.agents, 0))[1] for _ in range(env.horizon)]
        env.close()
        return rewards

    half = np.float64(0.5)
    mixed = at_first({"traffic.reward": {"mean-speed": half, "pressure": half}})
    assert len(mixed) == 3 and mixed == at_first({"traffic.reward": {"mean-speed": 0.5, "pressure": 0.5}})
    assert mixed != at_first({})
    assert at_first({"policy.hidden": [np.int32(8), np.int64(8)]})
    # The error names a file that is missing as it was given, so all characters came through.
    for name in ("\U0001f6a6", 'a\x7fb"\u00e9'):
        with pytest.raises(dials_traffic.SimulatorError, match=f"^{name}.net.xml: no such network"):
            at_first({"traffic.network": name})


def test_it_becomes_an_aec_env(warehouse):
    env = dials_traffic.aec_env(warehouse, seed=1)
    env.reset()
    for agent in env.agent_iter(max_iter=20):
        _, _, termination, truncation, info = env.last()
        env.step(None if termination or truncation else int(np.flatnonzero(info["action_mask"])[0]))
    env.close()


def test_many_environments_step_together(grid):
    alone = []
    for seed in (3, 4, 5):
        env = dials_traffic.parallel_env(grid, seed=seed)
        alone.append(played(env))
        env.close()
    many = dials_traffic.vector_parallel_env(grid, 3, seed=3)
    obs, infos = many.reset()
    for step in range(1, many.horizon + 1):
        actions = {agent: masks.argmax(axis=1) for agent, masks in infos["action_mask"].items()}
        obs, rewards, _, truncations, infos = many.step(actions)
        over = step == many.horizon
        shown = infos["final_obs"] if over else obs
        for copy, (expected, _, _) in enumerate(alone):
            assert all(np.array_equal(shown[agent][copy], expected[step][agent]) for agent in many.agents)
        assert all(truncations[agent].tolist() == [over] * 3 for agent in many.agents)
    for copy, (_, _, expected) in enumerate(alone):
        assert infos["episodes"][copy]["r0c0"]["system"] == expected["r0c0"]["system"]
    again, _ = many.reset(seed=3)
    assert all(np.array_equal(again[agent][2], alone[2][0][0][agent]) for agent in many.agents)
    many.close()


@pytest.mark.parametrize("seed", [np.uint64(2**63 + 5), np.int32(7)])
def test_seeds_of_many_environments_may_be_numbers_of_numpy(grid, seed):
    many = dials_traffic.vector_parallel_env(grid, np.int64(2), seed=seed)
    expected = [int(seed), int(seed) + 1]
    assert [env.seed for env in many.envs] == expected
    many.reset(seed=0)
    many.reset(seed=seed)
    assert [env.seed for env in many.envs] == expected
    with pytest.raises(ValueError, match="seed -1: must be from 0"):
        many.reset(seed=-1)
    assert [env.seed for env in many.envs] == expected
    many.close()


def test_actions_that_are_refused_move_none_of_many_environments(grid):
    many = dials_traffic.vector_parallel_env(grid, 2, seed=1)
    many.reset()
    good = {agent: [0, 0] for agent in many.agents}
    for actions, error, reason in [
        ({**good, "r1c1": [0, 5]}, ValueError, "agent 'r1c1': action 5"),
        ({**good, "r1c1": [0, 0, 0]}, ValueError, "agent 'r1c1': 3 actions for 2 copies"),
        ({"r1c1": [0, 0]}, dials_traffic.SimulatorError, "there is none for 'r0c0'"),
        ({**good, "nobody": [0, 0]}, dials_traffic.SimulatorError, "there is no agent 'nobody'"),
    ]:
        with pytest.raises(error, match=reason):
            many.step(actions)
    steps, over = 0, False
    while not over:
        _, _, _, truncations, _ = many.step(good)
        steps, over = steps + 1, truncations["r0c0"].all()
    assert steps == many.horizon
    many.close()
    with pytest.raises(TypeError, match="n 2.0: must be a whole number"):
        dials_traffic.vector_parallel_env(grid, 2.0)


def test_an_interrupted_step_of_many_environments_needs_a_reset(grid, monkeypatch):
    many = dials_traffic.vector_parallel_env(grid, 2, seed=1)
    expected, _ = many.reset(seed=1)
    actions = {agent: [0, 0] for agent in many.agents}
    with monkeypatch.context() as patched:
        patched.setattr(many, "_joined", None)  # as if Ctrl-C had come when all copies had answered
        with pytest.raises(TypeError):
            many.step(actions)
    with pytest.raises(dials_traffic.SimulatorError, match="was not finished; call reset"):
        many.step(actions)
    again, _ = many.reset(seed=1)
    assert all(np.array_equal(again[agent], expected[agent]) for agent in many.agents)
    many.step(actions)
    os.kill(many.envs[1].pid, signal.SIGKILL)
    with pytest.raises(dials_traffic.ProcessDied, match="copy 1 of the environment of"):
        while True:
            many.step(actions)
    many.close()
