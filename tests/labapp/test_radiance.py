"""Radiance HDR against imagecodecs, OpenCV, and bytes by the format's definition."""

from __future__ import annotations

from pathlib import Path

import cv2
import imagecodecs
import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.files.picture.radiance import encode_radiance, read_radiance

PATH = Path("a.hdr")


def wide_light(rows: int = 9, columns: int = 40, bands: int = 3) -> np.ndarray:
    """Light over 12 decades, with black pixels and equal neighbours."""
    generator = np.random.default_rng(3)
    decades = 10 ** generator.uniform(-6, 6, (1, rows, columns))
    light = (generator.random((bands, rows, columns)) * decades).astype(np.float32)
    light[:, 2] = 0
    light[:, 3] = light[:, 3, :1]
    return light


def hdr(pixels: bytes, size: bytes = b"-Y 1 +X 4", lines: bytes = b"") -> bytes:
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n" + lines + b"\n" + size + b"\n" + pixels


PIXELS = bytes([128, 64, 32, 129, 200, 0, 100, 120, 0, 0, 0, 0, 9, 8, 255, 140])
LIGHT = np.array([[128, 64, 32], [200, 0, 100], [0, 0, 0], [9, 8, 255]]) * 2.0 ** np.array(
    [[129 - 136], [120 - 136], [0], [140 - 136]]
)


def test_pixels_by_hand_have_their_light():
    found = read_radiance(PATH, hdr(PIXELS))
    np.testing.assert_array_equal(found.values[:, 0].T, LIGHT.astype(np.float32))
    assert found.values.dtype == np.float32
    assert (found.kind, found.white, found.orientation) == ("Radiance HDR", None, 1)
    assert found.encoding is not None
    assert found.encoding.name == "linear"
    assert found.notes == ()


def test_what_other_programs_write_is_read():
    light = wide_light()
    files = [
        imagecodecs.rgbe_encode(np.ascontiguousarray(np.moveaxis(light, 0, -1)), header=True),
        cv2.imencode(".hdr", np.ascontiguousarray(np.moveaxis(light[::-1], 0, -1)))[1].tobytes(),
    ]
    for data in files:
        found = read_radiance(PATH, data).values
        opencv = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(found, np.moveaxis(opencv[..., ::-1], -1, 0))
        # Both cut mantissas of 8 bits off.
        assert np.abs(found - light).max(axis=0) == pytest.approx(0, abs=1e9)
        assert (np.abs(found - light) <= light.max(axis=0) / 128).all()


@pytest.mark.parametrize("columns", [1, 7, 8, 130, 40000])
def test_what_is_written_is_the_nearest_that_the_format_holds(columns):
    light = wide_light(5, columns)
    data, notes = encode_radiance(light)
    assert notes == ()
    opencv = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    for found in (read_radiance(PATH, data).values, np.moveaxis(opencv[..., ::-1], -1, 0)):
        # Half a step of a mantissa: the brightest colour has 128 to 256 of them.
        assert (np.abs(found - light) <= light.max(axis=0) / 256 * (1 + 1e-6)).all()
    again, _ = encode_radiance(read_radiance(PATH, data).values)
    assert again == data


def test_grey_is_written_as_equal_colours():
    grey = wide_light(bands=1)
    found = read_radiance(PATH, encode_radiance(grey)[0]).values
    assert (np.abs(found - grey) <= grey / 256 * (1 + 1e-6)).all()
    assert (found[0] == found[1]).all()


def test_what_does_not_fit_is_told():
    light = np.array([[[-1.0, 2.0, 0.5, 1e-35]]], np.float32)
    data, notes = encode_radiance(light)
    assert notes == ("25 % of its numbers are negative, and 0 in Radiance HDR",)
    np.testing.assert_array_equal(read_radiance(PATH, data).values[0, 0], [0, 2, 0.5, 0])
    for bad in (np.nan, np.inf, 3e38):
        with pytest.raises(UserError, match=r"holds numbers up to 1\.7e\+38.* Write OpenEXR"):
            encode_radiance(np.full((1, 2, 2), bad, np.float32))


def test_exposures_and_corrections_are_taken_off():
    lines = b"SOFTWARE=x\nEXPOSURE=2\nEXPOSURE= 4.0 \nCOLORCORR=1 2 0.5\nGAMMA=1.0\n"
    found = read_radiance(PATH, hdr(PIXELS, lines=lines))
    expected = LIGHT / 8 / np.array([1, 2, 0.5])
    np.testing.assert_allclose(found.values[:, 0].T, expected, rtol=1e-6)
    assert any("divided by its EXPOSURE, 4.0" in note for note in found.notes)


