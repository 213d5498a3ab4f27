"""A camera by itself: lens, separation and polarisation in a camera file or a bench file."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile, read_bench, read_camera, read_camera_file
from labapp.files.calibration_file import CalibrationFile, ZerothOrderTable, calibration_to_json
from labapp.files.camera_file import CameraFile, LensTable
from labapp.files.reading import bundled_path
from optics.camera import Ghost
from optics.camera.stop import Circle, Stop, regular_polygon

BENCH = bundled_path("bench.toml").read_text()
CAMERA = BENCH[: BENCH.index("[devices.slm]")]
BARE = CAMERA.replace("unmodulated = 0.05\n", "")


def written(folder: Path, text: str) -> Path:
    path = folder / "camera.toml"
    path.write_text(text)
    return path


def read(folder: Path, text: str) -> CameraFile:
    return read_camera_file(written(folder, text))


def test_the_thesis_camera_comes_with_labapp():
    """Section 5.6: 15.36 x 8.64 mm, 100 mm f/5.6, 3.45 µm pixels; focused 2 m before the panel."""
    camera = read_camera(bundled_path("thesis-camera.toml"))
    panel, lens, sensor = camera.panel, camera.lens, camera.sensor
    assert [n * panel.pitch for n in panel.shape] == pytest.approx([8.64e-3, 15.36e-3])
    assert (lens.focal_length, lens.f_number, lens.focus_distance) == (0.1, 5.6, 2.05)
    assert lens.has_clear_stop
    assert (sensor.shape, sensor.pitch) == ((3000, 4096), pytest.approx(3.45e-6))
    assert camera.separation == pytest.approx(0.05)
    # A polariser's half (and the thousandth of the other), and half of it twice in the cube.
    assert camera.transmission == pytest.approx(0.6 * 0.5 * 1.001 * 0.25)
    angle = math.radians(12.9)
    along = math.cos(angle) ** 2 + math.sin(angle) ** 2 / 1000
    across = math.sin(angle) ** 2 + math.cos(angle) ** 2 / 1000
    assert panel.unmodulated == pytest.approx(across / (along + across))
    assert 0.05 <= panel.unmodulated < 0.055
    assert camera.glare == 0


def test_a_bench_file_is_a_camera_file_with_devices(tmp_path):
    bench = read_camera_file(bundled_path("bench.toml"))
    assert isinstance(bench, BenchFile)
    camera = read(tmp_path, CAMERA)
    assert not isinstance(camera, BenchFile)
    assert camera.build_camera() == bench.build_camera() == read_camera(None)
    with pytest.raises(UserError, match="key 'devices' is missing"):
        read_bench(tmp_path / "camera.toml")


def test_a_spectroradiometer_is_no_part_of_a_run(tmp_path):
    with_one = bundled_path("bench.toml").read_text()
    table = '[devices.spectroradiometer]\ndriver = "cs2000"\noptions = { port = "x" }\n'
    path = tmp_path / "bench.toml"
    path.write_text(with_one[: with_one.index("[devices.spectroradiometer]")])
    without = read_bench(path)
    path.write_text(path.read_text() + table)
    real = read_bench(path)
    runs = ["slm", "filter", "camera", "targets"]
    assert list(without.devices.tables) == list(without.devices.run_devices) == runs
    assert list(real.devices.run_devices) == runs
    assert list(real.devices.tables) == [*runs, "spectroradiometer"]
    assert not real.is_real


def test_what_is_not_said_of_a_lens_is_off():
    lens = LensTable(focal_length_mm=125.0, f_number=5.0, focus_distance_m=2.0)
    assert lens.build() == read_bench(bundled_path("bench.toml")).lens.build()
    assert lens.build().has_clear_stop
    assert lens.build().has_quadratic_phase
    assert read_camera(bundled_path("bench.toml")).separation == 0


def test_a_lens_can_be_all_that_the_engine_knows_of_it(tmp_path):
    more = """separation_mm = 50.0
