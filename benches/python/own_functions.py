#!/usr/bin/env python3
"""What a reward of one's own costs, beside the built-in one: steps per second of the global simulator (GS) and of local ones.

    python-env/bin/python benches/python/own_functions.py

All play the same actions, so the same traffic, each in a process of its own. They take turns, block by block, `--pairs` times.
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


class Gs:
    def __init__(self, config, reward):
        self.env = dials_traffic.parallel_env(config, seed=0, reward=reward)
        self.env.reset()

    def step(self, number):
        if not self.env.agents:
            self.env.reset()
        # Every light turns to another green from time to time.
        actions = dict.fromkeys(self.env.agents, number // 6 % 2)
        begun = time.perf_counter()
        self.env.step(actions)
        return time.perf_counter() - begun


class Local:
    def __init__(self, config, agent, copies, reward):
        self.env = dials_traffic.vector_env(config, agent, copies, "untrained", seed=0, reward=reward)
        _, self.infos = self.env.reset()

    def step(self, number):
        masks = self.infos["action_mask"]
        actions = np.where(number // 6 % 2, masks.argmax(axis=1), masks.shape[1] - 1 - masks[:, ::-1].argmax(axis=1))
        begun = time.perf_counter()
        _, _, _, _, self.infos = self.env.step(actions)
        return time.perf_counter() - begun


def paired(make, rewards, pairs, steps):
    """Return seconds per step of each reward in each pair, and the share of it that the function took in all."""
    sides = [make(reward) for reward in rewards]
    taken = [[] for _ in rewards]
    # The first block is not counted: roads fill, and caches too.
    for pair in range(pairs + 1):
        for side, of_side in zip(sides, taken):
            of_side.append(sum(side.step(pair * steps + number) for number in range(steps)) / steps)
    shares = [side.env.own_cost.share for side in sides]
    for side in sides:
        side.env.close()
    return [of_side[1:] for of_side in taken], shares


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, default=ROOT / "configs/town.toml")
    parser.add_argument("--agent", help="of the local simulators [default: the first one]")
    parser.add_argument("--copies", type=int, default=8)
    parser.add_argument("--steps", type=int, default=100, help="of a block")
    parser.add_argument("--pairs", type=int, default=15)
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    arguments = parser.parse_args()
    config, steps = arguments.config, arguments.steps
    env = dials_traffic.parallel_env(config)
    agent = arguments.agent or env.possible_agents[0]
    env.close()
    places = {
        "GS": lambda reward: Gs(config, reward),
        f"{arguments.copies} copies of a local simulator": lambda reward: Local(config, agent, arguments.copies, reward),
    }
    found = []
    functions = [queue, lost_by_type]
    for place, make in places.items():
        (built_in, *own), (_, *shares) = paired(make, [None, *functions], arguments.pairs, steps)
        for function, seconds, share in zip(functions, own, shares):
            pairs = [{"built_in_s": before, "own_s": after} for before, after in zip(built_in, seconds)]
            found.append({"place": place, "reward": function.__name__, "share": share, "pairs": pairs})
    if arguments.json:
        print(json.dumps({"config": str(config), "agent": agent, "steps": steps, "lines": found}))
        return
    print(f"{config.name}, n = {arguments.pairs} pairs of {steps} steps\n")
    print(f"{'':32} {'reward':14} {'built-in /s':>12} {'own /s':>9} {'difference':>11} {'in the function':>16}   of each pair")
    for line in found:
        pairs = line["pairs"]
        changes = [pair["built_in_s"] / pair["own_s"] - 1 for pair in pairs]
        rates = [1 / statistics.median(pair[key] for pair in pairs) for key in ("built_in_s", "own_s")]
        each = " ".join(f"{change:+.0%}" for change in changes)
        change = statistics.median(changes)
        print(f"{line['place']:32} {line['reward']:14} {rates[0]:12.0f} {rates[1]:9.0f} {change:+11.1%} {line['share']:16.1%}   {each}")


if __name__ == "__main__":
    main()
