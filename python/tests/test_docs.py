"""The Python of docs/python.md and docs/python-recipes.md runs as it is written."""

import re

import numpy as np
import pytest
from conftest import ROOT, path_of_program

RUN = "runs/smoke_traffic-dials-seed1"
RECIPES = ROOT / "docs/python-recipes.md"


def blocks(page):
    return [rest.split("```")[0] for rest in page.read_text().split("```python\n")[1:]]


def test_the_page_runs_from_its_first_line_to_its_last(grid_run, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("DIALS_TRAFFIC", path_of_program())
    names = {}
    of_page = blocks(ROOT / "docs/python.md")
    for block in of_page:
        # The run of the guide is long; this one has other weights and shorter episodes.
        block = block.replace("python-run", str(tmp_path / "run")).replace("runs/own-reward", str(tmp_path / "own"))
        block = block.replace("runs/own-predictor", str(tmp_path / "predicted"))
        if "out=" in block:
            block = block.replace("configs/smoke_traffic.toml", str(grid_run / "config.toml"))
        exec(block.replace(RUN, str(grid_run)).replace("python-replay", str(tmp_path / "replay")), names)
    assert len(of_page) == 10 and names["played"].replay.is_file()
    told = capsys.readouterr().out
    assert "p_switch_given_green" in told and "(16, 40)" in told and "'layers.0.weight': (40, 16)" in told
    assert np.isfinite(list(names["returns"].values())).all()


@pytest.mark.parametrize(
    ("library", "told"),
    [
        ("sb3_contrib", "1\n"),
        ("supersuit", "8 512\n"),
        ("ray.rllib", "['r0c0', 'r0c1', 'r1c0', 'r1c1'] False\n"),
        ("wandb", ""),
    ],
)
def test_a_recipe_runs_as_it_is_written(library, told, grid_run, grid, tmp_path, monkeypatch, capfd):
    pytest.importorskip(library, exc_type=ImportError)
    monkeypatch.chdir(tmp_path)
    block = next(block for block in blocks(RECIPES) if re.search(rf"^(import|from) {library}", block, re.MULTILINE))
    exec(block.replace(RUN, str(grid_run)).replace("configs/smoke_traffic.toml", str(grid)), {})
    assert capfd.readouterr().out.endswith(told)


def test_a_recipe_is_for_a_library_that_this_file_tries():
    assert len(blocks(RECIPES)) == 4
