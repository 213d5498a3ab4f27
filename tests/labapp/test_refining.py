"""`labapp refine`: designs that the bench's own camera corrects."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import torch

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile
from labapp.files.calibration_file import CalibrationFile, calibration_to_json
from labapp.files.design_file import read_design, write_design
from labapp.files.reading import read_file
from labapp.refining.command import run_refinement
from labapp.refining.psf_measurement import whole_periods
from labapp.refining.refinement_request import RefinementRequest
from labapp.refining.sensor_view import SensorView, nominal_registration
from labapp.refining.start import build_start
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from optics.camera import Camera, Panel, Sensor
from optics.measuring.registration import Registration
from optics.progress import Cancelled, Progress
from optics.retrieval import design_plane
from optics.retrieval.goal import RetrievalGoal
from optics.slm import PanelMap, phase_to_grey

pytestmark = pytest.mark.usefixtures("white_sheets")

WAVE = 550e-9
PANEL = Panel(shape=(108, 192), pitch=80e-6, fill_factor=0.9)
CAMERA = Camera(PANEL, sensor=Sensor(shape=(64, 96)))
LENGTH = 384
SCALE = WAVE * CAMERA.lens.image_distance / 80e-6 / 3.45e-6
"""Sensor pixels per cycle per panel pixel."""

TRUTH = """
[truth.panel]
response = { gamma = 1.35, range = 0.9 }
"""


def add(path: Path, text: str) -> None:
    path.write_text(path.read_text() + text)


@pytest.fixture(scope="module")
def made() -> dict[tuple[str, ...], bytes]:
    """Design files that are there already."""
    return {}


@pytest.fixture
def design(small, labapp, made):
    """A design file of a shape and so many frames."""

    def make(*words: str, frames: int = 2) -> Path:
        path = small.folder / "design.h5"
        words = words or ("spiral", "radius_um=70", "width_um=7", "turns=1.5")
        asked = ("retrieve", *words, "--iterations", "30", "--frames", str(frames))
        if asked not in made:
            assert labapp(*asked, "--out", path, "--bench", small.bench)[0] == 0
            made[asked] = path.read_bytes()
        path.write_bytes(made[asked])
        return path

    return make


def error_of(grey: np.ndarray, phase_of: np.ndarray, target: np.ndarray) -> float:
    """NRMSE of the mean PSF that grey levels give, by a plain FFT, where the target is bright."""
    field = np.exp(1j * phase_of[grey])
    far = np.abs(np.fft.fftshift(np.fft.fft2(field, (LENGTH, LENGTH)), axes=(1, 2))) ** 2
    rows, columns = target.shape
    at = LENGTH // 2 - rows // 2, LENGTH // 2 - columns // 2
    seen = far.mean(0)[at[0] : at[0] + rows, at[1] : at[1] + columns]
    bright = target > 0.02 * target.max()
    seen, wanted = seen[bright], target[bright]
    best = (seen @ wanted) / (wanted @ wanted)
    return np.linalg.norm(seen - best * wanted) / np.linalg.norm(best * wanted)


@pytest.mark.usefixtures("drawn")
def test_pictures_make_a_design_better_on_a_bench_that_nobody_has_described(
    labapp, small, design, tmp_path
):
    """By what the camera saw, and by a sum over the panel with its true response."""
    bright = small.scene.read_text().replace("radiance = 5.0", "radiance = 50.0")
    small.scene.write_text(bright + TRUTH)
    first, path = design("ring", "radius_um=70", "width_um=8"), tmp_path / "better.h5"
    asked = ("refine", first, *small.arguments(), "--exposures-ms", "30;250", "--json")
    code, out, err = labapp(*asked, "--pictures", 8, "--out", path)
    assert code == 0, err
    assert "no registration is in force" in err
    data = json.loads(out)
    errors = [one["nrmse"] for one in data["pictures"]]
    assert min(errors) < 0.8 * errors[0]
    assert data["best"] == 1 + int(np.argmin(errors))
    assert data["files"] == [str(path), str(tmp_path / "better_psf.png")]
    before, after = read_design(first), read_design(path)
    shares = 0.9 * np.linspace(0, 1, 256) ** 1.35
    # Between the table's 532 and 633 nm the phase goes as 1/wavelength, nearly.
    reach = np.interp(550, [532, 633], [6.7, 5.4]) * math.pi
    worse, better = (
        error_of(one.grey, reach * shares, before.target.images[0]) for one in (before, after)
    )
    assert better < 0.9 * worse
    # The file says how it came about, and can be refined again.
    account = after.settings["refined"][0]
    assert [one["nrmse"] for one in account["pictures"]] == errors
    assert after.quality["seen_nrmse"] == errors
    assert account["from"] == str(first)
    assert {key: after.settings[key] for key in before.settings} == before.settings
    shown = phase_to_grey(PANEL, torch.from_numpy(after.phase), WAVE, after.orders)
    assert (shown.numpy() == after.grey).all()
    drawn = cv2.imread(str(tmp_path / "better_psf.png"))
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 100
    again = tmp_path / "again.h5"
    code, out, _ = labapp(
        "refine", path, *small.arguments(), "--exposures-ms", 250, "--pictures", 2, "--out", again
    )
    assert code == 0
    assert "picture-1.h5" in out
    assert len(read_design(again).settings["refined"]) == 2


def test_every_picture_is_a_record_of_what_was_shown(labapp, small, design, tmp_path):
    first = design("ring", "radius_um=50", frames=1)
    code, _, err = labapp(
        "refine", first, *small.arguments(), "--pictures", 2, "--exposures-ms", "2;20",
        "--out", tmp_path / "b.h5", "--runs", tmp_path / "runs",
    )  # fmt: skip
    assert code == 0, err
    with Record(tmp_path / "runs/picture-1.h5") as record:
        assert record.state is State.COMPLETE
        assert (record.pattern("picture-1") == read_design(first).grey[0]).all()
        assert len(record.select(target="dark")) == 4
        assert sorted(set(record.column("exposure").tolist())) == pytest.approx([2e-3, 20e-3])
    assert (tmp_path / "runs/picture-2/plan.toml").is_file()


def registered(matrix: np.ndarray, centre: tuple[float, float]) -> Registration:
    none = np.zeros((0, 2))
    return Registration(
        WAVE, centre, matrix, np.zeros((3, 3)), (0, 0), none, np.zeros(0, dtype=bool)
    )


def turned(degrees: float, flip_x: bool) -> np.ndarray:
    """From cycles per panel pixel to sensor pixels, (y, x): mirrored first, then turned."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return SCALE * np.array([[c, s], [-s, c]]) @ np.diag([1, -1 if flip_x else 1])


