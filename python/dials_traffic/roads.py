"""What is on the roads of all lights and copies at once: for rewards and observations of your own.

A :class:`Roads` is a moment. It has a row for each light, or for each light and copy, and numpy arrays over rows, lanes and
vehicles. `row` and `lane` say where a vehicle belongs, so `numpy.bincount` sums over them: `per_row` and `per_lane` do.
Nothing of it changes later, so functions may keep it.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, TypeVar

import numpy as np

#: Classes of vehicles that carry many persons.
PUBLIC = ("bus", "coach", "tram", "rail_urban")
# The exit of a vehicle that has none, as the simulator writes it.
_NO_EXIT = 0xFFFFFFFF

_Made = TypeVar("_Made", bound="_FromSimulator")


class Neighbours(NamedTuple):
    """Which light feeds which, without a third one between them: one entry per pair. Some pairs are there twice, once in
    each direction.
    """

    #: Names of the lights. The numbers below count them.
    agents: List[str]
    #: Lights that feed others, and those that they feed, `[pairs]`.
    feeds: np.ndarray
    fed: np.ndarray
    #: Length of the shortest way from the exit of the one to the stop line of the other, and the time that it takes at the
    #: speed limits, `[pairs]`.
    metres: np.ndarray
    seconds: np.ndarray

    def matrix(self) -> np.ndarray:
        """Return the adjacency, `[agents, agents]`: true where the row feeds the column."""
        table = np.zeros((len(self.agents), len(self.agents)), bool)
        try:
            table[self.feeds, self.fed] = True
        except OverflowError as error:  # Somebody has made this of other numbers.
            raise ValueError(f"feeds, fed: must be numbers of lights: {error}") from error
        return table


class _FromSimulator:
    """What the simulator has written. Only `_read` makes it, so a wrong call is an error of that call."""

    def __init__(self, *_: Any, **__: Any) -> None:
        raise TypeError(f"{type(self).__name__} cannot be made: environments give it to your functions")

    @classmethod
    def _read(cls: type[_Made], *arguments: Any) -> _Made:
        made = cls.__new__(cls)
        made._fill(*arguments)
        return made

    def _fill(self, *arguments: Any, **options: Any) -> None:
        raise NotImplementedError


class Lanes(_FromSimulator):
    """The approaches of all rows, or their exits: row by row. They are the same at every step."""

    def _fill(self, rows: int, of_rows: Sequence[Sequence[Dict[str, Any]]], greens: int) -> None:
        self._rows = rows
        flat = [lane for lanes in of_rows for lane in lanes]
        self._begins = np.cumsum([0, *map(len, of_rows)])
        #: Row of each lane.
        self.row = np.repeat(np.arange(rows), [len(lanes) for lanes in of_rows])
        #: SUMO's names.
        self.name = np.array([lane["lane"] for lane in flat], dtype=object)
        self.length_m = np.array([lane["length_m"] for lane in flat])
        #: Speed limit.
        self.limit_mps = np.array([lane["limit_mps"] for lane in flat])
        #: Distance from the end of an approach to the stop line: 0 for a lane that ends there, and for exits.
        self.ahead_m = np.array([lane["ahead_m"] for lane in flat])
        #: Number of the agent that feeds an approach, or is fed by an exit. -1: none.
        self.neighbour = np.array([-1 if lane["neighbour"] is None else lane["neighbour"] for lane in flat], int)
        #: Whether a green lets vehicles of an approach go, `[lanes, greens]`. Exits have no green.
        self.serves = np.zeros((len(flat), greens), bool)
        for number, lane in enumerate(flat):
            self.serves[number, lane["greens"]] = True
        for array in (self.row, self.length_m, self.limit_mps, self.ahead_m, self.neighbour, self.serves):
            array.flags.writeable = False

    def __len__(self) -> int:
        return len(self.row)

    def per_row(self, values: Optional[Any] = None) -> np.ndarray:
        """Return the sum of values over the lanes of each row, `[rows]`; without values, the number of lanes."""
        return np.bincount(self.row, values, self._rows)


class Vehicles(_FromSimulator):
    """Vehicles on all lanes: row by row, lane by lane, the rearmost first. One entry per vehicle."""

    def _fill(self, roads: "Roads", lanes: Lanes, counts: np.ndarray, numbers: np.ndarray) -> None:
        """``numbers``: five for each vehicle, `[5, vehicles]`, four bytes each."""
        self._roads, self._lanes, self._counts = roads, lanes, counts
        floats = numbers.view(np.float32)
        #: Distance of the front from the beginning of the lane, in metres.
        self.position_m: np.ndarray = floats[0]
        self.speed_mps: np.ndarray = floats[1]
        #: Number of seconds for which it has stood on the approaches of this light. 0 on exits.
        self.waited_s: np.ndarray = floats[2]
        #: Number of its type in `roads.type_names`.
        self.type: np.ndarray = numbers[3]
        self._exit = numbers[4]

    def __len__(self) -> int:
        return len(self.position_m)

    @cached_property
    def lane(self) -> np.ndarray:
        """Number of the lane of each vehicle."""
        return np.repeat(np.arange(len(self._lanes)), self._counts)

    @cached_property
    def row(self) -> np.ndarray:
        """Row of each vehicle."""
        return np.repeat(self._lanes.row, self._counts)

    @cached_property
    def limit_mps(self) -> np.ndarray:
        """Speed limit of the lane of each vehicle."""
        return np.repeat(self._lanes.limit_mps, self._counts)

    @cached_property
    def to_stop_line_m(self) -> np.ndarray:
        """Distance from the front of each vehicle to the stop line, in metres; on exits to the end of the lane."""
        lanes = self._lanes
        distances: np.ndarray = np.repeat(lanes.length_m + lanes.ahead_m, self._counts) - self.position_m
        return distances

    @cached_property
    def exit(self) -> np.ndarray:
        """Number of the lane in `roads.exits` on which each vehicle will leave: the first one of its road. -1: not known, or it
        ends before. It is that of the route with which the vehicle departed.
        """
        begins = self._roads.exits._begins[self.row]
        return np.where(self._exit == _NO_EXIT, -1, begins + self._exit.astype(np.int64))

    @cached_property
    def is_public(self) -> np.ndarray:
        """Whether each vehicle is a bus, or another one that carries many persons."""
        of_each: np.ndarray = self._roads._is_public[self.type]
        return of_each

    def per_row(self, values: Optional[Any] = None) -> np.ndarray:
        """Return the sum of values over the vehicles of each row, `[rows]`; without values, the number of vehicles."""
        return np.bincount(self.row, values, self._roads.rows)

    def per_lane(self, values: Optional[Any] = None) -> np.ndarray:
        """Return the sum of values over the vehicles of each lane, `[lanes]`; without values, the number of vehicles."""
        return self._counts if values is None else np.bincount(self.lane, values, len(self._lanes))


class Layout:
    """What the roads of all rows always are."""

    def __init__(self, tables: Dict[str, Any], rows: Sequence[int]) -> None:
        """``tables``: what the simulator says of the roads of all agents; ``rows``: the agent of each row."""
        agents = tables["agents"]
        self.tables = tables
        self.names: List[str] = [agent["name"] for agent in agents]
        self.agent = np.array(rows, int)
        self.agent.flags.writeable = False
        most = max(agent["greens"] for agent in agents)
        self.approaches = Lanes._read(len(rows), [agents[agent]["approaches"] for agent in rows], most)
        self.exits = Lanes._read(len(rows), [agents[agent]["exits"] for agent in rows], most)
        detectors = [agents[agent]["detectors"] for agent in rows]
        self.detector_row = np.repeat(np.arange(len(rows)), [len(names) for names in detectors])
        self.detector_name = np.array([name for names in detectors for name in names], dtype=object)
        self.type_names = [kind["name"] for kind in tables["types"]] + ["unknown"]
        self.type_classes = [kind["class"] for kind in tables["types"]] + ["unknown"]
        self.is_public = np.array([kind in PUBLIC for kind in self.type_classes])

    def of_row(self, row: int) -> str:
        """Return a row in words, for errors."""
        return f"row {row} (agent {self.names[self.agent[row]]!r})"

    def empty(self) -> "Roads":
        """Return roads without vehicles, on which all lights show their first green."""
        rows, detectors = len(self.agent), len(self.detector_row)
        count = 4 * rows + 3 * detectors + len(self.approaches) + len(self.exits)
        return Roads._read(self, bytes(4 * count))


class Roads(_FromSimulator):
    """All lights and vehicles at a moment. Rows are lights; of local simulators, lights and copies."""

    def _fill(self, layout: Layout, data: Any) -> None:
        """``data``: what the simulator wrote, `RoadsNow::put` in crates/core/src/domain/roads.rs."""
        rows, detectors = len(layout.agent), 3 * len(layout.detector_row)
        numbers = np.frombuffer(data, np.uint32)
        floats = numbers.view(np.float32)
        #: Number of rows.
        self.rows = rows
        #: Names of all agents.
        self.agents = layout.names
        #: Number of the agent of each row, `[rows]`.
        self.agent = layout.agent
        #: Index of the green that is shown, or that comes next, `[rows]`.
        self.green: np.ndarray = numbers[:rows]
        #: Whether the light is on its way to its next green, `[rows]`: yellow, red for all, or the end of the walk on crossings.
        self.between: np.ndarray = numbers[rows : 2 * rows] != 0
        #: Number of seconds for which the light has shown what it shows, `[rows]`.
        self.shown_s: np.ndarray = floats[2 * rows : 3 * rows]
        #: Number of persons who wait at the crossings of the light, `[rows]`. Local simulators have none.
        self.persons: np.ndarray = floats[3 * rows : 4 * rows]
        end = 4 * rows + detectors
        #: What the detectors have seen: count, occupancy and gap, `[detectors, 3]`. There are some if the agents see them.
        self.detectors: np.ndarray = floats[4 * rows : end].reshape(-1, 3)
        self.detector_row, self.detector_name = layout.detector_row, layout.detector_name
        #: Lanes to the stop lines, and lanes behind the lights.
        self.approaches, self.exits = layout.approaches, layout.exits
        #: Names and classes of the types of vehicles. The last one stands for all that are not in the files.
        self.type_names, self.type_classes = layout.type_names, layout.type_classes
        self._is_public = layout.is_public
        begin, end = end, end + len(layout.approaches)
        on_approach = numbers[begin:end]
        begin, end = end, end + len(layout.exits)
        on_exit = numbers[begin:end]
        begin, end = end, end + 5 * int(on_approach.sum())
        #: Vehicles on the approaches, and those on the exits.
        self.cars = Vehicles._read(self, layout.approaches, on_approach, numbers[begin:end].reshape(5, -1))
        self.leaving = Vehicles._read(self, layout.exits, on_exit, numbers[end:].reshape(5, -1))
