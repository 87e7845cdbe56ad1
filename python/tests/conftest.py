"""Runs and configs that the tests share. They are made by the program, whose path is DIALS_TRAFFIC."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

WAREHOUSE = """
total_steps = 256
[warehouse]
agents_per_side = 2
horizon = 16
[policy]
recurrent = 32
hidden = [32]
[ppo]
rollout_steps = 8
[aip]
hidden = [32]
retrain_every_steps = 256
dataset_steps = 64
batch = 16
epochs = 2
[evaluation]
every_steps = 256
episodes = 1
final_episodes = 1
aip_loss_episodes = 0
"""

# Of the shipped configs, with short episodes and next to no training.
SHORT = {
    "total_steps": 128,
    "local_simulators.copies": 8,
    "policy.hidden": "[16]",
    "aip.hidden": "[16]",
    "aip.epochs": 1,
    "evaluation.episodes": 1,
    "evaluation.final_episodes": 1,
    "evaluation.aip_loss_episodes": 0,
}


def path_of_program():
    """Return the path of dials-traffic: that of DIALS_TRAFFIC, or what cargo has built."""
    built = [ROOT / f"target/{profile}/dials-traffic" for profile in ("release", "debug")]
    path = os.environ.get("DIALS_TRAFFIC") or next((path for path in built if path.is_file()), None)
    assert path, "there is no program: run `cargo build`, or name one in DIALS_TRAFFIC"
    return str(path)


def program(*words, **options):
    """Run dials-traffic and return what it prints."""
    words = [path_of_program(), *map(str, words)]
    done = subprocess.run(words, capture_output=True, text=True, **options)
    assert done.returncode == 0, f"{words}: {done.stderr}"
    return done.stdout


def train(config, out, settings=None):
    """Train a run and return its directory."""
    sets = [word for key, value in (settings or {}).items() for word in ("--set", f"{key}={value}")]
    program("train", config, "--out", out, "--workers", 0, *sets)
    return out


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("shared")


@pytest.fixture(scope="session")
def warehouse(folder):
    """A config of four robots with episodes of 16 steps."""
    path = folder / "warehouse.toml"
    path.write_text(WAREHOUSE)
    return path


@pytest.fixture(scope="session")
def grid(folder):
    """A config of four lights of the paper, with episodes of 40 steps."""
    text = (ROOT / "configs/smoke_traffic.toml").read_text()
    path = folder / "grid.toml"
    path.write_text(text.replace("../sumo_nets", str(ROOT / "sumo_nets")).replace("horizon = 300", "horizon = 40"))
    return path


@pytest.fixture(scope="session")
def scenario():
    """A .sumocfg of 16 lights, with turns."""
    return ROOT / "sumo_nets/grid_4x4_turns/grid_4x4_turns.sumocfg"


#: Settings that make episodes of the scenario as short as three minutes.
SCENARIO_SETTINGS = {"traffic.end_s": 180, "traffic.local_horizon": 12, "aip.dataset_steps": 72}


@pytest.fixture(scope="session")
def warehouse_run(warehouse, folder):
    return train(warehouse, folder / "warehouse_run")


@pytest.fixture(scope="session")
def grid_run(grid, folder):
    settings = {**SHORT, "aip.dataset_steps": 80, "aip.batch": 16, "evaluation.every_steps": 128}
    return train(grid, folder / "grid_run", settings)


@pytest.fixture(scope="session")
def scenario_run(scenario, folder):
    settings = {**SHORT, **SCENARIO_SETTINGS, "aip.batch": 16, "evaluation.every_steps": 128}
    settings.update({"simulator": "dials", "ppo.memory": 128, "ppo.rollout_steps": 16, "ppo.minibatch": 32})
    return train(scenario, folder / "scenario_run", settings)
