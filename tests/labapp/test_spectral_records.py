"""Coded snapshots of a small virtual bench, restored into cubes and judged by its scene."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import torch
from forging import forge, replace_text
from scipy.signal import fftconvolve
from small_bench.spectral import (
    BANDS_NM,
    COLUMNS,
    PITCH_UM,
    ROWS,
    patch_means,
    patch_reflectances,
    patches,
    star_place,
    take_record,
)

from labapp.common.errors import UserError
from labapp.files.cubes import SpectralCube, read_cube, write_cube
from labapp.pictures.analysis.star_psf import predict_star
from labapp.runs.record.reader import Record
from labapp.spectral.lights import find_light
from labapp.spectral.problem import SpectralProblem
from labapp.spectral.request import SpectralRequest
from labapp.spectral.restoration import RestoredCube, restore_snapshot
from optics.multispectral import restore_spectra
from optics.progress import Progress

pytestmark = pytest.mark.usefixtures("white_sheets")

BANDS = tuple(one / 1e9 for one in BANDS_NM)
ALL = ",".join(f"{one:g}" for one in BANDS_NM)


@pytest.fixture(scope="module", autouse=True)
def few_iterations():
    """Restorations are compared with each other here, but for the command's."""
    with pytest.MonkeyPatch.context() as patch:
        few = partial(restore_spectra, iterations=30)
        patch.setattr("labapp.spectral.restoration.restore_spectra", few)
        yield


@pytest.fixture(scope="module")
def record(tmp_path_factory) -> Path:
    return take_record(tmp_path_factory.mktemp("spectral"))


@pytest.fixture(scope="module")
def problem(record) -> SpectralProblem:
    return SpectralRequest(record).read_problem(Progress())


@pytest.fixture(scope="module")
def restored(problem) -> RestoredCube:
    return restore_snapshot(problem, find_light("D65"))


def predicted_psfs(record: Path) -> np.ndarray:
    """From the description of the camera, on the pixel beside which the star is, each of sum 1."""
    with Record(record) as read:
        camera = read.bench.build_camera()
        grey = [torch.from_numpy(read.pattern("ring"))]
    found = [predict_star(camera, grey, one, 70e-6, 2.0, 41)[0].numpy() for one in BANDS]
    return np.stack([one / one.sum() for one in found])


@pytest.mark.usefixtures("drawn")
def test_the_command_restores_the_patches_of_the_scene(labapp, record, tmp_path, monkeypatch):
    monkeypatch.setattr("labapp.spectral.restoration.restore_spectra", restore_spectra)
    out = tmp_path / "cube.h5"
    code, printed, errors = labapp("reconstruct", record, "--bands", "all", "--out", out, "--json")
    assert code == 0, errors
    said = json.loads(printed)
    assert said["bands_nm"] == list(BANDS_NM)
    assert said["white"] == "the white sheet 'flat'"
    assert said["score"]["psnr_db"] > 21
    assert said["score"]["spectral_angle_deg"] < 9
    assert said["score"]["crop"] == "full frame"
    cube = read_cube(out)
    assert cube.wavelengths == pytest.approx(BANDS)
    assert cube.pitch == pytest.approx(PITCH_UM * 1e-6)
    assert cube.values.min() >= 0
    wrong = patch_means(cube.values) - patch_reflectances()
    assert np.sqrt(np.mean(wrong**2)) < 0.05
    assert np.abs(wrong).max() < 0.15
    assert cube.error is not None
    assert np.median(cube.error) < 0.3
    colours = cv2.imread(said["colours"])
    assert colours.shape == (ROWS, COLUMNS, 3)
    assert cv2.imread(said["picture"]).shape[1] > 500


