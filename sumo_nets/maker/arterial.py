"""An arterial road of six lights; the peak goes east for half an hour, then west."""

from .network import Roads, links
from .programs import program, with_programs
from .traffic import flow, route, types, write
from .ways import Ways

SPEED_MPS, SIDE_SPEED_MPS = 13.89, 11.11
OUTSIDE_M, SIDE_M, POCKET_M = 300, 200, 60
ALL_RED_S = 1

# Crossings from west to east: place, and lanes of the side roads to the north and to the south (0: no road).
LIGHTS = {"a1": (0, 0, 1, 1), "a2": (260, 14, 2, 2), "a3": (620, 10, 0, 1), "a4": (860, -18, 2, 2),
          "a5": (1240, -34, 1, 1), "a6": (1450, -20, 2, 1)}
# Junctions without a light on the arterial. Only right turns lead into their side streets and out of them.
BACK_STREET, SHOPS = ("m1", 440, 12), ("m2", 1050, -26)
# Eastbound, a crossing begins its main green when the first car from the crossing before comes.
OFFSET_S = {"a1": 0, "a2": 20, "a3": 48, "a4": 66, "a5": 5, "a6": 20}

# Vehicles per hour that enter, by quarter of an hour; a side road has its lanes' share of its rate.
FROM_WEST, FROM_EAST = [780, 920, 450, 400], [400, 450, 920, 780]
FROM_SIDE, FROM_SHOPS, FROM_BACK_STREET = 70, 60, 40
TRUCKS = 0.08  # share of the vehicles that go from end to end
BUSES_PER_H = 8


def chain():
    """Returns the nodes of the arterial from west to east, with their places."""
    nodes = [(name, x, y) for name, (x, y, _, _) in LIGHTS.items()] + [BACK_STREET, SHOPS]
    ends = [("west", -OUTSIDE_M, 0), ("east", LIGHTS["a6"][0] + OUTSIDE_M, LIGHTS["a6"][1])]
    return sorted(nodes + ends, key=lambda node: node[1])


def main_road(made, start, end):
    """Adds one direction between two neighbours, with a lane for left turns before a light that has such turns."""
    (name, x, y), (goal, goal_x, goal_y) = start, end
    turns_left = goal in LIGHTS and LIGHTS[goal][2 if x < goal_x else 3] > 0
    if not turns_left:
        made.edge(name, goal, 2, SPEED_MPS, 3)
        return
    made.widened(name, goal, 2, SPEED_MPS, 3, POCKET_M)


def side_road(made, name, goal, lanes, towards=None):
    towards = towards or lanes
    made.edge(name, goal, lanes, SIDE_SPEED_MPS, 1)
    made.edge(goal, name, towards, SIDE_SPEED_MPS, 1)


def roads():
    made = Roads()
    for name, x, y in chain():
        kind = {"type": "traffic_light" if name in LIGHTS else "priority"} if name not in ("west", "east") else {}
        made.node(name, x, y, **kind)
    for one, other in zip(chain(), chain()[1:]):
        main_road(made, one, other)
        main_road(made, other, one)
    for name, (x, y, north, south) in LIGHTS.items():
        for letter, lanes, way in [("n", north, 1), ("s", south, -1)]:
            if lanes:
                made.node(f"{letter}{name[1]}", x, y + way * SIDE_M)
                if (name, letter) != ("a2", "n"):
                    side_road(made, f"{letter}{name[1]}", name, lanes)
    # The back street goes from the northern side road of a2 round a corner to the arterial.
    made.node("b1", LIGHTS["a2"][0], LIGHTS["a2"][1] + SIDE_M / 2, type="priority")
    side_road(made, "n2", "b1", 2)
    side_road(made, "b1", "a2", 2)
    made.node("b2", BACK_STREET[1], LIGHTS["a2"][1] + SIDE_M / 2, type="priority")
    made.edge("b1", "b2", 1, SIDE_SPEED_MPS, 0)
    made.edge("b2", "b1", 1, SIDE_SPEED_MPS, 0)
    side_road(made, "b2", "m1", 1)
    made.node("shops", SHOPS[1], SHOPS[2] - SIDE_M / 2)
    side_road(made, "shops", "m2", 1)
    connect_lights(made)
    connect_right_turns(made, "m1", "b2", before="a3_m1", after="m1_a2")
    connect_right_turns(made, "m2", "shops", before="a4_m2", after="m2_a5")
    made.connect("a2_m1", "m1_a3", (0, 0), (1, 1))
    made.connect("a5_m2", "m2_a4", (0, 0), (1, 1))
    return made


