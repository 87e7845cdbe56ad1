"""How many cars an hour the lights of a network can serve: a rough estimate, for the level of the demand."""

import re
import xml.etree.ElementTree as ET

# Cars an hour over one lane while it is green, by direction.
PER_LANE_H = {"s": 1650, "l": 1350, "r": 1250}
SPEED = {"G": 1, "g": 0.35}  # how fast a link is by its letter; `g` gives way
# Share of the time that yellow, red for all and starting up take.
LOST = 0.2
STEPS = 50


def greens(net):
    """Returns the different greens of every light: states in which somebody goes and nobody is yellow."""
    found = {}
    for program in ET.fromstring(net).iter("tlLogic"):
        states = [phase.get("state") for phase in program.iter("phase")]
        found[program.get("id")] = sorted({state for state in states if re.search("[Gg]", state) and "y" not in state})
    return found


def movements(net):
    """Returns for every light, by pair of edges: the links `(index, lane, direction)` from one to the other."""
    found = {}
    for link in ET.fromstring(net).iter("connection"):
        if "tl" in link.attrib and not link.get("from").startswith(":"):
            pairs = found.setdefault(link.get("tl"), {})
            pairs.setdefault((link.get("from"), link.get("to")), []).append(
                (int(link.get("linkIndex")), link.get("fromLane"), link.get("dir").lower()))
    return found


def broken(net):
    """Returns the lights that have no choice between greens, or no green for one of their links."""
    states, turns = greens(net), movements(net)

    def indices(light):
        return [index for links in turns.get(light, {}).values() for index, _, _ in links]

    def choices(light):
        """Returns the links that go in a green, for each one in which cars go."""
        going = {tuple(index for index in indices(light) if state[index] in "Gg") for state in states[light]}
        return going - {()}

    def served(light):
        return all(any(state[index] in "Gg" for state in states[light]) for index in indices(light))

    return [light for light in states if len(choices(light)) < 2 or not served(light)]


def most(states, turns, cars):
    """Returns by which factor the demand of a light may grow until it needs all greens all the time."""
    hours = sum(part for _, part in needs(states, turns, cars))
    return (1 - LOST) / hours if hours else float("inf")


def needs(states, turns, cars):
    """Yields greens and how long each is needed to serve the cars of an hour: `(state, hours)`, in small steps.

    `cars` are cars an hour by pair of edges. They spread evenly over the lanes that lead there. In every step, the
    green is on that serves the longest queues.
    """
    loads = {}  # share of an hour that a lane needs green for a pair, by lane
    for pair, rate in cars.items():
        for index, lane, direction in turns.get(pair, []):
            need = rate / len(turns[pair]) / PER_LANE_H[direction]
            loads.setdefault((pair[0], lane), []).append((index, need))
    if not loads:
        return
    left = {lane: sum(need for _, need in links) for lane, links in loads.items()}
    # How fast every green serves a lane: as fast as its slowest link, or the share of the links that go.
    speeds = {}
    for lane, links in loads.items():
        speeds[lane] = [min(SPEED.get(state[index], 0) for index, _ in links) for state in states]
        if not any(speeds[lane]):
            speeds[lane] = [sum(need for index, need in links if state[index] in "Gg") / left[lane] for state in states]
    step = max(left.values()) / STEPS
    while any(need > 0 for need in left.values()):
        served = [{lane: min(speeds[lane][green] * step, need) for lane, need in left.items()}
                  for green in range(len(states))]
        best = max(range(len(states)), key=lambda green: sum(left[lane] * part for lane, part in served[green].items()))
        yield states[best], max(part / speeds[lane][best] for lane, part in served[best].items() if part > 0)
        left = {lane: need - served[best][lane] for lane, need in left.items()}
