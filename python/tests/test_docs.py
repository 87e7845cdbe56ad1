"""The Python of docs/python.md runs as it is written."""

import numpy as np
from conftest import ROOT

RUN = "runs/smoke_traffic-dials-seed1"


def blocks():
    page = (ROOT / "docs/python.md").read_text()
    return [rest.split("```")[0] for rest in page.split("```python\n")[1:]]


def test_the_page_runs_from_its_first_line_to_its_last(grid_run, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    names = {}
    for block in blocks():
        # The run of the guide is long; this one has other weights and shorter episodes.
        block = block.replace("runs/own-reward", str(tmp_path / "own")).replace("python-replay", str(tmp_path / "replay"))
        exec(block.replace(RUN, str(grid_run)), names)
    assert len(blocks()) == 7 and names["played"].replay.is_file()
    told = capsys.readouterr().out
    assert "p_switch_given_green" in told and "(16, 40)" in told and "'layers.0.weight': (40, 16)" in told
    assert np.isfinite(list(names["returns"].values())).all()
