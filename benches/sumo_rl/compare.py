#!/usr/bin/env python3
"""Decisions per core-second: sumo-rl with libsumo beside the GS of dials-traffic, from Python and from Rust.

    python3 -m venv target/sumo_rl && target/sumo_rl/bin/pip install -r benches/sumo_rl/requirements.txt ./python
    cargo build --release
    target/sumo_rl/bin/python benches/sumo_rl/compare.py

Both simulate the same saved grid with the same inflow in episodes of 300 s, three seconds of yellow, observations and
rewards of all intersections at every decision. What differs:

- sumo-rl decides every `delta_time` seconds, which must exceed yellow: every 4 s is the most often that it allows.
  dials-traffic decides every second (and hears no action during yellow).
- Observations: sumo-rl has density and queue of every lane, dials-traffic 36 cells and the light. The reward is the
  mean speed in both, and in a second line of sumo-rl its defaults (change of the waiting time, system-wide figures).
- Random actions: sumo-rl draws the next green phase, dials-traffic draws whether to switch. So the traffic is not quite
  the same; under `alternate` it is: all lights change every 8 s, of which 3 are yellow.

Time is CPU time (user and system) of a process and its children: the difference between a long and a short run, so that
loading does not count. The lines take turns, and the fastest of `--repeats` counts. "From Python" is `parallel_env`,
whose simulator is a child process; "in the same Python" it has none. "From Rust" is `baseline`, which also measures in
full.
"""

import argparse
import json
import os
import random
import resource
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HORIZON_S = 300
DELTA_TIME_S = 4
YELLOW_S = 3
ALTERNATE_S = 8


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=5, choices=[2, 5, 7, 10], help="side of the grid")
    parser.add_argument("--episodes", type=int, default=10, help="per repeat")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/dials-traffic")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    # One simulator per process: libsumo keeps its own in globals.
    parser.add_argument("--play", help=argparse.SUPPRESS)
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


def ours(size, control, **options):
    import dials_traffic

    env = dials_traffic.parallel_env(config(size), seed=0, **options)

    def episode(seed):
        dice = random.Random(seed)
        env.reset()
        for step in range(env.horizon):
            if control == "random":
                actions = {light: dice.randrange(2) for light in env.agents}
            else:
                actions = dict.fromkeys(env.agents, int(step % ALTERNATE_S == ALTERNATE_S - 1))
            env.step(actions)
        return env.horizon

    return episode


def ours_inside(size, control):
    return ours(size, control, in_process=True)


SUBJECTS = {
    "alone": sumo_alone,
    "lean": sumo_rl_lean,
    "defaults": sumo_rl_defaults,
    "ours": ours,
    "inside": ours_inside,
}


def config(size):
    return ROOT / "configs" / f"traffic_{size**2}.toml"


def play(name, control, size, episodes):
    """In a process of its own: play episodes and print the number of decisions in each."""
    episode = SUBJECTS[name](size, control)
    print([episode(seed) for seed in range(episodes)][-1])


def from_python(name, control):
    def command(args, episodes):
        words = ["--play", f"{name},{control}", "--size", str(args.size), "--episodes", str(episodes)]
        return [sys.executable, __file__, *words]

    return command


def from_rust(control):
    def command(args, episodes):
        words = ["--controller", control, "--episodes", str(episodes), "--json"]
        return [args.binary, "baseline", config(args.size), *words]

    return command


def cpu_s(command):
    """Return the CPU seconds of a command and its children, and what it prints."""
    environment = dict(os.environ, LIBSUMO_AS_TRACI="1", SUMO_HOME=sumo_home())
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def sumo_home():
    import sumo

    return sumo.SUMO_HOME


LINES = {
    "SUMO alone, stepped from Python": from_python("alone", "program"),
    "sumo-rl, mean speed, random": from_python("lean", "random"),
    "sumo-rl, mean speed, alternate": from_python("lean", "alternate"),
    "sumo-rl, its defaults, random": from_python("defaults", "random"),
    "sumo-rl, its defaults, alternate": from_python("defaults", "alternate"),
    "dials-traffic from Python, random": from_python("ours", "random"),
    "dials-traffic from Python, alternate": from_python("ours", "alternate"),
    "dials-traffic in the same Python, random": from_python("inside", "random"),
    "dials-traffic in the same Python, alternate": from_python("inside", "alternate"),
    "dials-traffic from Rust, random": from_rust("random"),
    "dials-traffic from Rust, alternate": from_rust(f"switch-every-{ALTERNATE_S}"),
}

# What sumo-rl computes beside the traffic.
THEIRS = ("mean speed", "its defaults")


def main():
    args = arguments()
    if args.play:
        name, control = args.play.split(",")
        return play(name, control, args.size, args.episodes)
    taken = {name: [] for name in LINES}
    decisions = {}
    for _ in range(args.repeats):
        for name, command in LINES.items():
            short, _ = cpu_s(command(args, 1))
            long, told = cpu_s(command(args, 1 + args.episodes))
            taken[name].append((long - short) / args.episodes)
            decisions[name] = HORIZON_S if "Rust" in name else int(told.split()[-1])
    agents, answers = args.size**2, {}
    for name, seconds in taken.items():
        rates = agents * HORIZON_S / min(seconds), agents * decisions[name] / min(seconds)
        answers[name] = {"cpu_s": seconds, "intersection_seconds": rates[0], "decisions": rates[1]}
    if args.json:
        print(json.dumps({"size": args.size, "episodes": args.episodes, "subjects": answers}))
        return None
    print(f"{args.size}x{args.size} grid, {HORIZON_S} s per episode\n")
    print(f"{'':44} {'intersection-seconds':>22} {'decisions':>12}   per core-second")
    for name, answer in answers.items():
        print(f"{name:44} {answer['intersection_seconds']:>22.0f} {answer['decisions']:>12.0f}")
    print()
    for control in ("random", "alternate"):
        for name in ("dials-traffic from Python", "dials-traffic in the same Python"):
            ours = answers[f"{name}, {control}"]["decisions"]
            times = [ours / answers[f"sumo-rl, {what}, {control}"]["decisions"] for what in THEIRS]
            print(f"{name}, {control}: decisions of sumo-rl times " + ", ".join(
                f"{ratio:.1f} ({what})" for ratio, what in zip(times, THEIRS)
            ))
    return None


if __name__ == "__main__":
    sys.exit(main())