BLOBS = [(-0.04, 0.06, 0.02, 1.0), (0.05, 0.02, 0.03, 0.6), (0.0, -0.07, 0.025, 0.8)]
NARROW = [(-0.04, 0.06, 0.005, 1.0), (0.05, 0.02, 0.006, 0.6), (0.0, -0.07, 0.005, 0.8)]
"""y, x and width in cycles per panel pixel, and peak, of Gaussians."""

WINDOW, CENTRE, SENSOR = (101, 128), (43.3, 58.8), (88, 112)
SKEWED = np.diag([0.5, 0.9]) @ turned(200.0, flip_x=True)
"""As if the sensor's pixels were oblongs that lie askew before the panel."""


def grid(shape: tuple[int, int], centre: tuple[float, float]) -> np.ndarray:
    """(y, x) of samples, beside a centre."""
    return np.stack(np.indices(shape), -1) - np.array(centre)


ON_PLANE = grid(WINDOW, (50, 64)) / LENGTH


def light(blobs, vectors: np.ndarray) -> np.ndarray:
    return sum(
        peak * np.exp(-((vectors - (y, x)) ** 2).sum(-1) / (2 * width**2))
        for y, x, width, peak in blobs
    )


def view_of(blobs, matrix: np.ndarray, star: float = 0.0) -> SensorView:
    plane = design_plane(CAMERA, WAVE, WINDOW)
    goal = RetrievalGoal(CAMERA, torch.from_numpy(light(blobs, ON_PLANE)), plane, WAVE)
    return SensorView(goal, registered(matrix, CENTRE), SENSOR, star, is_calibrated=True)


