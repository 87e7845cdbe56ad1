"""What orders an environment, and the memory that it shares with this process.

An environment gets orders: a tag and a payload. Its answers have a payload, too. Numbers are in memory that both sides
map. `_process` gives the orders to a child process, `_in_process` to this one.

One thread at a time uses an environment: `alone` lets it into a method and holds the others until it is done.
"""

from __future__ import annotations

import fcntl
import functools
import json
import math
import mmap
import operator
import os
import struct
import threading
import weakref
from pathlib import Path
from typing import Any, Callable, Dict, Mapping, Optional, Sequence, Tuple, TypeVar, Union, cast

import numpy as np

from .errors import SimulatorError

PathLike = Union[str, "os.PathLike[str]"]

BEGIN, RESET, STEP, MEASURE, DRAW, LOOK, KEEP, TAKE = b"BRSMDLKT"
_IN_WORDS = {RESET: "reset", STEP: "step"}
# Bytes of the roads after a step, and after the beginning of further episodes.
_SIZES = struct.Struct("<II")


class Channel:
    """An environment to which orders are given. ``about`` is what it says of itself.

    Ctrl-C may end a call at any place. So an order counts as open until its answer is returned, and after an open one
    only a reset is taken.
    """

    about: Dict[str, Any]
    #: Number of the process in which the environment lives.
    pid: int

    def __init__(self, label: str) -> None:
        """Make the memory. ``label`` names the environment in errors."""
        self.label = label
        self._owner = os.getpid()
        # The tag of the order whose answer was not returned yet, and whether its answer can be waited for: it was sent, and
        # nobody has begun to wait.
        self._pending: Optional[int] = None
        self._can_be_received = False
        self._map: Optional[mmap.mmap] = None
        #: Held by the thread that uses the environment, from its first look at it to its last.
        self.lock = threading.RLock()
        # Whether somebody has begun to close it. From then on, no order is given.
        self._closing = False
        made = os.memfd_create("dials_traffic")
        try:
            # Not 0, 1 or 2, which may be free here: in a child these are the standard streams.
            self._memory: int = fcntl.fcntl(made, fcntl.F_DUPFD_CLOEXEC, 3)
        finally:
            os.close(made)
        # Closes the memory once: when the environment is closed, or when nothing refers to this channel any more.
        self._close_descriptor = weakref.finalize(self, os.close, self._memory)
        self._close_descriptor.atexit = False

    def _send(self, tag: int, payload: bytes) -> None:
        """Give an order and do not wait for the answer."""
        raise NotImplementedError

    def _receive(self) -> bytes:
        """Wait for the answer to the last order, and return its payload."""
        raise NotImplementedError

    def close(self) -> None:
        """End the environment. Only the process that made it does."""
        raise NotImplementedError

    def hang_up(self) -> None:
        """Tell the environment that it will be closed, and do not wait for its end."""

    def send(self, tag: int, what: Optional[Dict[str, Any]] = None) -> None:
        """Give an order. :meth:`receive` waits for the answer."""
        self.check()
        if self._pending is not None and tag != RESET:
            raise self._interrupted()
        payload = b"" if what is None else _in_json(what)
        self._pending, self._can_be_received = tag, False
        self._send(tag, payload)
        self._can_be_received = True

    def receive(self, tag: int) -> bytes:
        """Wait for the answer to the order of this tag, and return its payload."""
        self.check()
        if self._pending != tag:
            raise SimulatorError(f"{self.label}: no {_IN_WORDS.get(tag, 'call')} was begun that could be waited for")
        if not self._can_be_received:
            raise self._interrupted()
        self._can_be_received = False
        try:
            payload = self._receive()
        except (SimulatorError, ValueError):
            self._pending = None
            raise
        self._pending = None
        return payload

    def _interrupted(self) -> SimulatorError:
        return SimulatorError(f"{self.label}: its last call was not finished; call reset() first")

    def ask(self, tag: int, what: Optional[Dict[str, Any]] = None) -> bytes:
        """Give an order and return the payload of the answer."""
        self.send(tag, what)
        return self.receive(tag)

    def _begin(self, request: Dict[str, Any]) -> None:
        """Open the environment, or close the channel."""
        try:
            self.about = json.loads(self.ask(BEGIN, request))
            self._map = mmap.mmap(self._memory, self.about["memory"]["size"])
        except BaseException:
            self.close()
            raise

    def check(self) -> None:
        """Raise an error if no order can be given here: after a fork, or if the environment is closed."""
        if os.getpid() != self._owner:
            raise SimulatorError(
                f"{self.label}: belongs to process {self._owner}, and this is another one; make it anew after a fork"
            )
        self.check_open()

    def check_open(self) -> None:
        """Raise an error if the environment is closed."""
        if self._closing:
            raise self._closed()

    def _closed(self) -> SimulatorError:
        return SimulatorError(f"{self.label}: is closed; make a new one")

    def _close_memory(self) -> None:
        self._close_descriptor()
        # It is unmapped, and its last descriptor is closed, with the last array over it. `no_memory` lets arrays go.
        self._map = None

    def array(self, name: str) -> np.ndarray:
        """Return the numbers of a section of the shared memory. They change with every step."""
        if self._map is None:
            raise self._closed()
        offset, count, dtype = self.about["memory"]["sections"][name]
        return np.frombuffer(self._map, dtype, count, offset)

    def behind(self, length: int) -> bytes:
        """Return as many bytes of the shared memory behind its sections: what is on the roads now."""
        self.check_open()
        return os.pread(self._memory, length, self.about["memory"]["behind"])

    def reset(self, seed: int, episode: int = 0) -> bytes:
        """Begin an episode. Return the payload of the answer."""
        self.send_reset(seed, episode)
        return self.receive_reset()

    def send_reset(self, seed: int, episode: int = 0) -> None:
        """Order a new episode and do not wait for it."""
        self.send(RESET, {"seed": seed, "episode": episode})

    def receive_reset(self) -> bytes:
        """Wait for the episode that :meth:`send_reset` ordered. Return the payload of the answer."""
        return self.receive(RESET)

    def step(self) -> bytes:
        """Make a step with the actions in the shared memory. Return the payload of the answer."""
        self.send_step()
        return self.receive_step()

    def send_step(self) -> None:
        """Order a step and do not wait for it."""
        self.send(STEP)

    def receive_step(self) -> bytes:
        """Wait for the step that :meth:`send_step` ordered. Return the payload of the answer."""
        return self.receive(STEP)

    def measure(self) -> Dict[str, Any]:
        """Return the figures that the simulator keeps."""
        figures: Dict[str, Any] = json.loads(self.ask(MEASURE))
        return figures

    def look(self) -> Dict[str, Any]:
        """Return the roads of all agents as they always are."""
        tables: Dict[str, Any] = json.loads(self.ask(LOOK))
        return tables

    def roads(self, payload: bytes) -> Tuple[bytes, bytes]:
        """Return what is on the roads after a step, and after further episodes have begun in it, as an answer says. Empty: there
        is none.
        """
        now, begun = _SIZES.unpack(payload)
        data = self.behind(now + begun)
        return data[:now], data[now:]

    def draw(self) -> np.ndarray:
        """Return a picture, ``[height, width, 3]``."""
        payload = self.ask(DRAW)
        width, height = struct.unpack_from("<II", payload)
        return np.frombuffer(payload, np.uint8, offset=8).reshape(height, width, 3).copy()

    def keep(self, folder: Path) -> Path:
        """Write the recorded episode into a new folder, and return the file that sumo-gui opens."""
        return Path(os.fsdecode(self.ask(KEEP, {"folder": path_text("folder", folder)})))

    def take(self) -> None:
        """Let the environment take the weights in the shared memory."""
        self.ask(TAKE)


