"""The camera of a virtual bench is calibrated, and what was measured is in force."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import timedelta
from html import escape

import h5py
import numpy as np
import pytest
from small_bench.files import Size, bench_text

from drivers.interfaces import Identity
from labapp.bench.calibration_validity import (
    camera_calibration_summary,
    camera_validity_warnings,
)
from labapp.bench.opening import BenchFiles, open_bench
from labapp.calibration.camera.calibrating import (
    calibrate_camera,
    fit_camera_and_write,
    prepare_camera_plan,
)
from labapp.calibration.camera.exposure_search import FlatTrial, judge_trials
from labapp.calibration.camera.plan_design import (
    CameraRequest,
    build_camera_plan,
    light_exposures,
)
from labapp.calibration.camera.result_report import camera_advice, camera_rows, defect_rows
from labapp.common.errors import UserError
from labapp.files.bench_file import read_bench
from labapp.files.calibration_file import calibration_to_json
from labapp.files.camera_noise_file import CameraNoiseFile, QuantityTable
from labapp.files.plan_file import PlanFile, read_plan
from labapp.files.reading import read_file
from labapp.pictures.analysis.brackets import merge_all
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.recorded_calibrations import stale_camera
from optics.camera import Sensor
from optics.hdr import DEFECTIVE
from optics.progress import Progress
from optics.sensor import fixed_pattern

pytestmark = pytest.mark.usefixtures("white_sheets")

SIZE = Size((48, 64), 40.0, 40.0, (96, 112), 14.0)
SPOTS = """prnu_percent = 1.0
dsnu_electrons = 1.5
dead_pixels_ppm = 400.0
hot_pixels_ppm = 800.0
hot_electrons_per_s = 400.0
fixed_pattern_seed = 7
[devices.slm]"""
BENCH = bench_text(SIZE).replace("[devices.slm]", SPOTS, 1)
SCENE = """
version = 1
title = "A flat field"
[targets.dark]
kind = "dark"
[targets.flat]
kind = "flat"
distance_m = 2.0
radiance = 0.3
[targets.photograph]
kind = "flat"
distance_m = 2.0
radiance = 0.03
"""
REQUEST = CameraRequest(wavelength_nm=550.0, exposures=20)
FULL = (4095 - 64) * 2.6
"""Electrons at the converter's end; the wells hold 10500."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    (folder / "bench.toml").write_text(BENCH)
    (folder / "scene.toml").write_text(SCENE)
    return BenchFiles(folder / "bench.toml", folder / "scene.toml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("camera")


@pytest.fixture(scope="module")
def found(files, folder):
    """One calibration that most tests look at: 88 frames and some trials."""
    with open_bench(files) as bench:
        return calibrate_camera(bench, REQUEST, folder)


@pytest.fixture
def in_force(found, files, folder, tmp_path):
    """The same bench with the calibration of its camera in force."""
    line = f'camera_calibration = "{folder}/camera.json"\n[panel]'
    (tmp_path / "bench.toml").write_text(BENCH.replace("[panel]", line, 1))
    return BenchFiles(tmp_path / "bench.toml", files.scene)


def within(table, true, deviations=4.0):
    assert abs(table.value - true) <= deviations * table.sigma, (table, true)


def test_the_camera_is_measured_as_it_is(found):
    file = found.file
    within(file.gain_electrons_per_dn, 2.6)
    within(file.read_noise_electrons, 2.4)
    within(file.dark_current_electrons_per_s, 1.0)
    within(file.full_well_electrons, FULL)
    assert file.black_level_dn.value == pytest.approx(64.0, abs=0.05)
    assert file.prnu_percent.value == pytest.approx(1.0, rel=0.05)
    assert file.dsnu_electrons.value == pytest.approx(1.5, rel=0.05)
    assert file.linearity_error_percent.value < 0.2
    assert file.clip_limit == "converter"
    assert 0.6 < file.reduced_chi2 < 1.6


def test_defective_pixels_are_those_of_the_camera(found, files):
    pattern = fixed_pattern(read_bench(files.bench).build_camera().sensor)
    hot = np.argwhere(pattern.hot_current.numpy() > 0).tolist()
    dead = np.argwhere(pattern.response.numpy() == 0).tolist()
    assert len(hot) > 2
    assert len(dead) > 1
    assert [list(one) for one in found.file.defects.hot] == hot
    assert [list(one) for one in found.file.defects.dead] == dead


def test_the_longest_exposure_is_a_fifth_of_saturated_ones(found):
    full = [one for one in found.file.curve if one.signal_dn > 0.999 * FULL / 2.6]
    assert 2 <= len(full) <= 6
    steps = np.diff([one.exposure_ms for one in found.file.curve])
    np.testing.assert_allclose(steps, steps[0], rtol=1e-3)


def test_the_folder_has_plan_record_file_and_picture(found, folder):
    plan = read_file(folder / "plan.toml", PlanFile)
    assert [block.role for block in plan.acquire] == ["dark", "flat"]
    # Longer darkness tells the dark current.
    assert max(plan.acquire[0].exposures_ms) == 2000.0
    assert read_file(folder / "camera.json", CameraNoiseFile) == found.file
    assert (folder / "camera.png").read_bytes().startswith(b"\x89PNG")
    with Record(folder / "run.h5") as record:
        assert found.file.frames > record.frame_count


def test_a_record_is_fitted_again_alike(found, folder, tmp_path):
    (tmp_path / "run.h5").write_bytes((folder / "run.h5").read_bytes())
    assert fit_camera_and_write(tmp_path / "run.h5").file == found.file


def test_the_ready_plan_is_fitted_too(files, tmp_path):
    plan = read_plan("photon-transfer").plan
    with open_bench(files) as bench:
        run_plan(bench, plan, tmp_path / "ready.h5")
    file = fit_camera_and_write(tmp_path / "ready.h5").file
    within(file.gain_electrons_per_dn, 2.6)
    within(file.read_noise_electrons, 2.4)
    assert file.lamp_drift_percent is None


def test_the_report_names_all_with_uncertainties(found):
    rows = {row[0]: row for row in camera_rows(found.file)}
    assert rows["conversion gain 1/K"][3] == "e-/DN"
    assert "4095 DN" in rows["full well"][4]
    assert all(row[2] for row in rows.values())
    assert defect_rows(found.file)[0][0] == "hot, by dark signal"
    assert camera_advice(found.file) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"reduced_chi2": 3.0}, "scatter more than photons make them"),
        ({"reduced_chi2": 0.3}, "scatter less than photons make them"),
        ({"full_well_electrons": None}, "no exposure was saturated"),
        ({"read_noise_is_limit": True}, "less than the converter's steps show"),
        ({"light_unevenness_percent": 40.0}, "the light differs by 40 % over the sensor"),
        ({"lamp_jump_percent": 5.0}, "changed by up to 5.0 % within a pair"),
        ({"lamp_drift_percent": QuantityTable(value=-4.0, sigma=0.1)}, "drifted by -4.0 %"),
        ({"linearity_error_percent": QuantityTable(value=2.0, sigma=0.1)}, "2 % off a line"),
        (
            {"dark_current_electrons_per_s": QuantityTable(value=0.0, sigma=3.0)},
            "known to 3 e-/s only: take longer darkness",
        ),
    ],
)
def test_advice_is_given_where_something_is_wrong(found, change, words):
    (said,) = camera_advice(found.file.model_copy(update=change))
    assert words in said