@pytest.mark.parametrize("matrix", [turned(200.0, flip_x=True), turned(-35.0, flip_x=False)])
def test_a_turned_and_mirrored_picture_is_laid_on_the_design_grid(matrix):
    view = view_of(BLOBS, matrix)
    picture = light(BLOBS, grid(SENSOR, CENTRE) @ np.linalg.inv(matrix).T)
    laid = view.resample_picture(picture).numpy()
    assert view.on_sensor.mean() > 0.5
    assert np.abs(laid - light(BLOBS, ON_PLANE))[view.on_sensor].max() < 2e-3
    # The nearest pixel's value is beside it by half a pixel's diagonal of slope at most.
    assert np.abs(view.resample_nearest(picture).numpy() - laid)[view.on_sensor].max() < 0.1


@pytest.mark.parametrize("star", [0.0, 1.5, 4.0])
def test_the_camera_sees_pixels_and_a_disc_askew_before_the_panel(star):
    """Against a mean over the square and the disc, of Gaussians that are known everywhere."""
    inside = (np.arange(12) + 0.5) / 12 - 0.5
    square = np.stack(np.meshgrid(inside, inside, indexing="ij"), -1).reshape(-1, 2)
    radius = star / 2 * np.sqrt((np.arange(8) + 0.5) / 8)[:, None]
    angle = 2 * math.pi * np.arange(16) / 16
    disc = np.stack([radius * np.sin(angle), radius * np.cos(angle)], -1).reshape(-1, 2)
    offsets = (square[:, None] + disc).reshape(-1, 2) @ np.linalg.inv(SKEWED).T
    seen = view_of(NARROW, SKEWED, star).target.numpy() * light(NARROW, ON_PLANE).max()
    for i, j in [(35, 87), (33, 88), (36, 84), (69, 72), (71, 70), (50, 37), (53, 39), (40, 60)]:
        wanted = light(NARROW, ON_PLANE[i, j] + offsets).mean()
        assert seen[i, j] == pytest.approx(wanted, abs=2e-3)


def test_light_at_an_edge_of_the_window_is_not_seen_at_the_other():
    seen = view_of([(0, 62 / LENGTH, 0.005, 1.0)], SKEWED, star=4.0).target
    assert seen[50, -3] > 0.2
    assert seen[:, :30].max() < 1e-4


def test_a_bench_without_registration_is_taken_as_described():
    """A grating of so many cycles sends light to wavelength x distance x its frequency."""
    found = nominal_registration(CAMERA, WAVE).to_pixels(np.array([[0, 0], [0.1, 0], [0, -0.05]]))
    z = CAMERA.lens.image_distance
    reach = 0.1 / 80e-6 * WAVE * z / 3.45e-6
    assert found == pytest.approx(np.array([[32, 48], [32 + reach, 48], [32, 48 - reach / 2]]))


def test_what_falls_beside_the_sensor_is_an_error():
    with pytest.raises(UserError, match=r"columns -?\d+ to \d+ of a sensor of 64 x 96 pixels"):
        SensorView(
            view_of(BLOBS, turned(0, False)).goal,
            registered(turned(0, False), (31, 90)),
            (64, 96),
            1.0,
            True,
        )


def calibration(matrix: np.ndarray) -> CalibrationFile:
    """Of a registration alone."""
    return CalibrationFile.model_validate(
        {
            "version": 1, "date": datetime.now(UTC), "bench": "Small bench", "record": "none",
            "frames": 7, "software": "test", "devices": {}, "panel": {}, "lens": {}, "sensor": {},
            "registrations": [
                {
                    "wavelength_nm": 500.0, "centre_px": (32.0, 48.0),
                    "matrix_px": (matrix * 500 / 550).tolist(),
                    "covariance_px2": np.zeros((3, 3)).tolist(), "uncertainty_px": 0.1,
                    "residual_px": 0.1, "shift_px": (0, 0), "spots": 6, "outliers": 0,
                    "flip": "left-right", "rotation_deg": 25.0, "shear": 0.0,
                    "image_distance_mm": 133.3,
                }
            ],
        }
    )  # fmt: skip


