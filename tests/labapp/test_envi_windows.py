"""Windows of cubes in files: what is read, what is missing, and what it takes of memory."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from labapp.accuracy.spectral_case import spectral_case_from_options
from labapp.common import free_memory
from labapp.common.errors import UserError
from labapp.files.cubes import SpectralCube, cube_file, read_cube, write_cube
from labapp.files.cubes.stored_values import StoredValues
from labapp.spectral.lights import find_light
from labapp.spectral.other_files import read_psf_stack, read_true_cube
from labapp.spectral.scores import score_cube

SHARED = Path(__file__).parents[3] / "shared/data/cases/pictures"

SIDES = (5, 7, 9)
"""Bands, rows, columns."""

WAVELENGTHS = (600, 450, 550, 700, 500)
"""In the file's order, in nanometres."""

_ORDERS = {"bsq": (0, 1, 2), "bil": (1, 0, 2), "bip": (1, 2, 0)}


def stored_numbers(kind: str = "u2") -> np.ndarray:
    return np.random.default_rng(0).integers(1, 100, SIDES).astype(kind)


def write_envi(folder: Path, stored: np.ndarray, interleave: str = "bsq", more: str = "") -> Path:
    codes = {"u1": 1, "i2": 2, "f4": 4, "f8": 5, "u2": 12}
    bands, rows, columns = stored.shape
    listed = ", ".join(map(str, WAVELENGTHS[:bands]))
    (folder / "a.hdr").write_text(
        f"ENVI\nsamples = {columns}\nlines = {rows}\nbands = {bands}\n"
        f"data type = {codes[stored.dtype.str[1:]]}\ninterleave = {interleave}\nbyte order = 0\n"
        f"wavelength units = nm\nwavelength = {{{listed}}}\n{more}\n"
    )
    (folder / "a.raw").write_bytes(stored.transpose(_ORDERS[interleave]).tobytes())
    return folder / "a.hdr"


@pytest.fixture(autouse=True)
def stays_in_its_file(monkeypatch):
    monkeypatch.setattr(cube_file, "_LARGE", 0)


INDICES = [
    np.s_[2],
    np.s_[-1, 3],
    np.s_[:, 1:4, 2:9],
    np.s_[..., 4],
    np.s_[[3, 0, 4], 2:3, ::-2],
    np.s_[::2, ::3],
    np.s_[1, 2, 3],
    np.s_[:, 4:4],
    np.s_[np.array([0, 2])],
]


@pytest.mark.parametrize("interleave", ["bsq", "bil", "bip", "h5"])
def test_a_window_is_what_the_whole_array_has_there(tmp_path, interleave):
    stored = stored_numbers()
    if interleave == "h5":
        path = tmp_path / "a.h5"
        whole = stored.astype(np.float32)
        write_cube(path, SpectralCube(whole, tuple(n * 1e-9 for n in sorted(WAVELENGTHS))))
    else:
        path = write_envi(tmp_path, stored, interleave)
        whole = stored[np.argsort(WAVELENGTHS)].astype(np.float32)
    values = read_cube(path).values
    assert isinstance(values, StoredValues)
    assert (values.shape, values.size, len(values)) == (whole.shape, whole.size, len(whole))
    for index in INDICES:
        np.testing.assert_array_equal(values[index], whole[index], strict=True)
    np.testing.assert_array_equal(np.stack(list(values)), whole)
    np.testing.assert_array_equal(2 * values - whole, whole)
    assert values.max() == whole.max()
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(values)), whole)


def test_a_small_cube_is_read_at_once(tmp_path, monkeypatch):
    monkeypatch.undo()
    cube = read_cube(write_envi(tmp_path, stored_numbers()))
    (tmp_path / "a.raw").unlink()
    assert type(cube.values) is np.ndarray
    np.testing.assert_array_equal(cube.values[0], stored_numbers()[1])


