"""Trained policies in Python: an episode is that of `evaluate`, to the bit."""

import csv

import numpy as np
import pytest
from conftest import SCENARIO_SETTINGS, SHORT, program, train
from safetensors.numpy import load_file

import dials_traffic


def evaluated(run, folder, *words):
    """Return the returns of `evaluate`, by episode and agent, as they are written, and those of the system."""
    program("evaluate", run, "--seed", 7, "--episodes", 2, "--csv", folder / "csv", *words)
    tables = {}
    for name in ("agents", "episodes"):
        with open(folder / f"csv/{name}.csv") as file:
            tables[name] = list(csv.DictReader(file))
    return tables["agents"], tables["episodes"]


@pytest.mark.parametrize("kind", ["warehouse_run", "grid_run", "scenario_run"])
@pytest.mark.parametrize("greedy", [False, True])
def test_an_episode_from_python_is_that_of_evaluate_to_the_bit(kind, greedy, request, tmp_path):
    run = request.getfixturevalue(kind)
    agents, episodes = evaluated(run, tmp_path, *(["--greedy"] if greedy else []))
    env = dials_traffic.parallel_env(run, seed=7, full_metrics=True)
    controller = dials_traffic.load(run).controller(greedy=greedy)
    for episode in range(2):
        observations, infos = env.reset()
        controller.begin(env.seed, env.episode)
        returns = dict.fromkeys(env.agents, 0.0)
        while env.agents:
            observations, rewards, _, _, infos = env.step(controller.act(observations, infos))
            for agent, reward in rewards.items():
                returns[agent] += reward
        written = {int(line["agent"]): line for line in agents if int(line["episode"]) == episode}
        assert len(written) == len(returns)
        for row, (agent, value) in enumerate(returns.items()):
            assert value == float(written[row]["return"]), (episode, agent)
            for figure, own in infos[agent]["metrics"].items():
                told = written[row][figure]
                assert own == float(told or "nan") or (np.isnan(own) and told in ("", "NaN")), (agent, figure)
        for figure, value in infos[env.possible_agents[0]]["system"].items():
            told = episodes[episode][figure]
            assert value == float(told or "nan") or (np.isnan(value) and told in ("", "NaN")), figure
    controller.close()
    env.close()


@pytest.mark.parametrize("kind", ["grid_run", "scenario_run"])
def test_an_episode_is_played_and_replayed_in_one_call(kind, request, tmp_path):
    run = request.getfixturevalue(kind)
    agents, episodes = evaluated(run, tmp_path)
    played = dials_traffic.load(run).play(seed=7, replay=tmp_path / "ours")
    assert list(played.returns.values()) == [float(line["return"]) for line in agents if line["episode"] == "0"]
    assert played.system["arrived"] == float(episodes[0]["arrived"])
    assert played.metrics.keys() == played.returns.keys()
    # The program plays a replay in SUMO and compares before it keeps it.
    program("replay", run, "--episode-seed", 7, "--out", tmp_path / "theirs")
    sides = [sorted((tmp_path / side).iterdir()) for side in ("ours", "theirs")]
    ours, theirs = ({file.name: file.read_bytes() for file in side} for side in sides)
    assert ours == theirs and played.replay.name in ours and played.replay.suffix == ".sumocfg"


def test_only_a_whole_recorded_episode_becomes_a_replay(grid, warehouse, tmp_path):
    env = dials_traffic.parallel_env(grid, seed=1, record=True, settings={"traffic.horizon": 20})
    with pytest.raises(RuntimeError, match="play an episode to its end"):
        env.save_replay(tmp_path / "none")
    for number in range(2):
        env.reset()
        while env.agents:
            env.step(dict.fromkeys(env.agents, 0))
        (tmp_path / "file").touch()
        with pytest.raises(dials_traffic.SimulatorError):
            env.save_replay(tmp_path / "file/below")
        assert env.save_replay(tmp_path / str(number)).is_file(), "another folder may do"
    with pytest.raises(FileExistsError, match="exists already"):
        env.save_replay(tmp_path / "0")
    with pytest.raises(dials_traffic.SimulatorError, match="saved already"):
        env.save_replay(tmp_path / "again")
    env.close()
    assert len({file.read_bytes() for file in tmp_path.glob("*/*.rou.xml")}) == 2, "episodes have other cars"
    env = dials_traffic.parallel_env(grid, seed=1, settings={"traffic.horizon": 1})
    env.reset()
    env.step(dict.fromkeys(env.agents, 0))
    with pytest.raises(dials_traffic.SimulatorError, match="with record=True"):
        env.save_replay(tmp_path / "none")
    env.close()
    with pytest.raises(dials_traffic.SimulatorError, match="only traffic can be recorded"):
        dials_traffic.parallel_env(warehouse, record=True)


