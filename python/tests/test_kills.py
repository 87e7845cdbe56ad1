"""A training that is called from Python is killed at any moment, and goes on to the same bytes.

`DIALS_KILLS` says how often, and `DIALS_KILLS_SEED` when. Half of the kills hit Python, the others the program that it called.
"""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

from conftest import SHORT

KILLS = int(os.environ.get("DIALS_KILLS", "4"))
SEED = int(os.environ.get("DIALS_KILLS_SEED", "64"))

SCRIPT = """
import sys
import dials_traffic

def fewer_halts(before, now):
    cars = now.cars
    return -cars.per_row(cars.speed_mps < 0.1)

config, out, workers, resume = sys.argv[1:]
settings = {settings}
if resume == "yes":
    dials_traffic.train(out=out, reward=fewer_halts, workers=int(workers), resume=True, quiet=True)
else:
    dials_traffic.train(config, out=out, reward=fewer_halts, workers=int(workers), settings=settings, seed=1, quiet=True)
"""

#: Files of a run that must be equal.
KEPT = ["policies.safetensors", "aips.safetensors", "returns.csv", "training.csv", "aip_loss.csv"]


def children(pid):
    """Return the processes that a process has started."""
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            found += map(int, task.read_text().split())
        except OSError:
            pass
    return found


def test_a_killed_training_goes_on_to_the_same_bytes(grid, tmp_path):
    dice = random.Random(SEED)
    script = tmp_path / "own.py"
    settings = {**SHORT, "policy.hidden": [16], "aip.hidden": [16], "aip.dataset_steps": 80, "aip.batch": 16}
    settings.update({"total_steps": 512, "evaluation.every_steps": 128, "aip.retrain_every_steps": 128})
    script.write_text(SCRIPT.replace("{settings}", repr(settings)))

    def start(out, workers, resume):
        words = [sys.executable, script, grid, out, workers, "yes" if resume else "no"]
        with (tmp_path / "said").open("a") as said:
            return subprocess.Popen([str(word) for word in words], stderr=said)

    calm = start(tmp_path / "calm", 0, False)
    begun = time.monotonic()
    assert calm.wait() == 0, (tmp_path / "said").read_text()
    length = time.monotonic() - begun
    killed = runs = 0
    while killed < KILLS:
        out, resume = tmp_path / f"run{runs}", False
        runs += 1
        while True:
            process = start(out, dice.choice([1, 2]), resume)
            time.sleep(dice.uniform(0.0, length))
            if process.poll() is not None:
                break
            victims = [process.pid] if dice.random() < 0.5 else children(process.pid)
            for victim in victims[:1]:
                os.kill(victim, signal.SIGKILL)
                killed += 1
            process.wait()
            # What it started notices that it is gone.
            time.sleep(0.5)
            resume = (out / "checkpoints").is_dir() and any((out / "checkpoints").iterdir())
            if not resume and out.exists():
                out.rename(tmp_path / f"nothing{killed}")
        assert process.returncode == 0, (tmp_path / "said").read_text()
        for name in KEPT:
            assert (out / name).read_bytes() == (tmp_path / "calm" / name).read_bytes(), f"{out}: {name}, seed {SEED}"
    print(f"{killed} kills of {runs} runs")
