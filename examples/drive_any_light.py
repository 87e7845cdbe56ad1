"""Drive the lights of any scenario with one policy for any light: libsumo and numpy, and nothing of ours.

    dials-traffic nets inspect town.sumocfg --json > lights.json
    pip install libsumo==1.15.0 numpy safetensors
    python3 examples/drive_any_light.py town.sumocfg lights.json models/any_light.safetensors

Nothing is trained: the policy has never seen the scenario. The file is one that `dials-traffic export RUN --out X.safetensors`
wrote, or models/any_light.safetensors. After it there may be a seed for SUMO, and `--sample` as in drive_sumo.py.
"""

import json
from pathlib import Path

import libsumo
import numpy as np
from drive_sumo import Light, drawn, main, play
from read_policies import read
from safetensors import safe_open

STRETCHES_M, JAM_M, STANDS_MPS = (10, 25, 50, 100, 150), 7.5, 0.1
FORMAT = "dials-traffic any-light 4"
LONGEST_RED_S, HOLD_S = 120, 30
#: Queues in tens of cars: for these a green stays, and these count their red three times.
SEVERAL, LONG_QUEUE = 0.3 - 1e-6, 0.8 - 1e-6


def time(seconds):
    """Return a time as a feature."""
    return np.log1p(seconds) / 5


def seconds(feature):
    """Return the time that a feature shows."""
    return np.rint(np.expm1(5 * feature))


class AnyLight(Light):
    """A light as a set of lanes and a set of greens. The features are in the order that the file names."""

    def __init__(self, plan, seen_m):
        super().__init__(plan)
        self.seen_m, self.since_s = seen_m, np.zeros(len(plan["greens"]))
        of_lanes = [[plan["links"][link] for link in lane["links"]] for lane in plan["approaches"]]
        self.letters = [[link["letter"] for link in links] for links in of_lanes]
        self.exits = [[plan["exits"][link["to"]] for link in links] for links in of_lanes]
        #: For each crossing: its edge, the pavements that lead there, and the greens in which people walk.
        self.crossings = [(way["crossing"], way["from"], way["greens"]) for way in plan["people"]]

        def share(green, lane, letters):
            return sum(green[letter] in letters for letter in self.letters[lane]) / max(1, len(self.letters[lane]))

        lanes = range(len(plan["approaches"]))
        #: `[greens, 2, lanes]`: the share of a lane's links that a green opens, in all and with priority.
        self.opens = np.array([[[share(green, lane, letters) for lane in lanes] for letters in ("Gg", "G")]
                               for green in plan["greens"]])

    def shown_green(self):
        """Return the green that is shown, or None between two greens."""
        return None if self.clearing else self.green

    def see_lanes(self):
        """Return the features of all lanes, `[lanes, 29]`. It sees all cars, so the last ten are 0."""
        green, features = self.shown_green(), np.zeros((len(self.exits), 29))
        for lane, (row, road, exits) in enumerate(zip(features, self.plan["approaches"], self.exits)):
            cars = [(road["length_m"] - libsumo.vehicle.getLanePosition(car) + road["ahead_m"], libsumo.vehicle.getSpeed(car))
                    for car in libsumo.lane.getLastStepVehicleIDs(road["lane"])]
            cars = [car for car in cars if car[0] <= self.seen_m]
            links = max(1, len(exits))
            row[:4] = 1, min(road["length_m"], self.seen_m - road["ahead_m"]) / 150, road["speed_limit_mps"] / 20, len(exits) / 4
            row[4:6] = sum(speed < STANDS_MPS for _, speed in cars) / 10, len(cars) / 10
            for before_m, _ in cars:
                stretch = np.searchsorted(STRETCHES_M, before_m, side="right")
                row[6:11][stretch : stretch + 1] += 0.1
            row[11] = np.mean([speed for _, speed in cars]) / road["speed_limit_mps"] if cars else 0
            row[12] = 0 if green is None else self.opens[green, 0, lane]
            row[13] = time(min((since for since, opens in zip(self.since_s, self.opens[:, 0, lane]) if opens), default=0))
            for road in exits:
                count = libsumo.lane.getLastStepVehicleNumber(road["lane"])
                filled = min(1, count / max(1, road["length_m"] / JAM_M))
                row[14:17] += np.array([count / 10, libsumo.lane.getLastStepHaltingNumber(road["lane"]) / 10, filled]) / links
                row[17] = max(row[17], filled)
            row[18] = sum(not road["leaves_the_net"] for road in exits) / links
        return features

    def see_people(self):
        """Return for each green how many people wait to walk, in tens, and the longest time since they could, `[greens, 2]`."""
        features = np.zeros((len(self.opens), 2))
        for crossing, areas, greens in self.crossings:
            people = [person for area in areas for person in libsumo.edge.getLastStepPersonIDs(area)]
            count = sum(libsumo.person.getSpeed(person) < STANDS_MPS and libsumo.person.getNextEdge(person) == crossing
                        for person in people)
            if count and greens:
                features[greens, 0] += count / 10
                features[greens, 1] = np.maximum(features[greens, 1], time(self.since_s[greens].min()))
        return features

    def see_greens(self):
        """Return the features of all greens, `[greens, 11]`."""
        shown, features = self.shown_green(), np.zeros((len(self.opens), 11))
        features[:, 9:] = self.see_people()
        for green, row in enumerate(features):
            row[:3] = 1, green == self.green, green == shown
            row[4] = time(self.since_s[green])
            if green == shown:
                row[3], row[5] = time(self.shown_s), max(0, self.plan["min_green_s"][green] - self.shown_s) / 10
            elif shown is not None:
                row[6] = sum(state["seconds"] for state in self.changes[shown, green]["states"]) / 10
            change = None if shown is None else self.changes.get((shown, green))
            is_old_enough = green == self.green or change is not None and self.shown_s >= change["after_s"]
            row[7:9] = is_old_enough, self.opens[green, 0].sum() / 4
        return features

    def show(self, action):
        super().show(action)
        self.since_s += 1
        if not self.clearing:
            self.since_s[self.green] = 0


