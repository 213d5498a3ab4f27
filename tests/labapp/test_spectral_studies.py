"""Studies of multispectral imaging on a bench whose panel has few pixels, and their snapshots."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from labapp.files.bench_file import read_bench
from labapp.files.reading import bundled_path
from labapp.files.spectrum_file import read_spectra
from labapp.runs.record.reader import Record
from labapp.spectral import restoration
from labapp.spectral.computed_snapshot import (
    bundled_mosaic,
    chart_cube,
    compute_snapshot,
    filter_shares,
)
from labapp.studies import design_judgement, multispectral_noise, psf_designs
from labapp.studies.catalogue.multispectral_noise import MultispectralNoiseSettings
from labapp.studies.catalogue.psf_designs import PSFDesignSettings
from labapp.studies.coded_snapshots import psf_window, read_problem
from labapp.studies.command import StudyRequest, carry_out_study
from labapp.studies.design_judgement import draw_designs
from optics.multispectral import restore_spectra
from optics.progress import Progress

BANDS_NM = (450.0, 550.0, 650.0)
BANDS = tuple(one * 1e-9 for one in BANDS_NM)


def replaced(text: str, changes: dict[str, str]) -> str:
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def small_files(tmp_path_factory) -> tuple[Path, Path]:
    """The studies' bench with a hundredth of the panel's pixels and a small sensor, and a scene."""
    folder = tmp_path_factory.mktemp("small")
    bench = replaced(
        bundled_path("studies/spectral-bench.toml").read_text(),
        {
            "width = 1920": "width = 192",
            "height = 1080": "height = 108",
            "pitch_um = 8.0": "pitch_um = 80.0",
            "width = 288": "width = 96",
            "height = 192": "height = 72",
        },
    )
    scene = replaced(
        bundled_path("studies/spectral.toml").read_text(),
        {
            "tol = 0.05": 'tol = 0.5\neffects = { "panel orders" = false }',
            "../scenes/beads.npz": str(bundled_path("scenes/beads.npz")),
        },
    )
    (folder / "bench.toml").write_text(bench)
    (folder / "scene.toml").write_text(scene)
    return folder / "bench.toml", folder / "scene.toml"


@pytest.fixture(scope="module")
def done(small_files, tmp_path_factory) -> tuple[Path, dict]:
    """The study's folder, and its account as programs read it."""
    folder = tmp_path_factory.mktemp("study") / "out"
    bench, scene = small_files
    keys = (
        "target=beads", "bands_nm=[450,550,650]", "radius_um=60", "iterations=8", "scene_ms=[200]",
        "star_ms=[10]", "coded_star_ms=[80]", "sheet_ms=[50]",
    )  # fmt: skip
    request = StudyRequest("multispectral", keys, bench=bench, scene=scene)
    carry_out_study(request, folder)
    return folder, json.loads((folder / "study.json").read_text())


@pytest.fixture
def few_iterations(monkeypatch):
    """Pictures are compared with each other, and with a prediction that leaves 8 dB."""
    few = partial(restore_spectra, iterations=30)
    for module in (restoration, multispectral_noise, psf_designs, design_judgement):
        monkeypatch.setattr(module, "restore_spectra", few)


def values(said: dict, words: str) -> list[float]:
    return [row["value"] for row in said["rows"] if words in row["what"]]


