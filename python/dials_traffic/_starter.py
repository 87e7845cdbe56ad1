"""Starts children from threads that last as long as this process.

A child asks the system to be killed when its parent ends. That also reaches a child that is stopped, which would notice
nothing itself. But the system counts the thread that started the child as the parent, and an environment may outlive the
thread that made it. The main thread lasts. For all others, one thread of our own starts the children. It is a daemon: it
ends with the process. There is none without need, because Python warns of a fork where there are several threads.

A fork of this process waits until a start is over. Its copy would hold files of the start: then Python could not see that the child
runs, or later that it has ended, for as long as the copy lives.
"""

from __future__ import annotations

import os
import queue
import signal
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


#: Held while a child is started, by whoever makes files that only the child is to have, and around every fork. One thread may hold
#: it several times: a handler of a signal starts children, too.
starting = threading.RLock()
_starter: Optional[_Starter] = None


def _forget() -> None:
    """After a fork: the copy does not have the thread."""
    global _starter
    _starter = None


os.register_at_fork(after_in_child=_forget)
# No functions of ours, which Ctrl-C could end between the two. The copy has the thread that holds the lock.
os.register_at_fork(before=starting.acquire, after_in_parent=starting.release, after_in_child=starting.release)


def start(words: List[str], **options: Any) -> "subprocess.Popen[bytes]":
    """Start a child as `subprocess.Popen` does, and return it when it runs."""
    with starting:
        if threading.get_native_id() == os.getpid():
            return subprocess.Popen(words, **options)
        return _by_the_thread(words, options)


def _by_the_thread(words: List[str], options: Any) -> "subprocess.Popen[bytes]":
    global _starter
    _starter = _starter or _Starter()
    begun = _Start(words, options)
    _starter.orders.put(begun)
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


def end_is_known(child: "subprocess.Popen[bytes]") -> bool:
    """Return whether the system says how a child ended that has ended. `Popen` takes an end that nobody knows for exit code 0."""
    if signal.getsignal(signal.SIGCHLD) is signal.SIG_IGN:
        return False
    if child.returncode is not None:
        return True
    try:
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG)
    except ChildProcessError:
        # Somebody else has waited for all children.
        return False
    return True