def scores(policy, lanes, greens, opens):
    """Return a score for each green. Every lane is read alike, and every green is scored alike."""

    def affine(name, layer, rows):
        return rows @ policy[f"{name}.{layer}.weight"][0] + policy[f"{name}.{layer}.bias"][0]

    for layer in range(sum(name.startswith("items.") for name in policy) // 2):
        lanes = np.maximum(affine("items", layer, lanes), 0)
    pooled = (opens @ lanes).reshape(len(greens), -1)
    all_lanes = np.tile(lanes.sum(axis=0) / 4, (len(greens), 1))
    hidden = np.maximum(affine("choices", 0, np.concatenate([greens, pooled, all_lanes], axis=1)), 0)
    return affine("choices", 1, hidden)[:, 0]


def by_the_rules(allowed, lanes, greens, opens):
    """Return which greens are allowed. One stays while a queue passes; else those come who have stood at red for too long."""
    needed = (greens[:, 2] == 1) & (seconds(greens[:, 3]) < HOLD_S) & (opens[:, 0, lanes[:, 4] >= SEVERAL] > 0).any(axis=1)
    if (allowed & needed).any() and not greens[:, 9].any():
        return allowed & needed
    red = seconds(np.where(lanes[:, 4] > 0, lanes[:, 13], 0)) * np.where(lanes[:, 4] >= LONG_QUEUE, 3, 1)
    on_foot = seconds(greens[:, 10])
    longest = max(red.max(), on_foot.max())
    serving = allowed & ((opens[:, 0, red == longest] > 0).any(axis=1) | (on_foot == longest))
    return serving if longest >= LONGEST_RED_S and serving.any() else allowed


def drive(config, lights, file, seed=0, trips=None, sample=False):
    """Play a scenario. Yield what all lights saw, as (lanes, greens) of each, and what they did then."""
    with safe_open(file, "np") as opened:
        about = json.loads((opened.metadata() or {}).get("any_light", "{}"))
    if about.get("format") != FORMAT:
        raise SystemExit(f"{file}: is no policy for any light of this version; `dials-traffic export` writes one")
    policy, dice = read(file), np.random.default_rng(int(seed))
    lights = [AnyLight(plan, about["seen_m"]) for plan in json.loads(Path(lights).read_text())["learning"]]

    def choose():
        obs = [(light.see_lanes(), light.see_greens()) for light in lights]
        left = [by_the_rules(np.array(light.allowed(len(greens))), lanes, greens, light.opens)
                for light, (lanes, greens) in zip(lights, obs)]
        found = [np.where(greens_left, scores(policy, lanes, greens, light.opens), -np.inf)
                 for light, greens_left, (lanes, greens) in zip(lights, left, obs)]
        return obs, [drawn(row, dice, sample) for row in found]

    yield from play(config, lights, choose, seed, trips, about["decision_s"])


if __name__ == "__main__":
    main(drive, __doc__)
