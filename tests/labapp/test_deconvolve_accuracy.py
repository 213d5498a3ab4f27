"""Quality against time of every method that undoes a blur."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from scipy.signal import convolve2d

from labapp.accuracy.blurs import BLURS, circle, disk, photograph_from_options, simulate_photograph
from optics.inverse.choice import METHODS


@pytest.fixture(autouse=True)
def timed_once(monkeypatch):
    monkeypatch.setattr("labapp.accuracy.deconvolve._SHORT_S", 0.0)


@pytest.fixture
def picture(tmp_path):
    """Disks on a ramp."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:120, :140]
    levels = 60.0 + 0.4 * x
    for _ in range(10):
        levels[np.hypot(y - rng.uniform(0, 120), x - rng.uniform(0, 140)) < 18] = rng.uniform(
            0, 250
        )
    cv2.imwrite(str(tmp_path / "picture.png"), levels.astype(np.uint8))
    return tmp_path / "picture.png"


def test_every_method_is_a_row_and_the_best_are_the_front(labapp, picture, tmp_path):
    plot = tmp_path / "plot.png"
    code, printed, errors = labapp(
        "accuracy", "deconvolve", picture, "--blur", "disk of 3", "--size", 72,
        "--json", "--plot", plot,
    )  # fmt: skip
    assert code == 0, errors
    rows = json.loads(printed)["rows"]
    assert {row["method"] for row in rows} == {"as it is", *METHODS}
    assert not any(row["failure"] for row in rows)
    before, *others = rows
    for row in others:
        assert row["psnr_db"] > before["psnr_db"] + 1, row["method"]
        assert 0 < row["ssim"] <= 1
        assert row["cpu_s"] > 0
        assert row["cpu_predicted_s"] > 0
    for row in rows:
        beaten = [
            one
            for one in rows
            if one["cpu_s"] < row["cpu_s"] and one["error_achieved"] < row["error_achieved"]
        ]
        assert row["on_front"] == (not beaten)
    assert cv2.imread(str(plot)).std() > 10


def test_peers_are_rows_too(labapp, picture):
    pytest.importorskip("skimage")
    asked = ["--size", 40, "--blur", "disk of 3", "--peers"]
    code, printed, errors = labapp("accuracy", "deconvolve", picture, *asked)
    assert code == 0, errors
    for name in ("as it is", "wiener", "scikit-image", "front"):
        assert name in printed


@pytest.mark.parametrize("border", ["unknown", "periodic"])
def test_a_photograph_is_what_a_camera_would_have_taken(border):
    """Without noise it is the truth, spread by a slow convolution."""
    scene, psf = np.random.default_rng(0).random((30, 41)), circle(3, 0.3)[:, 1:]
    psf /= psf.sum()
    case = simulate_photograph("scene", scene, psf, 0.0, 0, border)
    rows, columns = psf.shape
    around = np.pad(scene, ((rows, rows), (columns, columns)), mode="wrap")
    whole = convolve2d(around, psf, mode="full")
    top, left = (m + m // 2 for m in psf.shape)
    spread = whole[top : top + 30, left : left + 41]
    if border == "unknown":
        within = (
            slice(rows - 1 - rows // 2, 30 - rows // 2),
            slice(columns - 1 - columns // 2, 41 - columns // 2),
        )
        spread, scene = spread[within], scene[within]
    assert np.allclose(case.observation, spread, atol=1e-12)
    assert np.array_equal(case.truth, scene)
    assert case.quality(case.truth)[1] == pytest.approx(1)


@pytest.mark.parametrize("name", BLURS)
def test_every_blur_is_a_psf_with_its_middle_in_the_middle(name):
    psf = BLURS[name]()
    assert psf.sum() == pytest.approx(1)
    assert psf.min() >= 0
    assert all(n % 2 for n in psf.shape)
    y, x = np.indices(psf.shape) - np.array(psf.shape)[:, None, None] // 2
    far = 4 if name.startswith(("shake", "spiral", "heart")) else 1e-9
    assert abs((psf * y).sum()) < far
    assert abs((psf * x).sum()) < far


def test_a_disk_covers_its_area():
    psf = disk(6.5)
    assert 1 / psf.max() == pytest.approx(np.pi * 6.5**2, rel=2e-3)
    assert psf[psf.shape[0] // 2, 0] < psf.max()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--blur", "fog"], "--blur fog: is unknown. Take one of disk of 3"),
        (["--border", "dark"], "Take unknown or periodic"),
        (["--psf", "nowhere.npy"], "nowhere.npy"),
        (["nowhere.png"], "nowhere.png"),
        (["dark.npy"], "is dark"),
        (["--size", "32", "--blur", "shake of 30"], "no larger than its PSF"),
        (["--plot", "nowhere/plot.png"], "nowhere"),
    ],
)
def test_what_can_not_be_asked(labapp, tmp_path, monkeypatch, asked, said):
    monkeypatch.chdir(tmp_path)
    np.save("dark.npy", np.zeros((64, 64)))
    code, _, errors = labapp("accuracy", "deconvolve", *asked)
    assert code == 1
    assert said in errors
    assert [file.name for file in tmp_path.iterdir()] == ["dark.npy"]


def test_the_default_is_the_demos_photograph():
    case = photograph_from_options(None, "disk of 7", None, 0.01, "unknown", 256, 0)
    assert case.truth.shape == (256 - 14, 256 - 14)
    assert 0.1 < case.truth.mean() < 0.9
