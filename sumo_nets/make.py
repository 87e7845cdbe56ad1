#!/usr/bin/env python3
"""Makes the scenarios of this directory again: `python3 sumo_nets/make.py [DIRECTORY]`.

Needs netconvert of SUMO 1.15 and nothing but Python's own library. The same bytes come out every time.
Without DIRECTORY the files beside this script are replaced.
"""

import sys
from pathlib import Path

sys.dont_write_bytecode = True  # no __pycache__ beside the makers

from maker import arterial, grid_4x4_turns, town  # noqa: E402

if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for scenario in [grid_4x4_turns, town, arterial]:
        scenario.make(target / scenario.__name__.rsplit(".", 1)[-1])
