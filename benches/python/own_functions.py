#!/usr/bin/env python3
"""What a reward of one's own costs, beside the built-in one: steps per second of the global simulator (GS) and of local ones.

    python-env/bin/python benches/python/own_functions.py

Both lines of a pair play the same actions, so the same traffic. They take turns, `--pairs` times, in processes of their own.
A negative number is a loss. Each is the median over the pairs. Run it on a machine that does nothing else.
"""

import argparse
import json
import statistics
import time
from pathlib import Path

import numpy as np

import dials_traffic

ROOT = Path(__file__).resolve().parents[2]


def queue(before, now):
    """The default reward of scenarios: minus the standing cars, in hundreds."""
    return -0.01 * now.cars.per_row(now.cars.speed_mps < 0.1)


def lost_by_type(before, now):
    """A larger one: seconds lost against the limits, with buses counted ten times, and how much more they have waited."""
    cars = now.cars
    lost = np.maximum(1 - cars.speed_mps / cars.limit_mps, 0) * np.where(cars.is_public, 10, 1)
    waited = cars.per_row(cars.waited_s) - before.cars.per_row(before.cars.waited_s)
    return -0.1 * cars.per_row(lost) - 0.01 * waited


def on_the_gs(config, steps, reward):
    env = dials_traffic.parallel_env(config, seed=0, reward=reward)
    env.reset()
    zeros = dict.fromkeys(env.agents, 0)
    taken = 0.0
    for number in range(steps + 20):
        if not env.agents:
            env.reset()
        begun = time.perf_counter()
        # Every light turns to another green from time to time.
        env.step({agent: number // 6 % 2 for agent in zeros})
        taken += time.perf_counter() - begun if number >= 20 else 0
    share = env.own_cost.share
    env.close()
    return taken / steps, share


def locally(config, agent, copies, steps, reward):
    env = dials_traffic.vector_env(config, agent, copies, "untrained", seed=0, reward=reward)
    _, infos = env.reset()
    taken = 0.0
    for number in range(steps + 20):
        masks = infos["action_mask"]
        actions = np.where(number // 6 % 2, masks.argmax(axis=1), masks.shape[1] - 1 - masks[:, ::-1].argmax(axis=1))
        begun = time.perf_counter()
        _, _, _, _, infos = env.step(actions)
        taken += time.perf_counter() - begun if number >= 20 else 0
    share = env.own_cost.share
    env.close()
    return taken / steps, share


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, default=ROOT / "configs/town.toml")
    parser.add_argument("--agent", help="of the local simulators [default: the first one]")
    parser.add_argument("--copies", type=int, default=8)
    parser.add_argument("--steps", type=int, default=600, help="per repeat")
    parser.add_argument("--pairs", type=int, default=7)
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    arguments = parser.parse_args()
    config, steps = arguments.config, arguments.steps
    env = dials_traffic.parallel_env(config)
    agent = arguments.agent or env.possible_agents[0]
    env.close()
    places = {
        "GS": lambda reward: on_the_gs(config, steps, reward),
        f"{arguments.copies} copies of a local simulator": lambda reward: locally(
            config, agent, arguments.copies, steps, reward
        ),
    }
    found = []
    for place, play in places.items():
        pairs = {function.__name__: [] for function in (queue, lost_by_type)}
        for _ in range(arguments.pairs):
            built_in, _ = play(None)
            for function in (queue, lost_by_type):
                seconds, share = play(function)
                pairs[function.__name__].append({"built_in_s": built_in, "own_s": seconds, "share": share})
        found += [{"place": place, "reward": name, "pairs": of_name} for name, of_name in pairs.items()]
    if arguments.json:
        print(json.dumps({"config": str(config), "agent": agent, "steps": steps, "lines": found}))
        return
    print(f"{config.name}, n = {arguments.pairs} pairs of {steps} steps\n")
    print(f"{'':32} {'reward':14} {'built-in /s':>12} {'own /s':>9} {'difference':>11} {'in the function':>16}   of each pair")
    for line in found:
        pairs = line["pairs"]
        changes = [pair["built_in_s"] / pair["own_s"] - 1 for pair in pairs]
        rates = [1 / statistics.median(pair[key] for pair in pairs) for key in ("built_in_s", "own_s")]
        share = statistics.median(pair["share"] for pair in pairs)
        each = " ".join(f"{change:+.0%}" for change in changes)
        change = statistics.median(changes)
        print(f"{line['place']:32} {line['reward']:14} {rates[0]:12.0f} {rates[1]:9.0f} {change:+11.1%} {share:16.1%}   {each}")


if __name__ == "__main__":
    main()
