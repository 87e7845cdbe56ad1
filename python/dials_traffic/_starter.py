"""Starts children from threads that last as long as this process.

A child asks the system to be killed when its parent ends. That also reaches a child that is stopped, which would notice
nothing itself. But the system counts the thread that started the child as the parent, and an environment may outlive the
thread that made it. The main thread lasts. For all others, one thread of our own starts the children. It is a daemon: it
ends with the process. There is none without need, because Python warns of a fork where there are several threads.
"""

from __future__ import annotations

import os
import queue
import subprocess
import threading
from typing import Any, List, Optional


class _Start:
    """A child to be started, and what became of it."""

    def __init__(self, words: List[str], options: Any) -> None:
        self.words, self.options = words, options
        self.child: Optional["subprocess.Popen[bytes]"] = None
        self.error: Optional[BaseException] = None
        self.done = threading.Event()

    def do(self) -> None:
        try:
            self.child = subprocess.Popen(self.words, **self.options)
        except BaseException as error:
            self.error = error
        self.done.set()


class _Starter:
    def __init__(self) -> None:
        self.orders: "queue.SimpleQueue[_Start]" = queue.SimpleQueue()
        threading.Thread(target=self._work, name="dials_traffic: starts children", daemon=True).start()

    def _work(self) -> None:
        while True:
            # Without a name here: it would keep the last child's object until the next one.
            self.orders.get().do()


_lock = threading.Lock()
_starter: Optional[_Starter] = None


def _forget() -> None:
    """After a fork: the copy has neither the thread nor, perhaps, the one that held the lock."""
    global _lock, _starter
    _lock, _starter = threading.Lock(), None


os.register_at_fork(after_in_child=_forget)


def start(words: List[str], **options: Any) -> "subprocess.Popen[bytes]":
    """Start a child as `subprocess.Popen` does, and return it when it runs."""
    global _starter
    if threading.get_native_id() == os.getpid():
        return subprocess.Popen(words, **options)
    with _lock:
        _starter = _starter or _Starter()
        starter = _starter
    begun = _Start(words, options)
    starter.orders.put(begun)
    try:
        begun.done.wait()
    except BaseException:
        # Ctrl-C: nobody will have the child. Until it runs, a moment, it needs the files of the caller.
        begun.done.wait()
        if begun.child is not None:
            begun.child.kill()
            begun.child.wait()
        raise
    if begun.child is None:
        assert begun.error is not None
        raise begun.error
    return begun.child
