"""The driver of examples/ on pip's libsumo, beside our simulator."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, program

import dials_traffic

sys.path.insert(0, str(ROOT / "examples"))


@pytest.fixture
def lights(scenario, tmp_path):
    """What our program says of the lights of the scenario, as a file."""
    lights = tmp_path / "lights.json"
    lights.write_text(program("nets", "inspect", scenario, "--json"))
    return lights


def test_policies_that_see_something_else_are_refused_with_the_way_out(scenario, scenario_run, lights):
    from drive_sumo import drive

    told = json.loads(lights.read_text())
    told["kind"]["columns"] += 4
    lights.write_text(json.dumps(told))
    with pytest.raises(SystemExit, match="columns.*dials-traffic train"):
        next(drive(scenario, lights, scenario_run / "policies.safetensors"))


def test_the_driver_sees_and_does_what_our_simulator_does(scenario, scenario_run, lights, tmp_path, monkeypatch):
    """Two libsumos at the same time: pip's in this process, and ours in that of the environment."""
    from drive_sumo import Light, delay_s, drive

    masks, allowed = [], Light.allowed
    monkeypatch.setattr(Light, "allowed", lambda light, actions: masks.append(allowed(light, actions)) or masks[-1])

    run = dials_traffic.load(scenario_run)
    # A replay says which seed SUMO gets in an episode.
    replay = run.play(seed=7, greedy=True, replay=tmp_path / "replay").replay
    (seed,) = re.findall(r'<seed value="(\d+)"', replay.read_text())
    env, controller = dials_traffic.parallel_env(run.path, seed=7, full_metrics=True), run.controller(greedy=True)
    observations, infos = env.reset()
    controller.begin(7)
    equal = cars = 0
    trips = tmp_path / "trips.xml"
    driver = drive(scenario, lights, run.path / "policies.safetensors", int(seed), trips)
    for obs, actions in driver:
        assert np.array_equal(obs, np.stack(list(observations.values())))
        cars += obs.sum()
        assert masks == [list(info["action_mask"]) for info in infos.values()]
        masks.clear()
        ours = controller.act(observations, infos)
        equal += np.mean(actions == list(ours.values()))
        observations, _, _, _, infos = env.step(dict(zip(env.agents, actions)))
        if not env.agents:
            break
    driver.close()
    # SUMO rounds what it writes.
    assert delay_s(trips) == pytest.approx(next(iter(infos.values()))["system"]["delay_s"], abs=1e-4)
    # Where two actions are equally good, rounding may decide.
    assert cars > 1000 and equal >= 0.99 * env.horizon, (cars, equal)
    controller.close()
    env.close()