def test_in_force_the_sensor_is_as_measured(found, in_force):
    sensor, file = read_bench(in_force.bench).build_camera().sensor, found.file
    assert sensor.gain == file.gain_electrons_per_dn.value != 2.6
    assert sensor.read_noise == file.read_noise_electrons.value
    assert sensor.black_level == file.black_level_dn.value
    assert sensor.dark_current == file.dark_current_electrons_per_s.value
    assert sensor.prnu == file.prnu_percent.value / 100
    # The converter's end clips, as it did in the frames.
    assert sensor.full_scale == 4095


def test_the_virtual_camera_stays_as_it_is(found, files, in_force, folder, labapp, tmp_path):
    wrong = found.file.model_copy(
        update={"gain_electrons_per_dn": QuantityTable(value=5.0, sigma=0.01)}
    )
    (tmp_path / "wrong.json").write_bytes(calibration_to_json(wrong))
    text = in_force.bench.read_text().replace(f"{folder}/camera.json", "wrong.json")
    in_force.bench.write_text(text)
    plan = photograph_plan()
    taken = []
    for name, some in (("without", files), ("with", in_force)):
        with open_bench(some) as bench:
            assert bench.world.camera.sensor.gain == 2.6
            assert bench.description.sensor.gain == (2.6 if name == "without" else 5.0)
            run_plan(bench, plan, tmp_path / f"{name}.h5")
        with Record(tmp_path / f"{name}.h5") as record:
            taken.append(record.image(0))
            kept = record.bench.active_camera_calibration
    np.testing.assert_array_equal(*taken)
    assert kept == wrong
    code, said, _ = labapp("show", tmp_path / "with.h5")
    assert code == 0
    assert "camera calibration of" in said
    assert "in force (5 electrons/DN" in " ".join(said.split())


