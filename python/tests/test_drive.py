"""The driver of examples/ on pip's libsumo, beside our simulator."""

import re
import sys

import numpy as np
from conftest import ROOT, program

import dials_traffic

sys.path.insert(0, str(ROOT / "examples"))


def test_the_driver_sees_and_does_what_our_simulator_does(scenario, scenario_run, tmp_path):
    """Two libsumos at the same time: pip's in this process, and ours in that of the environment."""
    from drive_sumo import drive

    run = dials_traffic.load(scenario_run)
    lights = tmp_path / "lights.json"
    lights.write_text(program("nets", "inspect", scenario, "--json"))
    # A replay says which seed SUMO gets in an episode.
    replay = run.play(seed=7, greedy=True, replay=tmp_path / "replay").replay
    (seed,) = re.findall(r'<seed value="(\d+)"', replay.read_text())
    env, controller = dials_traffic.parallel_env(run.path, seed=7), run.controller(greedy=True)
    observations, infos = env.reset()
    controller.begin(7)
    equal = cars = 0
    driver = drive(scenario, lights, run.path / "policies.safetensors", int(seed))
    for obs, actions in driver:
        assert np.array_equal(obs, np.stack(list(observations.values())))
        cars += obs.sum()
        ours = controller.act(observations, infos)
        equal += np.mean(actions == list(ours.values()))
        observations, _, _, _, infos = env.step(dict(zip(env.agents, actions)))
        if not env.agents:
            break
    driver.close()
    # Where two actions are equally good, rounding may decide.
    assert cars > 1000 and equal >= 0.99 * env.horizon, (cars, equal)
    controller.close()
    env.close()
