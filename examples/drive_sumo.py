"""Drive the lights of a scenario with the trained policies of a run: libsumo and numpy, and nothing of ours.

    dials-traffic nets inspect town.sumocfg --json > lights.json
    pip install libsumo==1.15.0 numpy safetensors
    python3 examples/drive_sumo.py town.sumocfg lights.json runs/town/policies.safetensors

It decides every 5 s, which is the default, and prints the mean delay of all cars. Each light takes its most likely action, as
with `dials-traffic evaluate --greedy`. With `--sample` as the last argument each light draws its action by its probability, as
`evaluate` does without `--greedy`; the random numbers are others. Before `--sample` there may be a seed for SUMO: that in the
.sumocfg of a replay gives the traffic of that episode. With `import traci as libsumo` it drives SUMO in another process.
"""

import json
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import libsumo
import numpy as np
from read_policies import judge, read

DECISION_S, CELL_M = 5, 10.0


class Light:
    """What `docs/environments.md` says of a light: what it sees, which greens are allowed, and what it then shows."""

    def __init__(self, plan):
        self.plan = plan
        self.changes = {(change["from"], change["to"]): change for change in plan["changes"]}
        self.green, self.clearing, self.shown_s, self.head_start_s = 0, [], 0, plan["min_green_s"][0]
        self.cells = [sum(name.startswith(f"{way['lane']}[") for name in plan["columns"]) for way in plan["approaches"]]

    def observe(self, columns):
        parts = [np.zeros(cells, np.float32) for cells in self.cells]
        for part, road in zip(parts, self.plan["approaches"]):
            for car in libsumo.lane.getLastStepVehicleIDs(road["lane"]):
                cell = int((road["length_m"] - libsumo.vehicle.getLanePosition(car)) / CELL_M)
                part[cell : cell + 1] = 1
        shown = np.eye(len(self.plan["greens"]))[self.green], [bool(self.clearing), min(self.shown_s / 60, 1)]
        obs = np.concatenate([*parts, *shown]).astype(np.float32)
        return np.pad(obs, (0, columns - len(obs)))

    def obeyed(self, actions):
        """Say which greens may come next. Longest greens and reds, which agents.toml may set, are left out."""
        shown_s = -1 if self.clearing else self.shown_s + self.head_start_s
        ways = {to for (green, to), change in self.changes.items() if green == self.green and shown_s >= change["after_s"]}
        return [action == self.green or action in ways for action in range(actions)]

    def gives_green(self, green, link):
        return self.plan["greens"][green][self.plan["links"][link]["letter"]] in "Gg"

    def crosses(self, green, link):
        """Say whether a green sends cars across the way of a link, and does not open it."""
        others = self.plan["links"][link]["crosses"]
        return not self.gives_green(green, link) and any(self.gives_green(green, other) for other in others)

    def allowed(self, actions):
        """Say which greens a policy may choose: they send no cars across one that stands within the junction without green."""
        obeyed, links = self.obeyed(actions), self.plan["links"]
        standing = [link for link in range(len(links)) if any(map(libsumo.lane.getLastStepHaltingNumber, links[link]["inside"]))]
        trapped = [link for link in standing if self.clearing or not self.gives_green(self.green, link)]
        left = [may and not any(self.crosses(green, link) for link in trapped) for green, may in enumerate(obeyed)]
        return left if any(left) else obeyed

    def show(self, action):
        """Show what follows from an action in the next second."""
        if self.clearing:
            self.clearing.pop(0)
            self.shown_s = self.shown_s if self.clearing else 0
        elif action != self.green and self.obeyed(action + 1)[action]:
            states = self.changes[self.green, action]["states"]
            self.clearing = [state["state"] for state in states for _ in range(state["seconds"])]
            self.green, self.shown_s, self.head_start_s = action, 0, 0
        self.shown_s += 1
        state = self.clearing[0] if self.clearing else self.plan["greens"][self.green]
        libsumo.trafficlight.setRedYellowGreenState(self.plan["light"], state)


def play(config, lights, choose, seed=0, trips=None, decision_s=DECISION_S):
    """Play a scenario with SUMO. Yield after every decision what `choose` returns: what the lights saw, and what they do.

    `seed`: that of SUMO. SUMO writes the trip of every car into the file `trips`, if there is one.
    """
    options = ["--seed", str(seed), "--no-step-log", "--no-warnings"]
    if trips:
        options += ["--tripinfo-output", str(trips), "--precision", "6"]
        options += [f"--tripinfo-output.write-{which}" for which in ("unfinished", "undeparted")]
    libsumo.start(["sumo", "-c", str(config), *options])
    try:
        while libsumo.simulation.getTime() + decision_s <= libsumo.simulation.getEndTime():
            obs, actions = choose()
            for _ in range(decision_s):
                for light, action in zip(lights, actions):
                    light.show(action)
                libsumo.simulationStep()
            yield obs, actions
    finally:
        libsumo.close()


def drawn(scores, dice, sample):
    """Return the actions with the best scores, or draw them: the largest score with Gumbel's noise is a draw from the softmax."""
    return (scores + dice.gumbel(size=scores.shape) if sample else scores).argmax(axis=-1)


def drive(config, lights, policies, seed=0, trips=None, sample=False):
    """Play a scenario. Yield what all lights saw, `[lights, columns]`, and what they did then.

    `sample`: draw actions by their probabilities instead of taking the most likely one.
    """
    told, stack, states = json.loads(Path(lights).read_text()), read(policies), None
    known = stack.get("gru.input_weight", stack["layers.0.weight"]).shape[:2]
    there = len(told["learning"]), told["kind"]["columns"]
    if known != there:
        raise SystemExit(
            f"{policies}: is of {known[0]} lights that see {known[1]} columns, and {lights} has {there[0]} that see "
            f"{there[1]}; train on this scenario itself: dials-traffic train {config}"
        )
    lights = [Light(plan) for plan in told["learning"]]
    dice = np.random.default_rng(int(seed))

    def choose():
        nonlocal states
        obs = np.stack([light.observe(told["kind"]["columns"]) for light in lights])
        masks = np.array([light.allowed(told["kind"]["actions"]) for light in lights])
        logits, _, states = judge(stack, obs[:, None], states)
        return obs, drawn(np.where(masks, logits[:, 0], -np.inf), dice, sample)

    yield from play(config, lights, choose, seed, trips)


def delay_s(trips):
    """Return the mean delay of all cars, as `docs/figures.md` defines it: on the way, and before they could enter."""
    cars = list(ElementTree.parse(trips).iter("tripinfo"))
    return sum(float(car.get(lost)) for car in cars for lost in ("timeLoss", "departDelay")) / max(len(cars), 1)


def main(drive, usage):
    """Play the scenario of the command line, and print the mean delay."""
    sample = sys.argv[-1] == "--sample"
    arguments = sys.argv[1:-1] if sample else sys.argv[1:]
    if len(arguments) not in (3, 4) or not all(Path(file).is_file() for file in arguments[:3]):
        sys.exit(usage)
    with tempfile.TemporaryDirectory() as folder:
        trips = Path(folder) / "trips.xml"
        decisions = len(list(drive(*arguments, trips=trips, sample=sample)))
        how = "drawn by their probability" if sample else "the most likely ones (--sample draws them)"
        print(f"{decisions} decisions, delay_s {delay_s(trips):.2f}; actions: {how}")


if __name__ == "__main__":
    main(drive, __doc__)
