"""The process of an environment.

libsumo holds one simulation per process. So every environment is a child process of its own, and one Python process can
have as many as it likes. Orders and answers go over a socket.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Dict, Optional

from . import _starter
from ._channel import Channel
from .errors import ProcessDied, SimulatorError

# What the child runs: an interpreter without site-packages that loads nothing but the native module.
_CODE = "import sys; sys.path.insert(0, sys.argv[1]); import _native; _native.serve(*map(int, sys.argv[2:]))"

# The head of a record: the number of the order, the tag, and whether this record is the last one of the order or answer.
_HEAD = struct.Struct("<QBB")
# Largest record. The answer to a step is one of a few bytes; a picture takes many.
_RECORD = 16 << 10
_DONE, _REFUSED = ord("K"), ord("V")
# Time in which a child whose channel is closed may end by itself, in seconds. A step takes milliseconds.
_PATIENCE_S = 2.0
# Bytes of a dead child's output that an error shows.
_LAST_WORDS = 2000


class Process(Channel):
    """A child process with an environment in it."""

    def __init__(self, label: str, request: Dict[str, Any]) -> None:
        """Start the child and open the environment."""
        super().__init__(label)
        # Number of the last order. Answers to earlier ones, which were interrupted, have smaller numbers.
        self._number = 0
        self._log = tempfile.TemporaryFile()
        with _starter.starting:
            # Records arrive whole or not at all. So what Ctrl-C makes us lose is never a part of one.
            self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            try:
                with theirs:
                    numbers = [str(self._memory), str(self._owner)]
                    self._child = _starter.start(
                        [sys.executable, "-I", "-S", "-c", _CODE, str(Path(__file__).parent), *numbers],
                        stdin=theirs.fileno(),
                        stdout=self._log,
                        stderr=self._log,
                        pass_fds=[self._memory],
                        # Ctrl-C at the terminal is for this process, which ends its children when it is ready.
                        start_new_session=True,
                    )
            except BaseException as error:
                self._close_files()
                if isinstance(error, OSError):
                    raise SimulatorError(f"{label}: its process cannot be started: {error}") from error
                raise
        self.pid = self._child.pid
        self._begin(request)

    def _send(self, tag: int, payload: bytes) -> None:
        self._number += 1
        pieces = range(0, len(payload), _RECORD - _HEAD.size) or range(1)
        try:
            for begin in pieces:
                piece = payload[begin : begin + _RECORD - _HEAD.size]
                head = _HEAD.pack(self._number, tag, begin == pieces[-1])
                self._socket.send(head + piece, socket.MSG_NOSIGNAL)
        except OSError as error:
            raise self._lost(error) from None

    def _receive(self) -> bytes:
        pieces = []
        while True:
            try:
                record = self._socket.recv(_RECORD)
            except OSError as error:
                raise self._lost(error) from None
            if not record:
                raise self._lost(None)
            number, tag, is_last = _HEAD.unpack_from(record)
            if number != self._number:
                # To an order that was interrupted; it has no meaning any more.
                continue
            pieces.append(record[_HEAD.size :])
            if is_last:
                break
        payload = b"".join(pieces)
        if tag != _DONE:
            text = payload.decode(errors="replace")
            raise ValueError(text) if tag == _REFUSED else SimulatorError(text)
        return payload

    def hang_up(self) -> None:
        # Once: whoever closes the socket has hung up before.
        if os.getpid() == self._owner and not self._closing:
            self._closing = True
            # Not only closed: a copy of this process, made by a fork, may hold the channel. And another thread may wait
            # for an answer: this wakes it.
            with contextlib.suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        if os.getpid() != self._owner:
            return
        # The end of the channel ends a child that waits for an order. A busy one is killed.
        self.hang_up()
        if not self.lock.acquire(timeout=_PATIENCE_S):
            # Another thread is in a call, and not with the child, but in a function of the user. Its files are closed
            # when nobody refers to this channel any more.
            self._end_child()
            return
        try:
            self._end_child()
            self._close_files()
        finally:
            self.lock.release()

    def _end_child(self) -> None:
        try:
            self._child.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()

    def _close_files(self) -> None:
        self._socket.close()
        self._log.close()
        self._close_memory()

    def __del__(self) -> None:
        if hasattr(self, "_child"):
            self.close()

    def _lost(self, error: Optional[OSError]) -> Exception:
        """Return the error for a channel that is broken, or closed if there is no ``error``."""
        if self._closing:
            # By another thread, or by a handler of signals in this one.
            return self._closed()
        if error is None or isinstance(error, (BrokenPipeError, ConnectionResetError)):
            return self._death()
        return error

    def _death(self) -> ProcessDied:
        """Return the error that says how the child ended, and close what is left of it."""
        is_known = _starter.end_is_known(self._child)
        try:
            code: Optional[int] = self._child.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            code = None
        how = _how_it_ended(code) if is_known or code is None else "ended, and nobody knows how: somebody else has waited for it"
        self._log.seek(0, os.SEEK_END)
        self._log.seek(max(0, self._log.tell() - _LAST_WORDS))
        words = self._log.read().decode(errors="replace").strip()
        self.close()
        said = f"; its last words: {words}" if words else ""
        return ProcessDied(f"{self.label}: its process {self.pid} {how}{said}")


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