def photograph_plan():
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": "Flat light",
            "patterns": {"neutral": {"kind": "constant"}},
            "acquire": [
                {
                    "targets": ["photograph"],
                    "patterns": ["neutral"],
                    "wavelengths_nm": [550],
                    "exposures_ms": [50, 400],
                }
            ],
        }
    )


def test_merged_pictures_leave_known_defects_out(found, in_force, labapp, tmp_path):
    with open_bench(in_force) as bench:
        run_plan(bench, photograph_plan(), tmp_path / "flat.h5")
    pixels = tuple(np.array(found.file.defects.pixels).T)
    with Record(tmp_path / "flat.h5") as record:
        (bracket,) = merge_all(record, Progress())
        sensor = record.bench.build_camera().sensor
    assert bracket.defects.sum() == len(found.file.defects.pixels)
    assert bracket.defects[pixels].all()
    # Even light: filled pixels are like the others; dead and hot ones weren't.
    middle = np.median(bracket.rate)
    assert np.abs(bracket.rate[pixels] / middle - 1).max() < 6 * sensor.prnu
    assert np.isfinite(bracket.variance).all()
    out = tmp_path / "merged.h5"
    code, _, errors = labapp("merge", tmp_path / "flat.h5", "--out", out)
    assert code == 0, errors
    with h5py.File(out) as merged:
        state = merged["state"][()]
    assert (state[pixels] == DEFECTIVE).all()
    assert (state == DEFECTIVE).sum() == len(found.file.defects.pixels)


def test_reports_say_which_calibration_was_in_force_and_why_it_may_not_have_held(
    found, in_force, labapp, tmp_path
):
    text = in_force.bench.read_text().replace("dark_current_electrons_per_s = 1.0",
                                              "dark_current_electrons_per_s = 2.0")  # fmt: skip
    in_force.bench.write_text(text)
    with open_bench(in_force) as bench:
        run_plan(bench, photograph_plan(), tmp_path / "flat.h5")
    code, printed, errors = labapp(
        "merge", tmp_path / "flat.h5", "--out", tmp_path / "merged.h5", "--json"
    )
    assert code == 0, errors
    said, page = json.loads(printed), (tmp_path / "merged.html").read_text()
    summary, doubt = camera_calibration_summary(found.file), "per_s was 1.0 and is 2.0"
    clips = "pixels clip at 4095 DN: by the calibration of the camera"
    assert said["sensor"]["source"] == f"{summary}; {clips}"
    gain = found.file.gain_electrons_per_dn.value
    assert said["sensor"]["gain_electrons_per_dn"] == pytest.approx(gain)
    assert any(doubt in one for one in said["warnings"])
    for part in (summary, doubt, f"{gain:.4g} electrons/DN"):
        assert escape(part) in page
    code, printed, errors = labapp("report", tmp_path / "flat.h5", "--out", tmp_path, "--json")
    assert code == 0, errors
    said, page = json.loads(printed), (tmp_path / "report.html").read_text()
    assert said["calibrations"] == [summary]
    (told,) = said["calibration_doubts"]
    assert doubt in told
    assert escape(summary) in page
    assert escape(told) in page
    with h5py.File(tmp_path / "flat.h5", "r+") as file:
        file["entry/start_time"][()] = "yesterday"
    words = "its start time is 'yesterday', which is no date"
    with (
        Record(tmp_path / "flat.h5", damaged=True) as record,
        pytest.raises(UserError, match=words),
    ):
        stale_camera(record)