class Remade:
    """Pickled and copied as what it was made of: a copy is a new environment, before its first episode."""

    _made_of: Dict[str, Any]

    def __reduce__(self) -> Tuple[Any, ...]:
        return _made, (type(self), self._made_of)


def _made(kind: "type[Any]", made_of: Dict[str, Any]) -> Any:
    return kind(**made_of)


_Method = TypeVar("_Method", bound=Callable[..., Any])


def alone(method: _Method) -> _Method:
    """Let one thread at a time into a method of an object that has a ``_channel``, and none after a close."""

    @functools.wraps(method)
    def call(self: Any, *args: Any, **options: Any) -> Any:
        channel: Channel = self._channel
        # Before the wait: a copy of this process, made by a fork, has no thread that would give the lock back.
        channel.check()
        with channel.lock:
            # The wait may have been for a close.
            channel.check_open()
            return method(self, *args, **options)

    return cast(_Method, call)


def no_memory(owner: Any, *names: str) -> None:
    """Replace arrays over the shared memory by copies. An array keeps the memory and a descriptor of it open."""
    for name in names:
        setattr(owner, name, getattr(owner, name).copy())


def request_of(config: PathLike, settings: Optional[Mapping[str, Any]], environment: Dict[str, Any]) -> Dict[str, Any]:
    """Return the first order. ``settings``: as ``--set`` takes them, such as ``traffic.horizon=100``."""
    if settings is not None:
        check_dict("settings", settings)
    words = [f"{key}={_in_toml(value)}" for key, value in (settings or {}).items()]
    return {"config": path_text("config", config), "settings": words, "environment": environment}


