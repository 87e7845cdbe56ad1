#!/usr/bin/env python3
"""Makes scenarios with netconvert of SUMO 1.15 and nothing but Python's own library.

`python3 sumo_nets/make.py [DIRECTORY]` makes the scenarios of this directory again. The same bytes come out every time.
Without DIRECTORY the files beside this script are replaced.

`python3 sumo_nets/make.py towns [--junctions N] [--seed S] DIRECTORY` makes a scenario of N lights on islands that
differ in all, to train policies for any light. Another seed gives other islands.

`python3 sumo_nets/make.py city [--lights N] [--seed S] DIRECTORY` makes a city of N lights with buses, for a
peak of an hour and a half. Another seed gives another city. A city of 300 lights takes a minute.
"""

import argparse
import sys
from pathlib import Path

sys.dont_write_bytecode = True  # no __pycache__ beside the makers

from maker import arterial, city, grid_4x4_turns, town, towns  # noqa: E402


def shipped(arguments):
    parser = argparse.ArgumentParser(description="Makes the shipped scenarios again.")
    parser.add_argument("directory", type=Path, nargs="?", default=Path(__file__).parent)
    target = parser.parse_args(arguments).directory
    for scenario in [grid_4x4_turns, town, arterial]:
        scenario.make(target / scenario.__name__.rsplit(".", 1)[-1])
    city.make(target / "city_60", 60, 1, "city_60")


def drawn(maker, about, number_option, number, least, arguments):
    parser = argparse.ArgumentParser(prog=f"make.py {maker.__name__.rsplit('.', 1)[-1]}", description=about)
    parser.add_argument(number_option, dest="lights", type=int, default=number, help="number of lights, about")
    parser.add_argument("--seed", type=int, default=1, help="another seed gives another scenario")
    parser.add_argument("directory", type=Path)
    parsed = parser.parse_args(arguments)
    if parsed.lights < least:
        parser.error(f"{number_option} must be at least {least}")
    print(maker.make(parsed.directory, parsed.lights, parsed.seed))


if __name__ == "__main__":
    if sys.argv[1:2] == ["towns"]:
        drawn(towns, "Makes many islands of lights side by side.", "--junctions", 40, 1, sys.argv[2:])
    elif sys.argv[1:2] == ["city"]:
        drawn(city, "Makes a city of streets of all kinds.", "--lights", 300, 20, sys.argv[2:])
    else:
        shipped(sys.argv[1:])
