"""What policies are shown: NaN, infinity, wrong shapes, and masks that allow nothing."""

import re
import warnings

import numpy as np
import pytest

import dials_traffic

WRONG = [np.nan, np.inf, -np.inf, 1e300, -1.1e6]


def shown_in(run, steps=3):
    """Return what the first steps of an episode show."""
    env = dials_traffic.parallel_env(run, seed=3)
    shown = [env.reset()]
    for _ in range(steps):
        actions = {agent: int(np.flatnonzero(info["action_mask"])[0]) for agent, info in shown[-1][1].items()}
        observations, _, _, _, infos = env.step(actions)
        shown.append((observations, infos))
    env.close()
    return shown


def changed(table, column, value):
    table = np.array(table, np.float64)
    table[column] = value
    return table


@pytest.fixture
def no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.parametrize("kind", ["warehouse_run", "grid_run", "scenario_run"])
def test_a_refused_observation_leaves_a_controller_as_it_was(kind, request, no_warnings):
    """The warehouse's policies have a memory, and all policies draw."""
    path = request.getfixturevalue(kind)
    run, shown = dials_traffic.load(path), shown_in(path)
    controller, other = run.controller(), run.controller()
    for one in (controller, other):
        one.begin(3)
    last = run.agents[-1]
    for observations, infos in shown:
        expected = other.act(observations, infos)
        for number, value in enumerate(WRONG):
            wrong = {**observations, last: changed(observations[last], number, value)}
            told = rf"of agent '{last}': column {number}.* is {re.escape(str(np.float64(value)))}; must be a finite number"
            with pytest.raises(ValueError, match=told):
                controller.act(wrong, infos)
        for what, error in [("text", TypeError), (None, TypeError), ([[0.0]], ValueError)]:
            with pytest.raises((error, ValueError)):
                controller.act({**observations, last: what}, infos)
        nothing = np.zeros_like(infos[last]["action_mask"])
        for mask, told in [
            (nothing, "all [0-9]+ are 0; at least one action must be allowed"),
            (changed(nothing, 1, np.nan), "action 1 .*has nan"),
            (changed(nothing, 0, 2), "action 0 .*has 2.0; must be 1, allowed, or 0"),
            (nothing[1:], "of shape"),
        ]:
            with pytest.raises(ValueError, match=f"action masks: of agent '{last}'.*{told}"):
                controller.act(observations, {**infos, last: {"action_mask": mask}})
        assert controller.act(observations, infos) == expected
    controller.close()
    other.close()


@pytest.mark.parametrize("kind", ["warehouse_run", "grid_run", "scenario_run"])
def test_a_refused_observation_leaves_a_policy_in_numpy_as_it_was(kind, request, no_warnings):
    path = request.getfixturevalue(kind)
    run, shown = dials_traffic.load(path), shown_in(path)
    agent = run.agents[0]
    policy, other = run.policy(agent, seed=1), run.policy(agent, seed=1)
    for observations, infos in shown:
        obs, mask = observations[agent], infos[agent]["action_mask"]
        for number, value in enumerate(WRONG):
            told = f"of agent '{agent}': column {number}.* is {re.escape(str(np.float64(value)))}"
            for call in (policy, policy.judge):
                with pytest.raises(ValueError, match=told):
                    call(changed(obs, number, value))
        with pytest.raises(ValueError, match="at least one action must be allowed"):
            policy(obs, np.zeros_like(mask))
        with pytest.raises(ValueError, match="has nan; must be 1"):
            policy(obs, changed(mask, 0, np.nan))
        # A batch: once it gave the place of the largest number in the whole table.
        for batch in (obs[None], np.stack([obs] * 3), np.stack([changed(obs, 0, np.nan)] * 3), obs[:-1], 0.0):
            with pytest.raises(ValueError, match="of shape"):
                policy(batch)
        with pytest.raises(TypeError, match="must be numbers"):
            policy([str(number) for number in obs])
        assert policy(obs, mask) == other(obs, mask)
        assert np.array_equal(policy.judge(obs)[0], other.judge(obs)[0])


def test_the_error_names_the_column_as_describe_does(grid_run):
    run = dials_traffic.load(grid_run)
    controller = run.controller()
    controller.begin(1)
    obs = np.zeros(40)
    obs[37] = np.nan
    told = []
    for call in (run.policy("r0c0"), lambda shown: controller.act({"r0c0": shown}, {"r0c0": {}})):
        with pytest.raises(ValueError) as error:
            call(obs)
        told.append(str(error.value))
    controller.close()
    assert told[0] == told[1] and re.search(r"column 37 \(.+\) is nan", told[0]), told


def test_a_policy_that_overflows_says_so_and_remembers_nothing_of_it(no_warnings):
    huge = np.full((2, 3), 3e38, np.float32)
    policy = dials_traffic.Policy({"layers.0.weight": huge, "layers.0.bias": np.zeros((1, 3), np.float32)})
    with pytest.raises(ValueError, match="its policy are not finite; its weights are too large"):
        policy([9.0, 9.0])
    assert policy([0.0, 0.0]) in (0, 1)


def test_a_policy_without_masks_does_not_ignore_one_that_forbids(grid_run):
    run = dials_traffic.load(grid_run)
    controller = run.controller()
    controller.begin(1)
    obs = np.zeros(40)
    with pytest.raises(ValueError, match="agent 'r0c0': its policy knows no masks"):
        controller.act({"r0c0": obs}, {"r0c0": {"action_mask": [1, 0]}})
    assert controller.act({"r0c0": obs}, {"r0c0": {"action_mask": [1, 1]}}).keys() == {"r0c0"}
    for wrong in (None, [obs], b"r0c0", 3):
        with pytest.raises(TypeError, match="must be a dict"):
            controller.act(wrong, {})
        with pytest.raises(TypeError, match="must be a dict"):
            controller.act({"r0c0": obs}, {"r0c0": wrong})
    controller.close()


def test_a_refused_action_of_one_agent_leaves_its_turn_where_it_was(grid):
    env = dials_traffic.aec_env(grid, seed=1)
    env.reset()
    env.step(0)
    for wrong, error in [(2, ValueError), (-1, ValueError), (2**70, ValueError), (np.nan, TypeError), ("1", TypeError)]:
        with pytest.raises(error, match="agent 'r0c1': action"):
            env.step(wrong)
        assert env.agent_selection == "r0c1"
    for _ in range(3):
        env.step(1)
    assert env.agent_selection == "r0c0"
    env.close()
