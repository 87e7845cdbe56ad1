"""Bus lines of a city, both ways through it, with stops and a timetable."""

from math import atan2

from .network import element
from .traffic import route, vehicle

LIGHTS_PER_LINE = 20
EVERY_S = 600
STOP_S = 15  # least time at a stop
STOP_M, STOPS_APART_M = 15, 250  # length of a stop, and least way between two
LATE = 1.15  # how long a bus has by the timetable, as a share of the fastest drive
DETOUR = 3  # how much buses avoid streets of one lane and the ring road


def lines(city, ways, count):
    """Returns the ways of the buses, from one end of the city to the other and back."""
    slow = {part: DETOUR for edge, _, kind, lanes in city.edges() if lanes == 1 or kind == "ring"
            for part in (edge, f"{edge}_turn")}
    wide = [corner for corner in city.plan.outside if city.lanes(corner, city.plan.arms[corner][0]) > 1]
    wide.sort(key=lambda corner: atan2(*city.plan.places[corner]))
    found = []
    for number in range(count):
        start = wide[number * len(wide) // (2 * count)]
        goal = max(wide, key=lambda corner: city.plan.distance(start, corner))
        for one, other in ((start, goal), (goal, start)):
            way = ways.fastest(city.edge_from(one), city.edge_to(other), slow)
            if way:
                found.append(way)
    return found


def stops_of(way, ways, city):
    """Returns `(edge, seconds from the start)` of the stops of a line: on wide streets, behind a corner."""
    lanes = {edge: count for edge, _, _, count in city.edges()}
    found, seconds, metres = [], 0.0, 0.0
    for edge, following in zip(way, way[1:]):
        if metres > STOPS_APART_M and lanes.get(edge, 0) > 1 and ways.metres[edge] > 5 * STOP_M:
            found.append((edge, round(LATE * seconds)))
            metres = 0.0
            seconds += STOP_S
        seconds += ways.seconds[edge] + ways.after[edge][following]
        metres += ways.metres[edge]
    return found


def buses(city, ways, lights, dice, end_s):
    """Returns the stops, the routes, and the buses as pairs of a second and a text."""
    count = max(1, round(lights / LIGHTS_PER_LINE))
    stops, routes, rows = {}, [], []
    for number, way in enumerate(lines(city, ways, count)):
        calls = stops_of(way, ways, city)
        routes.append(route(f"line{number}", way))
        for edge, _ in calls:
            stops[edge] = element("busStop", {"id": f"stop_{edge}", "lane": f"{edge}_0", "startPos": 2 * STOP_M,
                                              "endPos": 3 * STOP_M})
        for depart_s in range(int(dice.between(0, EVERY_S)), end_s - EVERY_S, EVERY_S):
            times = [element("stop", {"busStop": f"stop_{edge}", "duration": STOP_S,
                                      "until": depart_s + seconds + STOP_S}) for edge, seconds in calls]
            rows.append((depart_s, vehicle(f"bus{number}_{depart_s}", "bus", f"line{number}", depart_s, times)))
    return list(stops.values()), routes, rows