@pytest.mark.usefixtures("drawn")
def test_some_bands_are_written_as_envi_and_told_to_a_person(labapp, record, tmp_path):
    out = tmp_path / "leaf.hdr"
    code, printed, errors = labapp(
        "reconstruct", record, "--bands", "620,460", "--out", out, "--light", "A"
    )
    assert code == 0, errors
    said = " ".join(printed.split())
    assert "460, 620 nm" in said
    assert "the sum of 2 photographs in narrow light" in said
    assert "dB, mean of the bands (full frame, peak 1)" in said
    assert "in A, by straight lines to 1 nm" in said
    assert "a common shift of all PSFs" in errors
    assert read_cube(out).wavelengths == pytest.approx((460e-9, 620e-9))
    assert (tmp_path / "leaf.raw").stat().st_size == 2 * ROWS * COLUMNS * 4
    assert (tmp_path / "leaf_colours.png").is_file()
    assert (tmp_path / "leaf_bands.png").is_file()


def test_the_psfs_are_those_of_the_pattern(problem, record):
    known = predicted_psfs(record)
    for measured, one in zip(problem.psfs, known, strict=True):
        shape = measured / measured.sum()
        # The star is beside the middle of a pixel, which the prediction isn't.
        assert np.linalg.norm(shape - one) < 0.6 * np.linalg.norm(one)
        assert 0.85 < measured.sum() < 1.0


