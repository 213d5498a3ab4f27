"""`labapp beam`: the picture of the light along the axis."""

from __future__ import annotations

import cv2
import numpy as np
import pytest


@pytest.fixture
def camera(small, tmp_path):
    """The small bench with its panel 40 mm before the lens."""
    path = tmp_path / "camera.toml"
    text = small.bench.read_text()
    path.write_text(text.replace("[lens]\n", "[lens]\nseparation_mm = 40.0\n", 1))
    return path


def test_a_picture_is_drawn_for_a_camera_and_a_pattern(labapp, camera, tmp_path):
    cv2.imwrite(str(tmp_path / "ramp.png"), np.tile(np.arange(192) % 8 * 10, (108, 1)))
    out = tmp_path / "beam.png"
    arguments = ["--camera", camera, "--pattern", tmp_path / "ramp.png", "--field", "0,0.05"]
    code, printed, _ = labapp("beam", *arguments, "--slices", "12", "--out", out)
    assert code == 0
    assert "wrote" in printed
    picture = cv2.imread(str(out))
    assert picture.shape[0] > 600
    # The light, in its colours, over a dark ground: neither all of it nor nothing.
    bright = (picture.max(axis=2) > 60) & (picture.min(axis=2) < 200)
    assert 0.02 < bright.mean() < 0.7


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "beam.pdf"], "the ending must be .png"),
        (["--out", "beam.png", "--slices", "1"], "--slices 1"),
        (["--out", "beam.png", "--distance", "-1"], "distance is -1"),
        (
            ["--out", "beam.png", "--wavelength-nm", "0"],
            "--wavelength-nm is 0: give a wavelength",
        ),
        (["--out", "beam.png", "--field", "1"], "--field 1"),
    ],
)
def test_bad_input_is_named_and_nothing_is_written(labapp, camera, tmp_path, arguments, words):
    arguments = [tmp_path / word if word.startswith("beam.") else word for word in arguments]
    code, _, complaint = labapp("beam", "--camera", camera, *arguments)
    assert code == 1
    assert words in complaint
    assert not list(tmp_path.glob("beam.*"))


def test_a_pattern_of_another_panel_is_refused(labapp, camera, tmp_path):
    cv2.imwrite(str(tmp_path / "other.png"), np.zeros((5, 7), np.uint8))
    out = tmp_path / "beam.png"
    code, _, complaint = labapp(
        "beam", "--camera", camera, "--pattern", tmp_path / "other.png", "--out", out
    )
    assert code == 1
    assert "other.png" in complaint
    assert not out.exists()


def test_an_existing_picture_is_kept(labapp, camera, tmp_path):
    out = tmp_path / "beam.png"
    out.write_bytes(b"mine")
    code, _, complaint = labapp("beam", "--camera", camera, "--out", out)
    assert code == 1
    assert "--force" in complaint
    assert out.read_bytes() == b"mine"
