"""The process of an environment, and the memory that it shares with this one.

libsumo holds one simulation per process. So every environment is a child process of its own, and one Python process can
have as many as it likes. Orders and answers go over a socket; numbers are in memory that both processes map.
"""

from __future__ import annotations

import json
import mmap
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Union

import numpy as np

from .errors import ProcessDied, SimulatorError

PathLike = Union[str, "os.PathLike[str]"]

# What the child runs: an interpreter without site-packages that loads nothing but the native module.
_CODE = "import sys; sys.path.insert(0, sys.argv[1]); import _native; _native.serve(int(sys.argv[2]))"

_BEGIN, _RESET, _STEP, _MEASURE, _DRAW, _LOOK = b"B", b"R", b"S", b"M", b"D", b"L"
_DONE = ord("K")
_HEAD = struct.Struct("<BI")
_STEP_ORDER = _HEAD.pack(_STEP[0], 0)
# Time in which a child whose channel is closed may end by itself, in seconds. A step takes milliseconds.
_PATIENCE_S = 2.0
# Bytes of a dead child's output that an error shows.
_LAST_WORDS = 2000


class Process:
    """A child process with an environment in it. ``about`` is what the child says of the environment."""

    def __init__(self, label: str, request: Dict[str, Any]) -> None:
        """Start the child and open the environment. ``label`` names it in errors."""
        self._label = label
        self._owner = os.getpid()
        # Whether an answer is outstanding: Ctrl-C may come between an order and its answer.
        self._waiting = False
        self._received = bytearray()
        self._map: Optional[mmap.mmap] = None
        self._log = tempfile.TemporaryFile()
        self._memory = os.memfd_create("dials_traffic")
        self._socket, theirs = socket.socketpair()
        with theirs:
            self._child = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", _CODE, str(Path(__file__).parent), str(self._memory)],
                stdin=theirs.fileno(),
                stdout=self._log,
                stderr=self._log,
                pass_fds=[self._memory],
                # Ctrl-C at the terminal is for this process, which ends its children when it is ready.
                start_new_session=True,
            )
        try:
            self.about: Dict[str, Any] = json.loads(self._ask(_BEGIN, request))
            memory = self.about["memory"]
            self._map = mmap.mmap(self._memory, memory["size"])
        except BaseException:
            self.close()
            raise
        self._sections = memory["sections"]

    def array(self, name: str) -> np.ndarray:
        """Return the numbers of a section of the shared memory. They change with every step."""
        if self._map is None:
            raise SimulatorError(f"{self._label}: is closed")
        offset, count, dtype = self._sections[name]
        return np.frombuffer(self._map, dtype, count, offset)

    def reset(self, seed: int, episode: int = 0) -> None:
        """Begin an episode."""
        self.send_reset(seed, episode)
        self.receive()

    def send_reset(self, seed: int, episode: int = 0) -> None:
        """Order a new episode and do not wait for it."""
        if self._waiting:
            # The answer to the interrupted order has no meaning any more.
            self._answer()
        self._order(_RESET, {"seed": seed, "episode": episode})

    def step(self) -> None:
        """Make a step with the actions in the shared memory."""
        self.send_step()
        self.receive()

    def send_step(self) -> None:
        """Order a step and do not wait for it."""
        self._send(_STEP_ORDER)

    def receive(self) -> bytes:
        """Wait for the answer to the last order."""
        tag, payload = self._answer()
        if tag != _DONE:
            raise SimulatorError(f"{payload.decode(errors='replace')}")
        return payload

    def measure(self) -> Dict[str, Any]:
        """Return the figures that the simulator keeps."""
        figures: Dict[str, Any] = json.loads(self._ask(_MEASURE))
        return figures

    def look(self) -> List[Dict[str, Any]]:
        """Return what is on the roads of every agent, in order."""
        seen: List[Dict[str, Any]] = json.loads(self._ask(_LOOK))
        return seen

    def draw(self) -> np.ndarray:
        """Return a picture, ``[height, width, 3]``."""
        payload = self._ask(_DRAW)
        width, height = struct.unpack_from("<II", payload)
        return np.frombuffer(payload, np.uint8, offset=8).reshape(height, width, 3).copy()

    @property
    def pid(self) -> int:
        """Number of the child process."""
        pid: int = self._child.pid
        return pid

    def close(self) -> None:
        """End the child. Only the process that started it does."""
        if os.getpid() != self._owner:
            return
        self._waiting = False
        # The end of the channel ends a child that waits for an order. A busy one is killed.
        self._socket.close()
        if self._memory >= 0:
            os.close(self._memory)
            self._memory = -1
        try:
            self._child.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._log.close()
        # numpy arrays over the memory may still be in use: it is unmapped with the last of them.
        self._map = None

    def __del__(self) -> None:
        if hasattr(self, "_child"):
            self.close()

    def _ask(self, tag: bytes, what: Optional[Dict[str, Any]] = None) -> bytes:
        self._order(tag, what)
        return self.receive()

    def _order(self, tag: bytes, what: Optional[Dict[str, Any]] = None) -> None:
        payload = b"" if what is None else json.dumps(what).encode()
        self._send(_HEAD.pack(tag[0], len(payload)) + payload)

    def _send(self, order: bytes) -> None:
        if os.getpid() != self._owner:
            raise SimulatorError(
                f"{self._label}: belongs to process {self._owner}, and this is another one; make it anew after a fork"
            )
        if self._socket.fileno() < 0:
            raise SimulatorError(f"{self._label}: is closed")
        if self._waiting:
            raise SimulatorError(f"{self._label}: its last call was interrupted; call reset() first")
        self._waiting = True
        try:
            self._socket.sendall(order)
        except (BrokenPipeError, ConnectionResetError):
            raise self._death() from None

    def _answer(self) -> "tuple[int, bytes]":
        """Read an answer. What an interrupted call has read stays in ``_received``."""
        received = self._received
        while True:
            if len(received) >= _HEAD.size:
                tag, length = _HEAD.unpack_from(received)
                if len(received) == _HEAD.size + length:
                    payload = bytes(memoryview(received)[_HEAD.size :])
                    received.clear()
                    self._waiting = False
                    return tag, payload
            try:
                more = self._socket.recv(1 << 20)
            except ConnectionResetError:
                more = b""
            if not more:
                raise self._death()
            received += more

    def _death(self) -> ProcessDied:
        """Return the error that says how the child ended, and close what is left of it."""
        try:
            code: Optional[int] = self._child.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            code = None
        self._log.seek(0, os.SEEK_END)
        self._log.seek(max(0, self._log.tell() - _LAST_WORDS))
        words = self._log.read().decode(errors="replace").strip()
        pid = self._child.pid
        self.close()
        said = f"; its last words: {words}" if words else ""
        return ProcessDied(f"{self._label}: its process {pid} {_how_it_ended(code)}{said}")


def _how_it_ended(code: Optional[int]) -> str:
    if code is None:
        return "does not answer any more"
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = "unknown"
    memory = "; out of memory?" if -code == signal.SIGKILL else ""
    return f"died of signal {-code} ({name}{memory})"


def settings_of(settings: Optional[Mapping[str, Any]]) -> "list[str]":
    """Return settings as ``--set`` takes them, such as ``traffic.horizon=100``."""
    return [f"{key}={_in_toml(value)}" for key, value in (settings or {}).items()]


def _in_toml(value: Any) -> str:
    """Return a value as TOML writes it. JSON writes these types in the same way."""
    if isinstance(value, (bool, int, float, str, list, tuple)):
        return json.dumps(value)
    raise TypeError(f"settings: {value!r} is neither a bool, a number, a text nor a list of them")


def fresh_seed(seed: Optional[int]) -> int:
    """Return the seed, or one from the system if there is none."""
    if seed is None:
        return int(np.random.SeedSequence().generate_state(1, np.uint64)[0])
    if not 0 <= int(seed) < 1 << 64:
        raise ValueError(f"seed {seed}: must be from 0 to 2**64 - 1")
    return int(seed)
