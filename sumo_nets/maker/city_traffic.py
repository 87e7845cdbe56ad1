"""The traffic of a city: a peak of an hour and a half, with goals in the centre and outside, and with buses."""

from math import exp

from .capacity import greens, most, movements, needs
from .city_buses import buses
from .city_streets import is_shared
from .traffic import any_route, flow_between, mix, route, types
from .ways import Ways

END_S, SLICE_S = 5400, 600
QUIET_S = 180  # at the end nobody sets out, so that nearly all arrive
# Demand by ten minutes, as a share of the highest.
SHAPE = [0.4, 0.55, 0.75, 0.95, 1, 0.9, 0.65, 0.45, 0.25]
# Journeys from outside or from within the city, to outside or to within: first and last share of the mean.
# People drive into the city first, and out of it later.
CHANGE = {"out_out": (1, 1), "out_in": (1.4, 0.6), "in_out": (0.5, 1.5), "in_in": (1, 1)}
PARTS = 3  # parts of the time with shares of their own
GOES_OUT = {"out": 0.4, "in": 0.45}  # share of the journeys that end outside, by where they begin
CARS_PER_LIGHT_H = 130  # that want to drive at the peak
FROM_OUTSIDE = 0.55  # share of them that begin outside
ROUTES = {"out": 24, "in": 4}  # different routes by where they begin; the second divides the first
CENTRE = 0.45  # how far from the centre goals are, as a share of the city's radius
FAR_M = 1800  # how far most people drive within the city
LEAST_M = 400
TRUCKS = 0.06
# What a lane takes in an hour before it gets slow: before a light, elsewhere, and on streets that give way.
LANE_H, FREE_LANE_H, MINOR_LANE_H = 500, 1400, 250
JAMS = 3  # how much longer a street takes that is full, for those who choose a route
FULL = 0.65  # how much of what a light can serve is used at most
SHARED = 0.6  # how much of that a light of two corners serves
ROUNDS = 8  # in which those stay at home who would make a light too full


class Ends:
    """Edges where journeys begin, or end if they are `leaving`: outside, and in the minor streets within."""

    def __init__(self, city, leaving):
        self.kinds, self.places, self.weights = {}, {}, {"out": {}, "in": {}}
        for edge, (start, end), kind, lanes in city.edges():
            corner = end if leaving else start
            where = "out" if corner in city.plan.outside else "in"
            if where == "in" and kind != "minor":
                continue
            self.kinds[edge], self.places[edge] = where, city.plan.places[corner]
            central = 0.3 + exp(-(city.plan.outwards(corner) / CENTRE) ** 2) if leaving else 1
            self.weights[where][edge] = lanes ** 1.3 if where == "out" else central


