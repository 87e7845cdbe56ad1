"""A grid of 4 x 4 lights with left-turn lanes and eight greens each; cars come at random, by SUMO's seed."""

from .network import Roads, links
from .programs import program, with_programs
from .traffic import flow, route, types, write

SIZE = 4
SPACING_M = 200
SPEED_MPS = 13.89
# Streets from west to east have three lanes, the others two. The leftmost lane is for left turns alone.
LANES = {"w": 3, "e": 3, "s": 2, "n": 2}
STEP = {"w": (1, 0), "e": (-1, 0), "s": (0, 1), "n": (0, -1)}
LEFT_OF = {"w": "n", "n": "e", "e": "s", "s": "w"}
OPPOSITE = {"w": "e", "e": "w", "s": "n", "n": "s"}

# Vehicles per hour in all, by quarter of an hour, and the weights of the sides where they come from.
RATE_PER_H = [1100, 1700, 2100, 1100]
WEIGHTS = [{"w": 4, "e": 2, "s": 1, "n": 1}, {"w": 4, "e": 2, "s": 2, "n": 1},
           {"w": 2, "e": 3, "s": 2, "n": 2}, {"w": 1, "e": 3, "s": 1, "n": 3}]
STRAIGHT, ONE_TURN, TWO_TURNS = 0.4, 0.45, 0.15
TRUCKS = 0.1  # share of the vehicles that go straight


def place(x, y):
    """Returns the node of a crossing, or of the place outside where a street begins."""
    for side, outside in {"w": x < 0, "e": x >= SIZE, "s": y < 0, "n": y >= SIZE}.items():
        if outside:
            return f"{side}{y if side in 'we' else x}"
    return f"x{x}y{y}"


def inside(x, y):
    return 0 <= x < SIZE and 0 <= y < SIZE


def came_from(x, y, side):
    """Returns the crossing before this one, for cars that come from a side."""
    return x - STEP[side][0], y - STEP[side][1]


def approach(x, y, side):
    return f"{place(*came_from(x, y, side))}_{place(x, y)}"


def roads():
    made = Roads()
    for x in range(-1, SIZE + 1):
        for y in range(-1, SIZE + 1):
            if inside(x, y):
                made.node(place(x, y), x * SPACING_M, y * SPACING_M, type="traffic_light")
            elif inside(x, 0) or inside(0, y):
                made.node(place(x, y), x * SPACING_M, y * SPACING_M)
    crossings = [(x, y) for x in range(SIZE) for y in range(SIZE)]
    for x, y in crossings:
        for side, lanes in LANES.items():
            before, here = came_from(x, y, side), place(x, y)
            made.edge(place(*before), here, lanes, SPEED_MPS, 1)
            if not inside(*before):
                made.edge(here, place(*before), lanes, SPEED_MPS, 1)
    for x, y in crossings:
        here = place(x, y)
        for side, lanes in LANES.items():
            def leaves(exit_side):
                return f"{here}_{place(*came_from(x, y, exit_side))}"

            left = LEFT_OF[side]
            came = approach(x, y, side)
            made.connect(came, leaves(OPPOSITE[left]), (0, 0))
            made.connect(came, leaves(OPPOSITE[side]), *[(lane, lane) for lane in range(lanes - 1)])
            made.connect(came, leaves(left), (lanes - 1, LANES[left] - 1))
    return made


def light_program(net_links, x, y):
    """Eight greens: straight and right from two sides, left from two sides, and everything from one side."""
    def green(sides, directions):
        return {approach(x, y, side): directions for side in sides}

    # In this order the cars of a side that go in two greens on end see no yellow between them.
    greens = [(10, green("we", "sr")), (5, green("w", "srl")), (6, green("we", "l")), (5, green("e", "srl")),
              (10, green("sn", "sr")), (5, green("s", "srl")), (6, green("sn", "l")), (5, green("n", "srl"))]
    # Neighbours are half a cycle apart: a little better than all at once.
    return program(place(x, y), net_links, greens, offset_s=38 * ((x + y) % 2))


def follow(x, y, side, turns):
    """Returns the edges from a place outside to the next one. `turns` maps a crossing to the side it is left by."""
    edges = [approach(x, y, side)]
    while inside(x, y):
        side = OPPOSITE[turns.get((x, y), OPPOSITE[side])]
        after = (x + STEP[side][0], y + STEP[side][1])
        edges.append(f"{place(x, y)}_{place(*after)}")
        x, y = after
    return edges


def routes():
    """Returns `(side, name, edges, share of the cars of its entry)` for every route."""
    for side in LANES:
        along_x = side in "we"
        across = "sn" if along_x else "we"
        for street in range(SIZE):
            def crossing(other):
                return (other, street) if along_x else (street, other)

            first = crossing(0 if side in "ws" else SIZE - 1)
            yield side, f"{side}{street}_straight", follow(*first, side, {}), STRAIGHT
            for other in range(SIZE):
                for turn in across:
                    edges = follow(*first, side, {crossing(other): turn})
                    yield side, f"{side}{street}_{turn}{other}", edges, ONE_TURN / (2 * SIZE)
            for goal in range(SIZE):
                if goal == street:
                    continue
                # Between the two turns, the routes are spread over all streets.
                other = (street + goal) % SIZE
                turn = across[goal > street]
                back = (other, goal) if along_x else (goal, other)
                edges = follow(*first, side, {crossing(other): turn, back: OPPOSITE[side]})
                yield side, f"{side}{street}_{OPPOSITE[side]}{goal}", edges, TWO_TURNS / (SIZE - 1)


def make(folder):
    net = roads().convert()
    found = links(net)
    crossings = [(x, y) for x in range(SIZE) for y in range(SIZE)]
    programs = {place(x, y): light_program(found[place(x, y)], x, y) for x, y in crossings}
    ways = list(routes())
    rows = types("car", "truck") + [route(name, edges) for _, name, edges, _ in ways]
    for quarter, rate in enumerate(RATE_PER_H):
        weights = WEIGHTS[quarter]
        for side, name, _, share in ways:
            cars = rate * weights[side] / sum(weights.values()) / SIZE * share
            if name.endswith("straight"):
                rows.append(flow(f"truck_{name}_{quarter}", "truck", name, quarter, TRUCKS * cars))
                cars *= 1 - TRUCKS
            rows.append(flow(f"car_{name}_{quarter}", "car", name, quarter, cars))
    write(folder, folder.name, with_programs(net, programs), rows)
