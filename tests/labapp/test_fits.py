"""FITS files by the standard's definition: numbers, units, keywords and damage."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.files.exif import Exif
from labapp.files.picture.fits import count_fits_pages, read_fits

PATH = Path("a.fits")
NUMBERS = np.arange(12).reshape(3, 4)


def unit(
    values: np.ndarray | None, first: str = "SIMPLE  =                    T", **keys: object
) -> bytes:
    """A unit as the standard lays it out: lines of 80, blocks of 2880 bytes, big endian."""
    bits = 8 if values is None else values.dtype.itemsize * (8 if values.dtype.kind in "iu" else -8)
    sizes = () if values is None else values.shape[::-1]
    lines = [first, f"BITPIX  = {bits:20d}", f"NAXIS   = {len(sizes):20d} / axes"]
    lines += [f"NAXIS{k:<3d}= {size:20d}" for k, size in enumerate(sizes, 1)]
    for name, value in keys.items():
        shown = {bool: lambda x: "T" if x else "F", str: lambda x: f"'{x}'"}.get(type(value), str)
        lines.append(f"{name.replace('_', '-'):8}= {shown(value):>20} / a comment / of two")
    text = "".join(f"{line:80}" for line in [*lines, "END"]).encode()
    data = b"" if values is None else values.astype(values.dtype.newbyteorder(">")).tobytes()
    return text + b" " * (-len(text) % 2880) + data + bytes(-len(data) % 2880)


EXTENSION = "XTENSION= 'IMAGE   '"


@pytest.mark.parametrize("kind", ["u1", "i2", "i4", "i8", "f4", "f8"])
def test_numbers_are_read_as_they_are(kind):
    found = read_fits(PATH, unit(NUMBERS.astype(kind)))
    np.testing.assert_array_equal(found.values, NUMBERS[None])
    assert found.values.dtype == kind
    assert found.values.dtype.isnative
    assert found.white == (255 if kind == "u1" else None)
    assert found.pages == 1
    assert found.encoding is not None
    assert found.encoding.name == "linear"


@pytest.mark.parametrize(
    ("kind", "zero", "expected"),
    [("i2", 2**15, "u2"), ("i4", 2**31, "u4"), ("i8", 2**63, "u8"), ("u1", -128, "i1")],
)
def test_the_range_of_the_other_sign_is_kept_to_the_bit(kind, zero, expected):
    """By table 11 of the standard."""
    limits = np.iinfo(expected)
    values = np.array([[limits.min, limits.min + 1, limits.max - 1, limits.max]], object)
    stored = (values - zero).astype(kind)
    for written in (zero, float(zero)):
        found = read_fits(PATH, unit(stored, BZERO=written, BSCALE=1.0))
        assert found.values.dtype == expected
        assert found.values[0].tolist() == values.tolist()
    assert found.white == (65535 if expected == "u2" else None)


def test_scaled_numbers_and_missing_ones():
    found = read_fits(PATH, unit(NUMBERS.astype("i2"), BSCALE="0.5", BZERO=-1))
    np.testing.assert_array_equal(found.values[0], NUMBERS - 1)
    found = read_fits(PATH, unit(NUMBERS.astype("i2"), BSCALE=0.5, BZERO=10.0, BLANK=7))
    expected = NUMBERS * 0.5 + 10
    expected[1, 3] = np.nan
    np.testing.assert_array_equal(found.values[0], expected)
    assert found.values.dtype == np.float32
    assert found.notes[:2] == (
        "its numbers were multiplied by 0.5 (BSCALE), and 10 added (BZERO)",
        "1 of its values are missing (BLANK)",
    )
    assert read_fits(PATH, unit(NUMBERS.astype("i2"), BLANK=-32768)).values.dtype == np.int16
    found = read_fits(PATH, unit(NUMBERS.astype("f8"), BSCALE=2.0))
    np.testing.assert_array_equal(found.values[0], 2.0 * NUMBERS)


def test_planes_are_colours_or_pages():
    cube = np.arange(24, dtype="i2").reshape(3, 2, 4)
    found = read_fits(PATH, unit(cube))
    np.testing.assert_array_equal(found.values, cube)
    assert "its three planes were taken as red, green and blue" in found.notes
    found = read_fits(PATH, unit(cube, CTYPE3="WAVE"), 2)
    np.testing.assert_array_equal(found.values, cube[2:])
    assert found.pages == 3
    stack = np.arange(16, dtype="i2").reshape(2, 1, 2, 4)
    np.testing.assert_array_equal(read_fits(PATH, unit(stack), 1).values, stack[1])


def test_units_are_counted_and_extensions_follow_an_empty_one():
    first = unit(None, EXPTIME=2.5, INSTRUME="Cam O''1", DATE_OBS="2024-05-06T07:08:09.5")
    table = unit(np.zeros((5, 3), "u1"), "XTENSION= 'BINTABLE'", PCOUNT=100, GCOUNT=1)
    file = first + unit(NUMBERS.astype("f4"), EXTENSION) + table
    file += unit(NUMBERS.astype("i2") + 1, EXTENSION, EXPTIME=4) + b"what is no unit"
    found = read_fits(PATH, file)
    assert found.pages == count_fits_pages(PATH, file) == 2
    np.testing.assert_array_equal(found.values[0], NUMBERS)
    assert found.exif == Exif(2.5, model="Cam O'1", taken=datetime(2024, 5, 6, 7, 8, 9, 500000))
    found = read_fits(PATH, file, 1)
    np.testing.assert_array_equal(found.values[0], NUMBERS + 1)
    assert found.exif is not None
    assert found.exif.exposure_time == 4
    for page in (-1, 2):
        with pytest.raises(UserError, match="holds 2 pictures, counted from 0"):
            read_fits(PATH, file, page)


def test_the_order_of_rows_and_a_mosaic_are_told():
    found = read_fits(PATH, unit(NUMBERS.astype("i2"), BAYERPAT="RGGB"))
    assert "FITS counts rows from the bottom, and they are kept in its order" in found.notes
    assert "it is a mosaic of colours (BAYERPAT 'RGGB'), which was taken as grey" in found.notes
    found = read_fits(PATH, unit(NUMBERS.astype("i2"), ROWORDER="TOP-DOWN"))
    assert found.notes == ("its first row is the top one (ROWORDER)",)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (unit(NUMBERS)[:2900], "a damaged FITS file: its data end early"),
        (unit(NUMBERS)[:300], "a header has no end"),
        (
            unit(NUMBERS).replace(
                b"BITPIX  =                   64", b"BITPIX  =                   63"
            ),
            "BITPIX 63",
        ),
        (
            unit(NUMBERS).replace(
                b"NAXIS   =                    2", b"NAXIS   =                   -1"
            ),
            "NAXIS -1",
        ),
        (unit(NUMBERS).replace(b"NAXIS2", b"NAXISX"), "doesn't say how many numbers an axis"),
        (unit(NUMBERS).replace(b"    3", b"99999"), "its data end early"),
        (unit(NUMBERS, BSCALE=0.0), "its BSCALE is 0"),
        (unit(NUMBERS, PCOUNT=-5), "PCOUNT -5"),
        (unit(None), "FITS file without a picture: it has no data"),
        (
            unit(None) + unit(np.zeros((1, 8), "u1"), "XTENSION= 'BINTABLE'", ZIMAGE=True),
            "compressed in tiles. Expand it with funpack",
        ),
        (
            unit(None) + unit(np.zeros((1, 8), "u1"), "XTENSION= 'TABLE   '"),
            "it has no data, TABLE",
        ),
    ],
)
def test_damaged_and_other_files_are_named(data, words):
    with pytest.raises(UserError, match=r"^a\.fits: ") as error:
        read_fits(PATH, data)
    assert words in str(error.value)


def test_hurt_files_end_in_words():
    data = unit(None, EXPTIME=1) + unit(NUMBERS.astype("i2"), EXTENSION, BZERO=3.0, BLANK=2)
    generator = np.random.default_rng(3)
    refused = 0
    for _ in range(400):
        hurt = np.frombuffer(data, np.uint8).copy()
        hurt[generator.integers(0, 1000, 4)] = generator.integers(32, 127, 4)
        hurt[2880 + generator.integers(0, 1000, 4)] = generator.integers(32, 127, 4)
        try:
            read_fits(PATH, hurt.tobytes())
        except UserError:
            refused += 1
    assert refused > 50
