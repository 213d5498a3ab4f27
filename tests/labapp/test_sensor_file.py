"""Sensors as data: bundled ones, and files of one's own."""

from pathlib import Path

import pytest

from labapp.common.errors import UserError
from labapp.files.reading import bundled_path, read_file
from labapp.files.sensor_file import SensorFile, read_sensor, with_sensor
from optics.camera import Sensor

PLAIN = """
version = 1
model = "mine"
width = 64
height = 48
pitch_um = 5.0
bits = 10
full_well_electrons = 9000
gain_electrons_per_dn = 9.0
read_noise_electrons = 3.0
dark_current_electrons_per_s = 0.5
black_level_dn = 16
shortest_exposure_us = 10
longest_exposure_s = 5
"""


def saved(folder: Path, more: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(PLAIN + more)
    return path


def built(folder: Path, more: str) -> Sensor:
    saved(folder, more)
    return read_sensor("mine.toml", folder).build()


def test_all_that_a_file_says_is_in_the_sensor(tmp_path):
    sensor = built(tmp_path, """quantum_efficiency = 0.5
prnu_percent = 0.8
dsnu_electrons = 1.2
dead_pixels_ppm = 20
hot_pixels_ppm = 100
hot_electrons_per_s = 250
fixed_pattern_seed = 77
shutter = "rolling"
line_time_us = 12.5
crosstalk_percent = 4
dust = [[-20, 30, 12.5]]
dust_distance_um = 700
""")  # fmt: skip
    assert sensor == Sensor(
        shape=(48, 64), pitch=5 * 1e-6, bits=10, full_well=9000, gain=9, read_noise=3,
        dark_current=0.5, black_level=16, quantum_efficiency=0.5, exposure_range=(10 * 1e-6, 5),
        prnu=0.8 / 100, dsnu=1.2, dead=20 * 1e-6, hot=100 * 1e-6, hot_current=250, fixed_seed=77,
        shutter="rolling", line_time=12.5 * 1e-6, model="mine",
        crosstalk=4 / 100, dust=((-20 * 1e-6, 30 * 1e-6, 12.5 * 1e-6),), dust_distance=700 * 1e-6,
    )  # fmt: skip


def test_efficiencies_by_wavelength_are_linear_between(tmp_path):
    sensor = built(tmp_path, "quantum_efficiency = { 400 = 0.2, 500 = 0.6, 700 = 0.4 }")
    assert sensor.spectral_efficiency.at([450e-9, 600e-9, 750e-9]) == pytest.approx([0.4, 0.5, 0])
    assert sensor.quantum_efficiency == 0.6


def test_curves_are_read_beside_the_file(tmp_path):
    (tmp_path / "qe.csv").write_text("nm,a,b\n400,0.1,0.5\n600,0.3,0.7\n")
    sensor = built(tmp_path, 'quantum_efficiency = { file = "qe.csv", column = "b" }')
    assert sensor.spectral_efficiency.at(500e-9) == pytest.approx(0.6)


def test_the_thesis_camera_has_its_own_curves():
    """Peaks as in the thesis' data: blue .458, green .416, red .349; a Bayer pattern."""
    sensor = read_sensor("dvc-4000c-like", Path()).build()
    assert sensor.shape == (2048, 2048)
    assert sensor.colour.channels == ("R", "G", "B")
    peaks = [sensor.colour.efficiencies[name].peak for name in "RGB"]
    assert peaks == pytest.approx([0.34900, 0.41620, 0.45779], rel=1e-4)
    assert sensor.colour.efficiencies["B"].at(400e-9) == pytest.approx(0.2)


def test_the_oryx_is_monochrome_and_large():
    sensor = read_sensor("flir-oryx-123s6m-like", Path()).build()
    assert (sensor.shape, sensor.pitch, sensor.colour) == ((3000, 4096), 3.45e-6, None)


@pytest.mark.parametrize("name", sorted(one.stem for one in bundled_path("sensors").glob("*.toml")))
def test_bundled_sensors_hold_all_that_they_need(name):
    table = read_sensor(name, Path("/nowhere"))
    assert table.has_all_curves
    assert type(table).model_validate(table.model_dump()).build() == table.build()


def test_remarks_of_bundled_sensors_are_sound(tmp_path):
    """The lines that say what else there is work when they are no remarks any more."""
    text = (bundled_path("sensors") / "flir-oryx-123s6m-like.toml").read_text()
    keys = [line[2:] for line in text.splitlines() if line.startswith("# ") and " = " in line]
    path = tmp_path / "all.toml"
    path.write_text(text + "\n".join(keys))
    assert read_file(path, SensorFile).build().line_time == pytest.approx(12e-6)


def test_a_bench_may_name_a_file_and_change_some_of_it(tmp_path):
    saved(tmp_path, "quantum_efficiency = 0.5")
    data = with_sensor(
        {"sensor": {"file": "mine.toml", "read_noise_electrons": 9.0}}, tmp_path, "bench"
    )
    assert data["sensor"]["read_noise_electrons"] == 9.0
    assert data["sensor"]["full_well_electrons"] == 9000
    assert with_sensor({"sensor": {"model": "x"}}, tmp_path, "bench") == {"sensor": {"model": "x"}}


def test_one_kind_of_efficiency_takes_the_place_of_the_other():
    data = with_sensor(
        {"sensor": {"file": "dvc-4000c-like", "quantum_efficiency": 0.4}}, Path(), "bench"
    )
    assert data["sensor"]["colour"] is None
    assert data["sensor"]["quantum_efficiency"] == 0.4


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("", "quantum_efficiency is missing; add it, or a table 'colour'"),
        ("quantum_efficiency = 1.5", "less than or equal to 1"),
        ("quantum_efficiency = { 400 = 0.5 }", "a spectrum needs two or more"),
        ("quantum_efficiency = { blue = 0.5, red = 0.1 }", "blue"),
        ("quantum_efficiency = 0.5\nprnu_percent = 30", "'prnu_percent' is 30"),
        ('quantum_efficiency = 0.5\nshutter = "rolling"', "needs its line_time"),
        ('quantum_efficiency = 0.5\nshutter = "slow"', "'shutter' is 'slow'"),
        ("quantum_efficiency = 0.5\nblack_level = 2000", "key 'black_level' is unknown"),
        ("quantum_efficiency = 0.5\nwells = 3", "key 'wells' is unknown"),
        ('quantum_efficiency = { file = "none.csv" }', "cannot be read"),
        ('quantum_efficiency = 0.5\n[colour]\npattern = ["R"]\nefficiency = {R = {400=1,500=1}}',
         "remove one of the two"),
        ('[colour]\npattern = ["RG"]\nefficiency = {R = {400=1,500=1}}', "pattern has G, which"),
    ],
)  # fmt: skip
def test_files_that_cant_be_are_refused(tmp_path, more, message):
    with pytest.raises(UserError, match=message):
        built(tmp_path, more)


def test_what_no_sensor_can_be_is_refused(tmp_path):
    path = saved(tmp_path, "quantum_efficiency = 0.5")
    path.write_text(path.read_text().replace("black_level_dn = 16", "black_level_dn = 2000"))
    with pytest.raises(UserError, match="black_level is 2000; it must lie below the full scale"):
        read_sensor("mine.toml", tmp_path)


def test_a_curve_above_one_is_refused(tmp_path):
    (tmp_path / "qe.csv").write_text("nm,a\n400,10\n600,30\n")
    with pytest.raises(UserError, match=r"30 electrons a photon can't be. Give shares, 0 to 1"):
        built(tmp_path, 'quantum_efficiency = { file = "qe.csv" }')


def test_a_sensor_that_isnt_there_is_named(tmp_path):
    with pytest.raises(UserError, match=r"there is no such sensor. Give its file, or one of those"):
        read_sensor("other", tmp_path)
    with pytest.raises(UserError, match=r"key 'sensor.file' is 3: it should be a string"):
        with_sensor({"sensor": {"file": 3}}, tmp_path, "bench")