def path_text(name: str, path: PathLike) -> str:
    """Return a path as text. ``name`` names it in errors: a TypeError for what is no path, a ValueError for a path that
    is not UTF-8. SUMO, the configs and the files of a run write paths as UTF-8.
    """
    try:
        text = os.fspath(path)
    except TypeError:
        text = None
    if not isinstance(text, str):
        raise TypeError(f"{name} {path!r}: must be a path, a str or an os.PathLike of one")
    try:
        text.encode()
    except UnicodeEncodeError:
        raise ValueError(f"{name} {text!r}: this path is not UTF-8; rename the file or the folder") from None
    if "\0" in text:
        raise ValueError(f"{name} {text!r}: a path has no zero in it")
    return str(Path(text))


def _in_json(what: Dict[str, Any]) -> bytes:
    text = json.dumps(what, ensure_ascii=False)
    try:
        return text.encode()
    except UnicodeEncodeError as error:
        around = text[max(0, error.start - 20) : error.end + 20]
        raise ValueError(f"{around!r}: holds half of a pair of UTF-16, which is no text") from None


def free_memory() -> int:
    """Return the bytes that new processes can have."""
    try:
        with open("/proc/meminfo") as file:
            return next(int(line.split()[1]) << 10 for line in file if line.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        return 1 << 40


def _in_toml(value: Any) -> str:
    """Return a value as TOML writes it. JSON writes texts and numbers in the same way."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"settings: {value}: must be a finite number")
    if isinstance(value, (bool, int, float)):
        return json.dumps(value)
    if isinstance(value, str):
        # JSON would write characters beyond 16 bits as pairs, which TOML does not know. TOML wants DEL escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_in_toml, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_in_toml(str(key))} = {_in_toml(of_key)}' for key, of_key in value.items())}}}"
    raise TypeError(f"settings: {value!r} is neither a bool, a number, a text nor a list or a dict of them")


def fresh_seed(seed: Optional[int]) -> int:
    """Return the seed, or one from the system if there is none."""
    if seed is None:
        return int(np.random.SeedSequence().generate_state(1, np.uint64)[0])
    return whole_number("seed", seed)


def whole_number(name: str, value: Any, least: int = 0) -> int:
    """Return the value as an int. ``name`` names it in errors: a TypeError for another type, a ValueError for a number
    that is below ``least`` or does not fit into 64 bits.
    """
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} {value!r}: must be a whole number") from None
    if not least <= number < 1 << 64:
        raise ValueError(f"{name} {number}: must be from {least} to 2**64 - 1")
    return number


def check_dict(name: str, value: Any) -> None:
    """Raise a TypeError if the value is no dict, and nothing like one. ``name`` names it in errors."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} {value!r}: must be a dict")


def yes_or_no(name: str, value: Any) -> bool:
    """Return the value, which must be a bool. ``name`` names it in errors."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} {value!r}: must be True or False")
    return bool(value)


def refuse_unknown_options(options: Optional[Mapping[str, Any]], known: Sequence[str]) -> None:
    """Raise a ValueError that names an option of ``reset`` that does not exist."""
    if options is not None:
        check_dict("options", options)
    for name in options or {}:
        if name not in known:
            raise ValueError(f"options: {name!r}: there is none; known: {', '.join(known) or 'none'}")


def first_names(names: Sequence[str]) -> str:
    """Return names for an error: the first five, and dots if there are more."""
    return ", ".join(map(repr, names[:5])) + (", ..." if len(names) > 5 else "")