def test_every_reason_to_doubt_the_calibration_is_named(found, files):
    file, bench = found.file, read_bench(files.bench)
    device = file.camera
    same = {"camera": Identity(device.model, device.serial, device.simulated)}
    assert camera_validity_warnings(file, bench, same) == []
    (said,) = camera_validity_warnings(file, bench, same, now=file.date + timedelta(days=200))
    assert "200 days old" in said
    assert "labapp calibrate --camera" in said
    (said,) = camera_validity_warnings(file, bench, {"camera": Identity("other", "9", False)})
    assert "was made with the camera simulated camera simulated, and this is other 9" in said
    warm = bench.sensor.model_copy(update={"gain_electrons_per_dn": 1.3})
    (said,) = camera_validity_warnings(file, bench.model_copy(update={"sensor": warm}), same)
    assert "gain_electrons_per_dn was 2.6 and is 1.3" in said
    camera = bench.devices.camera.model_copy(update={"options": {"gain_db": 6.0}})
    devices = bench.devices.model_copy(update={"camera": camera})
    (said,) = camera_validity_warnings(file, bench.model_copy(update={"devices": devices}), same)
    assert "the bench file's camera has changed since the calibration: gain_db was None" in said


def test_the_bench_says_what_is_in_force_and_what_is_stale(found, in_force, caplog):
    text = in_force.bench.read_text().replace("dark_current_electrons_per_s = 1.0",
                                              "dark_current_electrons_per_s = 2.0")  # fmt: skip
    in_force.bench.write_text(text)
    with open_bench(in_force) as bench:
        (said,) = bench.calibration_warnings_at([550e-9])
    assert "dark_current_electrons_per_s was 1.0 and is 2.0" in said
    assert f"STALE CALIBRATION: {said}" in caplog.text
    assert "electrons/DN, read noise 2." in camera_calibration_summary(found.file)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("width = 112", "width = 110", "it is of 112 x 96 pixels, and the sensor has 110 x 96"),
        ("bits = 12", "bits = 10", "it is of 12 bits, and the sensor has 10"),
    ],
)
def test_the_calibration_of_another_sensor_is_refused(in_force, old, new, words):
    in_force.bench.write_text(in_force.bench.read_text().replace(old, new))
    with pytest.raises(UserError, match=f"not of this sensor: {words}.*labapp calibrate --camera"):
        read_bench(in_force.bench).build_camera()


def sensor_of(file, **changes):
    described = Sensor(shape=(96, 112), full_well=20_000.0, gain=2.0, black_level=60.0)
    return file.model_copy(update=changes).apply_to(described)


def test_a_full_well_below_the_converters_end_is_where_numbers_clip(found):
    gain = found.file.gain_electrons_per_dn.value
    well = QuantityTable(value=3000 * gain, sigma=5.0)
    sensor = sensor_of(found.file, full_well_electrons=well, clip_limit="well")
    assert sensor.full_well == well.value
    assert 3050 < sensor.full_scale < 3064


def test_an_unknown_full_well_leaves_the_clip_level_as_described(found):
    sensor = sensor_of(found.file, full_well_electrons=None, clip_limit=None)
    assert sensor.full_well / sensor.gain == pytest.approx(20_000 / 2.0)


SENSOR = Sensor(shape=(96, 112))
ROOM = 4031.0


def trial(exposure, rate=20_000.0, most=ROOM):
    return FlatTrial(exposure, min(rate * exposure, most), min(0.9 * rate * exposure, most))


