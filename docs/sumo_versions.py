#!/usr/bin/env python3
"""Measures reference figures on versions of SUMO from PyPI, for the table in docs/sumo-versions.md.

    python3 docs/sumo_versions.py --program PROGRAM VERSION...            compares with the table
    python3 docs/sumo_versions.py --program PROGRAM --write VERSION...    writes the rows of these versions

PROGRAM is a built `dials-traffic`. Each version is downloaded once, to target/sumo. Five minutes a version on one core.
"""

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "sumo-versions.md"
TOWN = "sumo_nets/town/town.sumocfg"
# Two machines differ in the last bits of what they compute, so a mean may differ by this part of its interval.
TOLERANCE = 0.5


def installed(version: str) -> Path:
    """Return the library of a version, downloaded if it is not there yet."""
    folder = ROOT / "target" / "sumo" / version
    library = folder / "sumo" / "lib64" / "libsumocpp.so"
    if not library.exists():
        options = ["-q", "--no-deps", "--root-user-action", "ignore", "--target", folder]
        subprocess.run([sys.executable, "-m", "pip", "install", *options, f"eclipse-sumo=={version}"], check=True)
    return library


class Sumo:
    """One version, and the program that uses it."""

    def __init__(self, program: Path, version: str):
        self.program, self.version = program, version
        self.environment = {**os.environ, "DIALS_SUMO_LIBRARY": str(installed(version))}

    def run(self, *words: str) -> str:
        command = [self.program, *words, "--quiet"]
        done = subprocess.run(command, cwd=ROOT, env=self.environment, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.exit(f"SUMO {self.version}: {' '.join(words)}: {done.stderr.strip()}")
        return done.stdout

    def baseline(self, config: str, controller: str, episodes: int) -> dict:
        return json.loads(self.run("baseline", config, "--controller", controller, "--episodes", str(episodes), "--json"))

    def row(self) -> list:
        """Return the columns of the table."""
        grid = "configs/traffic_4.toml"
        figures = [self.baseline(grid, controller, 100) for controller in ("actuated", "gap-out")]
        means = [(found["mean_return"], found["half_width_95"]["return"]) for found in figures]
        town = self.baseline(TOWN, "program", 20)
        means.append((town["delay_s"], town["half_width_95"]["delay_s"]))
        alike = json.loads(self.run("check", grid, "--json"))["all"]["true_entries"]
        doctor = subprocess.run([self.program, "doctor"], env=self.environment, capture_output=True, check=False)
        return [
            self.version,
            "works" if doctor.returncode == 0 else "fails",
            *(f"{mean:.1f} +- {half:.1f}" for mean, half in means),
            f"{alike['precision']:.2f} / {alike['recall']:.2f}",
            self.smoke(),
        ]

    def smoke(self) -> str:
        """Return the beginning of the digest of the smoke run's policies, which a second run must have, too."""
        digests = set()
        for _ in range(2):
            with tempfile.TemporaryDirectory() as room:
                self.run("train", "configs/smoke_traffic.toml", "--out", f"{room}/run")
                digests.add(hashlib.sha256(Path(room, "run", "policies.safetensors").read_bytes()).hexdigest()[:8])
        return digests.pop() if len(digests) == 1 else "does not repeat"


def differ(old: str, new: str) -> bool:
    """Return whether two cells of one column differ in more than last bits. A digest is that of one kind of CPU."""
    if re.fullmatch("[0-9a-f]{8}", old):
        return not re.fullmatch("[0-9a-f]{8}", new)
    if "+-" not in old:
        return old != new
    (mean, half), (other, _) = ([float(part) for part in cell.split(" +- ")] for cell in (old, new))
    return abs(mean - other) > TOLERANCE * half


def main() -> None:
    about, _, usage = __doc__.partition("\n\n")
    parser = argparse.ArgumentParser(description=about, epilog=usage, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, default=ROOT / "target" / "release" / "dials-traffic")
    parser.add_argument("--write", action="store_true", help="write the rows instead of comparing")
    parser.add_argument("versions", nargs="+")
    args = parser.parse_args()
    wrong = []
    for version in args.versions:
        row = Sumo(args.program.resolve(), version).row()
        print("| " + " | ".join(row) + " |", flush=True)
        page = PAGE.read_text()
        found = re.search(rf"^\| {re.escape(version)} \|.*$", page, re.MULTILINE)
        if not found:
            sys.exit(f"{PAGE}: has no row for SUMO {version}; add an empty one: | {version} |")
        if args.write:
            PAGE.write_text(page.replace(found[0], "| " + " | ".join(row) + " |"))
            continue
        known = [cell.strip() for cell in found[0].strip("|").split("|")]
        if len(known) != len(row) or any(differ(old, new) for old, new in zip(known, row)):
            wrong.append(f"SUMO {version}: the table has {known}")
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
