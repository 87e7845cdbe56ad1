"""Islands: small road networks of 1 to 9 lights that differ as much as those of real towns. Only shapes, no demand."""

from itertools import accumulate
from math import cos, hypot, radians, sin

from .network import Roads

SPEEDS_MPS = {8.33: 1, 11.11: 2, 13.89: 4, 16.67: 2, 19.44: 1}
LANES = {1: 4, 2: 5, 3: 3, 4: 1}
ARM_M = (70, 400)
BETWEEN_LIGHTS_M = (90, 350)
BLOCK_M = (90, 260)
SLOW_EXIT_M = 60
MOUTH = 0.25  # share of the long arms where a side street joins just before the light
MOUTH_M = (30, 60)  # from the middle of the light's junction
# The least angle between two arms of a light, in degrees.
APART = 40
MAIN, SIDE = 3, 1  # priorities of streets


class Island:
    """Roads with arms that end outside. `name` begins the ids of everything on it; `count` is its number of lights."""

    def __init__(self, name, count, dice):
        self.name, self.count, self.dice = name, count, dice
        self.roads = Roads()
        self.outside = []  # (end of an arm, whether it is a side street)
        self.joined = False  # whether two junctions share a light
        self.streets = []  # (one place, other place), for `crosses`

    def light(self, name, x, y, tl=None):
        """Adds a node with a light. Nodes with the same `tl` have one light together."""
        self.joined = self.joined or tl is not None
        return self._node(name, x, y, type="traffic_light", **({"tl": f"{self.name}_{tl}"} if tl else {}))

    def _node(self, name, x, y, **attributes):
        name = f"{self.name}_{name}"
        self.roads.node(name, x, y, **attributes)
        return name

    def street(self, one, other, towards, back, speed, priority=MAIN, pockets=()):
        """Adds `towards` lanes to `other` and `back` lanes to `one`. Nodes in `pockets` get a lane for turns."""
        for start, end, lanes in [(one, other, towards), (other, one, back)]:
            if lanes and end in pockets:
                (x, y), (x0, y0) = self.roads.places[start], self.roads.places[end]
                pocket_m = min(self.dice.between(25, 70), 0.6 * hypot(x - x0, y - y0))
                side = self.dice.choose({"left": 3, "right": 1})
                self.roads.widened(start, end, lanes, speed, priority, pocket_m, side)
            elif lanes:
                self.roads.edge(start, end, lanes, speed, priority)
        self.streets.append((self.roads.places[one], self.roads.places[other]))

    def arm(self, light, angle, lanes_in, lanes_out, speed, slow=False):
        """Adds a street from a light to the outside, in a direction in degrees. A slow exit lets few cars out."""
        dice, (x, y) = self.dice, self.roads.places[light]
        length = ARM_M[0] + (ARM_M[1] - ARM_M[0]) * dice.next() ** 1.6
        number = len(self.outside)

        def away(metres):
            return x + metres * cos(radians(angle)), y + metres * sin(radians(angle))

        end = self._node(f"end{number}", *away(length + (SLOW_EXIT_M if slow else 0)))
        inner = self._node(f"gate{number}", *away(length), type="priority") if slow else end
        mouth = light
        if length > 2 * MOUTH_M[1] and dice.next() < MOUTH:
            mouth = self._node(f"mouth{number}", *away(dice.between(*MOUTH_M)), type="priority")
            self.street(mouth, light, lanes_in, lanes_out, speed)
        pockets = [light] if mouth == light and length > 90 and lanes_in < 4 and dice.next() < 0.35 else []
        self.street(inner, mouth, lanes_in, lanes_out, speed, pockets=pockets)
        if slow:
            if lanes_in:
                self.roads.edge(end, inner, lanes_in, speed, MAIN)
            if lanes_out:
                self.roads.edge(inner, end, 1, dice.between(1.5, 3.5), MAIN)
        self.outside.append((end, False))
        if mouth != light:
            self.branch(mouth, cos(radians(angle)), sin(radians(angle)))

    def branch(self, node, dx, dy):
        """Adds a side street at a junction without a light, to the left or the right of a direction."""
        length = self.dice.between(60, 110) * self.dice.choose({1: 1, -1: 1}) / hypot(dx, dy)
        (x, y), number = self.roads.places[node], len(self.outside)
        end = self._node(f"end{number}", x - length * dy, y + length * dx)
        self.street(end, node, 1, 1, 8.33, SIDE)
        self.outside.append((end, True))

    def side_street(self, one, other, towards, back, speed, pockets=()):
        """Adds a street between two lights with a junction without a light in it, where a side street begins."""
        (x, y), (x1, y1) = self.roads.places[one], self.roads.places[other]
        share, number = self.dice.between(0.4, 0.6), len(self.outside)
        middle = self._node(f"middle{number}", x + share * (x1 - x), y + share * (y1 - y), type="priority")
        self.street(one, middle, towards, back, speed, pockets=pockets)
        self.street(middle, other, towards, back, speed, pockets=pockets)
        self.branch(middle, x1 - x, y1 - y)

    def between(self, one, other, towards, back, speed):
        """Adds a street between two lights, with pockets or a side street by chance."""
        (x, y), (x1, y1) = self.roads.places[one], self.roads.places[other]
        length = hypot(x - x1, y - y1)
        pockets = [node for node in (one, other) if length > 90 and max(towards, back) < 4 and self.dice.next() < 0.3]
        build = self.side_street if length > 170 and self.dice.next() < 0.35 else self.street
        build(one, other, towards, back, speed, pockets=pockets)

    def move_to(self, x, y):
        """Moves everything so that the lower left corner is there. Returns width and height in metres."""
        west, south, east, north = (side(place[axis] for place in self.roads.places.values())
                                    for side in (min, max) for axis in (0, 1))
        for name, (x0, y0) in self.roads.places.items():
            self.roads.nodes[name] |= {"x": f"{x + x0 - west:.2f}", "y": f"{y + y0 - south:.2f}"}
        return east - west, north - south

    def crosses(self):
        """Says whether two streets cross where no junction is, or nearly touch."""
        for number, (a, b) in enumerate(self.streets):
            for c, d in self.streets[:number]:
                if not {a, b} & {c, d} and (meet(a, b, c, d) or min(
                        distance(a, c, d), distance(b, c, d), distance(c, a, b), distance(d, a, b)) < 22):
                    return True
        return False


