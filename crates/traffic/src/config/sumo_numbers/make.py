#!/usr/bin/env python3
"""Makes table.txt: which options of SUMO, and which attributes of its files, are numbers, from SUMO's own lists.

    pip install --target OLD eclipse-sumo==1.15.0; pip install --target NEW eclipse-sumo==1.28.0
    python3 make.py OLD/sumo NEW/sumo > table.txt

Options come from `sumo --save-template`, attributes from the XML schemas in data/xsd. Where two versions differ, the
kind that allows more counts.
"""

import pathlib
import re
import subprocess
import sys
import tempfile
import textwrap
import xml.etree.ElementTree as ElementTree

XSD = "{http://www.w3.org/2001/XMLSchema}"
# From the kind that allows least to the one that allows most.
KINDS = ["int", "float", "time"]
# Types that the schemas define elsewhere, some of which also allow words.
TYPES = {
    "periodType": "time",
    "departType": "time",
    "personDepartType": "time",
    "nonNegativeDistributionType": "float",
    "departPosType": "float",
    "departSpeedType": "float",
    "arrivalPosType": "float",
    "arrivalSpeedType": "float",
}
# Attributes that the schemas call texts: they are lists of numbers.
LISTS = {"vTypeDistribution": ["probabilities"], "routeDistribution": ["probabilities"]}
# Nets are judged as a whole. Detectors only measure. What stands in carFollowing-... may stand in a vType, too.
NOT_HERE = re.compile(
    "tlLogic|phase|function|[Dd]etector|instantInductionLoop|detEntry|detExit|entryExit|Data|Probe|poly|poi|timedEvent"
    "|^location$|^type$|^laneType$|^restriction$|^preference$|^meso$|^carFollowing"
)


def kind_of(name):
    name = (name or "").split(":")[-1]
    if name in TYPES:
        return TYPES[name]
    lower = name.lower()
    if lower.startswith("timetype"):
        return "time"
    if "float" in lower or lower in ("double", "decimal"):
        return "float"
    return "int" if "integer" in lower or lower == "int" or re.search("IntType", name) else None


def kind_inside(attribute):
    """The kind of an attribute whose type is written in place."""
    for inner in attribute.iter():
        names = (inner.get("base") or "") + " " + (inner.get("memberTypes") or "")
        for name in names.split():
            if kind_of(name):
                return kind_of(name)
    return None


def wider(one, other):
    return max((kind for kind in (one, other) if kind), key=KINDS.index)


def attributes(folder, found):
    schemas = [path for path in folder.rglob("*.xsd") if re.match("(route|additional|base|taz)", path.name)]
    trees = [ElementTree.parse(path).getroot() for path in schemas]
    types = {kind.get("name"): kind for tree in trees for kind in tree.iter(XSD + "complexType") if kind.get("name")}

    def own(kind):
        for child in kind:
            if child.tag == XSD + "attribute":
                yield child
            elif child.tag in (XSD + "complexContent", XSD + "simpleContent", XSD + "extension"):
                yield from own(child)
                base = types.get((child.get("base") or "").split(":")[-1])
                if base is not None:
                    yield from own(base)

    for tree in trees:
        for element in tree.iter(XSD + "element"):
            inner = element.find(XSD + "complexType")
            kind = inner if inner is not None else types.get((element.get("type") or "").split(":")[-1])
            name = element.get("name")
            if kind is None or not name or NOT_HERE.search(name):
                continue
            for attribute in own(kind):
                number = kind_of(attribute.get("type")) or kind_inside(attribute)
                if number and attribute.get("name") != "id":
                    place = found.setdefault(name, {})
                    place[attribute.get("name")] = wider(place.get(attribute.get("name")), number)


def options(program, found):
    with tempfile.TemporaryDirectory() as folder:
        template = pathlib.Path(folder) / "template.xml"
        subprocess.run([program, "--save-template", template], check=True, stdout=subprocess.DEVNULL)
        for option in ElementTree.parse(template).getroot().iter():
            kind = {"INT": "int", "FLOAT": "float", "TIME": "time"}.get(option.get("type"))
            if kind:
                found[option.tag] = wider(found.get(option.tag), kind)


def main():
    of_options, of_elements = {}, {}
    for package in map(pathlib.Path, sys.argv[1:]):
        options(package / "bin" / "sumo", of_options)
        attributes(package / "data" / "xsd", of_elements)
    for element, lists in LISTS.items():
        of_elements.setdefault(element, {}).update((name, "float") for name in lists)
    print("# Which options of SUMO and which attributes of its files are numbers. Made by make.py from SUMO's own lists.")
    for name, numbers in [("option", of_options)] + sorted(of_elements.items()):
        for kind in KINDS:
            words = sorted(word for word, other in numbers.items() if other == kind)
            if words:
                print(*textwrap.wrap(f"{name} {kind}: " + " ".join(words), 128, subsequent_indent="    ", break_on_hyphens=False), sep="\n")


if __name__ == "__main__":
    main()
