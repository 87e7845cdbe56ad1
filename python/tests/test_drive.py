"""The driver of examples/ on pip's libsumo, beside our simulator."""

import json
import re
import sys

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


def test_the_driver_sees_and_does_what_our_simulator_does(scenario, scenario_run, lights, tmp_path):
    """Two libsumos at the same time: pip's in this process, and ours in that of the environment."""
    from drive_sumo import delay_s, drive

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