kind = "stigmatic"
blades = 6
obscuration = 0.2
aberrations = [[4, 0, 60.0], [2, -2, -25.0]]
"""
    text = CAMERA.replace("focus_distance_m = 2.0\n", "focus_distance_m = inf\n" + more)
    file = read(tmp_path, text)
    camera = file.build_camera()
    assert camera.separation == pytest.approx(0.05)
    assert camera.lens.focus_distance == math.inf
    assert camera.lens.kind == "stigmatic"
    assert camera.lens.stop == Stop(regular_polygon(6), (Circle(0.2),))
    (n, m, first), (_, _, second) = camera.lens.aberrations
    assert (n, m) == (4, 0)
    assert (first, second) == pytest.approx((60e-9, -25e-9))
    again = CameraFile.model_validate(json.loads(json.dumps(file.model_dump(mode="json"))))
    assert again == file


def test_a_veil_is_a_share_of_the_light(tmp_path):
    veiled = CAMERA.replace("transmission", "glare = 0.02\ntransmission", 1)
    assert read(tmp_path, veiled).build_camera().glare == 0.02
    shaken = veiled.replace("glare", "vibration_um = 2\nglare", 1)
    warming = veiled.replace("glare", "focus_drift_um = -20\nfocus_drift_s = 600\nglare", 1)
    assert read(tmp_path, warming).build_camera().focus_drift == pytest.approx(-20e-6)
    assert read(tmp_path, warming).build_camera().focus_drift_time == 600
    with pytest.raises(UserError, match=r"focus_drift is -0\.2 m; it is between"):
        read(tmp_path, warming.replace("-20", "-2e5", 1))
    assert read(tmp_path, shaken).build_camera().vibration == 2e-6
    assert read(tmp_path, shaken).build_camera().vibration_frequency == math.inf
    with pytest.raises(UserError, match=r"key 'glare' is 1\.5: .* less than or equal to 1"):
        read(tmp_path, veiled.replace("0.02", "1.5", 1))


def test_a_lens_has_colour_by_wavelength(tmp_path):
    """In nanometres and micrometres."""
    coloured = CAMERA.replace(
        "[lens]",
        "[lens]\nlateral_colour = [[450, 0.1], [550, 0]]\naxial_colour = [[450, 60], [550, 0]]",
        1,
    )
    lens = read(tmp_path, coloured).build_camera().lens
    assert lens.focus_shift(500e-9) == pytest.approx(30e-6)
    assert lens.image_scale(500e-9) == pytest.approx(1.0005)
    with pytest.raises(UserError, match=r"450 nm after 550 nm; wavelengths rise"):
        read(tmp_path, coloured.replace("[[450, 60], [550, 0]]", "[[550, 0], [450, 60]]", 1))


def test_ghosts_are_tables_in_millimetres_and_share_the_light(tmp_path):
    table = "\n[[ghosts]]\nshare = 0.6\nmagnification = -1.2\nblur_mm = 1.5\n"
    found = read(tmp_path, CAMERA + table).build_camera().ghosts
    assert found == (Ghost(0.6, -1.2, 1.5e-3),)
    with pytest.raises(UserError, match=r"ghosts have 1\.2 of the light together"):
        read(tmp_path, CAMERA + 2 * table)
    with pytest.raises(UserError, match=r"magnification is 0; give the ghost's size"):
        read(tmp_path, CAMERA + table.replace("-1.2", "0"))
    with pytest.raises(UserError, match="blur_mm"):
        read(tmp_path, CAMERA + table.replace("1.5", "-1"))


def test_a_lens_is_aberrated_more_off_its_axis(tmp_path):
    bent = CAMERA.replace(
        "[lens]", "[lens]\nfield_aberrations = { height_mm = 8, astigmatism_nm = 200 }", 1
    )
    by = read(tmp_path, bent).build_camera().lens.field_aberrations
    assert (by.height, by.coma, by.astigmatism) == pytest.approx((8e-3, 0, 200e-9))
    with pytest.raises(UserError, match=r"astigmatism_nm' is 2000000000.* check its unit"):
        read(tmp_path, bent.replace("200", "2e9", 1))
    with pytest.raises(UserError, match=r"field_aberrations\.height_mm"):
        read(tmp_path, bent.replace("height_mm = 8, ", "", 1))


def test_a_lens_curve_of_relative_illumination_reaches_the_corner(tmp_path):
    """In millimetres, as in its data sheet."""
    falling = CAMERA.replace(
        "[lens]",
        "[lens]\ndistortion = [-0.1, 0]\nrelative_illumination = [[0, 1], [10, 0.9], [40, 0.3]]",
        1,
    )
    lens = read(tmp_path, falling).build_camera().lens
    heights, shares = zip(*lens.relative_illumination, strict=True)
    assert heights == pytest.approx((0, 0.01, 0.04))
    assert shares == (1, 0.9, 0.3)
    assert lens.distortion == (-0.1, 0)
    with pytest.raises(UserError, match=r"ends at 0\.01 mm.* give the curve up to there"):
        read(tmp_path, falling.replace("[10, 0.9], [40, 0.3]", "[0.01, 0.9]", 1))
    with pytest.raises(UserError, match=r"distortion is \[-1000000.* folds back"):
        read(tmp_path, falling.replace("-0.1, 0]", "-1e6, 0]", 1))


def test_light_across_a_panels_axis_is_not_modulated(tmp_path):
    """sin² of the polariser's angle; half of natural light passes, and the cube's shares."""
    table = """[polarisation]