def test_queues_pass_and_who_has_stood_at_red_too_long_comes_next_in_both_networks_of_python():
    """Two lanes, two greens, one each. Green 0 is shown. People may wait for it. Queues and reds are those of both lanes."""
    from drive_any_light import by_the_rules

    from dials_traffic._sets import OverSets

    lanes, greens, opens = np.zeros((2, 29)), np.zeros((2, 11)), np.zeros((2, 2, 2))
    opens[[0, 1], 0, [0, 1]], greens[0, 2] = 1, 1
    sets = OverSets({}, {"item_features": 29, "choice_features": 11, "ways": 2})
    both, first, second = np.array([True, True]), np.array([True, False]), np.array([False, True])
    cases = [  # cars on both lanes, seconds: of red, for people, of the green; allowed, left
        ((1, 1), 120, 0, 40, both, second), ((1, 1), 119, 0, 40, both, both), ((1, 0), 120, 0, 40, both, both),
        ((1, 1), 120, 0, 40, first, first), ((1, 1), 120, 121, 40, both, first), ((1, 1), 120, 120, 40, both, both),
        ((1, 0), 0, 119, 40, both, both), ((1, 0), 0, 120, 40, both, first),
        # A long queue counts its red three times.
        ((1, 8), 40, 0, 40, both, second), ((1, 7), 40, 0, 40, both, both), ((1, 8), 39, 0, 40, both, both),
        # A green stays for 30 s while three cars stand there, if it may.
        ((3, 8), 200, 0, 29, both, first), ((3, 8), 200, 0, 30, both, second), ((2, 8), 200, 0, 29, both, second),
        ((3, 8), 200, 0, 29, second, second),
    ]
    for queues, red_s, on_foot_s, green_s, allowed, left in cases:
        lanes[:, 4], lanes[:, 13] = np.array(queues) / 10, (0, np.log1p(red_s) / 5)
        greens[0, 3], greens[0, 10] = np.log1p(green_s) / 5, np.log1p(on_foot_s) / 5
        obs = np.concatenate([lanes.ravel(), greens.ravel(), opens.ravel()]).astype(np.float32)
        assert sets.by_the_rules(obs, allowed, 120, 30).tolist() == left.tolist(), (queues, red_s)
        assert by_the_rules(allowed, lanes, greens, opens).tolist() == left.tolist(), (queues, red_s)
    # Not while people wait to walk.
    lanes[:, 4], greens[0, 3], greens[1, 9] = (0.3, 0.8), 0, 0.1
    assert by_the_rules(both, lanes, greens, opens).tolist() == second.tolist()
    obs = np.concatenate([lanes.ravel(), greens.ravel(), opens.ravel()]).astype(np.float32)
    assert sets.by_the_rules(obs, both, 120, 30).tolist() == second.tolist()


def jammed(scenario, told, folder):
    """Write the scenario with cars that stop for long behind one light, and others that do not keep its junction clear."""
    name = scenario.stem
    lanes = [exit["lane"] for exit in told["learning"][5]["exits"]]
    stops = "".join(f'<vehicle id="stop{number}" depart="0" departPos="0" departLane="{lane[-1]}"><route edges="{lane[:-2]}"/>'
                    f'<stop lane="{lane}" endPos="8" duration="500"/></vehicle>' for number, lane in enumerate(lanes))
    net, routes = ((scenario.parent / f"{name}{ending}").read_text() for ending in (".net.xml", ".rou.xml"))
    (folder / f"{name}.net.xml").write_text(net.replace("<connection ", '<connection keepClear="0" '))
    (folder / f"{name}.rou.xml").write_text(routes.replace("<flow ", f"{stops}<flow ", 1))
    return Path(shutil.copy(scenario, folder))


def with_people(folder):
    """Write a scenario of two lights with cars from the west, and people who cross their way."""
    subprocess.run(
        ["netgenerate", "--grid", "--grid.x-number=2", "--grid.y-number=1", "--grid.length=150", "--grid.attach-length=150",
         "-j=traffic_light", "--sidewalks.guess", "--crossings.guess", "--no-turnarounds", "-o", folder / "street.net.xml"],
        check=True, capture_output=True)
    (folder / "street.rou.xml").write_text("""<routes>
        <flow id="car" begin="0" end="600" period="5" from="left0A0" to="B0right0"/>
        <personFlow id="walk" begin="0" end="600" period="4"><walk from="top0A0" to="A0bottom0"/></personFlow>
        <personFlow id="across" begin="0" end="600" period="7"><walk from="left0A0" to="B0right0"/></personFlow>
    </routes>""")
    files = '<net-file value="street.net.xml"/><route-files value="street.rou.xml"/>'
    (folder / "street.sumocfg").write_text(f'<configuration>{files}<end value="3600"/></configuration>')
    return folder / "street.sumocfg"


