"""An environment in the Python process itself: no messages, but one per process, and a crash is a crash of Python."""

from __future__ import annotations

import os
import sys
import threading
from typing import Any, Dict, Optional

from ._channel import Channel
from .errors import SimulatorError

# Simulators whose last reference went in another thread than theirs, by their thread. Only there can they end.
_LEFT: Dict[int, Any] = {}


class InProcess(Channel):
    """An environment in this process. Only the thread that made it can use it."""

    def __init__(self, label: str, request: Dict[str, Any]) -> None:
        if "libsumo" in sys.modules:
            raise SimulatorError(f"{label}: in_process: Python has loaded another libsumo; leave the option out")
        super().__init__(label)
        self.pid = os.getpid()
        self._native: Optional[Any] = None
        self._thread = threading.get_ident()
        # The answer to the last order, or the reason why there is none.
        self._answered: Optional[bytes] = None
        self._failed: Optional[Exception] = None
        _LEFT.pop(self._thread, None)
        self._begin(request)

    def check(self) -> None:
        super().check()
        self._check_thread()

    def _check_thread(self) -> None:
        if threading.get_ident() != self._thread:
            raise SimulatorError(f"{self.label}: lives in another thread; use it there, or without in_process")

    def _send(self, tag: int, payload: bytes) -> None:
        native = self._native
        self._answered, self._failed = None, None
        try:
            self._answered = self._open(payload) if native is None else native.order(tag, payload)
        except RuntimeError as error:
            self._failed = SimulatorError(str(error))
        except ValueError as error:
            self._failed = error

    def _open(self, request: bytes) -> bytes:
        # Only here: without this option, no native code comes into the Python process.
        from . import _native

        self._native = _native.InProcess(request, self._memory)
        return self._native.about().encode()

    def _receive(self) -> bytes:
        if self._failed is not None:
            raise self._failed
        assert self._answered is not None, "an order that was interrupted is not waited for"
        return self._answered

    def close(self) -> None:
        if os.getpid() != self._owner:
            return
        if self._native is not None:
            self._check_thread()
        with self.lock:
            self._closing = True
            # The simulator goes with its last reference.
            self._native = None
            self._close_memory()

    def __del__(self) -> None:
        native = getattr(self, "_native", None)
        if native is not None and threading.get_ident() != self._thread:
            _LEFT[self._thread] = native
