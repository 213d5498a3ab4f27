"""`labapp accuracy retrieval`: every method's quality and time, for a target of one's own."""

from __future__ import annotations

import json
from dataclasses import fields

import cv2
import numpy as np
import pytest

from labapp.accuracy.retrieval import RetrievalRow, goal_from_options, measure_retrieval
from labapp.patterns.designing.kinds import read_psf
from optics.accuracy import MachineSpeed
from optics.progress import Cancelled, Progress
from optics.retrieval import METHODS
from optics.retrieval.slow_crystal import displayed_psf

RING = ["ring", "radius_um=40", "width_um=6"]


@pytest.fixture
def bench(small):
    return ["--bench", str(small.bench)]


@pytest.fixture
def quickly(monkeypatch):
    monkeypatch.setattr("labapp.accuracy.retrieval._ITERATIONS", (1, 4))
    monkeypatch.setattr("labapp.accuracy.retrieval._SHORT_S", 0.0)


@pytest.mark.parametrize("frames", [1, 3])
def test_the_diagram_of_a_retrieval(labapp, bench, tmp_path, quickly, frames):
    files = ["--json", "--plot", tmp_path / "front.png"]
    asked = ["accuracy", "retrieval", *RING, "--frames", str(frames), *bench, *files]
    code, printed, _ = labapp(*asked)
    assert code == 0
    rows = json.loads(printed)["rows"]
    assert set(rows[0]) == {field.name for field in fields(RetrievalRow)}
    serving = {name for name, method in METHODS.items() if method.serves(frames)}
    # This panel's crystal is at once: nothing has to respond to it.
    assert {row["method"] for row in rows} == serving - {"responding"}
    good = [row for row in rows if not row["failure"]]
    assert all(row["cpu_s"] > 0 and 0 < row["efficiency"] <= 1 for row in good)
    for row in good:
        beaten = any(
            o["cpu_s"] < row["cpu_s"] and o["error_achieved"] < row["error_achieved"] for o in good
        )
        assert row["on_front"] != beaten
    assert cv2.imread(str(tmp_path / "front.png")).std() > 5


def test_what_does_not_serve_the_target_is_a_row(labapp, bench, quickly):
    """A ring isn't made of spots."""
    code, printed, _ = labapp("accuracy", "retrieval", *RING, *bench)
    assert code == 0
    assert "front" in printed
    spots = [line for line in printed.splitlines() if "weighted" in line]
    assert spots
    assert not any("front" in line for line in spots)
    assert "is for spots" in " ".join(printed.split())


def test_a_small_budget_leaves_out_what_takes_longer(small, quickly):
    goal, name = goal_from_options(read_psf(RING[0], RING[1:], 550.0, {}), small.bench)
    dear = MachineSpeed(fft=1.0)
    rows = measure_retrieval(goal, name, 1, 1e-3, dear, Progress())
    assert {row.iterations for row in rows} == {1}


def test_the_goal_is_the_target_on_the_benchs_panel(small):
    goal, name = goal_from_options(read_psf(RING[0], RING[1:], 550.0, {}), small.bench)
    assert goal.camera.panel.shape == (108, 192)
    assert name == "ring 40/6 µm, 550 nm"
    y, x = (axis.numpy() for axis in goal.plane.mesh())
    truth = np.exp(-((np.hypot(y, x) - 40e-6) ** 2) / (2 * 6e-6**2))
    assert np.abs(goal.target.numpy() - truth / truth.max()).max() < 1e-3
    assert displayed_psf(goal, goal.amplitude[None] * 0, 1).sum() <= 1


def test_bad_questions_are_refused_by_name(labapp, bench, tmp_path):
    (tmp_path / "there.png").write_text("mine")
    for words, said in (
        (["blob"], "target 'blob' is not known"),
        (["ring", "radius_um=-3"], "radius_um"),
        ([*RING, "--plot", tmp_path / "there.png"], "exists already"),
    ):
        code, _, complaint = labapp("accuracy", "retrieval", *words, *bench)
        assert code == 1
        assert said in complaint
    assert (tmp_path / "there.png").read_text() == "mine"


def test_measuring_can_be_cancelled(small, quickly):
    goal, name = goal_from_options(read_psf(RING[0], RING[1:], 550.0, {}), small.bench)
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        measure_retrieval(goal, name, 1, 1.0, MachineSpeed(), progress)
