"""The link: functions of this process that a run calls. The run is a script here, which speaks as the program does."""

import os
import signal
import subprocess
import sys
import textwrap
import threading

import numpy as np
import pytest

from dials_traffic import _starter
from dials_traffic._link import Interrupted, Link
from dials_traffic.errors import SimulatorError

PEER = """
import json, os, socket, struct, sys, time

def connect():
    link = socket.socket(socket.AF_UNIX)
    link.connect(os.environ["DIALS_TRAFFIC_LINK"])
    return link

def read(link, size):
    data = b""
    while len(data) < size:
        data += link.recv(size - len(data)) or sys.exit("closed")
    return data

def ask(link, call, values=None, arrays=(), body=b""):
    text = json.dumps({"call": call, "values": values, "arrays": list(arrays)}).encode()
    link.sendall(struct.pack("<IQ", len(text), len(body)) + text + body)
    sizes = struct.unpack("<IQ", read(link, 12))
    return json.loads(read(link, sizes[0])), read(link, sizes[1])
"""


@pytest.fixture
def peer(tmp_path, monkeypatch):
    """Returns a function that makes a script the program."""

    def make(code):
        path = tmp_path / "program"
        path.write_text(f"#!{sys.executable}\n{PEER}\n{textwrap.dedent(code)}")
        path.chmod(0o755)
        monkeypatch.setenv("DIALS_TRAFFIC", str(path))

    return make


def test_every_connection_says_what_it_wants_and_arrays_arrive_as_they_were(peer, capfd):
    peer("""
        one, two = connect(), connect()
        print(ask(one, "open", {"wants": "reward", "about": 3})[0]["values"])
        print(ask(two, "open", {"wants": "learner", "about": 4})[0]["values"])
        body = struct.pack("<3B5x", 1, 2, 3) + struct.pack("<2f", 0.5, 1.5)
        header, body = ask(one, "rate", {"step": 7}, [["few", "u1", [3]], ["halves", "f4", [2, 1]]], body)
        print(header, struct.unpack("<2d", body))
        print(ask(two, "act")[0]["values"])
    """)
    seen = []

    def rewards(about):
        def answer(call, values, arrays):
            seen.append((call, values, arrays))
            return None, {"rewards": arrays["halves"][:, 0].astype(np.float64) * about}

        return answer, f"about {about}"

    def learner(about):
        return lambda call, values, arrays: ([about, call], None)

    with Link({"reward": rewards, "learner": learner}) as link:
        link.run([])
        folder = os.path.dirname(link.path)
        assert os.stat(folder).st_mode & 0o777 == 0o700, "nobody else can enter it"
    assert not os.path.exists(folder)
    ((call, values, arrays),) = seen
    assert (call, values) == ("rate", {"step": 7})
    assert arrays["few"].tolist() == [1, 2, 3] and arrays["few"].dtype == np.uint8
    assert arrays["halves"].tolist() == [[0.5], [1.5]] and arrays["halves"].flags.writeable
    said = capfd.readouterr().out.splitlines()
    header = {"values": None, "arrays": [["rewards", "f8", [2]]]}
    assert said == ["about 3", "None", f"{header} (1.5, 4.5)", "[4, 'act']"]


def test_an_error_of_the_user_is_raised_as_it_was_when_the_run_has_ended(peer):
    peer("""
        link = connect()
        ask(link, "open", {"wants": "reward", "about": None})
        said = ask(link, "rate")[0]["error"]
        again = ask(link, "rate")[0]["error"]
        open(sys.argv[-1], "w").write(f"{said}|{again}")
        sys.exit(1)
    """)

    def rewards(about):
        return lambda call, values, arrays: 1 / 0

    out = os.path.join(os.path.dirname(os.environ["DIALS_TRAFFIC"]), "said")
    with Link({"reward": rewards}) as link, pytest.raises(ZeroDivisionError) as raised:
        link.run([out])
    assert raised.traceback[-1].name == "<lambda>", "its traceback leads to the user's line"
    with open(out) as file:
        said, again = file.read().split("|")
    assert said == "ZeroDivisionError: division by zero"
    assert again == "dials_traffic.errors.SimulatorError: the run ends, because of an error before this one"


