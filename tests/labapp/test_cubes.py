"""Spectral cubes and their files: HDF5 that describes itself, and ENVI as others write it."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.files.cubes import SpectralCube, read_cube, write_cube
from labapp.files.output_paths import cube_paths
from labapp.files.wavelengths import convert_wavelengths, remark_on_unit

SHARED = Path(__file__).parents[3] / "shared/data/ms_cubes"

BANDS = (450e-9, 550e-9, 700e-9)

HEADER = """ENVI
; written by hand after the description of the format
description = {
  Leaves, in the
  laboratory}
samples = 4
Lines   = 3
bands   = 2
header offset = {offset}
file type = ENVI Standard
data type = {code}
interleave = {interleave}
sensor type = Unknown
byte order = {order}
x start = 0
wavelength units = {unit}
wavelength = {{
 {first},
 {second}
}}
{more}"""


def cube(**more) -> SpectralCube:
    values = np.random.default_rng(0).random((3, 4, 5)).astype(np.float32)
    return SpectralCube(values, BANDS, **more)


def write_envi(folder: Path, numbers, **keys) -> Path:
    """Numbers (bands, lines, samples) behind a header, laid out by the format's own words."""
    usual = {"code": 12, "interleave": "bsq", "order": 0, "offset": 0, "unit": "Nanometers"}
    keys = usual | {"first": 500, "second": 600, "more": "", "ending": ".raw"} | keys
    text = HEADER
    for key, value in keys.items():
        text = text.replace("{" + key + "}", str(value))
    (folder / "leaf.hdr").write_text(text.replace("{{", "{").replace("}}", "}"))
    lay = {
        "bsq": numbers,  # a picture of each band after the other
        "bil": np.stack([numbers[:, y] for y in range(numbers.shape[1])]),
        "bip": np.array([[numbers[:, y, x] for x in range(4)] for y in range(3)]),
    }.get(str(keys["interleave"]).lower(), numbers)
    data = b"\0" * int(keys["offset"]) + lay.astype(numbers.dtype).tobytes()
    (folder / f"leaf{keys['ending']}").write_bytes(data)
    return folder / "leaf.hdr"


@pytest.mark.parametrize("name", ["a.h5", "a.hdr"])
def test_a_cube_is_read_as_it_was_written(tmp_path, name):
    made = cube(light="D65", pitch=7.4e-6, description="a leaf")
    files = write_cube(tmp_path / name, made)
    assert files == cube_paths(tmp_path / name)
    assert all(file.is_file() for file in files)
    read = read_cube(tmp_path / name)
    assert np.array_equal(read.values, made.values)
    assert read.wavelengths == BANDS
    assert (read.unit, read.light, read.pitch) == ("share of white", "D65", 7.4e-6)
    assert read.description == "a leaf"


def test_an_hdf5_cube_says_what_it_holds(tmp_path):
    error = np.full((3, 4, 5), 0.25, dtype=np.float32)
    write_cube(tmp_path / "a.h5", cube(error=error, pitch=5e-6))
    with h5py.File(tmp_path / "a.h5") as file:
        data = file["entry/data"]
        assert data.attrs["NX_class"] == "NXdata"
        assert data.attrs["signal"] == "values"
        assert list(data.attrs["axes"]) == ["wavelength", "y", "x"]
        assert data["values"].attrs["units"] == "share of white"
        assert data["wavelength"].attrs["units"] == data["x"].attrs["units"] == "m"
        assert data["x"][:].tolist() == pytest.approx([-1e-5, -5e-6, 0, 5e-6, 1e-5])
        assert data["values"].dims[0][0][:].tolist() == list(BANDS)
        assert "90 %" in data["error"].attrs["long_name"]
    assert np.array_equal(read_cube(tmp_path / "a.h5").error, error)


@pytest.mark.parametrize("interleave", ["bsq", "bil", "BIP"])
@pytest.mark.parametrize(
    ("code", "kind"), [(1, "u1"), (2, "i2"), (3, "i4"), (4, "f4"), (5, "f8"), (12, "u2")]
)
@pytest.mark.parametrize("order", [0, 1])
def test_envi_of_each_kind_is_read(tmp_path, interleave, code, kind, order):
    numbers = np.arange(24).reshape(2, 3, 4).astype("<>"[order] + kind)
    path = write_envi(
        tmp_path, numbers, code=code, interleave=interleave, order=order, offset=7, ending=".img"
    )
    found = read_cube(path)
    assert found.values.tolist() == np.arange(24.0).reshape(2, 3, 4).tolist()
    assert found.wavelengths == (500e-9, 600e-9)
    assert found.description == "Leaves, in the\n  laboratory"