def distance(one, other):
    return ((one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2) ** 0.5


def choose_goal(start, starts, goals, dice):
    """Returns a goal for a start, or None: outside anywhere, and within the city rather near than far."""
    begins, place = starts.kinds[start], starts.places[start]
    ends = "out" if dice.next() < GOES_OUT[begins] else "in"
    weights = {}
    for goal, weight in goals.weights[ends].items():
        metres = distance(place, goals.places[goal])
        if metres > LEAST_M:
            weights[goal] = weight if ends == "out" else weight * exp(-metres / FAR_M)
    return f"{begins}_{ends}", dice.choose(weights) if weights else None


def rooms(net, city):
    """Returns how many cars an hour every edge takes."""
    lit = {pair[0] for turns in movements(net).values() for pair in turns}
    found = {}
    for edge, _, kind, lanes in city.edges():
        for part in (edge, f"{edge}_turn"):
            lane_h = LANE_H if part in lit else MINOR_LANE_H if kind == "minor" else FREE_LANE_H
            found[part] = lane_h * lanes
    return found


def journeys(city, net, ways, lights, dice):
    """Returns `[start, kind of journey, edges, cars an hour]`, in rounds: in each one, people avoid full streets."""
    starts, goals = Ends(city, leaving=False), Ends(city, leaving=True)
    room, loads, found = rooms(net, city), {}, []
    rates = {}
    for where, share in (("out", FROM_OUTSIDE), ("in", 1 - FROM_OUTSIDE)):
        total = sum(starts.weights[where].values())
        for edge, weight in starts.weights[where].items():
            rates[edge] = CARS_PER_LIGHT_H * lights * share * weight / total
    order = {edge: number for number, edge in enumerate(rates)}
    for number in range(ROUTES["out"]):
        slower = {edge: 1 + JAMS * (load / room[edge]) ** 2 for edge, load in loads.items()}
        for start, rate in rates.items():
            routes = ROUTES[starts.kinds[start]]
            if (number + order[start]) % (ROUTES["out"] // routes):
                continue
            kind, goal = choose_goal(start, starts, goals, dice)
            way = ways.fastest(start, goal, slower) if goal else None
            if way:
                found.append([start, kind, way, rate / routes])
            for edge in way or []:
                loads[edge] = loads.get(edge, 0) + rate / routes
    return found


def crossings(found, light_of):
    """Returns for every light the cars an hour by pair of edges."""
    crossed = {}
    for _, _, way, rate in found:
        for pair in zip(way, way[1:]):
            if pair in light_of:
                cars = crossed.setdefault(light_of[pair], {})
                cars[pair] = cars.get(pair, 0) + rate
    return crossed


def without_jams(found, net):
    """Makes journeys rarer until no light has to serve more than it can. Returns how long its greens are needed."""
    turns, states = movements(net), greens(net)
    light_of = {pair: light for light, pairs in turns.items() for pair in pairs}
    for _ in range(ROUNDS):
        spare = {light: most(states[light], turns[light], cars) * FULL * (SHARED if is_shared(light) else 1)
                 for light, cars in crossings(found, light_of).items()}
        for journey in found:
            lights = [light_of[pair] for pair in zip(journey[2], journey[2][1:]) if pair in light_of]
            journey[3] *= min([1] + [spare[light] for light in lights])
    needed = {}
    for light, cars in crossings(found, light_of).items():
        for state, hours in needs(states[light], turns[light], cars):
            of_light = needed.setdefault(light, {})
            of_light[state] = of_light.get(state, 0) + hours
    return needed


def flows(found, names):
    """Returns routes to choose from by start and part of the time, and flows by ten minutes."""
    rows, by_start = [], {}
    for start, kind, way, rate in found:
        by_start.setdefault(start, []).append((kind, names[tuple(way)], rate))
    cars = []
    slices = END_S // SLICE_S
    for start, journeys_here in by_start.items():
        totals = []
        for part in range(PARTS):
            weights = {}
            for kind, name, rate in journeys_here:
                first, last = CHANGE[kind]
                weights[name] = weights.get(name, 0) + rate * (first + (last - first) * part / (PARTS - 1))
            totals.append(sum(weights.values()))
            rows.append(any_route(f"{start}_{part}", weights))
        for number in range(slices):
            part, at = number * PARTS // slices, number * SLICE_S
            cars.append((at, flow_between(f"{start}_at{at}", "mix", f"{start}_{part}", at,
                                          min(at + SLICE_S, END_S - QUIET_S), SHAPE[number] * totals[part])))
    return rows, cars


def traffic(city, net, dice):
    """Returns the rows of the route file, those of the bus stops, and how long the greens of each light are needed."""
    ways = Ways(net)
    lights = len(movements(net))
    found = journeys(city, net, ways, lights, dice)
    needed = without_jams(found, net)
    names = {}
    for _, _, way, _ in found:
        names.setdefault(tuple(way), f"r{len(names)}")
    rows, cars = flows(found, names)
    stops, bus_routes, bus_rows = buses(city, ways, lights, dice, END_S)
    timed = sorted([*cars, *bus_rows], key=lambda row: row[0])
    routes = [route(name, way) for way, name in names.items()]
    kinds = [*types("car", "truck", "bus"), mix("mix", {"car": 1 - TRUCKS, "truck": TRUCKS})]
    return [*kinds, *routes, *bus_routes, *rows, *[text for _, text in timed]], stops, needed
