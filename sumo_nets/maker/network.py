"""A road network: nodes, edges and connections in, netconvert's text out."""

import os
import re
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from math import hypot
from pathlib import Path
from xml.sax.saxutils import quoteattr

# An element of a network, with all that is in it.
PART = re.compile(r"    <(?P<kind>edge|tlLogic|junction|connection|roundabout) (?:[^>]*/>|.*?</(?P=kind)>)\n", re.DOTALL)
XML = '<?xml version="1.0" encoding="UTF-8"?>\n'


def element(name, attributes, content=None):
    """Returns an XML element as text; `content` are the elements in it, if it may have some."""
    opening = " ".join([name] + [f"{key}={quoteattr(str(value))}" for key, value in attributes.items()])
    if content is None:
        return f"<{opening}/>"
    inner = "".join("    " + line.replace("\n", "\n    ") + "\n" for line in content)
    return f"<{opening}>\n{inner}</{name}>"


def run(program, *arguments):
    """Runs a program of SUMO. A warning is an error, too: the scenarios must load without warnings."""
    # Without SUMO_HOME the programs warn that they use their own tables of road types. None is used here.
    surroundings = {**os.environ, "SUMO_HOME": os.environ.get("SUMO_HOME", "/usr/share/sumo")}
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=False,
                          env=surroundings)
    if done.returncode != 0 or done.stderr.strip():
        raise SystemExit(f"{program} failed or warned:\n{done.stderr or done.stdout}")


class Roads:
    """What netconvert is given."""

    def __init__(self):
        self.nodes, self.edges, self.connections = {}, {}, []
        self.places = {}

    def node(self, name, x, y, **attributes):
        self.places[name] = (x, y)
        self.nodes[name] = {"id": name, "x": f"{x:.2f}", "y": f"{y:.2f}", **attributes}

    def edge(self, start, end, lanes, speed, priority, name=None):
        """Adds a street in one direction and returns its id."""
        name = name or f"{start}_{end}"
        self.edges[name] = {
            "id": name, "from": start, "to": end, "numLanes": lanes, "speed": f"{speed:.2f}", "priority": priority,
        }
        return name

    def widened(self, start, end, lanes, speed, priority, pocket_m, side="left"):
        """Adds a street in one direction that gets one more lane on a side, `pocket_m` before its end."""
        (x, y), (x0, y0) = self.places[end], self.places[start]
        share = pocket_m / hypot(x - x0, y - y0)
        widening = f"{end}_from_{start}"
        self.node(widening, x + share * (x0 - x), y + share * (y0 - y), type="priority")
        first = self.edge(start, widening, lanes, speed, priority, f"{start}_{end}")
        pocket = self.edge(widening, end, lanes + 1, speed, priority, f"{start}_{end}_turn")
        shift = 0 if side == "left" else 1  # SUMO counts lanes from the right
        new = (lanes - 1, lanes) if side == "left" else (0, 0)
        self.connect(first, pocket, *sorted([(lane, lane + shift) for lane in range(lanes)] + [new]))

    def connect(self, start, end, *lanes):
        """Allows turns from lane to lane. Without any for an edge, netconvert guesses them."""
        self.connections += [{"from": start, "to": end, "fromLane": a, "toLane": b} for a, b in lanes]

    def convert(self, *options):
        """Returns the text of the network without date, comments and names of other files."""
        files = {"nodes": ("node", self.nodes.values()), "edges": ("edge", self.edges.values()),
                 "connections": ("connection", self.connections)}
        with tempfile.TemporaryDirectory() as directory:
            room = Path(directory)
            for name, (kind, rows) in files.items():
                text = element(name, {}, [element(kind, row) for row in rows])
                (room / f"{name}.xml").write_text(XML + text + "\n")
            run("netconvert", "-n", room / "nodes.xml", "-e", room / "edges.xml", "-x", room / "connections.xml",
                "-o", room / "net.xml", "--xml-validation", "never", "--no-turnarounds", "true",
                "--offset.disable-normalization", "true", *options)
            return without_origin((room / "net.xml").read_text())


def without_origin(text):
    """Takes out what changes from call to call or needs the internet: comments, and the place of the schema."""
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    return re.sub(r' xmlns:xsi="[^"]*"| xsi:noNamespaceSchemaLocation="[^"]*"', "", text)


def side_by_side(nets):
    """Returns one network of several that share no id and no place."""
    parts, corners = {}, []
    for net in nets:
        corners.append([float(x) for x in re.search(r'convBoundary="([^"]*)"', net)[1].split(",")])
        for part in PART.finditer(net):
            parts.setdefault(part["kind"], []).append(part[0])
    west, south, east, north = zip(*corners)
    boundary = ",".join(f"{x:.2f}" for x in (min(west), min(south), max(east), max(north)))
    head = nets[0][: nets[0].index("<location")]
    location = element("location", {"netOffset": "0.00,0.00", "convBoundary": boundary, "origBoundary": boundary,
                                    "projParameter": "!"})
    rows = [row for kind in ("edge", "tlLogic", "junction", "connection", "roundabout") for row in parts.get(kind, [])]
    return f"{head}{location}\n" + "".join(rows) + "</net>\n"


def links(net):
    """Returns for every light its links: `(index, from edge, direction)`, direction in SUMO's letters."""
    found = {}
    for link in ET.fromstring(net).iter("connection"):
        if "tl" in link.attrib:
            found.setdefault(link.get("tl"), []).append(
                (int(link.get("linkIndex")), link.get("from"), link.get("dir").lower()))
    return found
