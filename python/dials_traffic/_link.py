"""Runs of the program that call functions of this process.

The program `dials-traffic` does the training, in processes of its own. What a user has written in Python stays here: it
is never pickled, so closures, notebooks and debuggers work. The processes of the run connect to a socket in a private
folder. Each says what it wants, and the :class:`Link` gives its questions to what the user has written, one at a time, in the
thread that waits for the run.

A maker gets what a connection says of itself, ``about``, and returns the function that answers its questions, or that
function and what the other side needs to know. The function gets the name of the question, what is no array, and arrays
by name. It returns the same two: what is no array, and arrays by name. The arrays that it got belong to it.

    def rewards(about):
        def answer(call, values, arrays):
            return None, {"rewards": -arrays["queues"].sum(axis=1)}
        return answer

    with Link({"reward": rewards}) as link:
        link.run(["train", "configs/town.toml", "--out", "runs/mine"])

The other end, and the format of messages: crates/session/src/python/link.rs.
"""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import shutil
import signal
import socket
import struct
import subprocess
import sys
import sysconfig
import tempfile
import threading
import traceback
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

import numpy as np

from . import _starter
from .errors import SimulatorError

Arrays = Dict[str, np.ndarray]
#: Answers a question: its name, what is no array, and the arrays.
Answer = Callable[[str, Any, Arrays], Tuple[Any, Optional[Mapping[str, np.ndarray]]]]
#: Makes what answers the questions of a connection, from what it says of itself.
Maker = Callable[[Any], Any]

#: The variable with the path of the socket.
VARIABLE = "DIALS_TRAFFIC_LINK"
#: Names another program than the one of this package.
PROGRAM = "DIALS_TRAFFIC"

# The lengths of the header and of the arrays.
_HEAD = struct.Struct("<IQ")
_ALIGNMENT = 8
# Time in which a program that was asked to stop a second time may end by itself, in seconds.
_PATIENCE_S = 10.0


class Interrupted(KeyboardInterrupt):
    """Ctrl-C: the run was stopped where nothing is lost, and can be resumed."""