polariser = { angle_deg = 20.0 }
splitter = { transmitted = [0.4, 0.4], reflected = [0.5, 0.5] }
"""
    file = read(tmp_path, BARE + table)
    camera = file.build_camera()
    assert camera.panel.unmodulated == pytest.approx(math.sin(math.radians(20)) ** 2)
    assert camera.transmission == pytest.approx(0.15 * 0.5 * 0.4 * 0.5)
    again = CameraFile.model_validate(json.loads(json.dumps(file.model_dump(mode="json"))))
    assert again.build_camera() == camera


def test_every_element_of_the_path_counts(tmp_path):
    """Light along 30°, through nothing, a cube that reflects first, and a second polariser."""
    table = """[polarisation]
light = { degree = 1.0, angle_deg = 30.0 }
splitter = { transmitted = [0.9, 0.1], reflected = [0.1, 0.8], first = "reflected" }
analyser = { angle_deg = 45.0, transmission = 0.8 }
"""
    camera = read(tmp_path, BARE + table).build_camera()
    # Both polarisations meet at 45° with half of their powers, each after both passes of the
    # cube; the camera sums the two in intensity.
    m, u = (0.5 * 0.8 * a for a in (0.75 * 0.1 * 0.9, 0.25 * 0.8 * 0.1))
    assert camera.transmission == pytest.approx(0.15 * (m + u))
    assert camera.panel.unmodulated == pytest.approx(u / (m + u))


def test_a_bundled_panels_share_gives_way_to_the_polarisation(tmp_path):
    """The panel's file says 5 %; who says it in the camera's own file has to decide."""
    sensor = CAMERA[CAMERA.index("[lens]") :]
    head = CAMERA[: CAMERA.index("[panel]")] + '[panel]\nfile = "pluto-vis-016-hr"\n'
    table = "[polarisation]\npolariser = { angle_deg = 5.0 }\n"
    assert read(tmp_path, head + sensor).build_camera().panel.unmodulated == 0.05
    share = read(tmp_path, head + sensor + table).build_camera().panel.unmodulated
    assert share == pytest.approx(math.sin(math.radians(5)) ** 2)
    with pytest.raises(UserError, match=r"'panel\.unmodulated' is 0\.08"):
        read(tmp_path, head + "unmodulated = 0.08\n" + sensor + table)


POLARISED = "[polarisation]\npolariser = { angle_deg = 12.9 }\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CAMERA + POLARISED, ["key 'panel.unmodulated' is 0.05", "'polarisation' follows 0.0498"]),
        (CAMERA + POLARISED, ["remove one of the two"]),
        (BARE, ["key 'panel.unmodulated' is missing", "[polarisation]"]),
        (BARE + "[polarisation]\npolarizer = {}\n", ["key 'polarisation.polarizer' is unknown"]),
        (
            BARE + "[polarisation]\npolariser = { extinction = 0.5 }\n",
            ["key 'polarisation.polariser.extinction' is 0.5", "greater than or equal to 1"],
        ),
        (
            BARE + "[polarisation]\nsplitter = { transmitted = [0.8, 0.5] }\n",
            ["key 'polarisation.splitter'", "shares of p light sum to 1.3"],
        ),
        (
            BARE + "[polarisation]\npolariser = {}\nanalyser = { angle_deg = 90.0 }\n",
            ["key 'polarisation'", "no light passes", "turn one of them"],
        ),
        (
            CAMERA.replace("f_number = 5.0", "f_number = 5.0\nseparation_mm = -1.0"),
            ["key 'lens.separation_mm' is -1.0"],
        ),
        (
            CAMERA.replace("f_number = 5.0", "f_number = 5.0\nblades = 2"),
            ["key 'lens'", "blades is 2", "three or more"],
        ),
        (
            CAMERA.replace("f_number = 5.0", "f_number = 5.0\nobscuration = 1.0"),
            ["key 'lens.obscuration' is 1.0"],
        ),
        (
            CAMERA.replace("f_number = 5.0", "f_number = 5.0\naberrations = [[4, 1, 20.0]]"),
            ["key 'lens'", "(4, 1) doesn't exist"],
        ),
        (
            CAMERA.replace("f_number = 5.0", 'f_number = 0.4\nkind = "stigmatic"'),
            ["key 'lens'", "f_number is 0.4"],
        ),
        (CAMERA.replace("f_number = 5.0", 'f_number = 5.0\nkind = "thick"'), ["'lens.kind'"]),
        (CAMERA + "[device]\n", ["key 'device' is unknown"]),
        (BENCH.replace("[devices.targets]", "[devices.target]"), ["devices.target"]),
    ],
)
def test_a_mistake_in_a_camera_file_is_told_in_words(tmp_path, text, words):
    with pytest.raises(UserError) as caught:
        read(tmp_path, text)
    for word in words:
        assert word in str(caught.value)
    assert "camera.toml" in str(caught.value)


def test_a_benchs_calibration_counts_in_its_camera(tmp_path):
    calibration = CalibrationFile(
        version=1,
        date="2026-01-02T03:04:05Z",
        bench="Virtual bench",
        record="run.h5",
        frames=1,
        software="labapp",
        devices={},
        panel={},
        lens={},
        sensor={},
        zeroth=(ZerothOrderTable(wavelength_nm=550.0, share=0.12, sigma=0.01, frames=1),),
    )
    (tmp_path / "calibration.json").write_bytes(calibration_to_json(calibration))
    path = written(tmp_path, BENCH.replace("name =", 'calibration = "calibration.json"\nname ='))
    assert read_camera(path).panel.unmodulated == pytest.approx(0.12)
    # What was measured counts more than what follows from the polarisation.
    text = BARE.replace("name =", 'calibration = "calibration.json"\nname =') + POLARISED
    assert read_camera(written(tmp_path, text)).panel.unmodulated == pytest.approx(0.12)


SENSOR = CAMERA[CAMERA.index("[sensor]") :]


def test_a_sensor_may_be_one_that_comes_with_labapp(tmp_path):
    """Keys beside the file's name count more than what it says."""
    own = '[sensor]\nfile = "flir-oryx-123s6m-like"\nwidth = 96\nheight = 64\nprnu_percent = 0.5\n'
    file = read(tmp_path, CAMERA.replace(SENSOR, own))
    sensor = file.build_camera().sensor
    assert (sensor.shape, sensor.prnu, sensor.full_well) == ((64, 96), 0.005, 10500.0)
    assert sensor.model == "FLIR Oryx ORX-10G-123S6M-like"
    again = CameraFile.model_validate(json.loads(json.dumps(file.model_dump(mode="json"))))
    assert again.build_camera() == file.build_camera()


def test_a_sensors_curves_are_in_what_a_record_keeps(tmp_path):
    (tmp_path / "mine.csv").write_text("nm,share\n400,0.2\n500,0.6\n700,0.4\n")
    text = CAMERA.replace("quantum_efficiency = 0.62", 'quantum_efficiency = { file = "mine.csv" }')
    file = read(tmp_path, text)
    (tmp_path / "mine.csv").unlink()
    again = CameraFile.model_validate(json.loads(json.dumps(file.model_dump(mode="json"))))
    curve = again.build_camera().sensor.spectral_efficiency
    assert curve.at([450e-9, 600e-9]) == pytest.approx([0.4, 0.5])


def test_a_colour_sensor_has_its_filters(tmp_path):
    own = '[sensor]\nfile = "dvc-4000c-like"\nwidth = 96\nheight = 64\n'
    colour = read(tmp_path, CAMERA.replace(SENSOR, own)).build_camera().sensor.colour
    assert colour.pattern == ("RG", "GB")