def test_a_calibration_tells_how_the_panel_sits(small, design, tmp_path):
    """A panel that is mirrored and turned: its picture fits with the registration only."""
    first = design(frames=1)
    add(small.scene, "\n[truth.mount]\nrotation_deg = 25.0\nflip_x = true\n")
    request = RefinementRequest(pictures=2, exposures_ms=(4.0, 60.0))
    errors = []
    for name in ("described", "calibrated"):
        with open_bench(small.bench_files) as bench:
            found = run_refinement(bench, read_design(first), first, tmp_path / name, request)
        errors.append(found.pictures[0].nrmse)
        (small.folder / "c.json").write_bytes(
            calibration_to_json(calibration(turned(25, flip_x=True)))
        )
        text = small.bench.read_text()
        small.bench.write_text(text.replace("[panel]", 'calibration = "c.json"\n[panel]', 1))
    assert found.view.is_calibrated
    assert errors[0] > 0.6
    assert errors[1] < 0.3


def test_exposures_of_videos_are_whole_periods():
    request = RefinementRequest(exposures_ms=(1.0, 100.0, 66.7, 133.4, 400.0))
    assert whole_periods(request, 4 / 60) == [1, 2, 3, 6]
    assert whole_periods(RefinementRequest(exposures_ms=(1000 * 4 / 60,)), 4 / 60) == [1]


def test_a_design_of_grey_levels_starts_from_the_phases_that_they_show(design, small):
    path = design()
    contents = read_design(path)
    camera = read_file(small.bench, BenchFile).build_camera()
    bumps = torch.linspace(-80e-9, 120e-9, 12, dtype=torch.float64).reshape(3, 4)
    uneven = replace(camera, panel=replace(camera.panel, flatness=PanelMap(bumps)))
    start = build_start(replace(contents, phase=None), path, uneven)
    assert start.phases.shape == contents.grey.shape
    assert (start.grey_levels(start.phases) == contents.grey).all()


def test_videos_of_slow_panels_keep_their_short_ways(design, small):
    """The same light, and steps from frame to frame that are shorter in the mean."""
    path = design(frames=3)
    contents = read_design(path)
    camera = read_file(small.bench, BenchFile).build_camera()
    slow = replace(camera, panel=replace(camera.panel, response_time=5e-3))
    start = build_start(replace(contents, orders=3), path, slow)
    shown = start.phases_on_panel(start.phases)
    turns = (shown - start.phases) / (2 * math.pi)
    assert (turns - turns.round()).abs().max() < 1e-4
    plain = torch.remainder(start.phases, 2 * math.pi)
    assert (shown - shown.roll(1, 0)).square().mean() < 0.8 * (
        plain - plain.roll(1, 0)
    ).square().mean()
    still = build_start(contents, path, camera)
    assert still.phases_on_panel(still.phases) is still.phases


def test_cancelling_leaves_the_bench_safe_and_the_records_readable(small, design, tmp_path):
    first = design("ring", "radius_um=50", frames=1)

    def listen(fraction: float, message: str) -> None:
        if "star, picture-2" in message:
            progress.cancel()

    progress = Progress(listen)
    request = RefinementRequest(exposures_ms=(2.0, 20.0))
    with open_bench(small.bench_files) as bench:
        with pytest.raises(Cancelled):
            run_refinement(bench, read_design(first), first, tmp_path / "runs", request, progress)
        assert bench.slm.displayed_pattern == "neutral"
        assert not bench.world.grey.any()
    with Record(tmp_path / "runs/picture-1.h5") as record:
        assert record.state is State.COMPLETE
    with Record(tmp_path / "runs/picture-2.h5") as record:
        assert record.state is State.CANCELLED


WRONG = [
    (("--exposures-ms", "1,x"), "1,x: give milliseconds with commas or semicolons between"),
    (("--exposures-ms", "-1"), "refine: key 'exposures_ms.0' is -1.0: input should be greater"),
    (("--exposures-ms", "20000"), "of the PSF is clipped in every exposure; the shortest is 20000"),
    (("--exposures-ms", "0.02"), "the PSF can't be told from noise. Expose longer"),
    (("--exposures-ms", "99999"), "99999 ms, out of the camera's range"),
    (("--pictures", "1"), "refine: key 'pictures' is 1: input should be greater than or equal"),
    (("--star", "sun"), "--star sun: this bench has no such target. Choose among dark, star"),
    (("--dark", "night"), "--dark night: this bench has no such target"),
    (("--star", "photograph"), "give the diameter of the pinhole with --star-um"),
    (("--star-um", "0"), "refine: key 'star_um' is 0"),
    (("--out", "better.png"), "better.png: the ending must be .h5"),
    (("--out", "nowhere/better.h5"), "nowhere: is not a folder"),
]