def test_the_longest_exposure_fills_the_dimmest_pixels():
    answer = judge_trials([trial(t) for t in (1e-3, 0.016, 0.256)], SENSOR)
    assert answer == pytest.approx(1.25 * ROOM / 18_000, rel=1e-4)


def test_wells_that_are_full_early_are_found_by_a_trial():
    first = [trial(t, most=2000.0) for t in (1e-3, 0.016)]
    (longer,) = judge_trials(first, SENSOR)
    answer = judge_trials([*first, trial(longer, most=2000.0)], SENSOR)
    assert answer == pytest.approx(1.25 * 2000 / 18_000, rel=1e-4)
    # Where all are full, nothing is known of the light yet.
    (shorter,) = judge_trials([trial(t, rate=2e6, most=2000.0) for t in (0.016, 0.256)], SENSOR)
    assert shorter == pytest.approx(0.001)


def test_trials_all_too_bright_or_too_dim_ask_for_others():
    assert max(judge_trials([trial(t, rate=1e8) for t in (1e-3, 0.016)], SENSOR)) < 1e-4
    assert min(judge_trials([trial(t, rate=10) for t in (1e-3, 0.016)], SENSOR)) > 0.2
    both = judge_trials([FlatTrial(0.1, ROOM, ROOM), FlatTrial(0.001, 1.0, 1.0)], SENSOR)
    assert both == pytest.approx((0.01,))


@pytest.mark.parametrize(
    ("exposure", "rate", "words"),
    [(20e-6, 1e12, "too bright at 0.02 ms"), (30.0, 0.1, "too dim at 30000 ms.*--flat-ms")],
)
def test_light_beyond_what_the_camera_can_expose_is_named(exposure, rate, words):
    with pytest.raises(UserError, match=words):
        judge_trials([trial(exposure, rate=rate)], SENSOR)


def test_a_target_with_a_picture_is_named():
    with pytest.raises(UserError, match=r"lit unevenly: its dimmest pixels have 10% .* --flat"):
        judge_trials([replace(trial(0.016), evenness=0.1)], SENSOR)


def test_exposures_are_even_and_out_of_order():
    listed = light_exposures(CameraRequest(flat_ms=250.0, exposures=50), SENSOR)
    np.testing.assert_allclose(sorted(listed), 5.0 * np.arange(1, 51))
    # A drift that is linear in time has nothing of the exposure in it.
    assert abs(np.corrcoef(listed, np.arange(50))[0, 1]) < 0.1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"flat_ms": 0.5}, "exposures from 0.01 to 0.5 ms: the camera exposes 0.02 to 30000 ms"),
        ({"flat_ms": 40_000.0}, "the camera exposes 0.02 to 30000 ms. Give a shorter --flat-ms"),
    ],
)
def test_exposures_that_the_camera_cant_take_are_named(changes, words):
    with pytest.raises(UserError, match=words):
        build_camera_plan(CameraRequest(**changes), SENSOR)


def test_exposures_less_than_a_microsecond_apart_are_named():
    quick = replace(SENSOR, exposure_range=(1e-7, 1.0))
    with pytest.raises(UserError, match=r"less than a microsecond apart\. Dim the light"):
        light_exposures(CameraRequest(flat_ms=0.02), quick)


def test_a_plan_for_later_needs_the_exposure(files, tmp_path):
    with open_bench(files) as bench:
        with pytest.raises(UserError, match=r"--plan-only takes no pictures.*Give --flat-ms"):
            prepare_camera_plan(bench, REQUEST, tmp_path)
        request = REQUEST.model_copy(update={"flat_ms": 250.0})
        plan = prepare_camera_plan(bench, request, tmp_path / "later")
    assert read_file(tmp_path / "later/plan.toml", PlanFile) == plan


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"flat": "sheet"}, "--flat 'sheet': this bench has no such target.*evenly lit"),
        ({"dark": ""}, "--dark '': this bench has no such target.*without light"),
        ({"flat": "dark"}, "--flat and --dark are both 'dark'"),
    ],
)
def test_targets_that_arent_there_are_named(files, tmp_path, changes, words):
    with open_bench(files) as bench, pytest.raises(UserError, match=words):
        calibrate_camera(bench, REQUEST.model_copy(update=changes), tmp_path / "none")
    assert not (tmp_path / "none").exists()