@pytest.mark.parametrize("kind", ["warehouse_run", "grid_run", "scenario_run"])
def test_weights_are_those_of_the_file(kind, request):
    path = request.getfixturevalue(kind)
    run, tensors = dials_traffic.load(path), load_file(path / "policies.safetensors")
    count = sum(weights.size for agent in run.agents for weights in run.weights(agent).values())
    assert count == sum(tensor.size for tensor in tensors.values())
    if kind != "scenario_run":  # its agents may be of several kinds, with a prefix each
        for row, agent in enumerate(run.agents):
            assert all(np.array_equal(run.weights(agent)[name], tensor[row]) for name, tensor in tensors.items())


@pytest.mark.parametrize("kind", ["warehouse_run", "grid_run", "scenario_run"])
def test_a_policy_in_numpy_chooses_what_the_program_chooses(kind, request):
    """Also with a memory: the warehouse's policies have a GRU."""
    path = request.getfixturevalue(kind)
    run = dials_traffic.load(path)
    policies = {agent: run.policy(agent, greedy=True) for agent in run.agents}
    controller = run.controller(greedy=True)
    env = dials_traffic.parallel_env(path, seed=3)
    observations, infos = env.reset()
    controller.begin(3)
    equal = total = 0
    while env.agents:
        actions = controller.act(observations, infos)
        ours = {a: policies[a](observations[a], infos[a]["action_mask"]) for a in env.agents}
        equal, total = equal + sum(ours[a] == actions[a] for a in actions), total + len(actions)
        observations, _, _, _, infos = env.step(actions)
    # Where two actions are equally good, rounding may decide.
    assert equal >= 0.99 * total, (equal, total)
    controller.close()
    env.close()


def test_a_policy_draws_from_its_probabilities_and_respects_the_mask():
    weights = {"layers.0.weight": np.zeros((1, 4), np.float32), "layers.0.bias": np.log([[1, 2, 5, 9]]).astype("f4")}
    policy = dials_traffic.Policy(weights, seed=1)
    counts = np.bincount([policy([0.0]) for _ in range(8000)], minlength=3)
    # Shares 1/8, 2/8 and 5/8 of 8000: standard deviations 30, 39 and 43. The last output is the value.
    assert np.all(np.abs(counts - [1000, 2000, 5000]) < 180), counts
    assert {policy([0.0], [1, 0, 0]) for _ in range(50)} == {0}
    assert policy.judge([0.0])[1] == pytest.approx(np.log(9), abs=1e-6)


SETS = {"traffic.observation": "lanes", "policy.share": "kind", "policy.hidden": "[8, 6]"}


def test_a_run_whose_agents_see_sets_acts_in_numpy_as_the_program_does(scenario, tmp_path):
    settings = {**SHORT, **SCENARIO_SETTINGS, **SETS, "simulator": "gs", "evaluation.every_steps": 128}
    settings.update({"ppo.memory": 128, "ppo.rollout_steps": 16, "ppo.minibatch": 32})
    run = dials_traffic.load(train(scenario, tmp_path / "sets", settings))
    env, controller = dials_traffic.parallel_env(run.path, seed=3), run.controller(greedy=True)
    file = tmp_path / "any.safetensors"
    program("export", run.path, "--out", file)
    any_light = dials_traffic.any_light(file, greedy=True)
    policies = {agent: run.policy(agent, greedy=True) for agent in run.agents}
    observations, infos = env.reset()
    controller.begin(3)
    equal = [0, 0]
    for _ in range(20):
        actions = controller.act(observations, infos)
        for agent, action in actions.items():
            obs, mask = observations[agent], infos[agent]["action_mask"]
            equal[0] += policies[agent](obs, mask) == action
            equal[1] += any_light(obs, mask) == action
            assert any_light.judge(obs, mask.size)[1] == pytest.approx(policies[agent].judge(obs)[1])
        observations, _, _, _, infos = env.step(actions)
    assert min(equal) >= 0.99 * 20 * len(env.agents), equal
    with pytest.raises(ValueError, match="columns are no lanes and 2 greens; make the environment with settings="):
        any_light(observations[env.agents[0]][:-1], [1, 1])
    with pytest.raises(TypeError, match="action_mask: a policy for any light needs it"):
        any_light(observations[env.agents[0]])
    with pytest.raises(dials_traffic.SimulatorError, match="as sets; policy\\(\\) has its network in numpy"):
        run.torch_policy(env.agents[0])
    with pytest.raises(dials_traffic.SimulatorError, match="holds no policy for any light"):
        dials_traffic.any_light(run.path / "policies.safetensors")
    controller.close()
    env.close()