def test_bands_are_restored_better_than_published(done):
    """With the real camera: 21.5 dB (Table 4.1). The bench has no dust, and no haze."""
    folder, said = done
    bands = values(said, "band at")
    assert len(bands) == 3
    assert np.mean(bands) == pytest.approx(values(said, "mean PSNR")[0])
    assert values(said, "mean PSNR")[0] > 21.5
    assert values(said, "spectral angle")[0] < 15
    assert {row["published"][:4] for row in said["rows"][:3]} == {"27.6", "28.6", "26.7"}
    page = (folder / "study.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert "SIMULATED" in page


def test_true_bands_are_the_reflectances_of_the_beads(done):
    """Means of parts of the frame, which shows 1 / 1.05 of the file's picture."""
    file = np.load(bundled_path("scenes/beads.npz"))["reflectance"] / 1000
    rows, columns, _ = file.shape
    side = 1.05 * max(72 / rows, 96 / columns)
    with Record(done[0] / "run.h5") as record:
        problem = read_problem(record, Progress())
    parts, wanted = [], []
    for y, x in ((18, 24), (18, 72), (54, 24), (54, 72)):
        at = zip((y, x), (72, 96), (rows, columns), strict=True)
        v, u = (round((place - n / 2) / side + m / 2) for place, n, m in at)
        reach = round(12 / side)
        seen = file[v - reach : v + reach, u - reach : u + reach, [5, 15, 25]]
        wanted.append(seen.mean((0, 1)))
        parts.append(problem.equalised_truth[:, y - 12 : y + 12, x - 12 : x + 12].mean((1, 2)))
    # Light far from the star's middle is left out at this tolerance, so that ratios are compared.
    found, known = (np.array(one) / np.mean(one, axis=0) for one in (parts, wanted))
    assert found == pytest.approx(known, abs=0.06)


def test_noise_is_added_in_shares_of_white(done):
    with Record(done[0] / "run.h5") as record:
        problem = read_problem(record, Progress())
    noisy = multispectral_noise.add_noise(problem, 0.1, 3)
    added = (noisy.rate - problem.rate) / problem.response.white
    assert np.std(added) == pytest.approx(0.1, rel=0.03)
    assert np.mean(added) == pytest.approx(0, abs=0.006)
    assert multispectral_noise.add_noise(problem, 0.0, 3) is problem


@pytest.mark.usefixtures("few_iterations")
def test_more_noise_is_a_worse_picture(done):
    settings = MultispectralNoiseSettings(
        bands_nm=BANDS_NM, noise=(0.0, 0.1), seeds=2, side_px=64, ring_px=8.0
    )
    with Record(done[0] / "run.h5") as record:
        found = multispectral_noise.evaluate(record, settings, Progress())
    bench, computed = (found.data[name] for name in ("bench", "computed"))
    assert bench["0.1"][0] < bench["0"][0] - 2
    assert np.mean(computed["0.1"]) < computed["0"][0] - 2
    assert len(computed["0"]) == 1
    assert len(computed["0.1"]) == 2
    published = [row.published for row in found.rows]
    assert published == ["22.3 dB (Table 4.2)"] * 2 + ["14.8 dB (Table 4.2)"] * 2


@pytest.mark.usefixtures("few_iterations")
def test_designs_are_measured_drawn_and_restored(done):
    settings = PSFDesignSettings(
        bands_nm=BANDS_NM, radius_um=60.0, shapes=("ring",), side_px=64, twelve=False
    )
    with Record(done[0] / "run.h5") as record:
        found = psf_designs.evaluate(record, settings, Progress())
    names = {"ring, bench", "ring, drawn", "spiral, drawn", "dots, drawn"}
    assert set(found.data) == names | {"linear dispersion, drawn"}
    for one in found.data.values():
        assert np.mean(one["psnr_db"]) == pytest.approx(one["predicted_psnr_db"], abs=8)
        # The middle of a PSF belongs to all bands: its power is above that of disjoint ones.
        assert 1 / 12 < one["dispersion_power"] < 1
    assert any("Fig. 4.11" in row.published for row in found.rows)


def test_the_window_holds_the_longest_band():
    settings = PSFDesignSettings()
    camera = read_bench(bundled_path("studies/spectral-bench.toml")).build_camera()
    largest = 116 * 700 / 550 / 7.4
    assert psf_window(settings, camera) > 2 * largest
    drawn = draw_designs(settings, camera, [450e-9, 700e-9])
    ring = drawn["ring"][1]
    y, x = np.indices(ring.shape) - ring.shape[0] // 2
    far = np.hypot(y, x)
    assert (ring * far).sum() / 0.8 == pytest.approx(largest, rel=0.02)


def test_a_snapshot_is_the_sum_over_bands():
    """Eq. 4.2, pixel by pixel."""
    rng = np.random.default_rng(0)
    truth, psfs = rng.random((2, 9, 8)), rng.dirichlet(np.ones(9), 2).reshape(2, 3, 3)
    mosaic, wavelengths = bundled_mosaic(), (500e-9, 600e-9)
    shares = filter_shares(mosaic, wavelengths)
    assert shares.sum(0) == pytest.approx([1, 1])
    found = compute_snapshot(truth, psfs, mosaic, wavelengths, noise=0.0, seed=0)
    raw = np.asarray(found.observation.image)
    for y, x in ((0, 0), (4, 3), (5, 6), (8, 7)):
        letter = mosaic.channels.index(mosaic.pattern[y % 2][x % 2])
        light = 0.0
        for n in range(2):
            for v in range(3):
                for u in range(3):
                    row, column = y - (v - 1), x - (u - 1)
                    if 0 <= row < 9 and 0 <= column < 8:
                        light += shares[letter, n] * psfs[n, v, u] * truth[n, row, column]
        assert raw[y, x] == pytest.approx(light, rel=1e-5)
    noisy = compute_snapshot(truth, psfs, mosaic, wavelengths, noise=0.5, seed=1)
    assert np.std(np.asarray(noisy.observation.image) - raw) == pytest.approx(0.5, rel=0.25)
    assert found.mean_level(truth + 0.1 * (truth < 0.5) - 0.1 * (truth >= 0.5)) == pytest.approx(20)


def test_the_chart_has_its_measured_reflectances():
    chart = read_spectra(bundled_path("spectra/colorchecker.csv"))
    drawn = chart_cube(BANDS, 96)
    assert drawn.shape == (3, 96, 96)
    for number, patch in enumerate(chart.values()):
        row, column = divmod(number, 6)
        wanted = [patch.at(one) for one in BANDS]
        assert drawn[:, 24 * row + 12, 16 * column + 8] == pytest.approx(wanted)
    assert drawn[:, 0, 0] == pytest.approx([0.03] * 3)


def test_a_band_that_no_filter_sees_is_refused():
    with pytest.raises(ValueError, match="no filter of the sensor sees the band at 1000 nm"):
        filter_shares(bundled_mosaic(), (550e-9, 1000e-9))


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["multispectral", "bands_nm=[550,500]"], "give rising wavelengths, each once"),
        (["multispectral", "bands_nm=[350,500]"], "bands_nm"),
        (["multispectral", "target=lemon"], "target"),
        (["multispectral", "light=D56"], "D56: is neither a CIE illuminant nor a file"),
        (["multispectral-noise", "noise=[-0.1]"], "noise"),
        (["psf-designs", 'shapes=["triangle"]'], "shapes"),
    ],
)
def test_what_cannot_be_studied_is_said_in_words(labapp, tmp_path, words, complaint):
    code, _, said = labapp("study", *words, "--out", tmp_path / "out")
    assert code == 1
    assert complaint in " ".join(said.split())
    assert not (tmp_path / "out" / "run.h5").exists()
