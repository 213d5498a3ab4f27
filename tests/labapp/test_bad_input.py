"""Every mistake that a user can make at the command line ends in a line that helps."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

PLAN = "plan.toml"
BENCH = "bench.toml"
SCENE = "scene.toml"


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def folder_of(path: Path) -> set[str]:
    return {item.name for item in path.iterdir()}


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        (PLAN, "seed = 3", "sede = 3", ["plan.toml", "'sede'", "unknown"]),
        (PLAN, "version = 1", "version = 2", ["plan.toml", "'version'", "2"]),
        (PLAN, "exposures_ms = [1, 8]", "exposures_ms = [0, 8]", ["acquire.0.exposures_ms.0", "0"]),
        (PLAN, "exposures_ms = [1, 8]", "exposures_ms = [-5]", ["exposures_ms", "-5", "greater"]),
        (PLAN, "exposures_ms = [1, 8]", "exposures_ms = [40000]", ["40000", "0.02 to 30000 ms"]),
        (PLAN, "exposures_ms = [1, 8]", "exposures_ms = []", ["exposures_ms"]),
        (PLAN, "[540, 550]", "[900]", ["wavelengths_nm", "900", "420 to 720 nm"]),
        (PLAN, '["dark", "star"]', '["moon"]', ["moon", "dark, star, photograph"]),
        (PLAN, '["neutral", "lens"]', '["spiral"]', ["spiral", "neutral, lens"]),
        (PLAN, 'kind = "constant"', 'kind = "constnat"', ["patterns.neutral", "constnat"]),
        (
            PLAN,
            "focal_length_m = 50.0",
            "focal_length_m = 0.01",
            ["lens", "focal_length", "at least"],
        ),
        (PLAN, "version = 1", "version = ", ["plan.toml", "not valid TOML"]),
        (BENCH, 'name = "Small bench"', "", ["bench.toml", "'name'", "missing"]),
        (BENCH, "fill_factor = 0.9", "fill_factor = 1.9", ["panel.fill_factor", "1.9"]),
        (
            BENCH,
            "simulated-camera",
            "no-such-camera",
            ["devices.camera.driver", "simulated-camera"],
        ),
        (
            BENCH,
            'driver = "simulated-camera"',
            'driver = "simulated-camera"\noptions = { speed = 1 }',
            ["devices.camera.options", "speed", "readout_ms"],
        ),
        (
            BENCH,
            'driver = "simulated-filter"',
            'driver = "simulated-filter"\noptions = { bandwidth_nm = -7 }',
            ["devices.filter.options", "bandwidth_nm", "-7", "positive"],
        ),
        (
            BENCH,
            'driver = "simulated-filter"',
            'driver = "simulated-filter"\noptions = { range_nm = "wide" }',
            ["devices.filter.options", "wide"],
        ),
        (
            BENCH,
            'driver = "simulated-camera"',
            'driver = "simulated-camera"\noptions = { readout_ms = -1 }',
            ["devices.camera.options", "readout_ms", "-1"],
        ),
        (BENCH, "focus_distance_m = 2.0", "focus_distance_m = 0.1", ["focus_distance_m", "125 mm"]),
        (BENCH, "unmodulated = 0.05\n", "", ["'panel.unmodulated' is missing", "[polarisation]"]),
        (
            BENCH,
            "[lens]",
            "[polarisation]\npolariser = { angle_deg = 12.9 }\n[lens]",
            ["'panel.unmodulated' is 0.05", "'polarisation' follows 0.0498", "remove one"],
        ),
        (
            BENCH,
            "focus_distance_m = 2.0",
            "focus_distance_m = 2.0\nseparation_mm = -1.0",
            ["lens.separation_mm", "-1.0"],
        ),
        (SCENE, "diameter_um = 70.0", "diameter_um = -1", ["scene.toml", "diameter_um", "-1"]),
        (SCENE, "picture.png", "nothing.png", ["nothing.png", "cannot be read"]),
        (SCENE, "picture.png", "plan.toml", ["plan.toml", "not a picture"]),
        (
            SCENE,
            'title = "Small scene"',
            'title = ""\neffects = { fog = true }',
            ["scene.toml", "'effects'", "fog", "shot noise"],
        ),
        (
            SCENE,
            'title = "Small scene"',
            'title = ""\neffects = { "shot noise" = "some" }',
            ["scene.toml", "'effects'", "'shot noise'", "'some'", "Gaussian", "Poisson"],
        ),
        (
            SCENE,
            'title = "Small scene"',
            'title = ""\neffects = { "panel orders" = true, diffraction = false }',
            ["scene.toml", "'effects'", "'panel orders'", "requires 'diffraction'"],
        ),
        (
            BENCH,
            'driver = "simulated-filter"',
            'driver = "simulated-filter"\noptions = { shape = "square" }',
            ["devices.filter.options", "'square'", "gaussian, lyot, interference"],
        ),
        (
            BENCH,
            'driver = "simulated-filter"',
            'driver = "simulated-filter"\noptions = { leak = 2.0 }',
            ["devices.filter.options", "leak is 2", "a share from 0"],
        ),
        (
            BENCH,
            "quantum_efficiency = 0.62",
            'quantum_efficiency = { file = "nothing.csv" }',
            ["nothing.csv", "cannot be read"],
        ),
        (BENCH, "[sensor]", '[sensor]\nfile = "none-such"', ["none-such", "flir-oryx-123s6m-like"]),
    ],
)
def test_a_wrong_file_is_named_with_key_value_and_remedy(
    labapp, small, tmp_path, file, old, new, words
):
    change(small.folder / file, old, new)
    out = tmp_path / "run.h5"
    code, _, said = labapp("run", small.plan, *small.arguments(), "--out", out)
    assert code == 1
    assert len(said.strip().splitlines()) <= 2
    assert "Traceback" not in said
    for word in words:
        assert word in said
    assert folder_of(tmp_path) == {"files"}, "nothing half-written is left behind"


def test_a_missing_plan_is_named(labapp, small, tmp_path):
    code, _, said = labapp("run", tmp_path / "no.toml", "--out", tmp_path / "run.h5")
    assert (code, "no.toml" in said, "Check the path" in said) == (1, True, True)


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (np.zeros((20, 30), np.uint8), ["30x20", "192x108"]),
        (np.zeros((108, 192), np.uint16), ["uint16", "8-bit"]),
    ],
)
def test_a_pattern_of_the_wrong_shape_or_type_is_refused(labapp, small, tmp_path, picture, words):
    cv2.imwrite(str(small.folder / "pattern.png"), picture)
    change(small.plan, 'kind = "constant"', 'kind = "image"\nfile = "pattern.png"')
    code, _, said = labapp("run", small.plan, *small.arguments(), "--out", tmp_path / "run.h5")
    assert code == 1
    assert "pattern.png" in said
    for word in words:
        assert word in said
    assert folder_of(tmp_path) == {"files"}


def test_an_existing_record_is_kept_without_force(labapp, small, tmp_path):
    out = tmp_path / "run.h5"
    out.write_text("precious")
    code, _, said = labapp("run", small.plan, *small.arguments(), "--out", out)
    assert code == 1
    assert "exists already" in said
    assert "--force" in said
    assert out.read_text() == "precious"
    code, _, _ = labapp("run", small.plan, *small.arguments(), "--out", out, "--force")
    assert code == 0
    assert h5py.is_hdf5(out)


def test_an_existing_record_survives_a_run_that_cannot_start(labapp, small, tmp_path):
    out = tmp_path / "run.h5"
    out.write_text("precious")
    change(small.plan, "focal_length_m = 50.0", "focal_length_m = 0.0")
    code, _, said = labapp("run", small.plan, *small.arguments(), "--out", out, "--force")
    assert code == 1
    assert "focal_length" in said
    assert out.read_text() == "precious"


@pytest.mark.parametrize("place", ["missing/run.h5", "file/run.h5"])
def test_a_place_that_cannot_be_written_is_refused(labapp, small, tmp_path, place):
    (tmp_path / "file").write_text("")
    code, _, said = labapp("run", small.plan, *small.arguments(), "--out", tmp_path / place)
    assert code == 1
    assert "folder" in said
    assert len(said.strip().splitlines()) == 1


def test_a_folder_without_leave_to_write_is_refused(labapp, small, tmp_path, monkeypatch):
    # Root may write anywhere, so the question is answered for it.
    asked = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path and asked(path, mode))
    code, _, said = labapp("run", small.plan, *small.arguments(), "--out", tmp_path / "run.h5")
    assert code == 1
    assert "may not be written" in said


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "is empty"),
        (b"not a picture", "it is text"),
        (b"\xff\xd8\xff\xe0 cut off", "it is a damaged JPEG"),
    ],
)
def test_a_demo_of_something_that_is_no_picture_is_refused(labapp, tmp_path, content, what):
    image = tmp_path / "mine.jpg"
    image.write_bytes(content)
    code, _, said = labapp("demo", "--image", image, "--out", tmp_path / "out")
    assert code == 1
    assert "mine.jpg" in said
    assert what in said
    assert "Give a " in said
    assert folder_of(tmp_path) == {"mine.jpg"}


@pytest.mark.parametrize("command", ["show", "report"])
def test_a_file_that_is_no_record_is_refused(labapp, small, tmp_path, command):
    code, _, said = labapp(command, small.plan)
    assert code == 1
    assert "is not an HDF5 file" in said
    code, _, said = labapp(command, tmp_path / "none.h5")
    assert code == 1
    assert "no such file" in said


def test_a_traceback_is_shown_only_on_request(labapp, tmp_path):
    _, _, said = labapp("show", tmp_path / "none.h5")
    assert "Traceback" not in said
    with pytest.raises(Exception, match="no such file"):
        labapp("show", tmp_path / "none.h5", "--debug")
