"""Model of the run time on a cluster: prints the tables of docs/cluster.md and draws docs/cluster.svg.

    dials-traffic describe configs/traffic_100.toml --json | python3 benches/cluster/model.py docs/cluster.svg

The run is that of the config, on grids of any size.
"""

import json
import math
import sys

# How often the run does what, as the program counts it.
CONFIG = json.load(sys.stdin)
RUN, HORIZON = CONFIG["run"], CONFIG["episode_steps"]
STEPS, FINAL_EPISODES = RUN["steps_per_agent"], RUN["final_episodes"]
EVALUATIONS, EPISODES = RUN["evaluations"] - 1, RUN["evaluation_episodes"] + 4  # 4 for the AIPs' loss; the last is apart
TRAININGS, DATASET_EPISODES, EPOCHS = RUN["aip_trainings"], RUN["dataset_episodes"], RUN["aip_epochs"]

# Seconds, fitted to the tables "Traffic, 100 agents" and "Scaling" of docs/performance.md (one worker).
PER_STEP = lambda agents: (10 + 10.7 * math.sqrt(100 / agents)) * 1e-6  # per agent-step of a whole run, all included
ON_GS = lambda agents: 0.81 * PER_STEP(agents)  # per agent and step of the global simulator (GS)
AIP_PASS = 0.76e-6  # per sample and epoch of AIP training
CROWDED = 1.08  # several workers share a machine's memory

# Bytes per agent at an exchange, from the shapes of the networks (see docs/cluster.md).
POLICY, AIP, STREAMS = 175_116, 89_104, 8_000
STATE = 3 * POLICY + AIP + STREAMS
DATASET = DATASET_EPISODES * HORIZON * (5 + 4)

# Seconds per byte at rank 0, fitted to an exchange of 1024 agents: see "Measure it" in docs/cluster.md. All ranks were on
# one machine, so a network is not in them.
TAKE_IN, SEND, WRITE = 3.4e-9, 3.4e-9, 3.5e-9

# Measured points: agents, worker cores, hours for 4M steps. From agent-steps/s of `bench`, docs/performance.md.
MEASURED = [(agents, cores, agents * STEPS / speed / 3600) for agents, speeds in
            {100: (48_387, 86_468), 400: (60_555, 117_112), 1024: (75_617, 140_343)}.items()
            for cores, speed in enumerate(speeds, 1)]


def parts(agents, cores):
    """Returns the seconds of a run: training, GS, AIPs and rank 0."""
    crowded = CROWDED if cores > 1 else 1
    owners = min(agents, cores)  # a worker without agents plays episodes only
    gs = ON_GS(agents)
    in_turn = lambda episodes: math.ceil(episodes / cores)
    gs_steps = (EVALUATIONS * in_turn(EPISODES) + in_turn(FINAL_EPISODES) + TRAININGS * in_turn(DATASET_EPISODES)) * HORIZON
    aips = TRAININGS * DATASET_EPISODES * HORIZON * 0.9 * EPOCHS * AIP_PASS
    looked_at = (EVALUATIONS * EPISODES + FINAL_EPISODES + TRAININGS * DATASET_EPISODES) * HORIZON
    training = STEPS * PER_STEP(agents) - looked_at * gs - aips
    policies = 2 * EVALUATIONS + TRAININGS + 1
    rank_0 = EVALUATIONS * (STATE * TAKE_IN + (STATE + POLICY + AIP) * WRITE) + policies * POLICY * SEND
    rank_0 += TRAININGS * DATASET * (TAKE_IN + SEND) if cores > 1 else 0
    return [agents * seconds for seconds in
            (training / owners * crowded, gs_steps * gs * crowded, aips / owners * crowded, rank_0)]


def hours(agents, cores):
    return sum(parts(agents, cores)) / 3600


def table(header, rows):
    print("| " + " | ".join(header) + " |\n|" + "--:|" * len(header))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print()


def short(value):
    return f"{value:.0f}" if value >= 10 else f"{value:.1f}" if value >= 1 else f"{value:.2f}"


def draw(path):
    width, height, left, top, right, bottom = 640, 400, 60, 20, 110, 45
    x_of = lambda cores: left + (width - left - right) * math.log10(cores) / 3
    y_of = lambda h: height - bottom - (height - top - bottom) * (math.log10(h) + 2) / 5  # 0.01 to 1000 hours
    colours = {100: "#0072B2", 400: "#009E73", 1024: "#D55E00", 10_000: "#CC79A7"}
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" font-size="12">',
           f'<rect width="{width}" height="{height}" fill="#FFFFFF"/>']
    text = lambda x, y, words, more="": out.append(f'<text x="{x:.1f}" y="{y:.1f}" {more}>{words}</text>')
    for power in range(4):
        x = x_of(10**power)
        out.append(f'<path d="M{x:.1f} {top}V{height - bottom}" stroke="#DDDDDD"/>')
        text(x, height - bottom + 16, 10**power, 'text-anchor="middle"')
    for power in range(-2, 4):
        y = y_of(10.0**power)
        out.append(f'<path d="M{left} {y:.1f}H{width - right}" stroke="#DDDDDD"/>')
        text(left - 6, y + 4, f"{10.0**power:g}", 'text-anchor="end"')
    text((left + width - right) / 2, height - 8, "worker cores", 'text-anchor="middle"')
    text(14, height / 2, "hours for 4M steps", f'text-anchor="middle" transform="rotate(-90 14 {height / 2})"')
    for agents, colour in colours.items():
        cores = [10 ** (i / 60) for i in range(181)]
        points = [(x_of(round(c)), y_of(hours(agents, round(c)))) for c in cores]
        curve = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        out.append(f'<path d="{curve}" fill="none" stroke="{colour}" stroke-width="1.8"/>')
        text(points[-1][0] + 6, points[-1][1] + 4, f"{agents} agents", f'fill="{colour}"')
        for _, c, h in [point for point in MEASURED if point[0] == agents]:
            out.append(f'<circle cx="{x_of(c):.1f}" cy="{y_of(h):.1f}" r="3.5" fill="{colour}" stroke="#FFFFFF"/>')
    out.append("</svg>\n")
    with open(path, "w") as file:
        file.write("\n".join(out))


SIZES, CORES = (100, 400, 1024, 4096, 10_000), (1, 2, 8, 64, 256, 1000)
table(["agents", "state of an exchange", "joint policy", "datasets"],
      [[str(a)] + [f"{short(a * b / 1e6)} MB" for b in (STATE, POLICY, DATASET)] for a in SIZES])
table(["agents"] + [f"{c} core{'s' * (c > 1)}" for c in CORES], [[str(a)] + [short(hours(a, c)) for c in CORES] for a in SIZES])
table(["cores", "training", "GS", "AIPs", "rank 0"],
      [[str(c)] + [f"{100 * part / sum(parts(1024, c)):.0f} %" for part in parts(1024, c)] for c in CORES])
table(["agents, cores", "measured", "model"],
      [[f"{a}, {c}", short(h), short(hours(a, c))] for a, c, h in MEASURED])
if len(sys.argv) > 1:
    draw(sys.argv[1])
