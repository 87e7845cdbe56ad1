"""The streets of a city: lanes, one-way streets, turns, and the corners that may have a light."""

from .network import Roads

LANES = {"arterial": 3, "ring": 2, "main": 2, "collector": 1, "minor": 1}
SPEED_MPS = {"arterial": 16.67, "ring": 16.67, "main": 13.89, "collector": 11.11, "minor": 8.33}
PRIORITY = {"arterial": 5, "ring": 4, "main": 4, "collector": 3, "minor": 2}
ONE_WAY = {"minor": 0.4, "collector": 0.15}  # share of the streets of a kind
JOINED_M = 50  # two corners nearer than this share a light
POCKETS = {"main": 1, "ring": 1, "collector": 0.4}  # share of the approaches with a lane for left turns
POCKET_M, POCKET_STREET_M = 45, 100  # length of that lane, and least length of its street


class City:
    """A street plan with its lights, and the turns and directions that drivers may take."""

    def __init__(self, plan, dice):
        self.plan, self.dice = plan, dice
        self.closed = set()  # directions of one-way streets against which nobody drives
        self.right_only = set()  # corners where side streets have right turns only
        self.pockets = {way for way in self.directions() if self._has_left_turn(*way) and self._draws_pocket(*way)}

    def lanes(self, one, other):
        return LANES[self.plan.street(one, other)[1]]

    def candidates(self):
        """Returns corners that may have a light, or pairs that share one: most important first."""
        plan, found, taken = self.plan, [], set()
        by_weight = sorted((corner for corner in range(len(plan.arms)) if self._weight(corner)),
                           key=self._weight, reverse=True)
        for corner in by_weight:
            if corner not in taken:
                near = [other for other in plan.arms[corner] if plan.distance(corner, other) < JOINED_M
                        and other not in taken and len(plan.arms[other]) > 2]
                found.append((corner, *near[:1]))
                taken.update(found[-1])
        return found

    def _weight(self, corner):
        """Returns how much a corner needs a light, by its second most important street. None: not at all."""
        arms = self.plan.arms[corner]
        lines = sorted({(PRIORITY[kind], line) for line, kind in (self.plan.street(corner, arm) for arm in arms)})
        if len(arms) < 3 or lines[-2][0] < PRIORITY["collector"]:
            return None
        return lines[-2][0], sum(self.lanes(corner, arm) for arm in arms)

    def restrict(self, lit):
        """Draws one-way streets, and forbids left turns between side streets and main streets without a light.

        Nothing is forbidden that somebody needs: every street can be reached from every other one.
        """
        lines = {}
        for (one, other), (line, kind) in self.plan.streets.items():
            if kind in ONE_WAY:
                lines.setdefault((line, kind), []).append((one, other))
        for (_, kind), streets in lines.items():
            drawn = self.dice.next() < ONE_WAY[kind]
            if drawn and not any(end in self.plan.outside for street in streets for end in street):
                self._try(self.closed, self._against(streets))
        for corner, arms in enumerate(self.plan.arms):
            if corner not in lit and len(self._through(corner)) == 2 < len(arms):
                self._try(self.right_only, {corner})

    def _against(self, streets):
        """Returns the directions against a one-way street, given by its pieces. It is nearly straight."""
        def shift(one, other):
            (x, y), (x0, y0) = self.plan.places[other], self.plan.places[one]
            return x - x0, y - y0

        dx, dy = shift(*streets[0])
        sign = self.dice.choose({1: 1, -1: 1})
        forward = [sign * (dx * x + dy * y) > 0 for x, y in (shift(*street) for street in streets)]
        return {street[::-1] if ahead else street for street, ahead in zip(streets, forward)}

    def _try(self, rules, more):
        rules |= more
        if not self._connected():
            rules -= more

    def _through(self, corner):
        """Returns the arms of a corner with several lanes."""
        return [arm for arm in self.plan.arms[corner] if self.lanes(corner, arm) > 1]

    def _draws_pocket(self, start, end):
        long_enough = self.plan.distance(start, end) > POCKET_STREET_M
        return long_enough and self.dice.next() < POCKETS.get(self.plan.street(start, end)[1], 0)

    def _has_left_turn(self, start, end):
        return any(self._turn(start, end, goal) > 0.5 for goal in self.plan.arms[end] if goal != start)

    def _turn(self, start, corner, goal):
        """Returns the sine of a turn: about 1 to the left, 0 straight on and -1 to the right."""
        (x, y), (x0, y0), (x1, y1) = (self.plan.places[place] for place in (corner, start, goal))
        across = (x - x0) * (y1 - y) - (y - y0) * (x1 - x)
        return across / self.plan.distance(start, corner) / self.plan.distance(corner, goal)

    def may_turn(self, start, corner, goal):
        """Says whether one may drive from the arm `start` over a corner to the arm `goal`."""
        through = self._through(corner)
        if start == goal:
            return False
        if corner not in self.right_only or start in through and goal in through:
            return True
        return self._turn(start, corner, goal) < 0 and (start in through) != (goal in through)

    def directions(self):
        both = [way for one, other in self.plan.streets for way in ((one, other), (other, one))]
        return [way for way in both if way not in self.closed]

    def _connected(self):
        """Says whether every street can be reached from every other one, but for those that leave the city."""
        after, before = {}, {}
        open_ways = set(self.directions())
        for way in open_ways:
            after[way] = [(way[1], goal) for goal in self.plan.arms[way[1]]
                          if (way[1], goal) in open_ways and self.may_turn(*way, goal)]
            for following in after[way]:
                before.setdefault(following, []).append(way)
        inner = next(way for way in self.directions() if not {*way} & {*self.plan.outside})
        return all(len(reached(inner, turns)) == len(open_ways) - len(self.plan.outside)
                   for turns in (after, before))

    def roads(self, lights):
        """Returns what netconvert is given. `lights` are corners, or pairs of corners that share a light."""
        made, shared = Roads(), {}
        for corners in lights:
            shared |= {corner: name_of(corners) for corner in corners}
        outside = set(self.plan.outside)
        for corner, (x, y) in enumerate(self.plan.places):
            kind = {"type": "traffic_light", "tl": shared[corner]} if corner in shared else {"type": "priority"}
            made.node(name_of([corner]), x, y, **({} if corner in outside else kind))
        for start, end in self.directions():
            kind = self.plan.street(start, end)[1]
            street = (name_of([start]), name_of([end]), LANES[kind], SPEED_MPS[kind], PRIORITY[kind])
            if end in shared and (start, end) in self.pockets:
                made.widened(*street, POCKET_M)
            else:
                made.edge(*street)
        for corner in sorted(self.right_only):
            self._connect(made, corner)
        return made

    def edges(self):
        """Returns `(edge, direction, kind of street, lanes)` of all directions."""
        for start, end in self.directions():
            kind = self.plan.street(start, end)[1]
            yield f"{name_of([start])}_{name_of([end])}", (start, end), kind, LANES[kind]

    def edge_from(self, outside):
        return f"{name_of([outside])}_{name_of(self.plan.arms[outside])}"

    def edge_to(self, outside):
        """Returns the edge that leaves the city there."""
        return f"{name_of(self.plan.arms[outside])}_{name_of([outside])}"

    def _connect(self, made, corner):
        """Writes the turns of a corner where side streets have right turns only."""
        arms, here = self.plan.arms[corner], name_of([corner])
        for start in arms:
            for goal in arms:
                ways = {(start, corner), (corner, goal)}
                if ways & self.closed or not self.may_turn(start, corner, goal):
                    continue
                straight = {start, goal} <= set(self._through(corner))
                lanes = min(self.lanes(start, corner), self.lanes(corner, goal)) if straight else 1
                made.connect(f"{name_of([start])}_{here}", f"{here}_{name_of([goal])}",
                             *[(lane, lane) for lane in range(lanes)])


def name_of(corners):
    return "".join(f"n{corner}" for corner in corners)


def is_shared(light):
    """Says whether a light is one of two corners, by its id from `name_of`."""
    return light.count("n") > 1


def reached(start, turns):
    found, waiting = {start}, [start]
    while waiting:
        for following in turns.get(waiting.pop(), []):
            if following not in found:
                found.add(following)
                waiting.append(following)
    return found
