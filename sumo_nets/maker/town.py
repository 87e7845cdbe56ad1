"""An irregular town: 20 lights on main streets and collectors, with streets without lights between them."""

from math import cos, hypot, radians, sin

from .network import Roads
from .programs import with_short_reds
from .traffic import QUARTER_S, Dice, route, types, vehicle, write
from .ways import Ways

SEED = 18
COLUMNS, ROWS = "abcdefghij", range(1, 9)
BLOCK_M, JITTER_M, TURNED_DEGREES = 118, 19, 14
OUTSIDE_M, POCKET_M = 160, 40

# Streets by line of the grid; every other line is a minor street. Some of these are one-way.
MAIN, COLLECTORS = ("d", "h", 4), ("b", "f", "j", 2, 6, 8)
ONE_WAY = {3: "east", 5: "west", "e": "north", "g": "south"}
LANES = {"main": 2, "collector": 1, "minor": 1}
SPEED_MPS = {"main": 13.89, "collector": 13.89, "minor": 8.33}
PRIORITY = {"main": 3, "collector": 2, "minor": 1}
# Minor streets that end at a main street's corner, across the blocks.
DIAGONALS = (("e5", "f6"), ("g3", "h4"), ("c7", "d6"), ("i7", "h8"))
# Lights with a lane for left turns on main streets: where two of them meet, and where a diagonal ends.
LEFT_LANES = ("d4", "h4", "d6", "h8")
REMOVED = 0.2  # share of the blocks of minor streets without a street
NO_WAY_OUT = ("b8_outside", "j2_outside", "f1_outside")

# Vehicles per hour in all, by quarter of an hour.
RATE_PER_H = [1900, 2700, 3000, 2100]
# From outside or from within, to outside or within, by quarter: the town fills first and empties later.
JOURNEYS = [
    {"out_out": 40, "out_in": 35, "in_out": 12, "in_in": 13},
    {"out_out": 40, "out_in": 35, "in_out": 12, "in_in": 13},
    {"out_out": 45, "out_in": 20, "in_out": 25, "in_in": 10},
    {"out_out": 45, "out_in": 12, "in_out": 33, "in_in": 10},
]
WEIGHT = {"main": 5, "collector": 1.5, "minor": 1}
TRUCKS = 0.1  # share of the vehicles from outside to outside
BUS_EVERY_S = 600
SHORTEST = 3  # edges of a journey
DETOUR = 0.6  # streets seem up to this share longer to a driver than they are


def kind_of(line):
    return "main" if line in MAIN else "collector" if line in COLLECTORS else "minor"


def blocks():
    """Returns the streets between neighbours: `(start, end, line)`, and those that leave the town."""
    for column, letter in enumerate(COLUMNS):
        for row in ROWS:
            if column + 1 < len(COLUMNS):
                yield f"{letter}{row}", f"{COLUMNS[column + 1]}{row}", row
            if row + 1 in ROWS:
                yield f"{letter}{row}", f"{letter}{row + 1}", letter


def place(column, row, dice):
    """Returns a corner's place: blocks are small in the middle of the town, and nothing is straight."""
    x, y = column - (len(COLUMNS) - 1) / 2, row - (len(ROWS) + 1) / 2
    stretched = BLOCK_M * (0.85 + 0.05 * hypot(x, y))
    x, y = x * stretched + dice.between(-JITTER_M, JITTER_M), y * stretched + dice.between(-JITTER_M, JITTER_M)
    turned = radians(TURNED_DEGREES)
    return x * cos(turned) - y * sin(turned), x * sin(turned) + y * cos(turned)


def corners(dice):
    """Returns the places of all corners, and of the ends outside of all main streets and collectors."""
    places = {f"{letter}{row}": place(column, row, dice) for column, letter in enumerate(COLUMNS) for row in ROWS}
    for line in MAIN + COLLECTORS:
        on_line = [f"{letter}{line}" for letter in COLUMNS] if line in ROWS else [f"{line}{row}" for row in ROWS]
        for end, before in [(on_line[0], on_line[1]), (on_line[-1], on_line[-2])]:
            (x, y), (x0, y0) = places[end], places[before]
            outwards = OUTSIDE_M / hypot(x - x0, y - y0)
            if f"{end}_outside" not in NO_WAY_OUT:
                places[f"{end}_outside"] = (x + outwards * (x - x0), y + outwards * (y - y0))
    return places


