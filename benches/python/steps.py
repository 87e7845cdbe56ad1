#!/usr/bin/env python3
"""Steps per second of the global simulator (GS): from Python, and from Rust.

    cargo build --release
    python-env/bin/python benches/python/steps.py

Both play the same number of whole episodes under random actions, with the same measures. Time is wall-clock time: the
simulator of Python is another process. For Rust it is the difference between a long and a short run of `baseline`, so
that loading does not count. The lines take turns, `--pairs` times. Each number is the median, and the comparison is the
median over the turns. Run it on a machine that does nothing else.
"""

import argparse
import json
import statistics
import subprocess
import time
from pathlib import Path

import numpy as np

import dials_traffic

ROOT = Path(__file__).resolve().parents[2]


def own_observation(roads):
    return roads.cars.per_row()[:, None]


def from_python(config, episodes, **options):
    """Return seconds per step, without the making of the environment and the first episode."""
    env = dials_traffic.parallel_env(config, seed=0, **options)
    rng = np.random.default_rng(0)

    def play():
        _, infos = env.reset()
        # Drawn before the clock matters little, but an agent's own work is not the environment's.
        actions = rng.integers(env.action_space(env.agents[0]).n, size=(env.horizon, len(env.agents))).tolist()
        for of_step in actions:
            _, _, _, _, infos = env.step(dict(zip(env.agents, of_step)))
        return infos

    play()
    begun = time.perf_counter()
    for _ in range(episodes):
        play()
    taken = time.perf_counter() - begun
    env.close()
    return taken / (episodes * env.horizon)


def from_rust(binary, config, episodes, horizon):
    """Return seconds per step of `baseline`, which measures in full."""

    def seconds(count):
        begun = time.perf_counter()
        command = [binary, "baseline", config, "--controller", "random", "--episodes", str(count), "--json"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return time.perf_counter() - begun

    return (seconds(1 + episodes) - seconds(1)) / (episodes * horizon)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, default=ROOT / "configs/traffic_25.toml")
    parser.add_argument("--episodes", type=int, default=10, help="per repeat")
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/dials-traffic")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    arguments = parser.parse_args()

    config, episodes = arguments.config, arguments.episodes
    env = dials_traffic.parallel_env(config)
    horizon, agents = env.horizon, len(env.possible_agents)
    env.close()
    rust, python = "Rust, measured in full", "Python, measured in full"
    lines = {
        rust: lambda: from_rust(arguments.binary, config, episodes, horizon),
        python: lambda: from_python(config, episodes, full_metrics=True),
        "Python, in the same process, measured in full": lambda: from_python(
            config, episodes, full_metrics=True, in_process=True
        ),
        "Python": lambda: from_python(config, episodes),
        "Python, own observation": lambda: from_python(config, episodes, observation=own_observation),
    }
    taken = {name: [] for name in lines}
    for _ in range(arguments.pairs):
        for name, measure in lines.items():
            taken[name].append(measure())
    if arguments.json:
        print(json.dumps({"config": str(config), "agents": agents, "seconds_per_step": taken}))
        return
    print(f"{config.name}: {agents} agents, {horizon} steps per episode, {arguments.pairs} pairs\n")
    print(f"{'':46} {'steps per second':>16} {'compared with Rust':>20}   of each pair")
    for name, seconds in taken.items():
        ratios = [base / own - 1 for base, own in zip(taken[rust], seconds)]
        pairs = " ".join(f"{ratio:+.1%}" for ratio in ratios)
        rate = 1 / statistics.median(seconds)
        print(f"{name:46} {rate:>16.0f} {statistics.median(ratios):>+19.1%}   {pairs}")


if __name__ == "__main__":
    main()
