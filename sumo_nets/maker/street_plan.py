"""The street plan of a city: an area that streets cut into blocks again and again, main streets first. Only shapes.

Most cuts end in the middle of a street, so most corners have three arms, as in towns that grew. A cut that ends near
such a corner on the other side goes on there, and a crossing of four arms comes of it.
"""

from math import atan2, cos, degrees, hypot, pi, radians, sin, sqrt

HECTARE = 10_000
# Blocks of at least this size are cut by a street of this kind, at the mean distance from the centre.
KINDS = [("arterial", 55 * HECTARE), ("main", 20 * HECTARE), ("collector", 8.5 * HECTARE), ("minor", 4.2 * HECTARE)]
# How much larger blocks are at the edge of the city than in its centre.
CENTRE, EDGE = 0.6, 1.35
PARKS = 0.05  # share of the blocks for minor streets that stay whole
TRIES = 30
TURNED_DEGREES = 9  # how far a cut is off the short way through a block
APART_DEGREES = 52  # least angle between two arms of a corner
SHORTEST_M = 72  # least distance between two corners
NEAR = 0.28  # how near to a corner a cut goes on there, as a share of the width of its block
STAGGERED, STAGGER_M = 0.3, 34  # share of the crossings whose arms are a little apart, and how far
OUTSIDE_M = (170, 260)  # length of the streets that leave the city
WAYS_OUT = 0.35  # share of the collectors that leave it
BENT = 0.16  # how much streets are bent, as the steepest slope of their sideways shift


class StreetPlan:
    """Corners with `places`, and `streets`: pairs of corners, with the line that they belong to and its kind."""

    def __init__(self, radius_m, dice):
        self.radius_m, self.dice = radius_m, dice
        self.places, self.streets, self.blocks = [], {}, []
        self.arms = []  # neighbours of every corner
        self.lines = 1  # line 0 is the ring road
        self._surround()
        while self.blocks:
            self._cut(self.blocks.pop(0))
        self._bend()
        self.outside = [self._leave(corner, kind) for corner in range(len(self.places))
                        for kind in self._kinds_that_leave(corner)]

    def distance(self, one, other):
        (x, y), (x0, y0) = self.places[one], self.places[other]
        return hypot(x - x0, y - y0)

    def street(self, one, other):
        """Returns the line and the kind of the street between two corners."""
        return self.streets[pair(one, other)]

    def outwards(self, corner):
        """Returns how far a corner is from the centre; the ring road is at about 1."""
        return hypot(*self.places[corner]) / self.radius_m

    def _surround(self):
        """Draws the ring road: a round with corners at odd distances."""
        count, turned = 9 + int(self.radius_m / 400), self.dice.between(0, 2 * pi)
        for number in range(count):
            angle = turned + 2 * pi * (number + self.dice.between(-0.2, 0.2)) / count
            away = self.radius_m * self.dice.between(0.88, 1.1)
            self._corner(1.12 * away * cos(angle), 0.92 * away * sin(angle))
        for number in range(count):
            self._street(number, (number + 1) % count, 0, "ring")
        self.blocks.append(list(range(count)))

    def _corner(self, x, y):
        self.places.append((x, y))
        self.arms.append([])
        return len(self.places) - 1

    def _street(self, one, other, line, kind):
        self.streets[pair(one, other)] = (line, kind)
        self.arms[one].append(other)
        self.arms[other].append(one)

    def _kind(self, block):
        """Returns the kind of the street that cuts a block, or None for a block that is small enough."""
        points = [self.places[corner] for corner in block]
        away = hypot(sum(x for x, _ in points), sum(y for _, y in points)) / len(points) / self.radius_m
        size = area(points) / (CENTRE + (EDGE - CENTRE) * away)
        kind = next((kind for kind, least in KINDS if size >= least), None)
        return None if kind == "minor" and self.dice.next() < PARKS else kind

    def _cut(self, block):
        """Cuts a block in two, if it is large enough and a good cut is found."""
        kind = self._kind(block)
        if kind is None:
            return
        for _ in range(TRIES):
            ends = self._ends(block)
            if ends is None or not self._good(block, *ends):
                continue
            corners = [end if isinstance(end, int) else self._insert(block, *end) for end in ends]
            self._street(*corners, self.lines, kind)
            self.lines += 1
            first, second = sorted(block.index(corner) for corner in corners)
            self.blocks += [block[first:second + 1], block[second:] + block[:first + 1]]
            return

    def _ends(self, block):
        """Draws a line across the short way of a block. Returns its two ends: a corner, or a side and a place."""
        points = [self.places[corner] for corner in block]
        (x, y), along = middle_and_axis(points, self.dice)
        angle = along + pi / 2 + radians(self.dice.between(-TURNED_DEGREES, TURNED_DEGREES))
        dx, dy = cos(angle), sin(angle)
        aside = [(px - x) * dy - (py - y) * dx for px, py in points]
        ends = []
        for number, corner in enumerate(block):
            after = (number + 1) % len(block)
            if (aside[number] < 0) != (aside[after] < 0):
                share = aside[number] / (aside[number] - aside[after])
                ends.append(self._end(block, corner, block[after], share, sqrt(area(points))))
        return ends if len(ends) == 2 and None not in ends else None

    def _end(self, block, one, other, share, width_m):
        """Returns where a cut ends that meets a side there: at a corner near it, or between the corners of the side."""
        length = self.distance(one, other)
        near, far = (one, other) if share < 0.5 else (other, one)
        metres = min(share, 1 - share) * length
        if metres < NEAR * width_m and len(self.arms[near]) == 3 and not self._bends(near, block):
            if length > SHORTEST_M + STAGGER_M and self.dice.next() < STAGGERED:
                metres = STAGGER_M
            else:
                return near
        elif metres < SHORTEST_M:
            metres = SHORTEST_M
            if length < 2 * SHORTEST_M:
                return None
        (x, y), (x0, y0) = self.places[near], self.places[far]
        return one, other, (x + metres / length * (x0 - x), y + metres / length * (y0 - y))

    def _bends(self, corner, block):
        """Says whether the side of a block bends at a corner. Elsewhere its third arm comes from the other side."""
        number = block.index(corner)
        before, after = block[number - 1], block[(number + 1) % len(block)]
        return 180 - between(self.places[before], self.places[corner], self.places[after]) > 40

    def _good(self, block, start, end):
        """Says whether a cut is long enough and has no sharp angles at its ends."""
        ends = [self.places[end] if isinstance(end, int) else end[2] for end in (start, end)]
        for (here, there), cut_end in zip([ends, ends[::-1]], (start, end)):
            neighbours = self.arms[cut_end] if isinstance(cut_end, int) else cut_end[:2]
            if any(between(there, here, self.places[other]) < APART_DEGREES for other in neighbours):
                return False
        return hypot(ends[0][0] - ends[1][0], ends[0][1] - ends[1][1]) > SHORTEST_M

    def _insert(self, block, one, other, place):
        """Puts a new corner on a side, for all blocks that have this side."""
        corner = self._corner(*place)
        line, kind = self.streets.pop(pair(one, other))
        for end, far in [(one, other), (other, one)]:
            self.arms[end][self.arms[end].index(far)] = corner
            self.arms[corner].append(end)
            self.streets[pair(end, corner)] = (line, kind)
        for corners in [block, *self.blocks]:
            for number, here in enumerate(corners):
                if {here, corners[number - 1]} == {one, other}:
                    corners.insert(number, corner)
                    break
        return corner

    def _bend(self):
        """Shifts all corners a little, so that long streets are not straight."""
        waves = []
        for length in (1.3, 0.7):
            metres, phases = length * self.radius_m, [self.dice.between(0, 2 * pi) for _ in range(2)]
            waves.append((2 * pi / metres, BENT / 2 * metres / (2 * pi), phases))
        for corner, (x, y) in enumerate(self.places):
            dx = sum(high * sin(often * y + phases[0]) for often, high, phases in waves)
            dy = sum(high * sin(often * x + phases[1]) for often, high, phases in waves)
            self.places[corner] = (x + dx, y + dy)


    def _kinds_that_leave(self, corner):
        """Returns the kind of the street that goes on beyond the ring road at a corner, as a list of one or none."""
        kinds = [self.street(corner, other)[1] for other in self.arms[corner]]
        if len(kinds) != 3 or kinds.count("ring") != 2:
            return []
        kind = next(kind for kind in kinds if kind != "ring")
        return [kind] if kind in ("arterial", "main") or kind == "collector" and self.dice.next() < WAYS_OUT else []

    def _leave(self, corner, kind):
        """Adds a street from the ring road to the outside, and returns its end."""
        x, y = self.places[corner]
        longer = 1 + self.dice.between(*OUTSIDE_M) / hypot(x, y)
        end = self._corner(longer * x, longer * y)
        self._street(corner, end, self.lines, kind)
        self.lines += 1
        return end