def meet(a, b, c, d):
    """Says whether the line from `a` to `b` crosses the one from `c` to `d`."""
    def left(p, q, r):
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]) > 0

    return left(a, b, c) != left(a, b, d) and left(c, d, a) != left(c, d, b)


def distance(p, a, b):
    """Returns how far a place is from the line between two others."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    share = max(0, min(1, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy)))
    return hypot(p[0] - a[0] - share * dx, p[1] - a[1] - share * dy)


def lanes(dice, most=4):
    """Returns the lanes of a street in both directions. Mostly both have the same number."""
    towards = min(most, dice.choose(LANES))
    back = max(1, min(most, towards + dice.choose({0: 6, 1: 2, -1: 2})))
    return towards, back


def add_arms(island, light, angles, one_way=0.15, slow=0.12):
    """Adds arms to a light. All but two of them may be one-way. `one_way` and `slow` are probabilities."""
    dice, speed = island.dice, island.dice.choose(SPEEDS_MPS)
    spare = len(angles) - 2  # arms that may be one-way
    for angle in angles:
        lanes_in, lanes_out = lanes(dice)
        if spare > 0 and dice.next() < one_way * len(angles) / 3:
            lanes_in, lanes_out = (0, lanes_out) if dice.next() < 0.5 else (lanes_in, 0)
            spare -= 1
        own_speed = speed if dice.next() < 0.6 else dice.choose(SPEEDS_MPS)
        island.arm(light, angle, lanes_in, lanes_out, own_speed, lanes_out > 0 and dice.next() < slow)


def single(island):
    """One light with 3 to 6 arms at odd angles."""
    dice = island.dice
    count = dice.choose({3: 3, 4: 5, 5: 2, 6: 1})
    turned, shift = dice.between(0, 360), (360 / count - APART) / 2
    angles = [turned + 360 / count * arm + dice.between(-shift, shift) for arm in range(count)]
    add_arms(island, island.light("a", 0, 0), angles)


def joined(island):
    """Two junctions near each other that share one light."""
    dice, turned = island.dice, island.dice.between(0, 360)
    apart = dice.between(26, 45)
    west = island.light("a", 0, 0, tl="ab")
    east = island.light("b", apart * cos(radians(turned)), apart * sin(radians(turned)), tl="ab")
    towards, back = lanes(dice, 2)
    island.street(west, east, towards, back, 11.11)
    for light, along, sides in [(west, 180, dice.choose({(90,): 2, (270,): 1, (90, 270): 1})),
                                (east, 0, dice.choose({(90,): 1, (270,): 2, (90, 270): 1}))]:
        add_arms(island, light, [turned + angle + dice.between(-20, 20) for angle in (along, *sides)], 0.05, 0.05)


def arterial(island):
    """A main street with 2 to 4 lights, with side roads at each."""
    dice, turned = island.dice, island.dice.between(0, 360)
    along, nodes = 0, []
    for number in range(island.count):
        aside = dice.between(-18, 18)
        x = along * cos(radians(turned)) - aside * sin(radians(turned))
        y = along * sin(radians(turned)) + aside * cos(radians(turned))
        nodes.append(island.light("abcd"[number], x, y))
        along += dice.between(*BETWEEN_LIGHTS_M)
    towards, back = lanes(dice, 3)
    if dice.next() < 0.15:
        towards, back = (towards, 0) if dice.next() < 0.5 else (0, back)
    speed = dice.choose(SPEEDS_MPS)
    for one, other in zip(nodes, nodes[1:]):
        island.between(one, other, towards, back, speed)
    for light in nodes:
        angles = dice.choose({(90, 270): 5, (90,): 2, (270,): 2})
        add_arms(island, light, [turned + angle + dice.between(-28, 28) for angle in angles])
    island.arm(nodes[0], turned + 180, towards, back, speed, dice.next() < 0.1)
    island.arm(nodes[-1], turned, back, towards, speed, dice.next() < 0.1)


def grid(island):
    """An irregular grid of 4 to 9 lights; a street goes out wherever no neighbour is."""
    dice, turned = island.dice, island.dice.between(0, 360)
    columns, rows = ([0, *accumulate(dice.between(*BLOCK_M) for _ in range(2))] for _ in range(2))
    cells = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1), (0, 2), (1, 2), (2, 2)][:island.count]
    nodes = {}
    for number, (column, row) in enumerate(cells):
        x, y = columns[column] + dice.between(-22, 22), rows[row] + dice.between(-22, 22)
        nodes[column, row] = island.light("abcdefghi"[number], x * cos(radians(turned)) - y * sin(radians(turned)),
                                          x * sin(radians(turned)) + y * cos(radians(turned)))
    for (column, row), light in nodes.items():
        for step in [(1, 0), (0, 1)]:
            other = nodes.get((column + step[0], row + step[1]))
            if other:
                towards, back = lanes(dice, 3)
                if dice.next() < 0.15:
                    towards, back = (towards, 0) if dice.next() < 0.5 else (0, back)
                island.between(light, other, towards, back, dice.choose(SPEEDS_MPS))
        sides = [(0, (1, 0)), (90, (0, 1)), (180, (-1, 0)), (270, (0, -1))]
        free = [angle for angle, (dx, dy) in sides if (column + dx, row + dy) not in nodes]
        if len(free) > 1 and dice.next() < 0.3:
            free.pop(int(dice.between(0, len(free))))
        add_arms(island, light, [turned + angle + dice.between(-20, 20) for angle in free], 0.1, 0.08)


# Kinds of islands, with their share of the lights and the numbers of lights that they may have.
KINDS = {single: (0.34, (1, 1)), joined: (0.1, (1, 1)), arterial: (0.32, (2, 4)), grid: (0.24, (4, 9))}