def numbers(low: int = 0) -> np.ndarray:
    return (low + np.arange(24)).reshape(2, 3, 4).astype("<u2")


@pytest.mark.parametrize(
    ("unit", "first", "second"),
    [("nm", 500, 600), ("Micrometers", 0.5, 0.6), ("um", 0.5, 0.6), ("Unknown", 500, 600),
     ("Angstroms", 5000, 6000), ("meters", 5e-7, 6e-7)],
)  # fmt: skip
def test_wavelengths_are_read_in_their_unit(tmp_path, unit, first, second):
    found = read_cube(write_envi(tmp_path, numbers(), unit=unit, first=first, second=second))
    assert found.wavelengths == pytest.approx((500e-9, 600e-9))


def test_bands_are_sorted_and_scaled(tmp_path):
    """By hand: (number * gain + offset) / factor, the shorter wavelength first."""
    more = (
        "data gain values = {2, 4}\ndata offset values = {10, 20}\n"
        "reflectance scale factor = 100.0\n"
    )
    found = read_cube(write_envi(tmp_path, numbers(), first=600, second=500, more=more))
    assert found.wavelengths == (500e-9, 600e-9)
    assert found.values[0, 0, 0] == pytest.approx((12 * 4 + 20) / 100)
    assert found.values[1, 0, 1] == pytest.approx((1 * 2 + 10) / 100)
    assert found.unit == "share of white"


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"unit": "Unknown", "first": 4500, "second": 7000},
         r"leaf\.hdr: wavelengths 4500 to 7000 can't be nanometres, and their unit isn't stated: "
         r"in ångström or wavenumbers \(1/cm\)\? Say so with units"),
        ({"first": 0.45, "second": 0.7}, r"can't be nanometres\. In micrometres\?"),
        ({"unit": "Furlongs"}, "'Furlongs' aren't known"),
        ({"code": 6}, "data type is '6'.*complex"),
        ({"order": 2}, "byte order is 2"),
        ({"interleave": "tile"}, "'tile'. Write bsq, bil or bip"),
        ({"offset": 5, "ending": ".xyz"}, r"aren't beside it\. Put leaf\.raw there"),
        ({"first": 500, "second": "many"}, "Write finite numbers with commas"),
        ({"more": "data ignore value = none"}, "'none'. Write a number"),
        ({"more": "bbl = {1, 2}"}, "bbl has 2. Write 1 for a good band"),
        ({"more": "bbl = {0, 0}"}, "marks all bands as bad"),
        ({"more": "bbl = {1}"}, "has 1 numbers. Write 2"),
        ({"more": "file type = ENVI Classification"}, "twice|classes, and no light"),
        ({"more": "major frame offsets = {8, 0}"}, "without such gaps"),
        ({"more": "samples = 5"}, "samples stands there twice, as '4' and '5'"),
        ({"more": "reflectance scale factor = -1"}, "-1. Write a number above 0"),
        ({"more": "file compression = 1"}, "without compression"),
        ({"more": "data gain values = {1}"}, "has 1 numbers. Write 2"),
        ({"first": 500, "second": 500}, "don't rise"),
    ],
)  # fmt: skip
def test_a_wrong_header_is_refused_in_words(tmp_path, keys, words):
    path = write_envi(tmp_path, numbers(), **keys)
    with pytest.raises(UserError, match=words):
        read_cube(path)


