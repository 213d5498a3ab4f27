"""Portable maps against Pillow, OpenCV, and bytes by Netpbm's definitions."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from labapp.common.errors import UserError
from labapp.files.picture.netpbm import count_netpbm_pages, is_netpbm, read_netpbm

PATH = Path("a.pnm")
GREY = np.arange(35, dtype=np.uint8).reshape(5, 7) * 7
COLOURS = np.random.default_rng(1).integers(0, 256, (3, 5, 7), np.uint8)


def read(data: bytes, page: int = 0):
    assert is_netpbm(data)
    return read_netpbm(PATH, data, page)


def test_what_pillow_writes_is_read():
    for picture, values, white in (
        (Image.fromarray(GREY), GREY[None], 255),
        (Image.fromarray(np.ascontiguousarray(np.moveaxis(COLOURS, 0, -1))), COLOURS, 255),
        (Image.fromarray(GREY > 100), (GREY > 100)[None], 1),
        (Image.fromarray(GREY.astype(np.uint16) * 257), GREY[None] * np.uint16(257), 65535),
    ):
        file = io.BytesIO()
        picture.save(file, "PPM")
        found = read(file.getvalue())
        np.testing.assert_array_equal(found.values, values)
        assert (found.white, found.encoding, found.pages, found.notes) == (white, None, 1, ())


@pytest.mark.parametrize("kind", ["u1", "u2"])
@pytest.mark.parametrize(
    ("ending", "is_text"),
    [(".pgm", False), (".pgm", True), (".ppm", False), (".ppm", True), (".pam", False)],
)
def test_what_opencv_writes_is_read(kind, ending, is_text):
    # OpenCV writes PAM with blue first, which isn't what its header says.
    values = (COLOURS if ending == ".ppm" else COLOURS[:1]).astype(kind)
    values = values * 257 if kind == "u2" else values
    shown = np.moveaxis(values[::-1], 0, -1)
    options = [cv2.IMWRITE_PXM_BINARY, 0] if is_text else []
    found = read(cv2.imencode(ending, np.ascontiguousarray(shown), options)[1].tobytes())
    np.testing.assert_array_equal(found.values, values)
    assert found.white == {"u1": 255, "u2": 65535}[kind]


@pytest.mark.parametrize("bands", [1, 3])
def test_pfm_has_its_rows_from_top_to_bottom(bands):
    values = np.random.default_rng(2).random((bands, 5, 7)).astype(np.float32)
    shown = np.ascontiguousarray(np.moveaxis(values[::-1], 0, -1))
    found = read(cv2.imencode(".pfm", shown)[1].tobytes())
    np.testing.assert_array_equal(found.values, values)
    assert found.encoding is not None
    assert (found.encoding.name, found.white, found.kind) == ("linear", None, "PFM")
    # By its definition: the bottom row first, and the sign of the scale tells the order of bytes.
    stored = np.ascontiguousarray(np.moveaxis(values[:, ::-1], 0, -1))
    magic = b"Pf" if bands == 1 else b"PF"
    for scale, kind in ((b"1.0", ">f4"), (b"-1", "<f4")):
        data = magic + b"\n7 5\n" + scale + b"\n" + stored.astype(kind).tobytes()
        np.testing.assert_array_equal(read(data).values, values)
    data = magic + b"\n7 5\n-2.5\n" + stored.astype("<f4").tobytes()
    assert read(data).notes == ("its scale of 2.5 was not applied, since programs differ",)


@pytest.mark.parametrize(
    ("data", "values", "white"),
    [
        (b"P1\n# bits\n3 2\n101\n0 1 0\n", [[[0, 1, 0], [1, 0, 1]]], 1),
        (b"P4 3 2\n\xa0\x40", [[[0, 1, 0], [1, 0, 1]]], 1),
        (b"P2\n3 1\n#white\n15\n0 7 # seven\n15\n", [[[0, 7, 15]]], 15),
        (b"P3 1 2 4000\n1 2 3\n4000 5 6\n", [[[1], [4000]], [[2], [5]], [[3], [6]]], 4000),
        (b"P5\n2 1\n1023\n\x03\xff\x00\x10", [[[1023, 16]]], 1023),
        (b"P5 # a\n 2\t1 # b\n100\n\x64\x23", [[[100, 35]]], 100),
        (b"P6\n1 1\n255\n\n\r ", [[[10]], [[13]], [[32]]], 255),
        (
            b"P7\nWIDTH 1\nHEIGHT 2\nDEPTH 1\nMAXVAL 1\nTUPLTYPE BLACKANDWHITE\nENDHDR\n\1\0",
            [[[1], [0]]],
            1,
        ),
        (
            b"P7\n# x\nHEIGHT 1\nWIDTH 1\nDEPTH 3\nMAXVAL 255\nENDHDR\n\1\2\3",
            [[[1]], [[2]], [[3]]],
            255,
        ),
    ],
)
def test_files_by_hand(data, values, white):
    found = read(data)
    np.testing.assert_array_equal(found.values, values)
    assert found.white == white


def test_transparency_is_left_out_and_told():
    head = b"P7\nWIDTH 1\nHEIGHT 1\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\n"
    found = read(head + bytes([10, 20, 30, 128]))
    np.testing.assert_array_equal(found.values, [[[10]], [[20]], [[30]]])
    assert "transparency was left out" in found.notes[0]


def test_pictures_after_each_other_are_pages():
    data = b"P5 2 1 255\n\1\2" + b"P6 1 1 255\n\3\4\5" + b"P4 1 1\n\x80"
    assert count_netpbm_pages(PATH, data) == 3
    assert [read(data, k).pages for k in range(3)] == [3, 3, 3]
    np.testing.assert_array_equal(read(data, 1).values, [[[3]], [[4]], [[5]]])
    for page in (-1, 3):
        with pytest.raises(UserError, match="holds 3 pictures"):
            read(data, page)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"P5\n2", "header ends early"),
        (b"P5\n2 2\n255\n\1\2\3", "pixels end early"),
        (b"P5\n99999 99999\n255\n\1\2\3", "pixels end early"),
        (b"P5\n0 2\n255\n", "a size in its header is '0'"),
        (b"P5\n2 x\n255\n", "a size in its header is 'x'"),
        (b"P5\n2 1\n99999\n\1\2", "highest level is 99999"),
        (b"P5\n2 1\n100\n\1\xff", "numbers above 100"),
        (b"P2\n2 1\n9\n1 10\n", "2 numbers from 0 to 9"),
        (b"P2\n2 1\n9\n1\n    ", "2 numbers from 0 to 9"),
        (b"P2\n2 1\n9\n1 a\n", "aren't whole numbers"),
        (b"P2\n99999 99999\n9\n1 a\n", "pixels end early"),
        (b"P1\n2 2\n1 0 1\n", "pixels end early"),
        (b"Pf\n2 1\nnan\n" + bytes(8), "its scale is 'nan'"),
        (b"Pf\n2 1\n0\n" + bytes(8), "its scale is '0'"),
        (b"P7\nWIDTH 1\n", "header ends early"),
        (b"P7\nWIDTH 1\nHEIGHT 1\nDEPTH 5\nMAXVAL 1\nENDHDR\n12345", "5 samples a pixel"),
    ],
)
def test_damaged_files_are_named(data, words):
    with pytest.raises(UserError, match=r"^a\.pnm: ") as error:
        read(data)
    assert words in str(error.value)