def test_other_primaries_and_gammas_are_told():
    lines = b"PRIMARIES= .64 .33 .30 .60 .15 .06 .3127 .3290\n"
    assert read_radiance(PATH, hdr(PIXELS, lines=lines)).notes == ()
    lines = b"PRIMARIES= .68 .32 .265 .69 .15 .06 .3127 .3290\nGAMMA=2.2\n"
    found = read_radiance(PATH, hdr(PIXELS, lines=lines))
    assert "other primaries than sRGB" in found.notes[0]
    assert found.encoding is not None
    assert (found.encoding.name, found.encoding_source) == ("gamma 2.2", "its GAMMA")


@pytest.mark.parametrize(
    ("size", "orientation"),
    [
        # By the reference manual: the first axis is that of the rows; Y goes up, X to the right.
        (b"-Y 2 +X 2", 1),
        (b"-Y 2 -X 2", 2),
        (b"+Y 2 -X 2", 3),
        (b"+Y 2 +X 2", 4),
        (b"+X 2 -Y 2", 5),
        (b"-X 2 -Y 2", 6),
        (b"-X 2 +Y 2", 7),
        (b"+X 2 +Y 2", 8),
    ],
)
def test_rows_keep_their_order_and_the_orientation_is_told(size, orientation):
    found = read_radiance(PATH, hdr(PIXELS, size))
    assert found.orientation == orientation
    np.testing.assert_array_equal(found.values.reshape(3, 4).T, LIGHT.astype(np.float32))


def test_old_runs_are_expanded():
    first, second = PIXELS[:4], PIXELS[4:8]
    pixels = first + bytes([1, 1, 1, 5]) + second + bytes([1, 1, 1, 2, 1, 1, 1, 1]) + first
    count = 1 + 5 + 1 + 2 + 256 + 1
    found = read_radiance(PATH, hdr(pixels, b"-Y 1 +X %d" % count)).values[:, 0].T
    expected = np.repeat(LIGHT[[0, 1, 0]], [6, 259, 1], axis=0)
    np.testing.assert_array_equal(found, expected.astype(np.float32))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"#?RADIANCE\n", "header has no end"),
        (hdr(PIXELS, b"-Y 1 +Y 4"), "its size is '-Y 1"),
        (hdr(PIXELS, b"-Y 0 +X 4"), "no pixels"),
        (hdr(PIXELS[:-1]), "aren't as many"),
        (hdr(PIXELS + PIXELS), "aren't as many"),
        (hdr(b"\1\1\1\4" + PIXELS[:4]), "aren't as many"),
        (hdr(PIXELS[:4] + b"\1\1\1\xff" * 40, b"-Y 1 +X 300"), "aren't as many"),
        (hdr(b"\2\2\0\x08" + b"\x88\1" * 3, b"-Y 1 +X 8"), "end early"),
        (hdr(b"\2\2\0\x08" + b"\0" * 30, b"-Y 1 +X 8"), "end early, or can't"),
        (hdr(PIXELS, lines=b"EXPOSURE=0\n"), "EXPOSURE is '0'"),
        (hdr(PIXELS, lines=b"EXPOSURE=nan\n"), "EXPOSURE is 'nan'"),
        (hdr(PIXELS, lines=b"EXPOSURE=1e20\nEXPOSURE=1e20\n"), "no sensible number"),
        (hdr(PIXELS, lines=b"COLORCORR=1 1\n"), "COLORCORR is '1 1'"),
        (hdr(b"\2\2\0\x08" + b"\x88\1" * 60, b"-Y 10000 +X 10000"), "end early"),
        (hdr(PIXELS, b"-Y 99999 +X 99999"), "would take 120 GB"),
    ],
)
def test_damaged_files_are_named(data, words):
    with pytest.raises(UserError, match=r"^a\.hdr: ") as error:
        read_radiance(PATH, data)
    assert words in str(error.value)


def test_light_in_xyz_is_refused_by_name():
    with pytest.raises(UserError, match=r"format '32-bit_rle_xyze'.* ra_xyze -r"):
        read_radiance(PATH, hdr(PIXELS).replace(b"rgbe", b"xyze"))
    with pytest.raises(UserError, match="holds 1 picture"):
        read_radiance(PATH, hdr(PIXELS), 1)


def test_hurt_files_end_in_words():
    data, _ = encode_radiance(wide_light())
    generator = np.random.default_rng(5)
    refused = 0
    for _ in range(300):
        hurt = np.frombuffer(data, np.uint8).copy()
        hurt[generator.integers(0, hurt.size, 3)] = generator.integers(0, 256, 3)
        try:
            read_radiance(PATH, hurt[: generator.integers(1, hurt.size + 1)].tobytes())
        except UserError:
            refused += 1
    assert refused > 100