def test_files_that_are_no_cube_are_refused_in_words(tmp_path):
    path = write_envi(tmp_path, numbers())
    (tmp_path / "leaf.raw").write_bytes(b"12345")
    with pytest.raises(UserError, match="5 bytes, and by its header 48"):
        read_cube(path)
    path.write_text(path.read_text().replace("samples = 4\n", ""))
    with pytest.raises(UserError, match=r"no 'samples'\. Add it"):
        read_cube(path)
    path.write_text("PNG")
    with pytest.raises(UserError, match="its first line must be ENVI"):
        read_cube(path)
    with pytest.raises(UserError, match="ending says the kind"):
        cube_paths(tmp_path / "a.tiff")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["a"] = 1
    with pytest.raises(UserError, match="not a spectral cube"):
        read_cube(tmp_path / "other.h5")
    (tmp_path / "text.h5").write_text("no HDF5")
    with pytest.raises(UserError, match="cannot be read as HDF5"):
        read_cube(tmp_path / "text.h5")
    write_cube(tmp_path / "a.h5", cube())
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["entry/data/wavelength"].attrs["units"] = "nm"
    with pytest.raises(UserError, match="wavelengths are in 'nm'"):
        read_cube(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"wavelengths": (450.0, 550.0, 700.0)}, r"can't be metres\. In nanometres\?"),
        ({"wavelengths": (0.45, 0.55, 0.7)}, r"can't be metres\. In micrometres\?"),
        ({"wavelengths": (550e-9, 450e-9, 700e-9)}, "don't rise"),
        ({"wavelengths": (450e-9,)}, "3 bands and 1 wavelengths"),
        ({"values": np.ones((4, 5))}, "bands, rows, columns"),
        ({"values": np.full((3, 2, 2), np.inf)}, "12 NaN or infinite"),
        ({"values": np.full((3, 2, 2), "a")}, "real numbers"),
        ({"error": np.ones((3, 4))}, r"error is \(3, 4\)"),
        ({"error": -np.ones((3, 4, 5))}, "down to -1"),
        ({"pitch": 7.4}, "pitch is 7.4 m"),
    ],
)
def test_a_cube_refuses_what_it_cant_be(change, words):
    given = {"values": np.ones((3, 4, 5)), "wavelengths": BANDS}
    with pytest.raises(UserError, match=words):
        SpectralCube(**(given | change))


def test_bands_are_selected_by_wavelength():
    found = cube(error=np.ones((3, 4, 5))).select_bands((450e-9, 700e-9))
    assert np.array_equal(found.values, cube().values[[0, 2]])
    assert found.error.shape == (2, 4, 5)
    with pytest.raises(UserError, match=r"no band at 600 nm\. The cube has 450, 550, 700 nm"):
        cube().select_bands((600e-9,))


@pytest.mark.parametrize(
    ("values", "first", "taken"),
    [
        ((400, 2500), 400e-9, "nanometres"),
        ((0.4, 2.5), 400e-9, "micrometres"),
        ((4.5e-7, 7e-7), 450e-9, "metres"),
        ((4.5e-4, 7e-4), 450e-9, "millimetres"),
        ((700_000, 430_000), 299_792_458 / 700e12, "gigahertz"),
        ((200, 350), 200e-9, "nanometres"),
    ],
)
def test_a_unit_that_isnt_stated_is_told_by_the_numbers(values, first, taken):
    assert convert_wavelengths(values, "Unknown")[0] == pytest.approx(first)
    assert f"taken to be {taken}" in remark_on_unit(values, "Unknown")
    assert not remark_on_unit(values, "nm")


@pytest.mark.parametrize(
    ("values", "asked"),
    [
        ((4500.0, 7000.0), "in ångström or wavenumbers"),
        ((8000.0, 14000.0), "in ångström or wavenumbers"),
        ((3.0, 5.0), "3 to 5 can't be nanometres, .* in micrometres\\? Say so"),
        ((0.0, 500.0), "isn't stated. Add it"),
        ((1.0, 2.0, 500.0), "isn't stated"),
    ],
)
def test_a_unit_that_could_be_another_is_asked_for(values, asked):
    with pytest.raises(UserError, match=asked):
        convert_wavelengths(values, "")


@pytest.mark.parametrize(
    ("unit", "values"),
    [("Wavenumber", (20_000, 12_500)), ("GHz", (599_584.916, 374_740.5725)),
     ("MHz", (599_584_916, 374_740_572.5)), ("Angstroms", (5000, 8000)), ("cm", (5e-5, 8e-5))],
)  # fmt: skip
def test_wavenumbers_and_frequencies_are_wavelengths(unit, values):
    """By hand: c / 599,584.916 GHz = 500 nm."""
    assert convert_wavelengths(values, unit) == pytest.approx((500e-9, 800e-9))


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="no cubes beside the checkout")
@pytest.mark.parametrize(
    ("name", "shape", "first"),
    [
        ("imec16/RedYellowSet_3_FD1_FN0.hdr", (16, 256, 512), 473e-9),
        ("imec16/VIS_leaves_FD1_FN0_original.hdr", (16, 256, 512), 476e-9),
        ("stereomsi/sample.hdr", (14, 240, 480), 477.247e-9),
    ],
)
def test_cubes_of_real_cameras_are_read(name, shape, first):
    found = read_cube(SHARED / name)
    assert found.shape == shape
    assert found.wavelengths[0] == pytest.approx(first)
    assert found.values.min() >= 0
    assert found.values.max() > 100
