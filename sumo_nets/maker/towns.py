"""Many islands side by side, for one policy that can work any light: roads, programs, traffic and people on foot all differ."""

from .capacity import broken, greens, most, movements
from .islands import KINDS, Island
from .network import side_by_side
from .people import walks
from .programs import with_more_greens, with_short_reds
from .traffic import QUARTER_S, Dice, any_route, flow_between, mix, route, types, write
from .ways import Ways

GAP_M = 300
# Demand of the quarters of an hour, as shares of the highest.
SHAPES = [(0.5, 0.8, 1, 0.5), (0.6, 1, 0.7, 0.4), (0.8, 0.8, 0.8, 0.7), (0.3, 1, 0.4, 0.6), (1, 0.6, 0.8, 0.4)]
LEVELS = (0.3, 1.3)  # the highest demand, as a share of what the lights can serve
SHORT_STREET = 0.55  # what two joined junctions serve of it: few cars find room between them
PLATOONS = 0.25  # share of the entries where cars come in platoons
ON_FOOT = 0.3  # share of the islands with pavements and crossings
TRUCKS = 0.15  # share at most
EXIT_LANE_H = 1700  # cars an hour over a lane that leaves


def options(dice):
    """Returns options of netconvert for the programs of an island."""
    drawn = {
        "tls.cycle.time": int(dice.between(60, 121)),
        "tls.yellow.time": dice.choose({3: 3, 4: 2, 5: 1}),
        "tls.allred.time": dice.choose({0: 3, 1: 1, 2: 1}),
        "tls.layout": dice.choose({"opposites": 3, "incoming": 1}),
        "tls.left-green.time": dice.choose({0: 1, 6: 3, 10: 2}),
        # Left turns wait for those from the other side where these may drive up to this speed.
        "tls.minor-left.max-speed": dice.choose({5: 1, 12: 1, 19.44: 2, 30: 1}),
    }
    if dice.next() < 0.2:
        drawn["tls.no-mixed"] = "true"
    if dice.next() < ON_FOOT:
        drawn |= {"sidewalks.guess": "true", "crossings.guess": "true"}
    return [f"--{key}={value}" for key, value in drawn.items()]


class Shelves:
    """Places for islands, from left to right in rows from bottom to top."""

    def __init__(self, width_m):
        self.width_m, self.x, self.y, self.height_m = width_m, 0.0, 0.0, 0.0

    def corner(self):
        """Returns the lower left corner of the next island."""
        if self.x > self.width_m:
            self.x, self.y, self.height_m = 0.0, self.y + self.height_m + GAP_M, 0.0
        return self.x, self.y

    def take(self, width_m, height_m):
        self.x, self.height_m = self.x + width_m + GAP_M, max(self.height_m, height_m)


def build(kind, lights, name, shelves, dice):
    """Returns an island and its network at the next free place: the first one drawn whose lights work."""
    while True:
        island = Island(name, lights, dice)
        kind(island)
        if island.crosses():
            continue
        size = island.move_to(*shelves.corner())
        # netconvert warns of what a planner would avoid, such as left turns without a lane. Here it is wanted.
        net = with_short_reds(island.roads.convert("--tls.default-type=static", "--no-warnings", *options(dice)))
        if not broken(net):
            shelves.take(*size)
            return island, with_more_greens(net, dice)


def plan(count, dice):
    """Returns the kinds of the islands with their numbers of lights, `count` lights in all."""
    found, left = [], count
    while left:
        fits = {kind: share * 2 / (low + high) for kind, (share, (low, high)) in KINDS.items() if low <= left}
        kind = dice.choose(fits)
        low, high = KINDS[kind][1]
        lights = int(dice.between(low, min(high, left) + 1))
        found.append((kind, lights))
        left -= lights
    return found


def arrival_shares(places, dice):
    """Returns how many cars every entry sends or every exit attracts: main streets by their lanes, side streets few."""
    return {edge: (0.15 if side else lanes) * dice.between(0.3, 1) ** 1.7 for edge, lanes, side in places}