class Link:
    """A socket to which the processes of a run connect. ``makers``: what each kind of connection is for."""

    def __init__(self, makers: Mapping[str, Maker]) -> None:
        self._makers = dict(makers)
        # A copy of this process, made by a fork in what the user has written, takes no part.
        self._owner = os.getpid()
        self._connections: Dict[socket.socket, Optional[Answer]] = {}
        # The first error of the user's code. It ends the run, and is raised when that has ended.
        self._error: Optional[BaseException] = None
        # Paths of sockets are short: not in a folder of the user. Nobody else can enter it.
        self._folder = tempfile.mkdtemp(prefix="dials-")
        #: Path of the socket.
        self.path = os.path.join(self._folder, "link")
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._selector = selectors.DefaultSelector()
        try:
            self._listener.bind(self.path)
            self._listener.listen(128)
            self._selector.register(self._listener, selectors.EVENT_READ)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "Link":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections, and remove the folder. In a copy of this process only what is its own: its descriptors."""
        if os.getpid() != self._owner:
            for copied in [*self._connections, self._listener]:
                copied.close()
            self._selector.close()
            return
        for connection in list(self._connections):
            self._drop(connection)
        self._listener.close()
        self._selector.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def run(self, words: List[str], *, quiet: bool = False) -> None:
        """Run a command of the program, and answer its questions until it has ended.

        If code of the user fails, its error is raised here as it was. Ctrl-C asks the program to stop where nothing is lost; a
        second one ends it. Everything else that goes wrong is a :class:`SimulatorError`. ``quiet``: print nothing.
        """
        if signal.getsignal(signal.SIGCHLD) is signal.SIG_IGN:
            raise SimulatorError(
                "SIGCHLD is ignored in this process, so nobody could say how the run ends; call "
                "signal.signal(signal.SIGCHLD, signal.SIG_DFL) first"
            )
        command = [program(), "--end-with", str(self._owner), *words]
        out = subprocess.DEVNULL if quiet else None
        # What it prints last belongs into an error.
        with tempfile.TemporaryFile() as log, _Pressed() as pressed:
            try:
                child = _starter.start(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=log if quiet else None,
                    env={**os.environ, VARIABLE: self.path},
                    # Ctrl-C at the terminal is for this process, which passes it on.
                    start_new_session=True,
                )
                pressed.started(child)
                self._serve(child)
                is_known = _starter.end_is_known(child)
                code = child.wait()
            except BaseException:
                if pressed.child is not None and os.getpid() == self._owner:
                    pressed.child.kill()
                    pressed.child.wait()
                raise
            if self._error is not None:
                raise self._error
            if pressed.times and (code != 0 or not is_known):
                raise Interrupted("the run was stopped; it can be resumed")
            if not is_known:
                raise SimulatorError(
                    f"nobody knows how dials-traffic {words[0]} ended, because another part of this process has waited for it; if the run "
                    "is not complete, resume=True goes on with it"
                )
            if code != 0:
                log.seek(0)
                words_left = log.read().decode(errors="replace").strip()[-2000:]
                said = f": {words_left}" if words_left else "; what was wrong stands above"
                raise SimulatorError(f"dials-traffic {words[0]} ended with exit code {code}{said}")

    def _serve(self, child: "subprocess.Popen[bytes]") -> None:
        end = os.pidfd_open(child.pid)
        try:
            self._selector.register(end, selectors.EVENT_READ)
            while True:
                for key, _ in self._selector.select():
                    if key.fileobj is self._listener:
                        connection, _ = self._listener.accept()
                        self._connections[connection] = None
                        self._selector.register(connection, selectors.EVENT_READ)
                    elif key.fileobj == end:
                        return
                    else:
                        self._answer(key.fileobj)  # type: ignore[arg-type]
        finally:
            # What a copy takes out of the selector would be out of ours.
            if os.getpid() == self._owner:
                self._selector.unregister(end)
            os.close(end)

    def _answer(self, connection: socket.socket) -> None:
        """Answer the next question of a connection, or drop it if it has ended."""
        try:
            question = _receive(connection)
        except OSError:
            question = None
        if question is None:
            self._drop(connection)
            return
        call, values, arrays = question
        try:
            if self._error is not None:
                raise SimulatorError("the run ends, because of an error before this one")
            answer = self._connections[connection]
            said: Any = None
            made: Optional[Mapping[str, np.ndarray]] = None
            if answer is not None:
                said, made = answer(call, values, arrays)
            else:
                opened = self._open(values)
                self._connections[connection], said = opened if isinstance(opened, tuple) else (opened, None)
            message = _message({"values": said}, made or {})
        except Exception as error:
            if os.getpid() != self._owner:
                raise
            if self._error is None:
                self._error = error
            lines = "".join(traceback.format_exception_only(type(error), error)).strip()
            message = _message({"error": lines}, {})
        if os.getpid() != self._owner:
            raise SimulatorError("this process is a copy of the one that waits for the run; let it end with os._exit")
        # If the other side has gone, the next look at the connection shows it.
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            connection.sendall(message, socket.MSG_NOSIGNAL)

    def _open(self, values: Dict[str, Any]) -> Any:
        wants = values["wants"]
        if wants not in self._makers:
            raise SimulatorError(f"the config names a {wants} in Python, and none was given: {wants}=...")
        return self._makers[wants](values["about"])

    def _drop(self, connection: socket.socket) -> None:
        self._connections.pop(connection, None)
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(connection)
        connection.close()


def program() -> str:
    """Return the path of the program: the one that was installed with this package."""
    named = os.environ.get(PROGRAM)
    beside = [Path(sysconfig.get_path("scripts")), Path(sys.executable).parent]
    found = [named] if named else [str(folder / "dials-traffic") for folder in beside]
    for path in found:
        if os.access(path, os.X_OK):
            return path
    raise SimulatorError(f"there is no program dials-traffic at {found[0]}; install the package again")


class _Pressed:
    """Ctrl-C during a run. The first one is passed on to the program, also if it comes while that is started. The second one is for
    this process.
    """

    def __init__(self) -> None:
        self.child: Optional["subprocess.Popen[bytes]"] = None
        self.times = 0
        self._told = False
        self._is_ours = False

    def __enter__(self) -> "_Pressed":
        # Signals are for the main thread, and a handler of the user decides itself.
        is_main = threading.current_thread() is threading.main_thread()
        self._is_ours = is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        if self._is_ours:
            signal.signal(signal.SIGINT, self._press)
        return self

    def __exit__(self, *_: Any) -> None:
        if self._is_ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)

    def started(self, child: "subprocess.Popen[bytes]") -> None:
        """Take the program, and tell it of what was pressed before."""
        self.child = child
        if self.times > 0:
            self._tell(child)

    def _press(self, number: int, frame: Any) -> None:
        self.times += 1
        if self.child is None:
            return
        if self._told:
            raise KeyboardInterrupt
        self._tell(self.child)

    def _tell(self, child: "subprocess.Popen[bytes]") -> None:
        if not self._told:
            self._told = True
            child.send_signal(signal.SIGINT)


def _receive(connection: socket.socket) -> Optional[Tuple[str, Any, Arrays]]:
    """Read a question. ``None``: the other side has gone."""
    head = _read(connection, _HEAD.size)
    if head is None:
        return None
    header_size, body_size = _HEAD.unpack(head)
    header, body = _read(connection, header_size), _read(connection, body_size)
    if header is None or body is None:
        return None
    about = json.loads(bytes(header))
    arrays: Arrays = {}
    begin = 0
    for name, dtype, shape in about["arrays"]:
        kind = np.dtype(dtype)
        count = int(np.prod(shape, dtype=np.int64))
        arrays[name] = np.frombuffer(body, kind, count, begin).reshape(shape)
        begin += -(-count * kind.itemsize // _ALIGNMENT) * _ALIGNMENT
    return about["call"], about["values"], arrays


def _read(connection: socket.socket, size: int) -> Optional[bytearray]:
    data = bytearray(size)
    view = memoryview(data)
    while view:
        got = connection.recv_into(view)
        if got == 0:
            return None
        view = view[got:]
    return data


def _message(header: Dict[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    abouts, pieces = [], []
    for name, array in arrays.items():
        array = np.ascontiguousarray(array)
        abouts.append([name, array.dtype.str[1:], list(array.shape)])
        data = array.tobytes()
        pieces.append(data + bytes(-len(data) % _ALIGNMENT))
    body = b"".join(pieces)
    text = json.dumps({**header, "arrays": abouts}).encode()
    return b"".join([_HEAD.pack(len(text), len(body)), text, body])
