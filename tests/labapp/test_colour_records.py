"""Records of a sensor with colour filters: restored in colour, or grey by name."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from skimage import data

from labapp.bench.opening import BenchFiles, open_bench
from labapp.common.errors import UserError
from labapp.common.stopwatch import Stopwatch
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.pictures.analysis.dead_pixels import find_dead_pixels
from labapp.pictures.report import page
from labapp.pictures.report.record_analysis import analyse_record
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.studies.command import _evaluate_and_write
from labapp.studies.study_lookup import find_study
from labapp.window.commands import ReconstructRun
from labapp.window.engine.reconstruction import reconstruct_record
from optics.progress import Progress
from optics.sensor import fixed_pattern

pytestmark = pytest.mark.usefixtures("white_sheets")

BENCH = """
version = 1
name = "Colour bench"
transmission = 0.15
[panel]
model = "coarse"
width = 192
height = 108
pitch_um = 80.0
fill_factor = 0.9
unmodulated = 0.05
reflectivity = 0.6
settling_ms = 50.0
max_phase_pi = { 452 = 9.0, 532 = 6.7, 633 = 5.4 }
[lens]
focal_length_mm = 125.0
f_number = 5.0
focus_distance_m = 2.0
[sensor]
file = "dvc-4000c-like"
width = 96
height = 64
dead_pixels_ppm = 1500.0
[devices.slm]
driver = "simulated-slm"
[devices.filter]
driver = "simulated-wheel"
options = { slots_nm = [[550.0, 300.0], [650.0, 10.0]], shape = "interference" }
[devices.camera]
driver = "simulated-camera"
[devices.targets]
driver = "simulated-targets"
"""

SCENE = """
version = 2
title = "A star and a print under halogen"
tol = 0.2
effects = { "panel orders" = false }
[lights.halogen]
kind = "halogen"
[targets.dark]
kind = "dark"
[targets.star]
kind = "star"
diameter_um = 70.0
distance_m = 2.0
radiance = 20.0
light = "halogen"
[targets.photograph]
kind = "photograph"
file = "picture.png"
spectra = "mallett"
distance_m = 2.0
radiance = 0.1
light = "halogen"
"""

PLAN = """
version = 1
title = "Colours"
seed = 5
[patterns.neutral]
kind = "constant"
[patterns.ring]
kind = "ring"
radius_um = 40.0
width_um = 8.0
wavelength_nm = 550
iterations = 10
[[acquire]]
targets = ["star"]
patterns = ["neutral", "ring"]
slots = [{slot}]
exposures_ms = [0.1, {exposure}]
interleave = [{{ role = "dark", frames = 1 }}]
[[acquire]]
targets = ["photograph"]
patterns = ["neutral", "ring"]
slots = [{slot}]
exposures_ms = [{longer}]
interleave = [{{ role = "dark", frames = 1 }}]
[reconstruct]
coded = "ring"
psf_window_px = 33
"""


def run_colours(folder, slot, exposure):
    """A print of a photograph, behind a wide slot of the filter wheel or a narrow one."""
    (folder / "bench.toml").write_text(BENCH)
    (folder / "scene.toml").write_text(SCENE)
    small = cv2.resize(data.astronaut(), (256, 256), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "picture.png"), small[20:84, 70:166, ::-1])
    (folder / "plan.toml").write_text(
        PLAN.format(slot=slot, exposure=exposure, longer=3 * exposure)
    )
    with open_bench(BenchFiles(folder / "bench.toml", folder / "scene.toml")) as bench:
        return run_plan(bench, read_file(folder / "plan.toml", PlanFile), folder / "run.h5").path


@pytest.fixture(scope="module")
def white_record(tmp_path_factory):
    return run_colours(tmp_path_factory.mktemp("white"), 1, 6.4)


@pytest.fixture(scope="module")
def red_record(tmp_path_factory):
    return run_colours(tmp_path_factory.mktemp("red"), 2, 100)


@pytest.mark.parametrize("method", ["tv", "plug-and-play"])
def test_colours_are_restored_together_and_gain(labapp, white_record, tmp_path, method):
    light, picture = tmp_path / "light.npy", tmp_path / "picture.png"
    code, printed, errors = labapp(
        "reconstruct", white_record, "--method", method, "--out", light, "--json", "--force"
    )
    assert code == 0, errors
    told = json.loads(printed)
    assert told["colours"]["channels"] == ["R", "G", "B"]
    assert np.sum(told["colours"]["matrix_to_linear_srgb"], axis=1) == pytest.approx(1)
    before, after = told["score"]["psnr_db"]
    assert after > before + 1
    assert told["dead_share"] > 0
    bands = np.load(light)
    assert bands.shape == (64, 96, 3)
    assert np.isfinite(bands).all()
    code, _, errors = labapp(
        "reconstruct", white_record, "--method", method, "--out", picture, "--force"
    )
    assert code == 0, errors
    shown = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)
    assert shown.shape == (64, 96, 3)
    # The print's own mean colour; what the wheel cuts off and the fit of the matrix shift it.
    printed = cv2.imread(str(white_record.parent / "picture.png"))
    ratio = shown.mean((0, 1)) / printed.mean((0, 1))
    assert ratio / ratio.mean() == pytest.approx(1, abs=0.12)


@pytest.mark.usefixtures("drawn")
def test_window_report_and_command_agree(labapp, white_record, tmp_path, monkeypatch):
    analysis = analyse_record(white_record)
    assert list(analysis.restored_pictures) == ["total-variation", "plug-and-play"]
    assert analysis.images["coded"].shape == (64, 96, 3)
    assert "Reconstruct" not in page.encode_png(analysis.images["coded"]).decode("latin1")
    window = reconstruct_record(ReconstructRun(white_record, "tv", None), Progress())
    assert window.result_message.after.shape == (64, 96, 3)
    shown = tmp_path / "shown.npy"
    window.save(shown)
    restored = analysis.restored_pictures["total-variation"].light
    assert np.array_equal(np.load(shown), np.moveaxis(restored, 0, -1))
    # The command would analyse the record once more.
    monkeypatch.setattr("labapp.pictures.report.analyse_record", lambda *_, **options: analysis)
    code, _, errors = labapp("report", white_record, "--out", tmp_path, "--force")
    assert code == 0, errors


def test_the_dead_pixels_are_found_and_no_others(white_record):
    window = reconstruct_record(ReconstructRun(white_record, "tv", None), Progress())
    found = ~np.isfinite(window.problem.light[0])
    with Record(white_record) as record:
        sensor = record.bench.build_camera().sensor
    dead = fixed_pattern(sensor).response.numpy() == 0
    assert dead.sum() >= 3
    assert not (found & ~dead).any()
    assert (found & dead).sum() >= 0.6 * dead.sum()


def test_light_of_one_colour_is_refused_and_restored_grey_by_name(labapp, red_record, tmp_path):
    code, _, errors = labapp("reconstruct", red_record, "--out", tmp_path / "a.npy")
    assert code != 0
    assert "--grey" in errors
    # The noise decides whether blue is found to be without light, or too faint.
    assert "told apart" in errors or "see hardly any" in errors
    with pytest.raises(UserError, match="--grey"):
        reconstruct_record(ReconstructRun(red_record, "tv", None), Progress())
    out = tmp_path / "grey.npy"
    code, printed, errors = labapp("reconstruct", red_record, "--grey", "--out", out, "--json")
    assert code == 0, errors
    told = json.loads(printed)
    assert told["colours"]["grey"]
    before, after = told["score"]["psnr_db"]
    assert after > before + 1
    assert np.load(out).shape == (64, 96)
    window = reconstruct_record(ReconstructRun(red_record, "auto", None, True), Progress())
    assert window.result_message.after.shape == (64, 96)


@pytest.mark.parametrize(("option", "words"), [
    (["--blind", "15"], "--blind"),
    (["--refine-psf"], "--refine-psf"),
    (["--method", "wiener"], "knows no colour filters"),
])  # fmt: skip
def test_what_needs_a_monochrome_sensor_is_refused_in_words(
    labapp, white_record, tmp_path, option, words
):
    code, _, errors = labapp("reconstruct", white_record, "--out", tmp_path / "a.npy", *option)
    assert code != 0
    assert words in " ".join(errors.split())


def test_a_study_refuses_colour_filters(white_record, tmp_path):
    with pytest.raises(UserError, match=r"study deconvolution.*monochrome sensor"):
        _evaluate_and_write(
            "deconvolution", find_study("deconvolution"), None, white_record, tmp_path, Stopwatch(),
            Progress(),
        )  # fmt: skip


def test_no_pixel_of_a_dim_or_even_picture_is_called_dead():
    from labapp.pictures.analysis.brackets import Bracket

    rng = np.random.default_rng(0)
    rest = {"clipped": 0.0, "dark": 0.0, "clipped_by_exposure": [0.0], "dark_frames": 1}
    for level in (0.0, 3.0, 1000.0):
        rate = rng.poisson(level, (40, 50)).astype(float)
        rate[7, 9] = 0.0
        bracket = Bracket(
            "photograph", "neutral", 550e-9, [1.0], rate, np.full(rate.shape, max(level, 1.0)),
            histogram=np.zeros((1, 4), dtype=np.int64), **rest,
        )  # fmt: skip
        found = find_dead_pixels([bracket], (2, 2))
        row = replace(bracket, rate=rate[:1], variance=bracket.variance[:1])
        assert not find_dead_pixels([row], (2, 2)).any()
        assert found.sum() == (level == 1000.0)
        assert found[7, 9] == (level == 1000.0)
