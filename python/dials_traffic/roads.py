"""What is on the roads of one light: for observations and rewards of your own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, List


@dataclass(frozen=True)
class Car:
    """A car on an approach."""

    #: Distance of its front from the beginning of the lane, in metres.
    position_m: float
    speed_mps: float
    #: Number of seconds for which it has stood on the approaches of this light.
    waited_s: int


@dataclass(frozen=True)
class Approach:
    """A lane on which cars come to the light."""

    #: SUMO's name of the lane.
    lane: str
    length_m: float
    speed_limit_mps: float
    #: Distance from the end of the lane to the stop line: 0 for a lane that ends there.
    ahead_m: float
    #: Cars, the rearmost first.
    cars: List[Car]


@dataclass(frozen=True)
class Intersection:
    """An intersection with its light, now."""

    agent: str
    #: Index of the green that is shown, or that comes next.
    green: int
    #: Whether yellow or red for all is shown, between two greens.
    between: bool
    #: Number of seconds for which the light has shown what it shows.
    shown_s: int
    #: Lanes to the stop lines, in the order of the observations.
    approaches: List[Approach]


def intersection(agent: str, told: Dict[str, Any]) -> Intersection:
    """Make an intersection of what the simulator says."""
    approaches = [
        Approach(**{**approach, "cars": [Car(**car) for car in approach["cars"]]}) for approach in told["approaches"]
    ]
    return Intersection(agent=agent, **{**told, "approaches": approaches})