@pytest.mark.parametrize(("options", "message"), WRONG, ids=[" ".join(one[0]) for one in WRONG])
def test_what_is_wrong_is_said_in_a_line(labapp, small, design, tmp_path, options, message):
    first = design("ring", "radius_um=50", frames=1)
    out = tmp_path / "better.h5"
    code, printed, err = labapp("refine", first, *small.arguments(), "--out", out, *options)
    assert code == 1
    assert message in err
    assert not printed
    assert not out.exists()


def test_a_video_that_clips_needs_less_light(labapp, small, design, tmp_path):
    first = design("ring", "radius_um=50", frames=2)
    text = small.scene.read_text()
    small.scene.write_text(text.replace("radiance = 5.0", "radiance = 5000.0"))
    asked = ("refine", first, *small.arguments(), "--out", tmp_path / "b.h5")
    code, _, err = labapp(*asked)
    assert code == 1
    assert "whole periods of 33.3333 ms: dim the lamp, or make it of fewer frames" in err


@pytest.mark.parametrize(
    ("words", "frames", "message"),
    [
        (("shrinking-spiral", "radius_um=60"), 2, "changes with time, and a picture shows its"),
        (("ring", "radius_um=150"), 1, "the target falls on rows -"),
    ],
)
def test_what_a_picture_cannot_show_is_refused(
    labapp, small, design, tmp_path, words, frames, message
):
    first = design(*words, frames=frames)
    code, _, err = labapp("refine", first, *small.arguments(), "--out", tmp_path / "b.h5")
    assert code == 1
    assert message in err
    assert not list(tmp_path.glob("b*.h5"))


def test_a_design_of_another_kind_or_panel_is_refused(labapp, small, design, tmp_path):
    lens, first, other = tmp_path / "lens.h5", design(frames=1), tmp_path / "other.h5"
    asked = ("pattern", "lens", "focal_length_m=20", "--out", lens, "--bench", small.bench)
    assert labapp(*asked)[0] == 0
    write_design(other, replace(read_design(first), pixel_pitch=8e-6))
    bare = tmp_path / "bare.h5"
    write_design(bare, replace(read_design(first), settings={}))
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(first.read_bytes())
    with h5py.File(damaged, "r+") as file:
        del file["entry/settings"]
    for path, message in (
        (lens, "has no target to come nearer to. Give a design that labapp retrieve wrote"),
        (other, "is for a panel of 192 x 108 pixels of 8 µm, and this bench's has 192 x 108 of 80"),
        (bare, "its settings name no pattern"),
        (damaged, "damaged.h5: is damaged"),
        (small.scene, "scene.toml: cannot be read as HDF5"),
        (tmp_path / "none.h5", "none.h5: cannot be read: there is no such file"),
    ):
        code, _, err = labapp("refine", path, *small.arguments(), "--out", tmp_path / "b.h5")
        assert code == 1
        assert message in err


def test_nothing_is_replaced_without_leave(labapp, small, design, tmp_path):
    first = design("ring", "radius_um=50", frames=1)
    asked = ("refine", first, *small.arguments(), "--out", tmp_path / "b.h5", "--pictures", 2)
    files = [tmp_path / name for name in ("b.h5", "b_psf.png", "b_runs/picture-2.h5")]
    for file in reversed(files):
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(b"mine")
        code, _, err = labapp(*asked)
        assert code == 1
        assert f"{file.name}: exists already" in err
    assert all(file.read_bytes() == b"mine" for file in files)
    assert labapp(*asked, "--force")[0] == 0
    assert all(file.read_bytes() != b"mine" for file in files)


def test_without_a_place_to_write_there_is_nothing_to_do(labapp, tmp_path):
    code, _, err = labapp("refine", tmp_path / "x.h5")
    assert code == 1
    assert "there is no --out. Name an .h5 file" in err
