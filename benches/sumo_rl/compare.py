#!/usr/bin/env python3
"""Simulated intersection-seconds per core-second: sumo-rl with libsumo beside the GS of dials-traffic.

    python3 -m venv target/sumo_rl && target/sumo_rl/bin/pip install -r benches/sumo_rl/requirements.txt
    cargo build --release
    target/sumo_rl/bin/python benches/sumo_rl/compare.py

Both simulate the same saved grid with the same inflow in episodes of 300 s, three seconds of yellow, observations and
rewards of all intersections at every decision. What differs:

- sumo-rl decides every `delta_time` seconds, which must exceed yellow: every 4 s is the most often that it allows.
  dials-traffic decides every second (and hears no action during yellow).
- Observations: sumo-rl has density and queue of every lane, dials-traffic 36 cells and the light. The reward is the mean
  speed in both, and in a second line of sumo-rl its defaults (change of the waiting time, and system-wide figures).
- Random actions: sumo-rl draws the next green phase, dials-traffic draws whether to switch. So the traffic is not quite
  the same; under `alternate` it is: all lights change every 8 s, of which 3 are yellow.

Time is CPU time of the process (user and system), without what happens before the first episode; the fastest of
`--repeats` counts. For dials-traffic it is the difference between a long and a short run of `baseline`.
"""

import argparse
import json
import os
import random
import resource
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HORIZON_S = 300
DELTA_TIME_S = 4
YELLOW_S = 3
ALTERNATE_S = 8


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=5, choices=[2, 5, 7, 10], help="side of the grid")
    parser.add_argument("--episodes", type=int, default=5, help="per repeat")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/dials-traffic")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    # One simulator per process: libsumo keeps its own in globals.
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    return parser.parse_args()


def network(size):
    return ROOT / "sumo_nets" / f"grid_{size}x{size}"


def sumo_alone(size, _control):
    """Steps of SUMO from Python and nothing else, the lights under the programs of the net."""
    import libsumo

    files = network(size)
    options = ["-n", f"{files}.net.xml", "-r", f"{files}.rou.xml", "--time-to-teleport", "-1"]
    options += ["--no-step-log", "--no-warnings", "--duration-log.disable"]

    def episode(seed):
        libsumo.start(["sumo", *options, "--seed", str(seed)])
        for _ in range(HORIZON_S):
            libsumo.simulationStep()
        libsumo.close()
        return HORIZON_S

    return episode


def sumo_rl(size, control, **options):
    from sumo_rl.environment.env import SumoEnvironment

    files = network(size)
    env = SumoEnvironment(
        net_file=f"{files}.net.xml",
        route_file=f"{files}.rou.xml",
        num_seconds=HORIZON_S,
        delta_time=DELTA_TIME_S,
        yellow_time=YELLOW_S,
        min_green=0,
        sumo_warnings=False,
        additional_sumo_cmd="--no-step-log --duration-log.disable",
        **options,
    )

    def episode(seed):
        dice = random.Random(seed)
        env.reset(seed=seed)
        decisions, over = 0, False
        while not over:
            if control == "random":
                actions = {light: dice.randrange(2) for light in env.ts_ids}
            else:
                phase = decisions * DELTA_TIME_S // ALTERNATE_S % 2
                actions = {light: phase for light in env.ts_ids}
            _, _, ends, _ = env.step(actions)
            over = ends["__all__"]
            decisions += 1
        return decisions

    return episode


def sumo_rl_lean(size, control):
    return sumo_rl(size, control, reward_fn="average-speed", add_system_info=False, add_per_agent_info=False)


def sumo_rl_defaults(size, control):
    return sumo_rl(size, control)


SUBJECTS = {"alone": sumo_alone, "lean": sumo_rl_lean, "defaults": sumo_rl_defaults}


def measure(name, control, size, episodes):
    """In a process of its own: CPU seconds and decisions per episode, after one that warms up."""
    episode = SUBJECTS[name](size, control)
    episode(0)
    begun = time.process_time()
    decisions = sum(episode(1 + seed) for seed in range(episodes))
    print(json.dumps({"cpu_s": (time.process_time() - begun) / episodes, "decisions": decisions / episodes}))


def ask(name, control, args):
    """The fastest of several processes."""
    environment = dict(os.environ, LIBSUMO_AS_TRACI="1", SUMO_HOME=sumo_home())
    command = [sys.executable, __file__, "--measure", f"{name},{control}", "--size", str(args.size)]
    command += ["--episodes", str(args.episodes)]
    answers = []
    for _ in range(args.repeats):
        output = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout
        answers.append(json.loads(output.splitlines()[-1]))
    return min(answers, key=lambda answer: answer["cpu_s"])


def sumo_home():
    import sumo

    return sumo.SUMO_HOME


def dials_traffic(control, args):
    def cpu_s(episodes):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        config = ROOT / "configs" / f"traffic_{args.size ** 2}.toml"
        command = [args.binary, "baseline", config, "--controller", control, "--episodes", str(episodes), "--json"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    short, long = 1, 1 + args.episodes
    fastest = [min(cpu_s(episodes) for _ in range(args.repeats)) for episodes in (short, long)]
    return {"cpu_s": (fastest[1] - fastest[0]) / args.episodes, "decisions": HORIZON_S}


def main():
    args = arguments()
    if args.measure:
        name, control = args.measure.split(",")
        return measure(name, control, args.size, args.episodes)
    lines = {
        "SUMO alone, stepped from Python": ask("alone", "program", args),
        "sumo-rl, mean speed, random": ask("lean", "random", args),
        "sumo-rl, mean speed, alternate": ask("lean", "alternate", args),
        "sumo-rl, its defaults, random": ask("defaults", "random", args),
        "dials-traffic GS, random": dials_traffic("random", args),
        "dials-traffic GS, alternate": dials_traffic(f"switch-every-{ALTERNATE_S}", args),
    }
    agents = args.size**2
    for answer in lines.values():
        answer["intersection_seconds_per_core_second"] = agents * HORIZON_S / answer["cpu_s"]
        answer["decisions_per_core_second"] = agents * answer["decisions"] / answer["cpu_s"]
    if args.json:
        print(json.dumps({"size": args.size, "episodes": args.episodes, "subjects": lines}))
        return None
    print(f"{args.size}x{args.size} grid, {HORIZON_S} s per episode\n")
    print(f"{'':34} {'intersection-seconds':>22} {'decisions':>12}   per core-second")
    for name, answer in lines.items():
        seconds, decisions = answer["intersection_seconds_per_core_second"], answer["decisions_per_core_second"]
        print(f"{name:34} {seconds:>22.0f} {decisions:>12.0f}")
    return None


if __name__ == "__main__":
    sys.exit(main())