def test_lights_that_see_a_part_of_the_cars_have_a_policy_of_their_own(scenario):
    settings = {"traffic.observation": "lanes", "traffic.end_s": 600, "traffic.seen_cars": 0.3}
    env = dials_traffic.parallel_env(scenario, seed=7, settings=settings)
    observations, _ = env.reset()
    obs, n_actions = next(iter(observations.values())), env.action_space(env.agents[0]).n
    partial = ROOT / "models/any_light_partial.safetensors"
    files = [{}, {"partial": True}, {"file": partial}, {"file": partial, "partial": True}]
    values = [dials_traffic.any_light(**file).judge(obs, n_actions)[1] for file in files]
    assert values[0] != values[1] and len(set(values[1:])) == 1
    env.close()


@pytest.mark.parametrize("kind", ["cars", "jammed", "people"])
def test_a_policy_for_any_light_drives_as_our_simulator_does(scenario, lights, tmp_path, monkeypatch, kind):
    """Without training, and without anything of ours but the file. In a jam both mind the cars that are trapped."""
    from drive_any_light import drive
    from drive_sumo import Light, delay_s

    chosen, minding, allowed = [], 0, Light.allowed

    def recorded(light, greens):
        chosen.append((allowed(light, greens), light.obeyed(greens)))
        return chosen[-1][0]

    monkeypatch.setattr(Light, "allowed", recorded)
    if kind == "jammed":
        scenario = jammed(scenario, json.loads(lights.read_text()), tmp_path)
    elif kind == "people":
        scenario = with_people(tmp_path)
        lights.write_text(program("nets", "inspect", scenario, "--json"))
    settings = {"traffic.observation": "lanes", "traffic.end_s": 600, "traffic.decision_s": 2}
    env = dials_traffic.parallel_env(scenario, seed=7, full_metrics=True, record=True, settings=settings)
    policy = dials_traffic.any_light(greedy=True)
    # An episode in which nothing happens, for SUMO's seed.
    env.reset()
    while env.agents:
        env.step(dict.fromkeys(env.agents, 0))
    replay = env.save_replay(tmp_path / "replay").read_text()
    (seed,) = re.findall(r'<seed value="(\d+)"', replay)
    text = scenario.read_text().replace(f'="{scenario.stem}', f'="{scenario.parent}/{scenario.stem}')
    (tmp_path / "short.sumocfg").write_text(re.sub(r'<end value="[^"]*"', '<end value="600"', text))

    observations, infos = env.reset(options={"episode": 0})
    trips, equal, steps, people = tmp_path / "trips.xml", 0, 0, 0
    for obs, actions in drive(tmp_path / "short.sumocfg", lights, ROOT / "models/any_light.safetensors", seed, trips):
        masks = [infos[agent]["action_mask"] for agent in env.agents]
        assert [list(mask[: len(left)]) for mask, (left, _) in zip(masks, chosen)] == [left for left, _ in chosen]
        minding += sum(left != obeyed for left, obeyed in chosen)
        chosen.clear()
        for (lanes, greens), row, mask in zip(obs, observations.values(), masks):
            # Ours has room for the largest light: lanes first, then greens.
            assert np.allclose(lanes, row[: lanes.size].reshape(lanes.shape), atol=1e-5)
            of_lane = lanes.shape[1]
            first = of_lane * ((row.size - greens.shape[1] * mask.size) // (of_lane + 2 * mask.size))
            assert np.allclose(greens, row[first:][: greens.size].reshape(greens.shape), atol=1e-5)
            people += greens[:, 9].sum()
        ours = [policy(row, mask) for row, mask in zip(observations.values(), masks)]
        equal, steps = equal + np.mean(np.array(actions) == ours), steps + 1
        observations, _, _, _, infos = env.step({agent: int(action) for agent, action in zip(env.agents, actions)})
    assert steps == env.horizon and [minding > 0, people > 10] == [kind == "jammed", kind == "people"]
    # Where two greens are equally good, as for an empty light, rounding may decide.
    assert equal >= 0.95 * steps, equal
    # SUMO rounds what it writes.
    assert delay_s(trips) == pytest.approx(next(iter(infos.values()))["system"]["delay_s"], abs=1e-4)
    env.close()
