"""Merged brackets and records, restored with their variance map, or told why not."""

from __future__ import annotations

import json
import shutil

import h5py
import numpy as np
import pytest
import tifffile
from scipy.signal import convolve2d
from typer.testing import CliRunner

from labapp.cli import app

pytestmark = pytest.mark.usefixtures("white_sheets")

SIDE, TIMES = 96, (1e-3, 8e-3, 64e-3)


def disk():
    at = (np.arange(7 * 8) + 0.5) / 8 - 3.5
    inside = np.hypot(at[:, None], at) < 3.2
    squares = inside.reshape(7, 8, 7, 8).mean((1, 3))
    return squares / squares.sum()


def half_lit(shade=100.0):
    """Patches of light, electrons per second, of which half is in the shade."""
    rng = np.random.default_rng(3)
    whole = SIDE + 6
    patches = np.kron(rng.uniform(0.2, 1, (13, 13)), np.ones((8, 8)))[:whole, :whole]
    return 5e6 * patches * np.where(np.arange(whole) < whole // 2, 1 / shade, 1.0)


@pytest.fixture(scope="module")
def bracket(tmp_path_factory):
    """A folder with a bracket of a blurred scene, merged."""
    folder = tmp_path_factory.mktemp("bracket")
    seen, rng, files = convolve2d(half_lit(), disk(), mode="valid"), np.random.default_rng(0), []
    for number, time in enumerate(TIMES):
        counted = rng.poisson(seen * time) + rng.normal(0, 2.4, seen.shape)
        files.append(str(folder / f"{number}.tiff"))
        levels = np.clip(np.round(counted / 2.6 + 64), 0, 4095).astype(np.uint16)
        tifffile.imwrite(files[-1], levels)
    done = CliRunner().invoke(app, [
        "merge", *files, "--exposures", ",".join(map(str, TIMES)), "--gain", "2.6",
        "--read-noise", "2.4", "--black", "64", "--full-scale", "4095",
        "--out", str(folder / "merged.h5"),
    ])  # fmt: skip
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture
def merged(bracket, tmp_path):
    """A merged bracket of a blurred scene, its PSF beside it, and the scene, which is returned."""
    shutil.copy(bracket / "merged.h5", tmp_path)
    np.save(tmp_path / "psf.npy", disk())
    return half_lit()[3:-3, 3:-3]


def restored(labapp, folder, *options):
    code, printed, errors = labapp(
        "reconstruct", folder / "merged.h5", "--psf", folder / "psf.npy",
        "--out", folder / "out.npy", "--force", "--json", *options,
    )  # fmt: skip
    assert code == 0, errors
    return json.loads(printed), np.load(folder / "out.npy").squeeze()


def error(image, scene):
    return np.mean((image - scene)[8:-8, 8:-8] ** 2)


def test_a_merged_bracket_is_restored_with_its_map_which_gains_about_what_is_told(
    labapp, merged, tmp_path
):
    told, mapped = restored(labapp, tmp_path, "--method", "tv")
    with h5py.File(tmp_path / "merged.h5") as file:
        deviation = np.sqrt(file["variance"][:].mean(dtype=np.float64))
    even_told, even = restored(labapp, tmp_path, "--method", "tv", "--noise", f"{deviation:.9g}")
    (use,) = told["variance_map"]
    assert use["is_used"]
    assert told["noise"] == pytest.approx([deviation], rel=1e-4)
    gain = 10 * np.log10(error(even, merged) / error(mapped, merged))
    assert gain > 0.3
    assert use["gain"]["light"] == pytest.approx(gain, abs=0.7)
    (unused,) = even_told["variance_map"]
    assert (unused["is_used"], unused["gain"]) == (False, None)
    assert "one noise was told" in unused["reason"]


@pytest.mark.usefixtures("drawn")
def test_the_table_says_what_the_map_gains(labapp, merged, tmp_path):
    code, printed, errors = labapp(
        "reconstruct", tmp_path / "merged.h5", "--psf", tmp_path / "psf.npy"
    )
    assert code == 0, errors
    flat = " ".join(printed.split())
    assert "variance map used: +" in flat
    assert "root mean square" in flat


def test_methods_without_a_map_say_so(labapp, merged, tmp_path):
    told, _ = restored(labapp, tmp_path, "--method", "wiener")
    assert told["variance_map"] == [
        {"is_used": False, "gain": None, "reason": "wiener takes one noise for all pixels"}
    ]


def test_without_time_the_map_is_used_and_its_gain_not_told(labapp, merged, tmp_path):
    told, _ = restored(labapp, tmp_path, "--method", "tv", "--budget", "0.5")
    (use,) = told["variance_map"]
    assert (use["is_used"], use["gain"]) == (True, None)
    assert "want of time" in use["reason"]


def test_even_noise_gains_nothing_and_is_told(labapp, merged, tmp_path):
    with h5py.File(tmp_path / "merged.h5", "r+") as file:
        file["variance"][:] = np.mean(file["variance"][:])
    told, _ = restored(labapp, tmp_path, "--method", "tv")
    (use,) = told["variance_map"]
    assert not use["is_used"]
    assert "noise is even, so that it gains nothing" in use["reason"]


def test_noise_that_the_map_doesnt_have_is_added_and_told(labapp, merged, tmp_path):
    with h5py.File(tmp_path / "merged.h5", "r+") as file:
        file["variance"][:] /= 100
    told, _ = restored(labapp, tmp_path, "--method", "tv")
    (use,) = told["variance_map"]
    assert "far more noise than the map has" in use["reason"]


@pytest.mark.usefixtures("drawn")
def test_a_middle_without_a_measured_pixel_doesnt_end_the_restoration(labapp, tmp_path):
    side = 300
    rng = np.random.default_rng(1)
    rate = rng.uniform(1e3, 1e6, (side, side)).astype(np.float32)
    state, variance = np.zeros((side, side), np.uint8), (0.05 * rate) ** 2
    middle = (slice(20, -20),) * 2
    state[middle], variance[middle] = 1, np.inf
    with h5py.File(tmp_path / "merged.h5", "w") as file:
        file["rate"], file["variance"], file["state"] = rate, variance, state
    np.save(tmp_path / "psf.npy", disk())
    told, _ = restored(labapp, tmp_path, "--method", "tv")
    (use,) = told["variance_map"]
    assert use["is_used"]
    assert "can't be estimated" in use["reason"]


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("variance", lambda v: v[:-1], "variance (95, 96) and state (96, 96)"),
        ("variance", np.zeros_like, "variance is NaN or not above 0 at 9216 pixels"),
        ("variance", lambda v: np.where(v > 0, np.nan, v), "NaN or not above 0 at 9216 pixels"),
        ("variance", lambda v: np.full_like(v, np.inf), "a band has no measured pixel"),
    ],
)
def test_what_cant_be_a_merged_bracket_is_named(labapp, merged, tmp_path, name, change, message):
    with h5py.File(tmp_path / "merged.h5", "r+") as file:
        wrong = change(file[name][:])
        del file[name]
        file[name] = wrong
    code, _, errors = labapp("reconstruct", tmp_path / "merged.h5", "--psf", tmp_path / "psf.npy")
    assert code == 1
    assert message in " ".join(errors.split())


@pytest.mark.parametrize("option", [("--dark", "3"), ("--clip", "9"), ("--frame", "1")])
def test_options_of_other_pictures_are_refused(labapp, merged, tmp_path, option):
    code, _, errors = labapp(
        "reconstruct", tmp_path / "merged.h5", "--psf", tmp_path / "psf.npy", *option
    )
    assert code == 1
    assert "Leave it out" in errors
