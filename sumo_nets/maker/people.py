"""People on foot: over every crossing of an island with signals, from pavement to pavement."""

import xml.etree.ElementTree as ET

from .network import element
from .traffic import END_S

PEOPLE_H = (20, 100)  # people an hour over a crossing
FROM_CORNER_M = 15  # where they come from and go to, measured along the pavement from the junction


def crossings(net):
    """Returns the crossings of the lights, each with the edges on its one side and those on its other side.

    An edge comes with the place on it where people begin or end, as SUMO counts it.
    """
    root = ET.fromstring(net)
    function = {edge.get("id"): edge.get("function") for edge in root.iter("edge")}
    length_m = {edge.get("id"): float(edge.find("lane").get("length")) for edge in root.iter("edge")}
    beside, around, signals = {}, {}, set()

    def metres(edge):
        return round(min(FROM_CORNER_M, length_m[edge] / 2), 2)

    for link in root.iter("connection"):
        start, goal = link.get("from"), link.get("to")
        kinds = function[start], function[goal]
        if kinds == ("walkingarea", None):
            beside.setdefault(start, []).append((goal, metres(goal)))
        elif kinds == (None, "walkingarea"):
            beside.setdefault(goal, []).append((start, -metres(start)))
        elif kinds == ("walkingarea", "crossing"):
            around.setdefault(goal, [None, None])[0] = start
            signals |= {goal} if link.get("tl") else set()
        elif kinds == ("crossing", "walkingarea"):
            around.setdefault(start, [None, None])[1] = goal
    found = {name: [beside.get(area, []) for area in areas] for name, areas in sorted(around.items()) if name in signals}
    return {name: sides for name, sides in found.items() if all(sides)}


def walks(net, dice):
    """Returns flows of people over the crossings of an island, both ways, as pairs of a second and a text."""
    flows = []
    for crossing, sides in crossings(net).items():
        rate_h = PEOPLE_H[0] + (PEOPLE_H[1] - PEOPLE_H[0]) * dice.next() ** 2
        ends = [side[int(dice.between(0, len(side)))] for side in sides]
        for way, ((start, begins_at), (goal, ends_at)) in enumerate([ends, ends[::-1]]):
            flows.append((0, element("personFlow", {
                "id": f"{crossing[1:]}_{way}", "begin": 0, "end": END_S, "probability": f"{rate_h / 2 / 3600:.5f}",
                "departPos": begins_at,
            }, [element("walk", {"from": start, "to": goal, "arrivalPos": ends_at})])))
    return flows