def test_a_program_that_fails_is_an_error_with_its_last_words(peer):
    peer("sys.exit('no such config')")
    with Link({}) as link, pytest.raises(SimulatorError, match="train ended with exit code 1: no such config"):
        link.run(["train"], quiet=True)


def test_ctrl_c_asks_the_program_to_stop_and_waits_for_it(peer):
    peer("""
        import signal
        link = connect()
        def stop(number, frame):
            print(ask(link, "last")[0])
            sys.exit(130)
        signal.signal(signal.SIGINT, stop)
        ask(link, "open", {"wants": "reward", "about": None})
        time.sleep(60)
    """)
    calls = []

    def rewards(about):
        # This thread waits for the run when the signal comes.
        main = threading.main_thread().ident
        threading.Timer(0.2, signal.pthread_kill, [main, signal.SIGINT]).start()

        def answer(call, values, arrays):
            calls.append(call)
            return None, None

        return answer

    with Link({"reward": rewards}) as link, pytest.raises(Interrupted):
        link.run([])
    assert calls == ["last"], "what the program still asked was answered"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_while_the_program_is_started_leaves_none_behind(peer, monkeypatch):
    peer("time.sleep(60)")
    started = []

    def start(words, **options):
        # As if it came within the start: the program runs, and nobody has it yet.
        child = subprocess.Popen(words, **options)
        started.append(child)
        signal.raise_signal(signal.SIGINT)
        return child

    monkeypatch.setattr(_starter, "start", start)
    with Link({}) as link, pytest.raises(Interrupted):
        link.run([])
    assert started[0].returncode == -signal.SIGINT


@pytest.mark.parametrize("leave", ["sys.exit(3)", "raise ArithmeticError", "return None, None"])
def test_a_copy_that_the_users_code_makes_by_a_fork_takes_no_part(peer, leave, capfd):
    peer("""
        link = connect()
        ask(link, "open", {"wants": "reward", "about": None})
        print([ask(link, "rate")[0]["values"] for _ in range(2)])
    """)
    code = f"""
        import os, sys
        from dials_traffic._link import Link

        def rewards(about):
            def answer(call, values, arrays):
                copy = os.fork()
                if copy == 0:
                    {leave}
                os.waitpid(copy, 0)
                return 7, None
            return answer

        with Link({{"reward": rewards}}) as link:
            link.run([])
        print("the folder is gone:", not os.path.exists(link.path))
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True, timeout=60)
    assert capfd.readouterr().out.splitlines() == ["[7, 7]", "the folder is gone: True"]


def test_a_program_that_goes_while_it_is_answered_does_not_end_python(peer):
    """Scripts that are piped have SIGPIPE at its default, which ends a process that writes to what nobody reads."""
    peer("""
        link = connect()
        text = json.dumps({"call": "open", "values": {"wants": "reward", "about": None}, "arrays": []}).encode()
        link.sendall(struct.pack("<IQ", len(text), 0) + text)
        link.close()
    """)
    code = """
        import signal, time
        from dials_traffic._link import Link
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)

        def rewards(about):
            time.sleep(0.3)
            return lambda call, values, arrays: (None, None)

        with Link({"reward": rewards}) as link:
            link.run([])
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True, timeout=60)


def test_a_run_whose_end_nobody_would_know_is_not_begun(peer, monkeypatch):
    peer("sys.exit(3)")
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        with Link({}) as link, pytest.raises(SimulatorError, match="SIGCHLD is ignored"):
            link.run(["train"])
    finally:
        signal.signal(signal.SIGCHLD, before)

    def serve(link, child):
        # Another part of the process waits for all children.
        os.waitpid(child.pid, 0)

    monkeypatch.setattr(Link, "_serve", serve)
    with Link({}) as link, pytest.raises(SimulatorError, match="nobody knows how dials-traffic train ended"):
        link.run(["train"])