def test_without_the_psfs_the_bands_are_worse(problem, restored):
    point = np.zeros_like(problem.psfs)
    point[:, point.shape[1] // 2, point.shape[2] // 2] = 1.0
    blurred = restore_snapshot(replace(problem, psfs=point), find_light("D65"))
    assert restored.scores.psnr > blurred.scores.psnr + 1


def test_the_star_is_as_white_as_the_sheet(record, problem):
    by_star = SpectralRequest(record, white="star").read_problem(Progress())
    assert by_star.response.source == "the light of the star 'star'"
    assert by_star.response.white is None
    ratio = by_star.response.shares / problem.response.shares
    assert ratio[problem.response.shares > 0.1] == pytest.approx(1, abs=0.2)
    found = restore_snapshot(by_star, find_light("D65"))
    assert found.truth.values.max() > 1
    assert np.percentile(found.truth.values, 99.9) == pytest.approx(1, abs=1e-3)


def test_the_stars_place_is_that_of_the_scene(record):
    from labapp.pictures.analysis.brackets import merge_all
    from labapp.spectral.band_psfs import measure_band_psfs
    from labapp.spectral.roles import choose_roles

    with Record(record) as read:
        roles = choose_roles(read, None, None, None)
        brackets = merge_all(read, Progress(), {"star"})
        found = measure_band_psfs(read, brackets, roles, BANDS)
    for spot in found.spots:
        assert (spot.y, spot.x) == pytest.approx(star_place(), abs=0.2)


def test_psfs_of_a_file_serve_as_well(record, tmp_path, restored):
    stack = SpectralCube(
        3 * predicted_psfs(record), BANDS, "share of light per pixel", pitch=PITCH_UM * 1e-6
    )
    write_cube(tmp_path / "psfs.h5", stack)
    np.save(tmp_path / "psfs.npy", stack.values)
    by_cube = SpectralRequest(record, psf=tmp_path / "psfs.h5").read_problem(Progress())
    by_array = SpectralRequest(record, BANDS, psf=tmp_path / "psfs.npy").read_problem(Progress())
    assert np.array_equal(by_cube.psfs, by_array.psfs)
    own = SpectralRequest(record, psf=record).read_problem(Progress())
    found = restore_snapshot(own, find_light("D65"))
    assert found.scores.psnr == pytest.approx(restored.scores.psnr, abs=0.3)


def test_a_true_cube_or_another_record_judges(labapp, record, tmp_path, restored):
    other = tmp_path / "stack.h5"
    shutil.copy(record, other)
    found = SpectralRequest(record, truth=other).read_problem(Progress())
    assert "stack.h5" in found.truth_source
    own = SpectralRequest(record).read_problem(Progress())
    assert np.array_equal(found.truth, own.truth)
    write_cube(tmp_path / "truth.h5", restored.cube)
    given = SpectralRequest(record, truth=tmp_path / "truth.h5").read_problem(Progress())
    same = restore_snapshot(given, find_light("D65"))
    assert same.scores.psnr > 100


WRONG = [
    (["--bands", "0.45,0.55"], "--bands 0.45,0.55: in micrometres? Write nanometres"),
    (["--bands", "4.5e-7,5e-7"], "in metres? Write nanometres"),
    (["--bands", "450000,500000"], "in picometres? Write nanometres"),
    (["--bands", "5,6"], "no visible light in nanometres"),
    (["--bands", "blue"], "isn't a list of numbers. Write nanometres"),
    (["--bands", "460"], "is one band. Name two or more"),
    (["--bands", "460,460"], "names a band twice"),
    (["--bands", "460,500"], "at 460, 540, 620 nm. Choose among these"),
    (["--bands", "460,720"], "the filter can be tuned from 440 to 700 nm only"),
    (["--bands", "all", "--star", "sun"], "--star sun: the record has dark, star"),
    (["--bands", "all", "--star", "dark"], "has no star 'dark' with pattern 'ring' at 460 nm"),
    (["--bands", "all", "--pattern", "dots"], "--pattern dots: the record has neutral, ring"),
    (["--bands", "all", "--target", "lemon"], "--target lemon: the record has"),
    (["--bands", "all", "--white", "sheet"], "--white sheet: the record has"),
    (["--bands", "all", "--light", "D56"], "--light D56: is neither a CIE illuminant nor a file"),
    (["--bands", "all", "--noise", "-1"], "--noise -1: give a number above 0"),
    (["--bands", "all", "--weight", "0"], "--weight 0: give a number above 0"),
    (["--bands", "all", "--border", "open"], "--border open: take one of"),
    (["--bands", "all", "--method", "tv"], "--method: means nothing with --bands"),
    (["--bands", "all", "--blind", "15"], "--blind: means nothing with --bands"),
    (["--bands", "all", "--wavelength-nm", "540"], "--wavelength-nm: means nothing with"),
    (["--light", "A"], "--light: means something with --bands only"),
    (["--bands", "all", "--psf", "two.npy"], "doesn't say its wavelengths"),
    (["--bands", ALL, "--psf", "two.npy"], "has 2 PSFs, and there are 3 bands"),
    (["--bands", ALL, "--psf", "flat.npy"], "of shape (5, 5). Give finite numbers"),
    (["--bands", ALL, "--psf", "dark.npy"], "It must send light somewhere"),
    (["--bands", ALL, "--psf", "psf.png"], "bands need a PSF each"),
    (["--bands", ALL, "--psf", "fine.h5"], "3.45 µm apart, and those of the sensor 7.4 µm"),
    (["--bands", ALL, "--psf", "few.h5"], "there is no band at 620 nm"),
    (["--bands", ALL, "--truth", "few.h5"], "there is no band at 620 nm"),
    (["--bands", "460,540", "--truth", "few.h5"], "the true cube is 2 x 5 x 5"),
    (["--bands", ALL, "--truth", "psf.png"], "give a cube (.h5 or .hdr), or the record"),
    (["--bands", ALL, "--out", "cube.tiff"], "the ending says the kind of a cube"),
    (["--bands", ALL, "--picture", "a.jpg"], "--picture a.jpg: must end in .png"),
    (["--bands", ALL, "--out", "few.h5", "--truth", "few.h5"], "few.h5: is a file that is read"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """PSFs and cubes that don't fit the record."""
    made = tmp_path_factory.mktemp("wrong")
    np.save(made / "two.npy", np.ones((2, 5, 5)))
    np.save(made / "flat.npy", np.ones((5, 5)))
    np.save(made / "dark.npy", np.zeros((3, 5, 5)))
    cv2.imwrite(str(made / "psf.png"), np.full((5, 5), 9, np.uint8))
    write_cube(made / "fine.h5", SpectralCube(np.ones((3, 5, 5)), BANDS, pitch=3.45e-6))
    write_cube(made / "few.h5", SpectralCube(np.ones((2, 5, 5)), BANDS[:2]))
    return made


@pytest.mark.parametrize(("options", "words"), WRONG, ids=lambda one: str(one)[:40])
def test_what_cant_be_restored_is_refused_in_words(
    labapp, record, folder, monkeypatch, options, words
):
    monkeypatch.chdir(folder)
    if "--out" not in options:
        options = [*options, "--out", "made.h5" if "--bands" in options else "made.tiff"]
    code, _, errors = labapp("reconstruct", record, *options)
    assert code != 0
    assert words in " ".join(errors.split())
    assert not (folder / "made.h5").exists()


def test_a_picture_is_no_record(labapp, folder):
    code, _, errors = labapp("reconstruct", folder / "psf.png", "--bands", ALL)
    assert code != 0
    assert "--bands needs the record of a run" in errors


def with_frames_lost(record: Path, copy: Path, target: str, wavelength: float | None) -> Path:
    """A copy of a record without the frames of a target, at one wavelength or all."""
    shutil.copy(record, copy)
    with h5py.File(copy, "r+") as file:
        data, names = file["entry/data"], file["entry/targets/names"][()].tolist()
        lost = data["target"][()] == names.index(target.encode())
        if wavelength is not None:
            lost &= np.isclose(data["wavelength"][()], wavelength, atol=1e-11, rtol=0)
        data["stored"][...] = data["stored"][()] * ~lost
    return copy


def test_a_band_without_a_star_is_named(record, tmp_path):
    lost = with_frames_lost(record, tmp_path / "lost.h5", "star", BANDS[1])
    with pytest.raises(UserError, match=r"no star 'star' .* at 540 nm; it has it at 460, 620\."):
        SpectralRequest(lost).read_problem(Progress())
    kept = SpectralRequest(lost, (BANDS[0], BANDS[2])).read_problem(Progress())
    assert kept.wavelengths == pytest.approx((BANDS[0], BANDS[2]))


def test_a_star_without_neutral_frames_gives_psfs_with_a_remark(record, tmp_path, restored):
    copy = tmp_path / "coded.h5"
    shutil.copy(record, copy)
    with h5py.File(copy, "r+") as file:
        data, names = file["entry/data"], file["entry/targets/names"][()].tolist()
        neutral = file["entry/patterns/names"][()].tolist().index(b"neutral")
        lost = (data["target"][()] == names.index(b"star")) & (data["pattern"][()] == neutral)
        data["stored"][...] = data["stored"][()] * ~lost
    found = SpectralRequest(copy).read_problem(Progress())
    assert any("no frames with the pattern 'neutral'" in one for one in found.notes)
    again = restore_snapshot(found, find_light("D65"))
    assert again.scores.psnr > restored.scores.psnr - 4


def test_missing_darks_are_remarked(record, tmp_path):
    lost = with_frames_lost(record, tmp_path / "lost.h5", "dark", None)
    found = SpectralRequest(lost).read_problem(Progress())
    assert any("3 of 3 photographs have no dark frames" in one for one in found.notes)


def edit_bench(path: Path, change) -> None:
    """Change the bench's description in a record."""
    with h5py.File(path, "r+") as file:
        bench = json.loads(file["entry/bench"][()])
        change(bench)
        replace_text(file, "entry/bench", json.dumps(bench))
    forge(path)


def make_monochrome(record: Path, copy: Path, share: float) -> Path:
    """A copy of a record whose pictures a sensor without filters took, by convolutions here.

    The coded pattern passes a share of the light, as rings that grow with the wavelength.
    """
    shutil.copy(record, copy)

    def change(bench):
        del bench["sensor"]["colour"]
        bench["sensor"]["quantum_efficiency"] = 0.6

    edit_bench(copy, change)
    y, x = np.indices((41, 41)) - 20
    rings = [np.abs(np.hypot(y, x) - radius) < 0.7 for radius in (4, 6.5, 9)]
    rng = np.random.default_rng(2)
    cells = patches()[8:88, 12:108, [6, 14, 22]].transpose(2, 0, 1)
    with h5py.File(copy, "r+") as file:
        data = file["entry/data"]
        targets, patterns = (
            [one.decode() for one in file[name][()]]
            for name in ("entry/targets/names", "entry/patterns/names")
        )
        for at, exposure in enumerate(data["exposure"][()]):
            target = targets[data["target"][at]]
            coded = patterns[data["pattern"][at]] == "ring"
            band = int(np.abs(data["wavelength"][at] - np.array(BANDS)).argmin())
            light = {"dark": np.zeros((ROWS, COLUMNS)), "flat": np.full((ROWS, COLUMNS), 2e4)}.get(
                target, 2e4 * cells[band]
            )
            if target == "star":
                light = np.zeros((ROWS, COLUMNS))
                light[40, 48] = 1e6
            if coded:
                kernel = share * rings[band] / rings[band].sum()
                light = fftconvolve(light, kernel, mode="same")
            electrons = rng.poisson(np.clip(light, 0, None) * exposure)
            data["images"][at] = np.clip(80 + electrons / 10, 0, 4095).astype(np.uint16)
    return copy


def test_a_monochrome_sensor_is_restored_with_a_remark(record, tmp_path):
    mono = make_monochrome(record, tmp_path / "mono.h5", 0.8)
    found = SpectralRequest(mono).read_problem(Progress())
    assert found.response.channels == "Y"
    assert found.psfs.sum((1, 2)) == pytest.approx([0.8] * 3, abs=0.03)
    assert any("no colour filters" in one for one in found.notes)
    restored = restore_snapshot(found, find_light("D65"))
    assert restored.scores.psnr > 15


def test_a_neutral_star_that_is_dimmer_than_the_coded_one_is_refused(record, tmp_path):
    mono = make_monochrome(record, tmp_path / "mono.h5", 1.6)
    with pytest.raises(UserError, match=r"has 1\.6 times the light of the neutral one"):
        SpectralRequest(mono).read_problem(Progress())


def make_broad(record: Path, copy: Path) -> Path:
    """A copy of a record whose coded photograph is one frame through an open slot."""
    shutil.copy(record, copy)
    slots = [[one, 10.0] for one in BANDS_NM] + [[545.0, 200.0]]

    def change(bench):
        bench["devices"]["filter"] = {"driver": "simulated-wheel", "options": {"slots_nm": slots}}

    edit_bench(copy, change)
    with h5py.File(copy, "r+") as file:
        data = file["entry/data"]
        targets = [one.decode() for one in file["entry/targets/names"][()]]
        patterns = [one.decode() for one in file["entry/patterns/names"][()]]
        coded = np.flatnonzero(
            (data["target"][()] == targets.index("photograph"))
            & (data["pattern"][()] == patterns.index("ring"))
        )
        total = sum(data["images"][at].astype(int) - 80 for at in coded) + 80
        data["images"][coded[0]] = np.clip(total, 0, 4095).astype(np.uint16)
        data["stored"][coded[1:]] = 0
        for name in ("wavelength", "wavelength_asked"):
            data[name][coded[0]] = 545e-9
    forge(copy)
    return copy


def test_one_photograph_in_broad_light_is_the_snapshot(labapp, record, tmp_path, restored):
    broad = make_broad(record, tmp_path / "broad.h5")
    found = SpectralRequest(broad, white="star").read_problem(Progress())
    assert found.wavelengths == pytest.approx(BANDS)
    assert "one photograph in broad light" in found.source
    assert any("broad light" in one for one in found.notes)
    by_star = restore_snapshot(
        SpectralRequest(record, white="star").read_problem(Progress()), find_light("D65")
    )
    again = restore_snapshot(found, find_light("D65"))
    assert again.scores.psnr > by_star.scores.psnr - 3
    with pytest.raises(UserError, match="--white flat: the snapshot is one photograph in broad"):
        SpectralRequest(broad).read_problem(Progress())
    code, _, errors = labapp("reconstruct", broad, "--bands", "460,690", "--out", tmp_path / "a.h5")
    assert code != 0
    assert "through a filter that passes 445 to 645 nm" in errors
