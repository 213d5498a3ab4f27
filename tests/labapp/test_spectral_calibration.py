"""A snapshot camera that isn't as its bench file says: calibrated, and then restored with that."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from forging import forge, replace_text
from small_bench.spectral import BANDS_NM, MONO_SENSOR, write_files

from labapp.bench.opening import BenchFiles, open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import Acquisition, PlanFile
from labapp.files.spectra_file import SpectraFile, read_spectra_file
from labapp.files.spectrum_file import read_spectra
from labapp.pictures.analysis.star_psf import predict_star
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import ExecutionOptions
from labapp.spectral.calibrated_bands import choose_calibrated_bands
from labapp.spectral.lights import ViewingLight
from labapp.spectral.refinement import parameter_rows
from labapp.spectral.request import SpectralRequest
from labapp.spectral_calibration import calibrating, exposure_search, plan_design
from labapp.spectral_calibration.command import (
    SpectraOptions,
    advice,
    calibrate_spectra_of_bench,
    spectra_data,
)
from labapp.spectral_calibration.plan_design import build_spectra_plan
from labapp.spectral_calibration.radiances import (
    measure_radiances,
    read_radiances,
    transmission_tables,
)
from labapp.spectral_calibration.request import SpectraRequest
from optics.light import Spectrum
from optics.multispectral import self_calibration
from optics.progress import Progress

pytestmark = pytest.mark.usefixtures("white_sheets")

METER = """[devices.spectroradiometer]
driver = "simulated-spectroradiometer"
"""

TRUTH = """[truth.panel]
unmodulated = 0.12
"""

WINDOW = 27

BANDS = tuple(one / 1e9 for one in BANDS_NM)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> BenchFiles:
    """A bench whose panel leaves more light unmodulated than its file says."""
    folder = tmp_path_factory.mktemp("bench")
    found = write_files(folder, more=METER, truth=TRUTH)
    plan = (folder / "plan.toml").read_text()
    narrow = plan.replace("psf_window_px = 41", f"psf_window_px = {WINDOW}")
    (folder / "plan.toml").write_text(narrow)
    return found


@pytest.fixture(scope="module")
def lamp(files) -> Path:
    """The halogen lamp of the scene, as CSV."""
    light = files.read().scene.build().targets["flat"].reflected_radiance()
    nm = np.arange(400, 721, 5)
    lines = [f"{one},{value:.8g}" for one, value in zip(nm, light.at(nm / 1e9), strict=True)]
    path = files.bench.with_name("lamp.csv")
    path.write_text("\n".join(lines))
    return path


def add_photograph(*known) -> PlanFile:
    """A calibration's plan that takes the patches as well, so that one run serves all tests."""
    plan = build_spectra_plan(*known)
    block = {
        "targets": ["photograph"],
        "patterns": ["neutral", "ring"],
        "wavelengths_nm": BANDS_NM,
        "exposures_ms": [200],
        "interleave": [{"role": "dark", "frames": 2}],
    }
    roles = plan.reconstruct.model_copy(update={"photograph": "photograph"})
    blocks = (*plan.acquire, Acquisition.model_validate(block))
    return plan.model_copy(update={"acquire": blocks, "reconstruct": roles})


@pytest.fixture(scope="module")
def folder(files, lamp, tmp_path_factory) -> Path:
    """One calibration that most tests look at."""
    out = tmp_path_factory.mktemp("calibrated")
    plan = str(files.bench.with_name("plan.toml"))
    options = SpectraOptions((), plan, "flat", "star", "dark", None, None, 25, 60, str(lamp))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibrating, "build_spectra_plan", add_photograph)
        # The noise of fewer frames moves the first band's PSF by a third of its error.
        patch.setattr(plan_design, "_STAR_REPEATS", 8)
        calibrate_spectra_of_bench(options, out, files, ExecutionOptions(yes=True))
    return out


@pytest.fixture(scope="module")
def record(folder) -> Path:
    return folder / "run.h5"


def arguments(files: BenchFiles, out: Path) -> list:
    plan = files.bench.with_name("plan.toml")
    return ["calibrate", "--spectra", "--bench", files.bench, "--scene", files.scene,
            "--plan", plan, "--out", out, "--yes"]  # fmt: skip