def streets(places, dice):
    """Returns `{(start, end): kind}` for every direction of every street, without dead ends."""
    found = {}
    for start, end, line in blocks():
        kind = kind_of(line)
        if kind == "minor" and dice.next() < REMOVED:
            continue
        if ONE_WAY.get(line) not in ("west", "south"):
            found[start, end] = kind
        if ONE_WAY.get(line) not in ("east", "north"):
            found[end, start] = kind
    for corner in places:
        if corner.endswith("_outside"):
            inner = corner.removesuffix("_outside")
            column, row = inner[0], int(inner[1])
            kind = kind_of(row if row in MAIN + COLLECTORS and column in "aj" else column)
            found[corner, inner] = found[inner, corner] = kind
    for start, end in DIAGONALS:
        found[start, end] = found[end, start] = "minor"
    while True:
        dead = {street for street in found if dead_end(street, found)}
        if not dead:
            return found
        found = {street: kind for street, kind in found.items() if street not in dead}


def dead_end(street, all_streets):
    """Says whether a street leads nowhere or comes from nowhere, but for a turn-around."""
    start, end = street
    outside = [corner.endswith("_outside") for corner in street]
    goes_on = outside[1] or any(a == end and b != start for a, b in all_streets)
    comes_from = outside[0] or any(b == start and a != end for a, b in all_streets)
    return not (goes_on and comes_from)


def has_light(corner):
    return corner[0] in MAIN + COLLECTORS and corner[1:].isdigit() and int(corner[1:]) in MAIN + COLLECTORS


def widens(kind, end, all_streets):
    """Says whether a street gets a lane for left turns before a light."""
    others = {all_streets[street] for street in all_streets if street[1] == end}
    return has_light(end) and (kind == "collector" and "main" in others or kind == "main" and end in LEFT_LANES)


def roads(dice):
    made, places = Roads(), corners(dice)
    all_streets = streets(places, dice)
    used = {corner for street in all_streets for corner in street}
    for corner, (x, y) in places.items():
        if corner in used:
            made.node(corner, x, y, **({} if corner.endswith("_outside") else
                                       {"type": "traffic_light" if has_light(corner) else "priority"}))
    for (start, end), kind in all_streets.items():
        street = (LANES[kind], SPEED_MPS[kind], PRIORITY[kind])
        if not widens(kind, end, all_streets):
            made.edge(start, end, *street)
            continue
        made.widened(start, end, *street, POCKET_M)
    return made, all_streets


def ends(all_streets, where, leaving):
    """Returns the edges where cars begin (or end, if they are leaving), with weights, outside or within the town."""
    def fits(street):
        return street[leaving].endswith("_outside") if where == "out" else all_streets[street] == "minor"

    return {f"{start}_{end}": WEIGHT[kind] for (start, end), kind in all_streets.items() if fits((start, end))}


def journeys(ways, all_streets, dice):
    """Returns `(time, kind of vehicle, edges)` of all cars and trucks."""
    starts, goals = ({where: ends(all_streets, where, leaving) for where in ("out", "in")} for leaving in (False, True))
    found = []
    for quarter, rate in enumerate(RATE_PER_H):
        for depart_s in dice.times(rate, quarter * QUARTER_S, (quarter + 1) * QUARTER_S):
            start, goal = dice.choose(JOURNEYS[quarter]).split("_")
            way = None
            while way is None or len(way) < SHORTEST:
                dearer = {edge: dice.between(1, 1 + DETOUR) for edge in ways.seconds}
                way = ways.fastest(dice.choose(starts[start]), dice.choose(goals[goal]), dearer)
            kind = "truck" if start == goal == "out" and dice.next() < TRUCKS else "car"
            found.append((depart_s, kind, way))
    return found


def buses(ways):
    """Returns the journeys of buses along the main streets, both ways."""
    for line, (one, other) in enumerate([("a4", "j4"), ("d1", "d8"), ("h1", "h8")]):
        for direction, (start, end) in enumerate([(one, other), (other, one)]):
            way = ways.fastest(f"{start}_outside_{start}", f"{end}_{end}_outside")
            for depart_s in range(60 + 100 * line + 50 * direction, 3600, BUS_EVERY_S):
                yield depart_s, "bus", way


def make(folder):
    dice = Dice(SEED)
    made, all_streets = roads(dice)
    net = with_short_reds(made.convert("--tls.default-type", "static", "--tls.layout", "opposites"))
    ways = Ways(net)
    trips = sorted([*journeys(ways, all_streets, dice), *buses(ways)], key=lambda trip: trip[0])
    names, rows = {}, []
    for number, (depart_s, kind, way) in enumerate(trips):
        name = names.setdefault(tuple(way), f"way_{len(names)}")
        rows.append(vehicle(f"{kind}_{number}", kind, name, depart_s))
    write(folder, folder.name, net, types("car", "truck", "bus") + [route(name, way) for way, name in names.items()] + rows)