def journeys(island, net):
    """Returns the ways as `{(entry, exit): edges}`, and the entries and the exits.

    Those are `(edge, lanes, whether it is a side street)`.
    """
    edges, ways = island.roads.edges.values(), Ways(net)
    sides = dict(island.outside)
    starts = [(edge["id"], edge["numLanes"], sides[edge["from"]]) for edge in edges if edge["from"] in sides]
    goals = [(edge["id"], edge["numLanes"], sides[edge["to"]]) for edge in edges if edge["to"] in sides]
    ends = {edge["id"]: (edge["from"], edge["to"]) for edge in edges}
    found = {}
    for start, _, _ in starts:
        for goal, _, _ in goals:
            way = ways.fastest(start, goal)
            if way and ends[start][0] != ends[goal][1]:
                found[start, goal] = way
    return found, starts, goals


def pattern(found, starts, goals, dice):
    """Returns shares of the cars by pair of entry and exit: skewed, so that every direction and turn has its own."""
    sends, attracts = arrival_shares(starts, dice), arrival_shares(goals, dice)
    weights = {pair: sends[pair[0]] * attracts[pair[1]] * dice.between(0.3, 1.7) for pair in found}
    total = sum(weights.values())
    return {pair: weight / total for pair, weight in weights.items()}


def capacity(island, net, found, shares):
    """Returns how many cars an hour may come in these shares: the first light or exit that is full decides."""
    turns, states, crossed, leaving = movements(net), greens(net), {}, {}
    for pair, share in shares.items():
        for turn in zip(found[pair], found[pair][1:]):
            crossed[turn] = crossed.get(turn, 0) + share
        leaving[pair[1]] = leaving.get(pair[1], 0) + share
    limits = [most(states[light], turns[light], {turn: crossed[turn] for turn in turns[light] if turn in crossed})
              for light in turns]
    for edge, share in leaving.items():
        speed, lanes = float(island.roads.edges[edge]["speed"]), island.roads.edges[edge]["numLanes"]
        limits.append(min(EXIT_LANE_H, 3600 / (1.2 + 7.5 / speed)) * lanes / share)
    return min(limits)


def traffic(island, net, dice):
    """Returns the routes of an island, and its flows as pairs of a second and a text."""
    found, starts, goals = journeys(island, net)
    names = {pair: f"{island.name}_way{number}" for number, pair in enumerate(found)}
    kinds, trucks = f"{island.name}_mix", TRUCKS * dice.next()
    rows = [mix(kinds, {"car": 1 - trucks, "truck": trucks})]
    rows += [route(names[pair], way) for pair, way in found.items()]
    first, last = (pattern(found, starts, goals, dice) for _ in range(2))
    level = LEVELS[0] + (LEVELS[1] - LEVELS[0]) * dice.next() ** 0.75
    level *= SHORT_STREET if island.joined else 1
    shape, flows = SHAPES[int(dice.between(0, len(SHAPES)))], []
    platoons = {edge: (dice.between(60, 120), dice.between(0.25, 0.45)) for edge, _, _ in starts
                if dice.next() < PLATOONS}
    for quarter, height in enumerate(shape):
        shares = {pair: first[pair] + quarter / 3 * (last[pair] - first[pair]) for pair in found}
        cars = level * height * capacity(island, net, found, shares)
        for edge in dict.fromkeys(pair[0] for pair in found):
            weights = {names[pair]: share for pair, share in shares.items() if pair[0] == edge}
            name = f"{edge}_{quarter}"
            rows.append(any_route(name, weights))
            rate, begin = cars * sum(weights.values()), quarter * QUARTER_S
            every, part = platoons.get(edge, (QUARTER_S, 1))
            for number in range(round(QUARTER_S / every)):
                at = int(begin + number * every)
                flows.append((at, flow_between(f"{name}_{number}", kinds, name, at,
                                               min(int(at + part * every), begin + QUARTER_S), rate / part)))
    return rows, flows


def make(folder, lights, seed, name="towns"):
    """Writes a scenario of `lights` lights, and returns its .sumocfg. Another seed gives other islands."""
    dice, nets, rows, flows = Dice(seed), [], types("car", "truck"), []
    for_people = Dice(f"people {seed}")
    shelves = Shelves(600 * lights ** 0.5)
    for number, (kind, count) in enumerate(plan(lights, dice)):
        island, net = build(kind, count, f"i{number}", shelves, dice)
        more, cars = traffic(island, net, dice)
        rows += more
        flows += cars + walks(net, for_people)
        nets.append(net)
    flows.sort(key=lambda pair: pair[0])
    return write(folder, name, side_by_side(nets), rows + [text for _, text in flows])
