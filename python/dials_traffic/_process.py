"""The process of an environment.

libsumo holds one simulation per process. So every environment is a child process of its own, and one Python process can
have as many as it likes. Orders and answers go over a socket.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Dict, Optional, Tuple

from ._channel import RESET, Channel
from .errors import ProcessDied, SimulatorError

# What the child runs: an interpreter without site-packages that loads nothing but the native module.
_CODE = "import sys; sys.path.insert(0, sys.argv[1]); import _native; _native.serve(int(sys.argv[2]))"

_DONE = ord("K")
_HEAD = struct.Struct("<BI")
# Bytes that are read at once, if more are not announced. The answer to a step has five.
_PIECE = 4096
# Time in which a child whose channel is closed may end by itself, in seconds. A step takes milliseconds.
_PATIENCE_S = 2.0
# Bytes of a dead child's output that an error shows.
_LAST_WORDS = 2000


class Process(Channel):
    """A child process with an environment in it."""

    def __init__(self, label: str, request: Dict[str, Any]) -> None:
        """Start the child and open the environment."""
        super().__init__(label)
        # Whether an answer is outstanding: Ctrl-C may come between an order and its answer.
        self._waiting = False
        self._received = bytearray()
        self._log = tempfile.TemporaryFile()
        self._socket, theirs = socket.socketpair()
        try:
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
        except BaseException:
            self._close_files()
            raise
        self.pid = self._child.pid
        self._begin(request)

    def send(self, tag: int, what: Optional[Dict[str, Any]] = None) -> None:
        self.check()
        if self._waiting and tag == RESET:
            # The answer to the interrupted order has no meaning any more.
            self._answer()
        if self._waiting:
            raise SimulatorError(f"{self._label}: its last call was interrupted; call reset() first")
        payload = b"" if what is None else json.dumps(what).encode()
        self._waiting = True
        try:
            self._socket.sendall(_HEAD.pack(tag, len(payload)) + payload)
        except (BrokenPipeError, ConnectionResetError):
            raise self._death() from None

    def receive(self) -> bytes:
        tag, payload = self._answer()
        if tag != _DONE:
            raise SimulatorError(payload.decode(errors="replace"))
        return payload

    def close(self) -> None:
        if os.getpid() != self._owner:
            return
        self._waiting = False
        # The end of the channel ends a child that waits for an order. A busy one is killed.
        self._socket.close()
        try:
            self._child.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._close_files()

    def _close_files(self) -> None:
        self._socket.close()
        self._log.close()
        self._close_memory()

    def __del__(self) -> None:
        if hasattr(self, "_child"):
            self.close()

    def _answer(self) -> Tuple[int, bytes]:
        """Read an answer. What an interrupted call has read stays in ``_received``."""
        received = self._received
        while True:
            missing = 0
            if len(received) >= _HEAD.size:
                tag, length = _HEAD.unpack_from(received)
                missing = _HEAD.size + length - len(received)
                if missing == 0:
                    payload = bytes(memoryview(received)[_HEAD.size :])
                    received.clear()
                    self._waiting = False
                    return tag, payload
            try:
                more = self._socket.recv(max(missing, _PIECE))
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
        self.close()
        said = f"; its last words: {words}" if words else ""
        return ProcessDied(f"{self._label}: its process {self.pid} {_how_it_ended(code)}{said}")


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
