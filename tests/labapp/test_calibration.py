"""A calibration on a virtual bench whose truth the application doesn't know."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_bench.files import Size, bench_text

from drivers.interfaces import Identity
from labapp.bench.calibration_validity import (
    calibration_summary,
    validity_warnings,
    wavelength_warnings,
)
from labapp.bench.opening import BenchFiles, open_bench
from labapp.calibration.calibrating import (
    CalibrationResult,
    calibrate,
    fit_and_write,
    prepare_plan_only,
)
from labapp.calibration.exposure_search import (
    StarExposure,
    TrialFrame,
    derive_exposures,
    evaluate_trials,
    first_bracket,
)
from labapp.calibration.plan_design import sweep_levels
from labapp.calibration.request import CalibrationRequest
from labapp.calibration.result_report import advice, result_rows
from labapp.common.errors import UserError
from labapp.files.bench_file import read_bench
from labapp.files.calibration_file import CalibrationFile, calibration_to_json
from labapp.files.camera_file import PolarisationTable, PolariserTable
from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import as_toml
from labapp.files.reading import read_file
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from optics.camera import Camera, Sensor
from optics.measuring import wavefront
from optics.progress import Cancelled, Progress
from optics.slm import grey_to_phase

SIZE = Size((54, 96), 160.0, 5.0, (96, 112))
BENCH = bench_text(SIZE, filter_options="range_nm = [420.0, 720.0], bandwidth_nm = 1.0")

SCENE = """
version = 1
title = "A star before a bench that isn't as described"
tol = 0.003
[effects] # they fall beside the frame, and take four fifths of the time
"panel orders" = false
[targets.dark]
kind = "dark"
[targets.star]
kind = "star"
diameter_um = 70.0
distance_m = 2.0
radiance = 5.0
[truth.panel]
unmodulated = 0.03
response = { gamma = 1.1, wiggle = 0.01, range = 1.06 }
flatness = [[3, 1, 25.0], [4, 0, 15.0]]
[truth.mount]
rotation_deg = 3.0
flip_x = true
"""

LEVELS = 16
ANGLE = math.radians(3.0)


def true_phase():
    """As the scene has it: range (x^gamma + wiggle sin 2 pi x) of 6.7 pi."""
    x = np.arange(256) / 255
    return 6.7 * math.pi * 1.06 * (x**1.1 + 0.01 * np.sin(2 * math.pi * x))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unknown")
    (folder / "bench.toml").write_text(BENCH)
    (folder / "scene.toml").write_text(SCENE)
    return BenchFiles(folder / "bench.toml", folder / "scene.toml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("calibration")


@pytest.fixture(scope="module")
def found(files, folder) -> CalibrationResult:
    """One calibration that most tests look at: 33 frames.

    After 25 steps its wavefront's chi² is within 0.2 % of that after 60.
    """
    request = CalibrationRequest(wavelengths_nm=(532.0,), regions=(1, 2), levels=LEVELS)
    with pytest.MonkeyPatch.context() as patch, open_bench(files) as bench:
        patch.setattr(wavefront, "_STEPS", 25)
        return calibrate(bench, request, folder)


@pytest.fixture
def calibrated_bench(found, files, folder, tmp_path) -> BenchFiles:
    """The same bench with the calibration in force."""
    text = BENCH.replace("[panel]", f'calibration = "{folder}/calibration.json"\n[panel]', 1)
    (tmp_path / "bench.toml").write_text(text)
    return BenchFiles(tmp_path / "bench.toml", files.scene)


def test_the_response_is_found_in_both_regions(found):
    (response,) = found.file.responses
    assert response.regions == (1, 2)
    for curve in response.curves:
        error = np.array(curve.phase_rad) - true_phase()
        assert np.sqrt((error**2).mean()) < 0.03
        assert curve.residual < 0.01
        assert 0 < max(curve.sigma_rad) < 0.2


def test_the_registration_is_the_mount_and_the_lens(found):
    """Pixels per cycle a panel pixel: wavelength times image distance over both pitches. The
    mirror comes first, then the turn from x towards y."""
    registration = found.file.registrations[0].build()
    scale = 532e-9 / (1 / 0.125 - 1 / 2.0) / 160e-6 / 3.45e-6
    corners = np.array([(y, x) for y in (-0.25, 0.25) for x in (-0.3, 0.3)])
    y, x = scale * corners[:, 0], -scale * corners[:, 1]
    turned = np.stack(
        [
            48 + y * math.cos(ANGLE) + x * math.sin(ANGLE),
            56 + x * math.cos(ANGLE) - y * math.sin(ANGLE),
        ],
        axis=1,
    )
    assert np.abs(registration.to_pixels(corners) - turned).max() < 0.15
    table = found.file.registrations[0]
    assert table.flip == "left-right"
    assert table.rotation_deg == pytest.approx(3.0, abs=0.05)
    assert table.image_distance_mm == pytest.approx(1e3 / (1 / 0.125 - 1 / 2.0), abs=0.1)
    assert table.outliers == 0
    assert 0 < table.uncertainty_px < 0.1


def test_unmodulated_light_and_wavefront_are_found(found):
    (zeroth,) = found.file.zeroth
    assert zeroth.share == pytest.approx(0.03, abs=max(4 * zeroth.sigma, 0.005))
    fitted = found.file.wavefront
    # 25 nm of coma and 15 nm of spherical aberration over the circle around the panel.
    assert fitted.rms_nm == pytest.approx(26.8, abs=max(4 * fitted.sigma_nm, 3))
    assert fitted.path_nm[fitted.terms.index((3, 1))] == pytest.approx(25.0, abs=4)
    assert abs(fitted.focus_dioptres) < 4 * fitted.focus_sigma_dioptres + 1e-3


def test_the_folder_holds_an_ordinary_run(found, folder):
    names = {path.name for path in folder.iterdir()}
    assert {"plan.toml", "patterns", "run.h5", "calibration.json", "calibration.png"} <= names
    plan = read_file(folder / "plan.toml", PlanFile)
    with Record(folder / "run.h5") as record:
        assert record.plan == plan
        trials = sum(exposures.trials for exposures in found.fits.design.exposures)
        assert record.frame_count + trials == found.file.frames <= 60
        for name in record.pattern_names:
            shown = cv2.imread(str(folder / "patterns" / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
            np.testing.assert_array_equal(record.pattern(name), shown)
    assert cv2.imread(str(folder / "calibration.png")).shape[0] > 500


def test_nothing_in_the_sweep_is_clipped_and_the_star_is_bright(found, folder):
    assert all(region.clipped_frames == 0 for region in found.fits.responses[532.0])
    sensor = found.fits.camera.sensor
    with Record(folder / "run.h5") as record:
        (first, *_) = record.select(pattern="neutral", target=record.target_names[1])
        brightest = record.image(first).max()
    assert 0.4 * sensor.full_scale < brightest < sensor.full_scale


def test_the_file_is_read_back_as_it_was_written(found, folder):
    read = read_file(folder / "calibration.json", CalibrationFile)
    assert read == found.file
    assert read.bench == "Small bench"
    assert read.record == "run.h5"
    assert read.devices["slm"].simulated
    assert read.panel["pitch_um"] == 160.0
    text = calibration_to_json(found.file).decode()
    assert json.loads(text) == found.file.model_dump(mode="json")
    assert max(len(line) for line in text.splitlines()) > 1000


@pytest.mark.sweep
def test_a_fit_of_the_record_gives_the_same_again(found, folder, tmp_path):
    shutil.copy(folder / "run.h5", tmp_path / "run.h5")
    again = fit_and_write(tmp_path / "run.h5").file
    assert again.responses == found.file.responses
    assert again.registrations == found.file.registrations
    # The order of sums in a transform isn't always the same.
    assert again.wavefront.rms_nm == pytest.approx(found.file.wavefront.rms_nm, abs=0.1)


def test_in_force_it_replaces_response_flatness_and_unmodulated_light(found, calibrated_bench):
    with open_bench(calibrated_bench) as bench:
        panel = bench.description.panel
        assert bench.calibration_warnings == ()
    assert panel.unmodulated == pytest.approx(found.file.zeroth[0].share)
    assert panel.flatness.at_pixels(panel).std() == pytest.approx(26.8e-9, abs=8e-9)
    grey = np.full(panel.shape, 200, dtype=np.uint8)
    left = found.file.responses[0].curves[0].phase_rad
    phase = grey_to_phase(panel, grey, 532e-9)
    assert phase[0, 0] == pytest.approx(left[200] - left[0], abs=1e-9)
    assert phase[0, 0] == pytest.approx(true_phase()[200], abs=0.1)


def test_a_calibration_changes_nothing_in_the_world_and_is_in_the_record(
    found, files, calibrated_bench, tmp_path
):
    plan = PlanFile.model_validate(
        {
            "version": 1,
            "title": "Levels",
            "patterns": {"grating": {"kind": "grating", "period_px": 8, "high": 40}},
            "acquire": [
                {
                    "targets": ["star"],
                    "patterns": ["grating"],
                    "wavelengths_nm": [532],
                    "exposures_ms": [1],
                }
            ],
        }
    )
    taken = []
    for name, some in (("without", files), ("with", calibrated_bench)):
        with open_bench(some) as bench:
            run_plan(bench, plan, tmp_path / f"{name}.h5")
        with Record(tmp_path / f"{name}.h5") as record:
            taken.append(record.image(0))
            in_force = record.bench.active_calibration
    np.testing.assert_array_equal(*taken)
    assert in_force == found.file


def test_a_stale_calibration_is_said_when_the_bench_opens(
    found, calibrated_bench, folder, tmp_path, caplog
):
    old = found.file.model_copy(update={"date": datetime.now(UTC) - timedelta(days=31)})
    (tmp_path / "old.json").write_bytes(calibration_to_json(old))
    text = calibrated_bench.bench.read_text().replace(f"{folder}/calibration.json", "old.json")
    calibrated_bench.bench.write_text(text)
    with open_bench(calibrated_bench) as bench:
        assert len(bench.calibration_warnings) == 1
        assert len(bench.calibration_warnings_at([532e-9])) == 1
        assert len(bench.calibration_warnings_at([532e-9, 633e-9])) == 2
    assert "STALE CALIBRATION: the calibration is 31 days old" in caplog.text
    assert "labapp calibrate" in caplog.text


def identities(file, **changes):
    known = {
        name: Identity(device.model, device.serial, device.simulated)
        for name, device in file.devices.items()
    }
    return known | changes


def test_every_reason_to_doubt_a_calibration_is_named(found, files):
    file, bench = found.file, read_bench(files.bench)
    same = identities(file)
    assert validity_warnings(file, bench, same) == []
    (said,) = validity_warnings(file, bench, same, now=file.date + timedelta(days=40))
    assert "40 days old" in said
    other = Identity("PLUTO", "0815", simulated=False)
    (said,) = validity_warnings(file, bench, same | {"slm": other})
    assert "made with the slm simulated SLM" in said
    assert "this is PLUTO 0815" in said
    assert validity_warnings(file, bench, same | {"filter": other}) == []
    (said,) = validity_warnings(file, bench, same | {"camera": replace(other, model="Oryx")})
    assert "Oryx 0815" in said
    lens = bench.lens.model_copy(update={"focal_length_mm": 150.0})
    (said,) = validity_warnings(file, bench.model_copy(update={"lens": lens}), same)
    assert "lens has changed" in said
    assert "focal_length_mm was 125.0 and is 150.0" in said
    assert all("labapp calibrate" in line for line in [said])


def test_a_calibration_older_than_a_key_of_the_bench_file_is_not_doubted_for_it(found, files):
    file, bench = found.file, read_bench(files.bench)
    old = file.lens.keys() & {"focal_length_mm", "f_number", "focus_distance_m"}
    aged = file.model_copy(update={"lens": {key: file.lens[key] for key in old}})
    assert validity_warnings(aged, bench, identities(file)) == []
    lens = bench.lens.model_copy(update={"separation_mm": 50.0})
    for one in (file, aged):
        (said,) = validity_warnings(one, bench.model_copy(update={"lens": lens}), identities(file))
        assert "separation_mm was" in said


def test_a_turned_polariser_makes_a_calibration_doubtful(found, files):
    polariser = PolariserTable(angle_deg=12.0)
    table = PolarisationTable(polariser=polariser)
    bench = read_bench(files.bench).model_copy(update={"polarisation": table})
    file = found.file.model_copy(update={"polarisation": table.model_dump(mode="json")})
    assert validity_warnings(file, bench, identities(file)) == []
    turned = PolarisationTable(polariser=polariser.model_copy(update={"angle_deg": 15.0}))
    (said,) = validity_warnings(
        file, bench.model_copy(update={"polarisation": turned}), identities(file)
    )
    assert "polarisation has changed" in said


def test_wavelengths_beyond_the_calibration_are_doubted(found):
    assert wavelength_warnings(found.file, [532e-9, 540e-9]) == []
    (said,) = wavelength_warnings(found.file, [532e-9, 633e-9])
    assert "calibrated at 532 nm, and 633 nm is used" in said
    assert "--wavelength-nm 633" in said
    bare = found.file.model_copy(update={"responses": ()})
    assert wavelength_warnings(bare, [633e-9]) == []
    assert "response at 532 nm" in calibration_summary(found.file)


def test_the_table_says_how_well_and_advice_what_to_do(found):
    listed = result_rows(found.file)
    assert [row[0] for row in listed][:4] == [
        "registration, 532 nm",
        "zeroth order, 532 nm",
        "response, 532 nm, region 1,1",
        "response, 532 nm, region 1,2",
    ]
    assert all("±" in row[2] for row in listed)
    table = found.file.zeroth[0].model_copy(update={"share": 0.3})
    dim = found.file.model_copy(update={"zeroth": (table,)})
    (said,) = [line for line in advice(replace(found, file=dim)) if "ignores" in line]
    assert "turn the polariser" in said


def test_a_plan_can_be_written_run_later_and_fitted(files, labapp, tmp_path):
    """As a real bench may want it: the plan is a plan, and its record says what it is."""
    out = tmp_path / "later"
    bench = ["--bench", files.bench, "--scene", files.scene]
    wanted = ["--only", "registration", "--exposure-ms", "4"]
    code, said, err = labapp("calibrate", "--plan-only", *wanted, *bench, "--out", out)
    assert code == 0, err
    assert "labapp run" in said
    assert not (out / "run.h5").exists()
    code, _, err = labapp("run", out / "plan.toml", *bench, "--out", out / "run.h5")
    assert code == 0, err
    code, said, err = labapp("calibrate", "--fit", out / "run.h5", "--json")
    assert code == 0, err
    data = json.loads(said)
    assert data["registrations"][0]["flip"] == "left-right"
    assert data["responses"] == []
    assert data["wavefront"] is None


def test_cancelling_leaves_a_record_and_no_calibration(files, tmp_path):
    progress = Progress(lambda fraction, message: progress.cancel() if fraction > 0.2 else None)
    request = CalibrationRequest(wavelengths_nm=(532.0,), parts=("registration",))
    with open_bench(files) as bench, pytest.raises(Cancelled):
        calibrate(bench, request, tmp_path / "out", progress=progress)
    assert not (tmp_path / "out" / "calibration.json").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--regions", "2"], "--regions 2: give rows x columns"),
        (["--regions", "5x5"], "--regions 5x5: .*choose fewer regions"),
        (["--only", "everything"], "everything"),
        (["--levels", "3"], "levels"),
        (["--wavelength-nm", "-1"], "--wavelength-nm is -1: give a wavelength"),
        (["--star", "sun"], "--star sun: this bench has no such target"),
        (["--dark", "night"], "--dark night: this bench has no such target"),
        (["--plan-only"], "Give --exposure-ms"),
    ],
)
def test_what_cannot_be_asked_is_refused(files, labapp, tmp_path, words, message):
    import re

    bench = ["--bench", files.bench, "--scene", files.scene, "--out", tmp_path / "out"]
    if "5x5" in words:
        words = [*words, "--exposure-ms", "1"]
    code, _, err = labapp("calibrate", *words, *bench)
    assert code == 1
    assert re.search(message, err), err


def test_a_folder_is_needed_and_files_are_kept(files, labapp, folder, found):
    bench = ["--bench", files.bench, "--scene", files.scene]
    assert "--out is missing" in labapp("calibrate", *bench)[2]
    code, _, err = labapp("calibrate", *bench, "--out", folder)
    assert code == 1
    assert "exists already" in err


def test_a_record_of_something_else_is_refused(small, labapp, tmp_path):
    code, *_ = labapp("run", small.plan, *small.arguments(), "--out", tmp_path / "run.h5")
    assert code == 0
    code, _, err = labapp("calibrate", "--fit", tmp_path / "run.h5")
    assert code == 1
    assert "no record of a calibration" in err


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda d: d.pop("date"), "key 'calibration.*date' is missing|'date' is missing"),
        (lambda d: d["responses"][0]["curves"].pop(), "there are 1 curves, and 2 regions"),
        (
            lambda d: d["responses"][0]["curves"][0]["phase_rad"].__setitem__(9, -5.0),
            "falls from one level",
        ),
        (lambda d: d.update(version=2), "version"),
    ],
)
def test_a_damaged_calibration_is_refused(calibrated_bench, tmp_path, folder, damage, message):
    data = json.loads((folder / "calibration.json").read_text())
    damage(data)
    (tmp_path / "bad.json").write_text(json.dumps(data))
    text = calibrated_bench.bench.read_text().replace(f"{folder}/calibration.json", "bad.json")
    calibrated_bench.bench.write_text(text)
    with pytest.raises(UserError, match=message):
        read_bench(calibrated_bench.bench)


def test_the_calibration_of_another_panel_is_refused(calibrated_bench):
    text = calibrated_bench.bench.read_text().replace("[lens]", "levels = 128\n[lens]")
    calibrated_bench.bench.write_text(text)
    with pytest.raises(UserError, match=r"not of this panel: .*256 levels.*Calibrate this bench"):
        read_bench(calibrated_bench.bench).build_camera()


def test_a_missing_calibration_file_is_named(files, tmp_path):
    text = files.bench.read_text().replace(
        "transmission", 'calibration = "gone.json"\ntransmission'
    )
    (tmp_path / "bench.toml").write_text(text)
    with pytest.raises(UserError, match=r"gone\.json: cannot be read"):
        read_bench(tmp_path / "bench.toml")


def star(peak, sensor=None):
    """A frame with a star of some peak above black, three pixels wide, and a hot pixel."""
    sensor = sensor or Sensor(shape=(60, 80))
    y, x = np.mgrid[:60, :80]
    light = peak * np.exp(-((y - 30) ** 2 + (x - 40.3) ** 2) / (2 * 1.2**2))
    numbers = np.clip(sensor.black_level + light, 0, 4095)
    numbers[5, 5] = 4095
    return numbers.round().astype(np.uint16)


def camera():
    return Camera(sensor=Sensor(shape=(60, 80)))


def test_the_exposure_is_found_from_the_brightest_frame_that_is_not_clipped():
    trials = [TrialFrame(t, star(2e6 * t)) for t in (1e-4, 1e-3, 1e-2)]
    found = evaluate_trials(trials, camera())
    sensor = camera().sensor
    assert found.exposure * 2e6 == pytest.approx(0.6 * (sensor.full_scale - 64), rel=0.05)
    # A Gaussian's light over its peak is 2 pi sigma².
    assert found.width == pytest.approx(math.sqrt(2 * math.pi) * 1.2, rel=0.05)


def test_trials_that_are_all_too_bright_or_too_dim_ask_for_others():
    assert evaluate_trials([TrialFrame(1e-3, star(1e5))], camera()) == pytest.approx(
        (4e-6, 6.2e-5), rel=5
    )
    assert max(evaluate_trials([TrialFrame(1e-3, star(1e5))], camera())) < 1e-3
    assert min(evaluate_trials([TrialFrame(1e-3, star(3.0))], camera())) > 1e-3


def test_a_star_beyond_what_the_camera_can_expose_is_refused():
    low, high = camera().sensor.exposure_range
    with pytest.raises(UserError, match=r"too bright at 0\.02 ms.*Dim the lamp"):
        evaluate_trials([TrialFrame(low, star(1e5))], camera())
    with pytest.raises(UserError, match=r"too dim at 30000 ms.*Brighten the lamp"):
        evaluate_trials([TrialFrame(high, star(3.0))], camera())


def test_the_first_trials_lie_in_the_range_of_the_sensor():
    made = camera()
    made = replace(made, sensor=replace(made.sensor, exposure_range=(1e-3, 2e-2)))
    bracket = first_bracket(made)
    assert min(bracket) >= 1e-3
    assert max(bracket) <= 2e-2


def test_regions_are_exposed_as_much_longer_as_their_spots_are_dimmer():
    """A spot of a quarter of the panel has 4/pi² of a quarter of the light."""
    found = StarExposure(1e-3, 30.0)
    exposures = derive_exposures(
        camera(), CalibrationRequest(wavelengths_nm=(532.0,)), 532.0, found, 3
    )
    wide = exposures.sweep_ms / exposures.full_ms * 0.6 / 0.5
    # A star far wider than the diffraction of the regions stays as wide as it is.
    assert wide == pytest.approx(math.pi**2, rel=0.05)


def test_a_sweep_shows_all_levels_once_and_the_last_one_twice():
    low, high = sweep_levels(256, 40, 6.7 * math.pi)
    assert sorted(high)[0] == 0
    assert sorted(high)[-2:] == [255, 255]
    assert len(set(zip(low, high, strict=True))) == 40
    assert set(low) == {0, round(255 / 13.4)}
    # Levels don't come in order: a lamp that drifts isn't taken for phase.
    assert abs(np.corrcoef(np.arange(40), high)[0, 1]) < 0.3


def test_a_plan_as_toml_reads_back(tmp_path):
    data = {
        "version": 1,
        "title": 'Say "hello"',
        "metadata": {"text": "line\nline", "number": 3, "yes": True},
        "patterns": {"neutral": {"kind": "constant", "grey": 7}, "b 2": {"kind": "constant"}},
        "acquire": [
            {
                "targets": ["star"],
                "patterns": ["neutral", "b 2"],
                "wavelengths_nm": [532.5],
                "exposures_ms": [1e-1],
                "interleave": [{"role": "dark", "frames": 2}],
            }
        ],
    }
    (tmp_path / "plan.toml").write_text(as_toml(data))
    assert read_file(tmp_path / "plan.toml", PlanFile) == PlanFile.model_validate(data)


def test_a_wavefront_needs_to_know_the_star(files, tmp_path):
    with open_bench(files) as bench:
        bench = replace(bench, scene_file=None)
        request = CalibrationRequest(wavelengths_nm=(532.0,), exposure_ms=1.0)
        with pytest.raises(UserError, match=r"--star-um and --star-m"):
            prepare_plan_only(bench, request, tmp_path / "out")
        only = request.model_copy(update={"parts": ("registration",)})
        assert prepare_plan_only(bench, only, tmp_path / "out").patterns
    assert Path(tmp_path / "out" / "plan.toml").is_file()
