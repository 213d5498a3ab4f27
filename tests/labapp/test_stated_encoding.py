"""What files say of their encoding: PNG's chunks and their order, profiles in other formats."""

from __future__ import annotations

import io
import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms

from labapp.common.errors import UserError
from labapp.files.picture.boxed_formats import heif_encoding
from labapp.files.picture.encoding import BT709, HLG, LINEAR, PQ, SRGB, Encoding, gamma_encoding
from labapp.files.picture.icc import icc_encoding
from labapp.files.picture.stated_encoding import (
    icc_of_jpeg,
    icc_of_webp,
    png_encoding,
    png_with_encoding,
)

GREY = np.arange(48, dtype=np.uint8).reshape(6, 8)
PLAIN = cv2.imencode(".png", GREY)[1].tobytes()
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def chunk(name: bytes, content: bytes) -> bytes:
    check = zlib.crc32(name + content)
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", check)


def png(*chunks: tuple[bytes, bytes]) -> bytes:
    return PLAIN[:33] + b"".join(chunk(*one) for one in chunks) + PLAIN[33:]


def gama(value: int) -> tuple[bytes, bytes]:
    return b"gAMA", struct.pack(">I", value)


ICCP = (b"iCCP", b"name\0\0" + zlib.compress(PROFILE))


@pytest.mark.parametrize(
    ("chunks", "name", "source"),
    [
        ((), None, ""),
        ((gama(45455),), "gamma 2.2", "gAMA"),
        ((gama(55556),), "gamma 1.8", "gAMA"),
        ((gama(100000),), "linear", "gAMA"),
        (((b"sRGB", b"\1"),), "srgb", "sRGB"),
        ((gama(100000), (b"sRGB", b"\0")), "srgb", "sRGB"),
        ((gama(45455), ICCP), "srgb", "ICC profile"),
        ((ICCP, (b"sRGB", b"\0")), "srgb", "ICC profile"),
        (((b"sRGB", b"\0"), (b"cICP", bytes((1, 8, 0, 1)))), "linear", "cICP"),
        ((ICCP, (b"cICP", bytes((1, 2, 0, 1)))), "srgb", "ICC profile"),
    ],
)
def test_the_most_exact_chunk_of_a_png_holds(chunks, name, source):
    stated = png_encoding(png(*chunks))
    assert (stated.encoding.name if stated.encoding else None) == name
    assert source in stated.source
    assert stated.notes == ()


@pytest.mark.parametrize(
    ("number", "encoding"),
    [
        *((number, BT709) for number in (1, 6, 14, 15)),
        *((8, LINEAR), (13, SRGB), (16, PQ), (18, HLG)),
        *((4, gamma_encoding(2.2)), (5, gamma_encoding(2.8))),
    ],
)
def test_code_points_name_encodings(number, encoding):
    """By ITU-T H.273, table 3."""
    stated = png_encoding(png((b"cICP", bytes((9, number, 0, 1)))))
    assert stated.encoding is not None
    assert stated.encoding.name == encoding.name
    assert "its colours are those of BT.2020, and not sRGB's" in stated.notes[0]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ((1, 9, 0, 1), "transfer characteristics 9"),
        ((1, 13, 0, 0), "those of video"),
        ((1, 13, 9, 1), "those of video"),
    ],
)
def test_levels_that_stand_for_unknown_light_are_refused(content, words):
    with pytest.raises(UserError, match=f"{words}.*name its encoding"):
        png_encoding(png((b"cICP", bytes(content))))


@pytest.mark.parametrize(
    ("first", "words"),
    [
        (gama(0), "gAMA holds no sensible number"),
        ((b"gAMA", b"\0\0"), "gAMA holds no sensible number"),
        ((b"cICP", b"\1"), "cICP is damaged"),
        ((b"iCCP", b"name\0\0nothing"), "ICC profile is damaged"),
        ((b"iCCP", b"name\0\0" + zlib.compress(PROFILE[:300])), "ICC profile is damaged"),
        ((b"iCCP", b""), "ICC profile is damaged"),
    ],
)
def test_damaged_chunks_are_passed_over_and_told(first, words):
    stated = png_encoding(png(first, (b"sRGB", b"\0")) if first[0] != b"gAMA" else png(first))
    assert any(words in note for note in stated.notes)
    assert stated.encoding is (None if first[0] == b"gAMA" else SRGB)


def test_a_wrong_check_sum_is_told():
    data = bytearray(png((b"sRGB", b"\0")))
    data[33 + 9] ^= 255
    assert png_encoding(bytes(data)).notes == ("its chunk sRGB is damaged and was passed over",)


@pytest.mark.parametrize("encoding", [LINEAR, SRGB, BT709, PQ, HLG, gamma_encoding(1.8)], ids=str)
@pytest.mark.parametrize("depth", ["u1", "u2"])
def test_a_png_says_what_it_is(encoding, depth):
    values = (np.arange(48) * 5).astype(depth).reshape(6, 8)
    data = png_with_encoding(cv2.imencode(".png", values)[1].tobytes(), encoding)
    stated = png_encoding(data)
    assert stated.encoding is not None
    assert stated.encoding.name == encoding.name
    read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, values)
    # Pillow checks the sums of chunks that it knows.
    pillow = Image.open(io.BytesIO(data))
    np.testing.assert_array_equal(np.asarray(pillow), values)
    gamma = {"linear": 1.0, "srgb": 0.45455, "gamma 1.8": 0.55556}.get(encoding.name)
    assert pillow.info.get("gamma") == gamma
    assert pillow.info.get("srgb") == (0 if encoding is SRGB else None)


def test_the_curves_of_a_profile_are_not_written():
    with pytest.raises(ValueError, match="isn't written"):
        png_with_encoding(PLAIN, Encoding("icc", np.zeros((1, 2))))


def test_profiles_are_found_in_other_formats():
    colour = Image.fromarray(np.zeros((8, 8, 3), np.uint8))
    # More than a segment of JPEG can hold.
    large = PROFILE + bytes(150_000)
    for kind, read in (("JPEG", icc_of_jpeg), ("WEBP", icc_of_webp)):
        for profile in (PROFILE, large):
            file = io.BytesIO()
            colour.save(file, kind, icc_profile=profile)
            assert read(file.getvalue()) == profile
        file = io.BytesIO()
        colour.save(file, kind)
        assert read(file.getvalue()) is None
    file = io.BytesIO()
    colour.save(file, "JPEG", icc_profile=large)
    data = file.getvalue()
    second = data.rindex(b"ICC_PROFILE")
    assert icc_of_jpeg(data[: second - 4] + data[second - 4 :].replace(b"ICC_P", b"XXX_P")) is None


def test_the_encoding_of_avif_stands_in_its_colour_box():
    picture = Image.fromarray(np.zeros((16, 16, 3), np.uint8))
    file = io.BytesIO()
    picture.save(file, "AVIF")
    # Pillow writes sRGB's code points.
    assert heif_encoding(file.getvalue()).encoding is SRGB
    for number, name in ((8, "linear"), (16, "pq")):
        at = file.getvalue().index(b"nclx") + 6
        changed = file.getvalue()[:at] + struct.pack(">H", number) + file.getvalue()[at + 2 :]
        stated = heif_encoding(changed)
        assert stated.encoding is not None
        assert stated.encoding.name == name
    file = io.BytesIO()
    picture.save(file, "AVIF", icc_profile=PROFILE)
    assert heif_encoding(file.getvalue()).source == icc_encoding(PROFILE).source
    assert heif_encoding(PLAIN).encoding is None
