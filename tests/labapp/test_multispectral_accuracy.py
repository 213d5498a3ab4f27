"""Quality against time of restored spectral bands."""

from __future__ import annotations

import json

import numpy as np
import pytest

from labapp.accuracy.multispectral import measure_multispectral
from labapp.accuracy.option_validation import PSF_NAMES
from labapp.accuracy.spectral_case import spectral_case_from_options
from labapp.accuracy.work_precision import CUT, Deadline
from labapp.files.cubes import SpectralCube, write_cube
from optics.progress import Progress


@pytest.fixture(autouse=True)
def few_iterations(monkeypatch):
    monkeypatch.setattr("labapp.accuracy.multispectral._SHORT_S", 0.0)
    monkeypatch.setattr("labapp.accuracy.multispectral._COUNTS", (5, 40))
    monkeypatch.setattr("labapp.accuracy.multispectral._PUBLISHED_COUNTS", (5, 20))


def test_all_methods_are_rows_and_the_best_are_the_front(labapp):
    code, printed, errors = labapp("accuracy", "multispectral", "--size", 48, "--json")
    assert code == 0, errors
    rows = json.loads(printed)["rows"]
    methods = {row["method"] for row in rows}
    assert methods == {"typical spectra", "typical spectra, adapting", "published objective"}
    assert [row["iterations"] for row in rows] == sorted(row["iterations"] for row in rows)
    for method in methods:
        first, last = (row for row in rows if row["method"] == method)
        assert last["psnr_db"] > first["psnr_db"] > 10
        assert last["least_db"] <= last["psnr_db"]
    for row in rows:
        beaten = [
            one
            for one in rows
            if one["cpu_s"] < row["cpu_s"] and one["error_achieved"] < row["error_achieved"]
        ]
        assert row["on_front"] == (not beaten)


def test_what_is_left_at_the_deadline_is_named():
    case = spectral_case_from_options(None, "ring", 0.01, 32, 0)
    rows = measure_multispectral(case, Progress(), Deadline(0.0))
    assert {row.failure for row in rows} == {CUT}


@pytest.mark.parametrize("psf", PSF_NAMES)
def test_every_shape_makes_a_snapshot(psf):
    case = spectral_case_from_options(None, psf, 0.0, 64, 0)
    assert case.snapshot.truth.shape == (6, 64, 64)
    assert case.spectra.shape == (99, 6)


def test_a_cube_of_a_file_is_cut_to_its_middle(tmp_path):
    values = np.random.default_rng(0).random((3, 40, 50)).astype(np.float32)
    write_cube(tmp_path / "leaf.h5", SpectralCube(values, (450e-9, 550e-9, 650e-9)))
    case = spectral_case_from_options(tmp_path / "leaf.h5", "ring", 0.01, 36, 0)
    assert case.snapshot.truth == pytest.approx(values[:, 2:38, 7:43])
    assert case.name == "leaf.h5, ring, noise 0.01, (3, 36, 36)"


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--psf", "triangle"], "--psf triangle: is unknown. Take one of ring, spiral"),
        (["nowhere.h5"], "nowhere.h5"),
        (["dark.h5"], "is dark, or not finite"),
        (["small.h5"], "give 32 pixels or more"),
        (["infrared.h5"], "no filter of the sensor sees the band at 1000 nm"),
        (["--plot", "nowhere/plot.png"], "nowhere"),
    ],
)
def test_what_can_not_be_asked(labapp, tmp_path, monkeypatch, asked, said):
    monkeypatch.chdir(tmp_path)
    bands, dark = (450e-9, 550e-9), np.zeros((2, 40, 40), np.float32)
    write_cube(tmp_path / "dark.h5", SpectralCube(dark, bands))
    write_cube(tmp_path / "small.h5", SpectralCube(dark[:, :9] + 1, bands))
    write_cube(tmp_path / "infrared.h5", SpectralCube(dark + 1, (550e-9, 1000e-9)))
    code, _, errors = labapp("accuracy", "multispectral", *asked)
    assert code != 0
    assert said in " ".join(errors.split())