def pair(one, other):
    return min(one, other), max(one, other)


def area(points):
    return abs(sum(x * y1 - x1 * y for (x, y), (x1, y1) in zip(points, points[1:] + points[:1]))) / 2


def between(one, corner, other):
    """Returns the angle at a corner between the ways to two places, in degrees."""
    (x, y), (x0, y0), (x1, y1) = corner, one, other
    angle = degrees(atan2(y0 - y, x0 - x) - atan2(y1 - y, x1 - x)) % 360
    return min(angle, 360 - angle)


def middle_and_axis(points, dice):
    """Returns a place near the middle of a block, and the direction of its long side, by the tightest box around it."""
    boxes = []
    for (x, y), (x1, y1) in zip(points, points[1:] + points[:1]):
        angle = atan2(y1 - y, x1 - x)
        along = [px * cos(angle) + py * sin(angle) for px, py in points]
        across = [py * cos(angle) - px * sin(angle) for px, py in points]
        sides = (max(along) - min(along), max(across) - min(across))
        boxes.append((sides[0] * sides[1], angle, (min(along), sides[0]), (min(across), sides[1])))
    _, angle, along, across = min(boxes)
    shares = dice.between(0.36, 0.64), 0.5
    if across[1] > along[1]:
        shares = shares[::-1]
    u, v = (low + share * side for (low, side), share in zip((along, across), shares))
    direction = angle + (pi / 2 if across[1] > along[1] else 0)
    return (u * cos(angle) - v * sin(angle), u * sin(angle) + v * cos(angle)), direction