def test_bad_bands_are_left_out_and_told(tmp_path):
    stored = stored_numbers()
    cube = read_cube(write_envi(tmp_path, stored, more="bbl = {1, 1.0, 0, 0, 1}"))
    assert cube.wavelengths == pytest.approx((450e-9, 500e-9, 600e-9))
    np.testing.assert_array_equal(cube.values, stored[[1, 4, 0]])
    assert cube.notes == ("a.hdr: 2 of 5 bands are marked as bad (bbl) and left out: 550, 700 nm",)
    with pytest.raises(UserError, match=r"no band at 550 nm.*marked as bad.*550, 700 nm"):
        read_true_cube(tmp_path / "a.hdr", (450e-9, 550e-9))


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="no cases beside the checkout")
def test_the_case_of_a_bad_band_is_read():
    cube = read_cube(SHARED / "bbl.hdr")
    stored = np.fromfile(SHARED / "bbl.raw", "<u2").reshape(5, 7, 9)
    np.testing.assert_array_equal(cube.values, stored[[0, 1, 3, 4]])
    assert "left out: 550" in cube.notes[0]


@pytest.mark.parametrize("kind", ["u2", "i2", "f4", "f8"])
@pytest.mark.parametrize("more", ["", "data gain values = {2, 2, 2, 2, 2}\n"])
def test_the_number_for_missing_values_is_no_light(tmp_path, kind, more):
    """It is compared before the numbers are scaled."""
    stored = stored_numbers(kind)
    stored[1, 2, 3] = stored[4, 6, 0] = 0
    cube = read_cube(write_envi(tmp_path, stored, "bil", f"{more}data ignore value = 0"))
    values = np.asarray(cube.values)
    gain = 2 if more else 1
    wanted = np.where(stored == 0, np.nan, gain * stored.astype(float))[np.argsort(WAVELENGTHS)]
    np.testing.assert_array_equal(values, wanted)
    assert np.argwhere(cube.missing).tolist() == [[2, 3], [6, 0]]
    assert "0 stands for a missing value" in cube.notes[0]


@pytest.mark.parametrize(
    ("written", "number"),
    [("-3.40282e+38", -np.float32(3.4028235e38)), ("NaN", np.nan), ("-9999.0", -9999.0)],
)
def test_a_rounded_number_for_missing_values_is_found(tmp_path, written, number):
    stored = stored_numbers("f4")
    stored[0, 0, 0] = number
    cube = read_cube(write_envi(tmp_path, stored, more=f"data ignore value = {written}"))
    assert np.isnan(np.asarray(cube.values)).sum() == 1


@pytest.mark.parametrize("name", ["b.h5", "b.hdr"])
def test_missing_values_come_back_as_they_were_written(tmp_path, name):
    values = np.ma.masked_less(stored_numbers("f4"), 10)
    made = SpectralCube(values, tuple(n * 1e-9 for n in sorted(WAVELENGTHS)))
    np.testing.assert_array_equal(np.isnan(made.values), values.mask)
    write_cube(tmp_path / name, made)
    np.testing.assert_array_equal(read_cube(tmp_path / name).values, made.values)


def test_scores_leave_out_missing_pixels():
    """A cube that is wrong only where the truth is missing is right; elsewhere it is by hand."""
    rng = np.random.default_rng(1)
    truth = rng.random((3, 40, 30)).astype(np.float32)
    bands, hole = (450e-9, 550e-9, 650e-9), np.s_[:, 5:9, 7:12]
    wrong = truth.copy()
    wrong[hole] = 9
    masked = np.ma.array(truth, mask=np.zeros_like(truth, bool))
    masked[hole] = np.ma.masked
    same = score_cube(SpectralCube(wrong, bands), SpectralCube(masked, bands), find_light("D65"))
    assert same.psnr == np.inf
    assert same.ssim == pytest.approx(1)
    assert (same.difference, same.missing) == (0, 20)
    assert same.as_data["crop"] == "full frame but for 20 missing pixels"
    off = SpectralCube(wrong + np.float32(0.1), bands)
    found = score_cube(off, SpectralCube(masked, bands), find_light("D65"))
    assert found.psnr == pytest.approx(20, abs=1e-3)


def test_uses_that_need_all_values_say_which_are_missing(tmp_path):
    stored = np.ones((3, 40, 40), "u2")
    stored[1, 20, 20] = 0
    path = write_envi(tmp_path, stored, more="data ignore value = 0")
    with pytest.raises(UserError, match=r"1 values are missing\. Write 0 where there is no light"):
        read_psf_stack(path, None, 5e-6)
    with pytest.raises(UserError, match="lacks a value at 1 pixels of its middle"):
        spectral_case_from_options(path, "ring", 0.01, 32, 0)
    found = read_true_cube(path, (450e-9, 600e-9))
    assert found.notes[-1] == "a.hdr: 1 pixels lack a value in a band, and are left out"


