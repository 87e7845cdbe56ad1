"""The build of the package: first the program `dials-traffic`, then maturin's own build, which packs both into one wheel.

pip calls this. It needs a Rust toolchain and a C++ compiler, and no SUMO.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import maturin
from maturin import *  # noqa: F403: the other hooks of PEP 517 are maturin's

_HERE = Path(__file__).resolve().parent
# Where maturin looks for programs.
_SCRIPTS = _HERE / "dials_traffic.data" / "scripts"
# A program that is built already, for an older system than this one: wheel.sh.
_BUILT = "DIALS_PROGRAM"


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    _SCRIPTS.mkdir(parents=True, exist_ok=True)  # maturin looks whether it is there
    return maturin.prepare_metadata_for_build_wheel(metadata_directory, config_settings)


def prepare_metadata_for_build_editable(metadata_directory, config_settings=None):
    _SCRIPTS.mkdir(parents=True, exist_ok=True)
    return maturin.prepare_metadata_for_build_editable(metadata_directory, config_settings)


def build_sdist(sdist_directory, config_settings=None):
    raise SystemExit("the program is not in a source distribution: build a wheel from a clone, with python/wheel.sh")


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    _pack_program()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    _pack_program()
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)


def _pack_program():
    _SCRIPTS.mkdir(parents=True, exist_ok=True)
    packed = _SCRIPTS / "dials-traffic"
    shutil.copyfile(os.environ.get(_BUILT) or _built_program(), packed)
    packed.chmod(0o755)
    if shutil.which("strip"):
        subprocess.run(["strip", packed], check=True)


def _built_program():
    command = ["cargo", "build", "--release", "--locked", "--bin", "dials-traffic"]
    command.append("--message-format=json-render-diagnostics")
    said = subprocess.run(command, cwd=_HERE.parent, check=True, stdout=subprocess.PIPE, text=True).stdout
    made = (json.loads(line) for line in said.splitlines())
    return next(path for path in (thing.get("executable") for thing in made) if path)
