"""Vehicle types, vehicles and flows, and the three files of a scenario."""

import random

from .network import XML, element

END_S = 3600
QUARTER_S = 900

# SUMO's own car-following model (Krauss) with dawdling; speeds differ by a tenth.
DRIVING = {"sigma": "0.5", "tau": "1", "minGap": "2.5", "speedFactor": "1", "speedDev": "0.1"}
TYPES = {
    "car": {"vClass": "passenger", "length": "5", "accel": "2.6", "decel": "4.5", "maxSpeed": "50"},
    "truck": {"vClass": "truck", "length": "10", "accel": "1.3", "decel": "4", "maxSpeed": "25"},
    "bus": {"vClass": "bus", "length": "12", "accel": "1.2", "decel": "4", "maxSpeed": "25"},
}
# Vehicles enter at the allowed speed, on the lane that suits their route.
ENTRY = {"departLane": "best", "departSpeed": "max"}


class Dice:
    """Random numbers of one scenario. Only `random()` is used: Python promises that it never changes."""

    def __init__(self, seed):
        self.next = random.Random(seed).random

    def between(self, low, high):
        return low + (high - low) * self.next()

    def choose(self, weights):
        """Returns a key of `weights`, with a probability in proportion to its value."""
        left = self.next() * sum(weights.values())
        for key, weight in weights.items():
            left -= weight
            if left < 0:
                return key
        return key

    def times(self, rate_per_h, begin_s, end_s):
        """Returns times of arrivals at random, in whole seconds and in order."""
        count = round(rate_per_h * (end_s - begin_s) / 3600)
        return sorted(int(self.between(begin_s, end_s)) for _ in range(count))


def types(*names):
    return [element("vType", {"id": name, **TYPES[name], **DRIVING}) for name in names]


def route(name, edges):
    return element("route", {"id": name, "edges": " ".join(edges)})


def vehicle(name, kind, route_name, depart_s, stops=None):
    attributes = {"id": name, "type": kind, "route": route_name, "depart": depart_s, **ENTRY}
    return element("vehicle", attributes, stops)


def flow(name, kind, route_name, quarter, rate_per_h):
    """Returns cars of one quarter of an hour that come at random: SUMO draws every second, by its seed."""
    return flow_between(name, kind, route_name, quarter * QUARTER_S, (quarter + 1) * QUARTER_S, rate_per_h)


def flow_between(name, kind, route_name, begin_s, end_s, rate_per_h):
    return element("flow", {
        "id": name, "type": kind, "route": route_name, "begin": begin_s, "end": end_s,
        "probability": f"{min(rate_per_h / 3600, 1):.5f}", **ENTRY,
    })


def mix(name, kinds):
    """Returns a type of vehicles that is one of `kinds` by chance, which maps types to their shares."""
    return element("vTypeDistribution", {
        "id": name, "vTypes": " ".join(kinds), "probabilities": " ".join(f"{share:.3f}" for share in kinds.values())})


def any_route(name, weights):
    """Returns a route that is one of several by chance; `weights` maps routes to how many cars they have."""
    total = sum(weights.values())
    return element("routeDistribution", {
        "id": name, "routes": " ".join(weights),
        "probabilities": " ".join(f"{weight / total:.4f}" for weight in weights.values())})


def write(folder, name, net, rows, stops=None, end_s=END_S):
    """Writes the net, the routes, bus stops if there are some, and NAME.sumocfg. Returns the path of the last one."""
    folder.mkdir(parents=True, exist_ok=True)
    more = {"additional-files": f"{name}.add.xml"} if stops else {}
    settings = {
        "input": {"net-file": f"{name}.net.xml", "route-files": f"{name}.rou.xml", **more},
        "time": {"begin": 0, "end": end_s},
        # A car that stands is never taken away: a jam is the fault of the lights and has to count.
        "processing": {"time-to-teleport": -1},
        "report": {"xml-validation": "never"},
    }
    tables = [
        element(table, {}, [element(key, {"value": value}) for key, value in keys.items()])
        for table, keys in settings.items()
    ]
    files = {"net": net, "rou": XML + element("routes", {}, rows) + "\n"}
    if stops:
        files["add"] = XML + element("additional", {}, stops) + "\n"
    for kind, text in files.items():
        (folder / f"{name}.{kind}.xml").write_text(text)
    config = folder / f"{name}.sumocfg"
    config.write_text(XML + element("configuration", {}, tables) + "\n")
    return config