def test_what_is_no_run_is_an_error_that_says_so(tmp_path, warehouse):
    with pytest.raises(dials_traffic.SimulatorError, match="not a run directory"):
        dials_traffic.load(tmp_path)
    (tmp_path / "config.toml").write_text(warehouse.read_text())
    with pytest.raises(dials_traffic.SimulatorError, match="has no policies yet"):
        dials_traffic.load(tmp_path)


def test_a_run_is_found_after_the_working_directory_changed(grid_run, tmp_path, monkeypatch):
    monkeypatch.chdir(grid_run.parent)
    run = dials_traffic.load(grid_run.name)
    monkeypatch.chdir(tmp_path)
    assert run.path == grid_run
    assert len(run.play(seed=1).returns) == 4


def test_agents_and_numbers_that_do_not_exist_are_errors_that_name_them(grid_run):
    run = dials_traffic.load(grid_run)
    reason = "agent 'nobody': there is none; the agents are 'r0c0'"
    for read in (run.weights, run.state_dict, run.policy):
        with pytest.raises(dials_traffic.SimulatorError, match=reason):
            read("nobody")
    with pytest.raises(TypeError, match="greedy 1: must be True or False"):
        run.controller(greedy=1)
    controller = run.controller()
    with pytest.raises(ValueError, match="seed -1: must be from 0"):
        controller.begin(-1)
    with pytest.raises(ValueError, match="episode -1: must be from 0"):
        controller.begin(1, -1)
    controller.begin(np.int64(1), np.int32(0))
    with pytest.raises(dials_traffic.SimulatorError, match=reason):
        controller.act({"nobody": np.zeros(40)}, {})
    with pytest.raises(dials_traffic.SimulatorError, match="infos: there is none for 'r0c0'"):
        controller.act({"r0c0": np.zeros(40)}, {})
    for width in ((), (1,), (39,)):
        with pytest.raises(ValueError, match="observations: of agent 'r0c0' of shape"):
            controller.act({"r0c0": np.zeros(width)}, {"r0c0": {}})
    assert controller.act({"r0c0": np.zeros(40)}, {"r0c0": {}}).keys() == {"r0c0"}
    controller.close()


def test_a_replay_that_cannot_be_kept_is_refused_before_the_episode(grid_run, tmp_path, monkeypatch):
    monkeypatch.setattr(dials_traffic.GlobalEnv, "reset", None)
    with pytest.raises(FileExistsError, match="exists already"):
        dials_traffic.load(grid_run).play(replay=tmp_path)


def test_an_interrupted_decision_needs_a_new_episode(warehouse_run, monkeypatch):
    """Its policies have a memory. A decision that was made twice would change it."""
    run = dials_traffic.load(warehouse_run)
    controller = run.controller()
    env = dials_traffic.parallel_env(warehouse_run, seed=3)
    observations, infos = env.reset()
    controller.begin(3)
    expected = controller.act(observations, infos)
    with monkeypatch.context() as patched:
        patched.setattr(controller, "_actions", None)  # as if Ctrl-C had come after the answer
        with pytest.raises(AttributeError):
            controller.act(observations, infos)
    with pytest.raises(dials_traffic.SimulatorError, match="call begin"):
        controller.act(observations, infos)
    controller.begin(3)
    assert controller.act(observations, infos) == expected
    controller.close()
    env.close()
