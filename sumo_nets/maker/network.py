"""A road network: nodes, edges and connections in, netconvert's text out."""

import os
import re
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from xml.sax.saxutils import quoteattr

XML = '<?xml version="1.0" encoding="UTF-8"?>\n'


def element(name, attributes, content=None):
    """Returns an XML element as text; `content` are the elements in it, if it may have some."""
    opening = " ".join([name] + [f"{key}={quoteattr(str(value))}" for key, value in attributes.items()])
    if content is None:
        return f"<{opening}/>"
    inner = "".join(f"    {line}\n" for line in content)
    return f"<{opening}>\n{inner}</{name}>"


def run(program, *arguments):
    """Runs a program of SUMO. What it warns of is an error: the scenarios must load without warnings."""
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

    def node(self, name, x, y, **attributes):
        self.nodes[name] = {"id": name, "x": f"{x:.2f}", "y": f"{y:.2f}", **attributes}

    def edge(self, start, end, lanes, speed, priority, name=None):
        """Adds a street in one direction and returns its id."""
        name = name or f"{start}_{end}"
        self.edges[name] = {
            "id": name, "from": start, "to": end, "numLanes": lanes, "speed": f"{speed:.2f}", "priority": priority,
        }
        return name

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


def links(net):
    """Returns for every light its links: `(index, from edge, direction)`, direction in SUMO's letters."""
    found = {}
    for link in ET.fromstring(net).iter("connection"):
        if "tl" in link.attrib:
            found.setdefault(link.get("tl"), []).append(
                (int(link.get("linkIndex")), link.get("from"), link.get("dir").lower()))
    return found