def block(target="flat", role="light", wavelengths=(550,), exposures=(50, 100), repeats=2):
    return {
        "targets": [target], "patterns": ["neutral"], "wavelengths_nm": list(wavelengths),
        "exposures_ms": list(exposures), "repeats": repeats, "role": role,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("blocks", "flat", "words"),
    [
        ([block("dark", "dark")], None, "all frames are dark.*photon-transfer"),
        ([block()], None, "no frame is dark; take two dark frames"),
        ([block(), block("dark", "dark")], None, "2 exposure times, and a curve needs 5"),
        ([block(), block("dark", "dark", exposures=(50,))], None, "no dark frames of 100 ms"),
        ([block(repeats=1), block("dark", "dark")], None, "there is one lit frame of 50 ms"),
        ([block(), block("photograph")], None, "frames of flat, photograph.*Name it with --flat"),
        ([block(wavelengths=(540, 550))], None, "540 nm, 550 nm, and photon transfer needs light"),
        ([block()], "sheet", "has no frames of 'sheet'.*--flat, among flat"),
        (
            [block(exposures=(400, 500, 600, 700, 800)),
             block("dark", "dark", exposures=(400, 500, 600, 700, 800))],
            None,
            "the light is saturated at every exposure time",
        ),
    ],
)  # fmt: skip
def test_records_from_which_no_noise_follows_are_named(files, tmp_path, blocks, flat, words):
    plan = PlanFile.model_validate(
        {
            "version": 1, "title": "wrong", "patterns": {"neutral": {"kind": "constant"}},
            "acquire": blocks,
        }
    )  # fmt: skip
    with open_bench(files) as bench:
        run_plan(bench, plan, tmp_path / "run.h5")
    with pytest.raises(UserError, match=words):
        fit_camera_and_write(tmp_path / "run.h5", flat)
    assert not (tmp_path / "camera.json").exists()


def test_the_command_writes_plan_and_fits_and_prints(labapp, files, found, folder, tmp_path):
    out = tmp_path / "later"
    code, said, errors = labapp(
        "calibrate", "--camera", "--bench", files.bench, "--scene", files.scene, "--out", out,
        "--plan-only", "--flat-ms", "250", "--exposures", "12",
    )  # fmt: skip
    assert code == 0, errors
    assert "labapp calibrate --camera --fit" in said
    copy = tmp_path / "run.h5"
    copy.write_bytes((folder / "run.h5").read_bytes())
    code, said, errors = labapp("calibrate", "--camera", "--fit", copy, "--json")
    assert code == 0, errors
    data = json.loads(said)
    assert data["gain_electrons_per_dn"]["value"] == found.file.gain_electrons_per_dn.value
    code, said, errors = labapp("calibrate", "--camera", "--fit", copy, "--force")
    assert code == 0, errors
    assert "conversion gain" in said
    assert 'camera_calibration = "' in said


WRONG = [
    (["--camera", "--spectra"], "--spectra: means nothing with --camera"),
    (["--camera", "--levels", "16"], "--levels: means nothing with --camera"),
    (["--camera", "--exposure-ms", "2"], "--exposure-ms: means nothing with --camera"),
    (["--camera", "--lamp", "A"], "--lamp: means nothing with --camera"),
    (["--exposures", "20"], "--exposures: means something with --camera only"),
    (["--dark-s", "2"], "--dark-s: means something with --camera only"),
    (["--flat", "x"], "--flat: means something with --spectra or --camera only"),
    (["--camera", "--exposures", "4"], "exposures"),
    (["--camera", "--wavelength-nm", "540", "--wavelength-nm", "550"], "one wavelength"),
]


@pytest.mark.parametrize(("options", "words"), WRONG, ids=lambda one: str(one)[:40])
def test_options_that_mean_nothing_are_refused(labapp, tmp_path, options, words):
    code, _, errors = labapp("calibrate", "--out", tmp_path / "out", *options)
    assert code != 0
    assert words in " ".join(errors.split())
