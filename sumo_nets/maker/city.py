"""A city for any number of lights: streets of five kinds, lights that two corners share, buses and a peak of demand."""

from math import pi, sqrt

from .capacity import broken
from .city_streets import City, name_of
from .city_traffic import END_S, traffic
from .programs import retimed, with_short_reds
from .street_plan import HECTARE, StreetPlan
from .traffic import Dice, write

AREA_PER_LIGHT = 4 * HECTARE  # of a first try; a city with too few corners for its lights grows
GROWTH = 1.06
SPARE = 0.04  # corners beyond the lights, as a share of these: they replace lights that do not work
LIGHTS = ("--tls.default-type=static", "--tls.layout=opposites", "--tls.left-green.time=8")


def large_enough(count, seed):
    """Returns the streets of a city with corners for `count` lights, and those corners, most important first."""
    area = count * AREA_PER_LIGHT
    while True:
        dice = Dice(seed)
        city = City(StreetPlan(sqrt(area / pi), dice), dice)
        candidates = city.candidates()
        if len(candidates) >= count + SPARE * count:
            return city, candidates, dice
        area *= GROWTH


def build(count, seed):
    """Returns a city, its network and the random numbers that follow. Corners whose light does not work have none."""
    city, candidates, dice = large_enough(count, seed)
    city.restrict({corner for corners in candidates[:count] for corner in corners})
    while True:
        lights = candidates[:count]
        # netconvert warns of sharp turns and of green that gives way. A city has both.
        net = with_short_reds(city.roads(lights).convert(*LIGHTS, "--no-warnings"))
        faulty = broken(net)
        if not faulty:
            return city, net, dice
        candidates = [corners for corners in candidates if name_of(corners) not in faulty]


def make(folder, lights, seed, name="city"):
    """Writes a scenario of `lights` lights, and returns its .sumocfg. Another seed gives another city."""
    city, net, dice = build(lights, seed)
    rows, stops, needed = traffic(city, net, dice)
    return write(folder, name, retimed(net, needed), rows, stops, END_S)
