"""Fastest ways through a road network."""

import heapq
import itertools
import xml.etree.ElementTree as ET

# What a turn costs beside the drive, in seconds, and a light before it.
TURN_S = {"s": 0, "r": 3, "l": 8}
LIGHT_S = 12


class Ways:
    """The edges of a network, with the time to drive them, and the turns between them."""

    def __init__(self, net):
        root = ET.fromstring(net)
        self.seconds, self.metres, self.after = {}, {}, {}
        for edge in root.iter("edge"):
            if "function" not in edge.attrib:  # no way over a junction, and no crossing
                lane = edge.find("lane")
                self.metres[edge.get("id")] = float(lane.get("length"))
                self.seconds[edge.get("id")] = float(lane.get("length")) / float(lane.get("speed"))
                self.after[edge.get("id")] = {}
        for turn in root.iter("connection"):
            start, goal = turn.get("from"), turn.get("to")
            if start in self.after and goal in self.after:
                cost = TURN_S[turn.get("dir").lower()] + (LIGHT_S if "tl" in turn.attrib else 0)
                self.after[start][goal] = cost

    def fastest(self, start, goal, dearer=None):
        """Returns the edges of the fastest way, or None. `dearer` maps an edge to a factor on its time."""
        dearer = dearer or {}
        order = itertools.count()
        queue, done = [(0.0, next(order), start, None)], {}
        while queue:
            cost, _, edge, before = heapq.heappop(queue)
            if edge in done:
                continue
            done[edge] = before
            if edge == goal:
                way = [edge]
                while done[way[-1]] is not None:
                    way.append(done[way[-1]])
                return way[::-1]
            for following, turn in self.after[edge].items():
                seconds = self.seconds[following] * dearer.get(following, 1.0)
                heapq.heappush(queue, (cost + turn + seconds, next(order), following, edge))
        return None