def connect_right_turns(made, junction, side, before, after):
    made.connect(before, after, (0, 0), (1, 1))
    made.connect(before, f"{junction}_{side}", (0, 0))
    made.connect(f"{side}_{junction}", after, (0, 0))


def arms(made, light):
    """Returns the edges towards a light, by the side where they come from, and those away from it."""
    x, y = LIGHTS[light][:2]
    towards, away = {}, {}
    for edge in made.edges.values():
        for here, there, found in [("to", "from", towards), ("from", "to", away)]:
            if edge[here] == light:
                node = made.nodes[edge[there]]
                east, north = float(node["x"]) - x, float(node["y"]) - y
                side = ("e" if east > 0 else "w") if abs(east) > abs(north) else ("n" if north > 0 else "s")
                found[side] = edge["id"]
    return towards, away


def connect_lights(made):
    """The right lane goes right and straight on; the left lane of two or three goes left alone, where there is one."""
    right_of = {"w": "s", "s": "e", "e": "n", "n": "w"}
    for light in LIGHTS:
        towards, away = arms(made, light)
        for side, edge in towards.items():
            lanes = made.edges[edge]["numLanes"]
            right = right_of[side]
            straight = right_of[right]
            left = right_of[straight]
            if right in away:
                made.connect(edge, away[right], (0, 0))
            if straight in away:
                through = 2 if side in "we" else 1
                made.connect(edge, away[straight], *[(lane, lane) for lane in range(through)])
            if left in away:
                made.connect(edge, away[left], (lanes - 1, made.edges[away[left]]["numLanes"] - 1))


def light_program(made, net_links, light):
    """A cycle of 90 s: the arterial, its left turns, the side roads, and their left turns where they have a lane."""
    towards, _ = arms(made, light)

    def green(sides, directions):
        return {towards[side]: directions for side in sides if side in towards}

    if "n" not in towards:
        greens = [(45, green("we", "sr")), (10, green("e", "sl")), (24, green("s", "rl"))]
    elif LIGHTS[light][2:] == (1, 1):
        greens = [(44, green("we", "sr")), (10, green("we", "l")), (24, green("ns", "srL"))]
    elif LIGHTS[light][2:] == (2, 2):
        greens = [(38, green("we", "sr")), (9, green("we", "l")), (18, green("ns", "sr")), (9, green("ns", "l"))]
    else:  # Two lanes in the north and one in the south take turns.
        greens = [(36, green("we", "sr")), (9, green("we", "l")), (15, green("n", "srl")), (14, green("s", "srl"))]
    return program(light, net_links, greens, OFFSET_S[light], ALL_RED_S)


def entries(made):
    """Returns for every place where cars begin and end: the edges in and out, and its rates by quarter."""
    found = {"west": ("west_a1", "a1_west", FROM_WEST), "east": ("east_a6", "a6_east", FROM_EAST),
             "shops": ("shops_m2", "m2_shops", [FROM_SHOPS] * 4), "back": ("b2_b1", "b1_b2", [FROM_BACK_STREET] * 4)}
    for node in made.nodes:
        if len(node) == 2 and node[0] in "ns":
            light = "b1" if node == "n2" else f"a{node[1]}"
            lanes = made.edges[f"{node}_{light}"]["numLanes"]
            found[node] = (f"{node}_{light}", f"{light}_{node}", [FROM_SIDE * lanes] * 4)
    return found


def make(folder):
    made = roads()
    net = made.convert()
    found = links(net)
    net = with_programs(net, {light: light_program(made, found[light], light) for light in LIGHTS})
    ways, places = Ways(net), entries(made)
    rows, flows = types("car", "truck", "bus"), []
    for start, (edge, _, rates) in places.items():
        # Places attract cars as they send them; the far end of the arterial attracts most.
        goals = {goal: (500 if goal in ("west", "east") else sum(other[2]) / 4)
                 for goal, other in places.items() if goal != start}
        for goal, weight in goals.items():
            way = ways.fastest(edge, places[goal][1])
            if way is None:
                continue
            name = f"{start}_to_{goal}"
            rows.append(route(name, way))
            ends = {start, goal} == {"west", "east"}
            for quarter, rate in enumerate(rates):
                cars = rate * weight / sum(goals.values())
                if ends:
                    flows.append((quarter, flow(f"truck_{name}_{quarter}", "truck", name, quarter, TRUCKS * cars)))
                    flows.append((quarter, flow(f"bus_{name}_{quarter}", "bus", name, quarter, BUSES_PER_H)))
                    cars *= 1 - TRUCKS
                flows.append((quarter, flow(f"car_{name}_{quarter}", "car", name, quarter, cars)))
    flows.sort(key=lambda pair: pair[0])
    write(folder, folder.name, net, rows + [text for _, text in flows])