def test_numbers_that_single_precision_loses_are_refused(tmp_path):
    stored = stored_numbers("f8")
    with pytest.raises(UserError, match="beyond single precision"):
        np.asarray(read_cube(write_envi(tmp_path, 1e300 * stored)).values)
    with pytest.raises(UserError, match=r"single precision takes for 0\. Multiply"):
        np.asarray(read_cube(write_envi(tmp_path, 1e-60 * stored)).values)
    np.testing.assert_array_equal(read_cube(write_envi(tmp_path, 0 * stored)).values, 0)


def test_a_file_that_changes_or_could_be_another_is_told(tmp_path):
    path = write_envi(tmp_path, stored_numbers())
    cube = read_cube(path)
    os.utime(tmp_path / "a.raw", ns=(1, 1))
    with pytest.raises(UserError, match=r"a\.raw: has changed since its header was read"):
        cube.values[0]
    (tmp_path / "a.img").write_bytes((tmp_path / "a.raw").read_bytes())
    with pytest.raises(UserError, match=r"may be in a\.raw or a\.img"):
        read_cube(path)
    (tmp_path / "a.img").write_bytes(b"notes")
    np.testing.assert_array_equal(read_cube(path).values[0], stored_numbers()[1])


def test_an_old_or_torn_header_is_read(tmp_path):
    path = write_envi(tmp_path, stored_numbers("u1"), more="fwhm = {1,2,3,4,5}\nx start = 5")
    text = path.read_text().replace("wavelength = {", "WAVELENGTH =\n  {").replace("lines", "Lines")
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert read_cube(path).wavelengths[0] == pytest.approx(450e-9)
    path.write_text(path.read_text().replace("byte order = 0", ""))
    assert read_cube(path).notes == ()
    write_envi(tmp_path, stored_numbers())
    path.write_text(path.read_text().replace("byte order = 0", ""))
    assert "the byte order isn't stated" in read_cube(path).notes[0]
    path.write_text("#?RADIANCE\n")
    with pytest.raises(UserError, match="in Radiance's format"):
        read_cube(path)


def test_more_than_there_is_memory_is_refused_before_it_is_read(tmp_path, monkeypatch):
    stored = np.ones((5, 300, 300), "u1")
    cube = read_cube(write_envi(tmp_path, stored))
    monkeypatch.setattr(free_memory, "available_memory", lambda: 2_000_000)
    with pytest.raises(
        UserError, match=r"its cube would take 1\.8 MB of memory, and 2 MB are free"
    ):
        np.asarray(cube.values)
    assert cube.values[:, :100].shape == (5, 100, 300)


_PEAK = """
import resource, sys
from pathlib import Path
from labapp.files.cubes import read_cube
read_cube(Path(sys.argv[1])).values[:, :1]
base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
cube = read_cube(Path(sys.argv[1]))
print(sum(float(cube.values[:, rows].sum(dtype=float)) for rows in cube.row_blocks()))
print(1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - base))
"""


@pytest.mark.parametrize("interleave", ["bsq", "bip"])
def test_windows_take_no_more_memory_than_themselves(tmp_path, interleave):
    """A block of rows is 8 MiB; the file has 48 MB, and 193 MB in single precision."""
    stored = np.full((16, 1500, 2000), 3, "u1")
    path = write_envi(tmp_path, stored[:5], interleave)
    text = path.read_text().replace("bands = 5", "bands = 16")
    listed = ", ".join(str(400 + 10 * k) for k in range(16))
    path.write_text(text.replace(", ".join(map(str, WAVELENGTHS)), listed))
    (tmp_path / "a.raw").write_bytes(stored.transpose(_ORDERS[interleave]).tobytes())
    done = subprocess.run(
        [sys.executable, "-c", _PEAK, str(path)], capture_output=True, text=True, check=True
    )
    total, peak = map(float, done.stdout.split())
    assert total == 3 * stored.size
    assert peak < 50e6