@pytest.fixture(scope="module")
def found(folder) -> SpectraFile:
    return read_spectra_file(folder / "spectra.json").file


def parameters(file: SpectraFile, beginning: str) -> list:
    return [one for one in file.parameters if one.name.startswith(beginning)]


def true_psfs(record: Path) -> np.ndarray:
    """Of a point, from the bench with the scene's truth, (neutral and coded, bands, 27, 27)."""
    with Record(record) as opened:
        camera = opened.scene.truth.true_camera(opened.bench.build_camera())
        greys = [torch.from_numpy(opened.pattern(one)) for one in ("neutral", "ring")]
    psfs = [
        [p.numpy() for p in predict_star(camera, greys, one, 1e-9, 2.0, WINDOW)] for one in BANDS
    ]
    return np.array(psfs, dtype=np.float64).swapaxes(0, 1)


def test_psfs_become_those_of_the_true_panel(record, found):
    """Unmodulated light interferes with the ring, which the calibrated model can't follow.

    In three draws of the noise, the first band's error was 0.15 to 0.17, and 0.38 to 0.44 of what
    it was before.
    """
    neutral, true = (one / one.sum((1, 2), keepdims=True) for one in true_psfs(record))
    known = found.build()
    psfs, margin = known.psfs.numpy(), known.model.margin
    inside = psfs[:, margin:-margin, margin:-margin]
    nominal = np.array(found.psfs_ppm) / 1e6
    for one, was, wanted in zip(inside, nominal, true, strict=True):
        error, before = (np.linalg.norm(psf - wanted) / np.linalg.norm(wanted)
                         for psf in (one, was))  # fmt: skip
        assert error < 0.2
        assert error < 0.5 * before
    middle = (slice(None), *2 * (slice(WINDOW // 2 - 1, WINDOW // 2 + 2),))
    orders = (neutral * true)[middle].sum((1, 2)) / (neutral**2)[middle].sum((1, 2))
    for one, wanted in zip(parameters(found, "zeroth order"), orders, strict=True):
        assert abs(one.value - wanted) < 0.5 * abs(one.nominal - wanted)


def test_places_and_size_are_the_described_ones_within_their_deviation(found):
    (size,) = parameters(found, "size")
    assert abs(size.value - 1) < 4 * size.sigma < 0.02
    for one in parameters(found, "centre"):
        assert one.unit == "px"
        assert abs(one.value) < 4 * one.sigma
        assert one.sigma < 0.05


def test_the_response_is_that_of_the_sensors_curves(record, found, lamp):
    """In photons of the lamp through a Gaussian filter of 10 nm."""
    with Record(record) as opened:
        curves = opened.bench.build_camera().sensor.colour.efficiencies
    wavelengths = np.arange(400e-9, 720e-9, 0.5e-9)
    photons = next(iter(read_spectra(lamp).values())).at(wavelengths) * wavelengths
    for nm, pair in zip(BANDS_NM, ("G/B", "B/G", "G/R"), strict=True):
        seen = photons * np.exp(-4 * np.log(2) * ((wavelengths * 1e9 - nm) / 10) ** 2)
        (one,) = parameters(found, f"{pair}, {nm:g} nm")
        above, below = (float(curves[letter].at(wavelengths) @ seen) for letter in pair.split("/"))
        assert one.value == pytest.approx(above / below, rel=0.015)
        assert one.sigma < 0.02 * one.value


def test_the_filter_passes_all_bands_alike(found, lamp):
    light = next(iter(read_spectra(lamp).values()))
    for one, nm in zip(found.transmission, BANDS_NM, strict=True):
        assert one.wavelength_nm == pytest.approx(nm, abs=1.0)
        assert one.relative == pytest.approx(1, abs=0.03)
        assert one.sigma >= 0.019
        # The area of the band is its peak's radiance times its width.
        assert one.radiance_w_sr_m2 == pytest.approx(
            float(light.at(np.array(nm / 1e9))) * 1e-9 * 10.6, rel=0.05
        )
    assert "over the lamp's spectrum 'lamp'" in found.transmission_source


def test_what_cant_be_told_is_said(found):
    said = " ".join(found.indeterminate)
    assert "overall gain" in said
    assert "shift of all bands" in said
    assert "transmission" not in said
    assert "standard deviations of 0.05 in the zeroth order" in found.nominal_source
    assert all(0.8 < one.light_share < 1 for one in found.bands)


def test_the_picture_is_written(folder):
    assert cv2.imread(str(folder / "spectra.png")).shape[1] > 1000


def level(labapp, record: Path, out: Path, *options) -> dict:
    code, printed, errors = labapp(
        "reconstruct", record, "--bands", "all", "--out", out / "cube.h5", "--json", *options
    )
    assert code == 0, errors
    return json.loads(printed)


@pytest.mark.usefixtures("drawn")
def test_a_calibration_stands_in_for_star_and_white(labapp, record, folder, tmp_path):
    """The star's own PSFs have its noise, which the calibrated model hasn't."""
    own = level(labapp, record, tmp_path)
    spectra = folder / "spectra.json"
    said = level(labapp, record, tmp_path, "--calibration", spectra, "--force")
    assert said["score"]["psnr_db"] > own["score"]["psnr_db"] + 0.5
    assert said["psf"].startswith(str(spectra))
    assert said["white"].startswith("the white sheet of")
    assert said["refined"] is None
    assert said["white_electrons_per_s"] == pytest.approx(own["white_electrons_per_s"], rel=0.02)


def test_two_of_three_bands_are_those_two(record, folder):
    spectra = folder / "spectra.json"
    three = SpectralRequest(record, calibration=spectra, refines=True).read_problem(Progress())
    chosen = (BANDS[0], BANDS[2])
    two = SpectralRequest(record, chosen, calibration=spectra, refines=True).read_problem(
        Progress()
    )
    assert two.prior is not None
    assert three.prior is not None
    assert two.prior.model.bands == 2
    # The size of the PSFs is common to all bands.
    assert two.prior.parameters[2].name == "size of the coded PSFs"
    assert two.prior.parameters[1].value == pytest.approx(three.prior.parameters[2].value)
    scale = two.response.shares[:, 1] / three.response.shares[:, 2]
    assert scale == pytest.approx([scale[0]] * 3)
    # Without the middle band, the others' common shift is another one.
    moved = np.abs(two.psfs[1] - three.psfs[2]).sum()
    assert moved < 0.05


def calibrated(record: Path, folder: Path, pattern: str = "ring", *, is_broad: bool, **keys):
    source = read_spectra_file(changed(folder, folder / "copy.json", **keys))
    with Record(record) as opened:
        return choose_calibrated_bands(source, opened, pattern, BANDS, is_broad=is_broad)


def test_in_broad_light_the_filter_dims_nothing(record, folder):
    """The middle band, of which the filter is said to pass half, is twice as bright without it."""
    tables = json.loads((folder / "spectra.json").read_text())["transmission"]
    for one, relative in zip(tables, (1.0, 0.5, 1.0), strict=True):
        one["relative"] = relative
    narrow = calibrated(record, folder, is_broad=False).response
    broad = calibrated(record, folder, is_broad=True, transmission=tables)
    unknown = calibrated(record, folder, is_broad=True, transmission=[])
    assert narrow.white is not None
    assert broad.response.white is None
    levels = [one.response.shares.sum(0) for one in (broad, unknown)]
    ratio = levels[0] / levels[1]
    assert ratio[1] / ratio[0] == pytest.approx(2)
    assert ratio[2] / ratio[0] == pytest.approx(1)
    wanted = narrow.shares.sum(0)
    assert levels[1] / levels[1][0] == pytest.approx(wanted / wanted[0], rel=1e-6)
    assert any("over its measured transmission" in one for one in broad.notes)
    assert any("transmission the calibration doesn't know" in one for one in unknown.notes)


def test_another_pattern_than_the_calibrated_one_is_refused(record, folder):
    """Its PSFs would restore a wrong cube, and no residual would show it."""
    with pytest.raises(UserError, match=r"is of another pattern than 'neutral'.*--plan"):
        calibrated(record, folder, "neutral", is_broad=False)


def test_results_are_plain_data(found, folder):
    said = json.loads(json.dumps(spectra_data(found, (folder / "spectra.json",)), allow_nan=False))
    assert said["advice"] == []
    assert said["parameters"][0]["name"] == "zeroth order's share, 460 nm"
    assert "psfs_ppm" not in said
    bad = found.bands[0].model_copy(update={"star_residual": 0.4})
    worse = found.model_copy(update={"bands": (bad, *found.bands[1:])})
    (line,) = advice(worse)
    assert "explain the star badly at 460 nm" in line


def test_the_photograph_refines_a_calibration_that_is_out_of_date(
    labapp, record, folder, tmp_path, monkeypatch
):
    # Fewer iterations, because its estimates are judged in tests/optics.
    monkeypatch.setattr(self_calibration, "_ITERATIONS", 15)
    data = json.loads((folder / "spectra.json").read_text())
    lacking = 0.07
    deviation = [one - lacking * (at < 3) for at, one in enumerate(data["deviation"])]
    code, printed, errors = labapp(
        "reconstruct", record, "--bands", "460,620", "--refine", "--out", tmp_path / "a.h5",
        "--calibration", changed(folder, tmp_path / "old.json", deviation=deviation),
    )  # fmt: skip
    assert code == 0, errors
    found = re.findall(r"zeroth order's share, \d+ nm +(\S+) +± +\S+ +(\S+) ±", printed)
    assert len(found) == 2
    for now, before in found:
        assert float(now) - float(before) > 0.4 * lacking
    assert "refined from the photograph" in printed
    told = " ".join(errors.split())
    assert "before: frames of 20" in told
    assert "indeterminate: Each band's overall gain" in told
    assert "indeterminate: A shift of all bands together" in told


def test_the_star_of_a_run_is_refined_from_what_it_shows(record):
    problem = SpectralRequest(record, refines=True).read_problem(Progress())
    prior = problem.prior
    assert prior is not None
    margin = prior.model.margin
    shapes = prior.psfs.numpy()[:, margin:-margin, margin:-margin]
    shares = problem.psfs.sum((1, 2))
    assert shapes * shares[:, None, None] == pytest.approx(problem.psfs, abs=1e-6)
    assert prior.response.numpy() == pytest.approx(problem.response.shares * shares, abs=1e-6)
    assert "star and white of the run" in prior.source
    rows = parameter_rows(prior, prior, BANDS)
    assert rows[0][0] == "zeroth order's share, 460 nm"
    assert rows[3] == ["size of the coded PSFs", "1.000", "± 0.010", "1.000 ± 0.010"]


def test_a_bench_without_a_spectroradiometer_says_so(tmp_path):
    bare = write_files(tmp_path)
    request = SpectraRequest(bands_nm=BANDS_NM, coded="ring")
    assert measure_radiances(bare, request, Progress(), ask=None, speed=np.inf) is None
    assert read_radiances(tmp_path / "radiances.csv", BANDS_NM) is None
    tables, source = transmission_tables(None, None)
    assert tables == ()
    assert "the bench has no spectroradiometer" in source


def test_without_the_lamp_lamp_and_filter_are_one(folder):
    seen = read_radiances(folder / "radiances.csv", BANDS_NM)
    tables, source = transmission_tables(seen, None)
    assert all(one.relative is None for one in tables)
    assert "lamp and filter together" in source
    dark = ViewingLight("violet", Spectrum((400e-9, 420e-9), (1.0, 1.0)))
    with pytest.raises(UserError, match=r"--lamp: its spectrum is dark at 460 nm"):
        transmission_tables(seen, dark)
    with pytest.raises(UserError, match=r"has no column for 500 nm"):
        read_radiances(folder / "radiances.csv", (460.0, 500.0))


def test_an_open_slot_shows_the_lamp(tmp_path):
    slots = [[one, 10.0] for one in BANDS_NM] + [[545.0, 1000.0]]
    bare = write_files(tmp_path, more=METER)
    text = bare.bench.read_text().replace('"simulated-filter"', '"simulated-wheel"')
    text = text.replace("{ range_nm = [440.0, 700.0], bandwidth_nm = 10.0 }",
                        f"{{ slots_nm = {slots} }}")  # fmt: skip
    bare.bench.write_text(text)
    request = SpectraRequest(bands_nm=BANDS_NM, coded="ring")
    seen = measure_radiances(bare, request, Progress(), ask=None, speed=np.inf)
    assert seen.lamp is not None
    tables, source = transmission_tables(seen, None)
    assert [one.relative for one in tables] == pytest.approx([1, 1, 1], abs=0.03)
    assert "open slot" in source


def test_trials_find_the_exposure_of_the_sheet(labapp, files, tmp_path):
    """The sheet's brightest channel then reaches 0.6 of the sensor's range."""
    request = SpectraRequest(bands_nm=(540, 620), coded="ring", exposure_ms=9)
    with open_bench(files) as bench:
        found = exposure_search.find_exposures(bench, request, tmp_path, Progress(), None)
        sensor = bench.description.sensor
    assert found["star", 540] == found["star", 620] == pytest.approx(0.009)
    with Record(tmp_path / "trial-1.h5") as trial:
        for index in range(trial.frame_count):
            nm = round(trial.column("wavelength_asked")[index] * 1e9)
            level = (np.percentile(trial.image(index), 99) - sensor.black_level) / (
                sensor.full_scale - sensor.black_level
            )
            share = trial.column("exposure")[index] / found["flat", nm]
            if 0.1 < level < 0.95:
                assert level / share == pytest.approx(0.6, rel=0.1)
    code, _, errors = labapp("calibrate", "--spectra", "--fit", tmp_path / "trial-1.h5")
    assert code != 0
    assert "is no record of a spectral calibration" in errors


@pytest.mark.parametrize(
    ("trials", "exposure", "further"),
    [
        ([(0.001, 0.02), (0.016, 0.3), (0.256, 1.0)], 0.032, ()),
        ([(0.001, 1.0), (0.016, 1.0)], None, (0.00001, 0.000062)),
        ([(0.016, 0.001), (0.256, 0.004)], None, (4.096, 60.0)),
        ([(0.001, 0.001), (0.016, 1.0)], None, (0.004,)),
    ],
)
def test_exposures_follow_from_trials(record, trials, exposure, further):
    with Record(record) as opened:
        sensor = opened.bench.build_camera().sensor
    tried = [exposure_search._Trial(*one) for one in trials]
    wanted, more = exposure_search._judge(tried, sensor)
    assert wanted == pytest.approx(exposure)
    low, high = sensor.exposure_range
    expected = sorted({min(max(one, low), high) for one in further})
    assert more == pytest.approx(expected, rel=0.05)


WRONG = [
    (["--regions", "1x1"], "--regions: means nothing with --spectra"),
    (["--levels", "16"], "--levels: means nothing with --spectra"),
    (["--only", "zeroth"], "--only: means nothing with --spectra"),
    (["--flat", "sheet"], "--flat sheet: this bench has no such target"),
    (["--star", "sun"], "--star sun: this bench has no such target"),
    (["--wavelength-nm", "550"], "--wavelength-nm 550: is one band"),
    (["--plan", "spectral-stack"], "has no table [reconstruct]"),
    (["--plan", "sheets"], "sheets"),
    (["--lamp", "D56"], "--lamp D56: is neither a CIE illuminant nor a file"),
    (["--plan-only"], "can't find exposures by trial. Give --exposure-ms"),
    (["--plan-only", "--exposure-ms", "9"], "Give --flat-ms"),
    (["--exposure-ms", "-1"], "exposure_ms"),
]


@pytest.mark.parametrize(("options", "words"), WRONG, ids=lambda one: str(one)[:40])
def test_what_cant_be_calibrated_is_refused_in_words(labapp, files, tmp_path, options, words):
    code, _, errors = labapp(*arguments(files, tmp_path / "out"), *options)
    assert code != 0
    assert words in " ".join(errors.split())


def test_a_monochrome_sensor_is_refused(labapp, tmp_path):
    files = write_files(tmp_path, sensor=MONO_SENSOR)
    code, _, errors = labapp(*arguments(files, tmp_path / "out"))
    assert code != 0
    assert "--spectra: the sensor has no colour filters" in errors


def test_options_of_spectra_need_it(labapp, tmp_path):
    code, _, errors = labapp("calibrate", "--out", tmp_path, "--lamp", "A")
    assert code != 0
    assert "--lamp: means something with --spectra only" in errors


def test_a_plan_can_be_written_for_later(labapp, files, tmp_path):
    out = tmp_path / "later"
    code, printed, errors = labapp(
        *arguments(files, out), "--plan-only", "--exposure-ms", 9, "--flat-ms", 20
    )
    assert code == 0, errors
    assert f"labapp calibrate --spectra --fit {out / 'run.h5'}" in " ".join(printed.split())
    assert "spectra_request" in (out / "plan.toml").read_text()
    assert len(list((out / "patterns").glob("*.png"))) == 2


def changed(folder: Path, path: Path, **keys) -> Path:
    data = json.loads((folder / "spectra.json").read_text()) | keys
    path.write_text(json.dumps(data))
    return path


def test_a_calibration_that_doesnt_fit_is_refused(labapp, record, folder, tmp_path):
    other = tmp_path / "other.json"
    cases = [
        ({"pitch_um": 3.45}, "is of pixels 3.45 µm apart, and those of"),
        ({"filters": ["GR", "BG"]}, "is of the filters GR/BG"),
        ({"kind": "panel"}, "is no calibration of spectra"),
        ({"deviation": [0.0]}, "3 bands need 3 PSFs and 16 deviations"),
        ({"zeroth_order": [0.1]}, "the model of the camera is damaged: zeroth_order"),
    ]
    for keys, words in cases:
        changed(folder, other, **keys)
        code, _, errors = labapp("reconstruct", record, "--bands", "all", "--calibration", other)
        assert code != 0
        assert words in " ".join(errors.split())


def test_options_that_dont_go_with_a_calibration_are_refused(labapp, record, folder, tmp_path):
    spectra = folder / "spectra.json"
    two = changed(folder, tmp_path / "bands.json")
    data = json.loads(two.read_text())
    for one, nm in zip(data["bands"], (460.0, 540.0, 640.0), strict=True):
        one["wavelength_nm"] = nm
    two.write_text(json.dumps(data))
    (tmp_path / "list.json").write_text("[1]")
    (tmp_path / "text.json").write_text("{")
    shutil.copy(record, tmp_path / "copy.h5")
    bands, with_file = ["--bands", "all"], ["--calibration", spectra]
    cases = [
        ([*bands, "--calibration", two], "has the bands 460, 540, 640 nm, and not 620 nm"),
        ([*bands, "--calibration", tmp_path / "list.json"], "holds a list"),
        ([*bands, "--calibration", tmp_path / "text.json"], "is not valid JSON"),
        ([*bands, "--calibration", tmp_path / "copy.h5"], "is no .json file"),
        ([*bands, *with_file, "--psf", tmp_path / "copy.h5"], "nothing with --calibration"),
        ([*bands, *with_file, "--white", "flat"], "--white flat: means nothing with --calibration"),
        ([*bands, "--refine", "--weight", "2"], "--weight: means nothing with --refine"),
        (with_file, "--calibration: means something with --bands only"),
        (["--refine"], "--refine: means something with --bands only"),
    ]
    for options, words in cases:
        code, _, errors = labapp("reconstruct", record, *options)
        assert code != 0
        assert words in " ".join(errors.split())


def test_a_monochrome_record_cant_be_refined(record, folder, tmp_path):
    mono = without_filters(record, tmp_path / "mono.h5")
    with pytest.raises(UserError, match="--refine: the sensor has no colour filters"):
        SpectralRequest(mono, refines=True).read_problem(Progress())
    with pytest.raises(UserError, match=r"--calibration .*: the sensor has no colour filters"):
        SpectralRequest(mono, calibration=folder / "spectra.json").read_problem(Progress())


def without_filters(record: Path, copy: Path) -> Path:
    import h5py

    shutil.copy(record, copy)
    with h5py.File(copy, "r+") as file:
        bench = json.loads(file["entry/bench"][()])
        del bench["sensor"]["colour"]
        bench["sensor"]["quantum_efficiency"] = 0.6
        replace_text(file, "entry/bench", json.dumps(bench))
    forge(copy)
    return copy
