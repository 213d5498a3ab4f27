"""Exif in files of all formats, as Pillow and others write it; damaged blocks end in nothing."""

from __future__ import annotations

import io
import random
import struct
import zlib
from datetime import datetime

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image

from labapp.files.exif import UNCALIBRATED, Exif, read_exif
from labapp.files.picture.boxed_formats import (
    exif_of_heif,
    exif_of_jpeg_xl,
    orientation_of_heif,
    read_jpeg_xl_header,
)
from labapp.files.picture.file_parts import (
    exif_of_jpeg,
    exif_of_png,
    exif_of_webp,
)

PICTURE = Image.fromarray(np.arange(24 * 16 * 3, dtype=np.uint8).reshape(24, 16, 3))
EXPOSED = {0x829A: 1 / 125, 0x829D: 5.6, 0x8827: 400, 0x9204: -2 / 3, 0xA001: 1}
SHOT = Exif(
    1 / 125, 5.6, 400, -2 / 3, 6, 1, "Maker", "Model 1", datetime(2024, 2, 29, 12, 0, 1, 250000)
)


def pillow_exif(inner: dict[int, object], outer: dict[int, object]) -> Image.Exif:
    """Exif that Pillow writes: tags of the inner directory, and of the outer one."""
    exif = Image.Exif()
    for tag, value in outer.items():
        exif[tag] = value
    exif.get_ifd(0x8769).update(inner)
    # Only what was read has the inner directory when Pillow writes TIFF.
    again = Image.Exif()
    again.load(exif.tobytes())
    return again


SHOT_BY_PILLOW = pillow_exif(
    {**EXPOSED, 0x9003: "2024:02:29 12:00:01", 0x9291: "25"},
    {0x010F: "Maker", 0x0110: "Model 1", 0x0112: 6},
)


def orientation_of_jpeg_xl(data: bytes) -> int | None:
    header = read_jpeg_xl_header(data)
    return header.orientation if header else None


def saved(kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    PICTURE.save(file, kind, **options)
    return file.getvalue()


def assert_same(found: Exif | None, expected: Exif) -> None:
    assert found is not None
    # Pillow writes fractions of numbers that are none.
    for name in ("exposure_time", "f_number", "iso", "exposure_bias"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-6)
    for name in ("orientation", "colour_space", "maker", "model", "taken"):
        assert getattr(found, name) == getattr(expected, name)


@pytest.mark.parametrize(
    ("kind", "read"),
    [("JPEG", exif_of_jpeg), ("PNG", exif_of_png), ("WEBP", exif_of_webp), ("TIFF", read_exif)],
)
def test_exif_is_found_where_pillow_writes_it(kind, read):
    assert_same(read(saved(kind, exif=SHOT_BY_PILLOW)), SHOT)
    assert read(saved(kind)) in (None, Exif(orientation=1))


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "TIFF"])
def test_the_wrong_format_holds_no_exif(kind):
    data = saved(kind, exif=SHOT_BY_PILLOW)
    readers = {"JPEG": exif_of_jpeg, "PNG": exif_of_png, "WEBP": exif_of_webp, "TIFF": read_exif}
    for other, read in readers.items():
        if other != kind:
            assert read(data) is None
    assert exif_of_heif(data) is None
    assert exif_of_jpeg_xl(data) is None
    assert orientation_of_jpeg_xl(data) is None


def test_exif_of_jpeg_xl_and_of_a_heif_item():
    block = SHOT_BY_PILLOW.tobytes()
    box = struct.pack(">I4sI", 12 + len(block), b"Exif", 6) + block
    assert_same(exif_of_jpeg_xl(struct.pack(">I4s", 12, b"JXL ") + b"\r\n\x87\n" + box), SHOT)
    assert_same(
        exif_of_heif(saved("AVIF", exif=pillow_exif(EXPOSED, {0x010F: "Maker"}))),
        Exif(1 / 125, 5.6, 400, -2 / 3, None, 1, "Maker"),
    )


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_of_avif_is_that_of_its_properties(orientation):
    data = saved("AVIF", exif=pillow_exif({}, {0x0112: orientation}))
    assert orientation_of_heif(data) == orientation


def test_the_orientation_of_jpeg_xl_is_in_its_header():
    plain = imagecodecs.jpegxl_encode(np.asarray(PICTURE), lossless=True)
    assert orientation_of_jpeg_xl(plain) == 1
    for rows, columns in ((24, 16), (256, 512), (301, 7)):
        picture = np.zeros((rows, columns), np.uint8)
        for boxed in (False, True):
            data = imagecodecs.jpegxl_encode(picture, lossless=True, usecontainer=boxed)
            assert orientation_of_jpeg_xl(data) == 1


@pytest.mark.parametrize("orientation", [2, 6, 8])
@pytest.mark.parametrize("size", ["small", "any", "wide"])
def test_the_bits_of_a_jpeg_xl_header(orientation, size):
    """Written by the standard's table: size, all_default, extra_fields, orientation - 1."""
    bits = {
        "small": [(1, 1), (2, 5), (0, 3), (1, 5)],
        "any": [(0, 1), (0, 2), (99, 9), (0, 3), (1, 2), (4000, 13)],
        "wide": [(0, 1), (2, 2), (99999, 18), (5, 3)],
    }[size]
    number = at = 0
    for value, count in [*bits, (0, 1), (1, 1), (orientation - 1, 3)]:
        number |= value << at
        at += count
    assert orientation_of_jpeg_xl(b"\xff\x0a" + number.to_bytes(20, "little")) == orientation


def test_older_png_files_keep_exif_in_a_text():
    block = SHOT_BY_PILLOW.tobytes()
    text = f"\nexif\n{len(block):8}\n" + "\n".join(
        block.hex()[k : k + 72] for k in range(0, 2 * len(block), 72)
    )
    for name, content in (
        (b"zTXt", b"Raw profile type exif\0\0" + zlib.compress(text.encode())),
        (b"tEXt", b"Raw profile type APP1\0" + text.encode()),
    ):
        assert_same(exif_of_png(png_with(name, content)), SHOT)
    assert exif_of_png(png_with(b"zTXt", b"Raw profile type exif\0\0no deflate")) is None
    assert exif_of_png(png_with(b"tEXt", b"Raw profile type exif\0\nexif\n 4\nzz")) is None


def test_a_chunk_with_a_wrong_check_sum_is_passed_over():
    data = png_with(b"eXIf", SHOT_BY_PILLOW.tobytes()[6:])
    assert_same(exif_of_png(data), SHOT)
    at = data.index(b"eXIf") + 40
    assert exif_of_png(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]) is None


def test_apex_values_stand_in_for_time_and_aperture():
    found = read_exif(pillow_exif({0x9201: 6.0, 0x9202: 3.0, 0x829A: 0}, {}).tobytes())
    assert found is not None
    assert found.exposure_time == pytest.approx(1 / 64)
    assert found.f_number == pytest.approx(2 * 2**0.5)


@pytest.mark.parametrize(
    ("tags", "iso"),
    [
        ({0x8827: 200}, 200),
        ({0x8827: 65535, 0x8830: 2, 0x8832: 102400}, 102400),
        ({0x8831: 125}, 125),
        ({0x8833: 51200, 0x8827: 65535}, 51200),
        ({0xA215: 160.0}, 160),
        ({0x8827: 0}, None),
    ],
)
def test_the_sensitivity_stands_in_several_tags(tags, iso):
    found = read_exif(pillow_exif({**tags, 0xA001: UNCALIBRATED}, {}).tobytes())
    assert found is not None
    assert (found.iso, found.colour_space) == (iso, UNCALIBRATED)


def test_a_page_of_a_tiff_is_named_by_its_directory():
    file = io.BytesIO()
    with tifffile.TiffWriter(file, bigtiff=True) as writer:
        for k in (1, 3):
            writer.write(
                np.zeros((2, 2), np.uint8),
                extratags=[(274, 3, 1, k), (33434, 5, 1, (1, 100 * k)), (33437, 5, 1, (28, 10))],
            )
    data = file.getvalue()
    with tifffile.TiffFile(io.BytesIO(data)) as read:
        places = [page.offset for page in read.pages]
    for k, place in zip((1, 3), places, strict=True):
        found = read_exif(data, place)
        assert found is not None
        assert (found.orientation, found.exposure_time, found.f_number) == (k, 0.01 / k, 2.8)
    assert read_exif(data) == read_exif(data, places[0])


@pytest.mark.parametrize("order", "<>")
def test_a_block_by_hand_in_both_orders_of_bytes(order):
    """Laid out by TIFF 6.0, section 2: a directory of three entries, then the text."""
    entries = [
        (0x0112, 3, 1, struct.pack(order + "HH", 8, 0)),
        (0x010F, 2, 6, struct.pack(order + "I", 50)),
    ]
    entries.append((0x9204, 10, 1, struct.pack(order + "I", 56)))
    block = {"<": b"II", ">": b"MM"}[order] + struct.pack(order + "HIH", 42, 8, 3)
    for tag, kind, count, value in entries:
        block += struct.pack(order + "HHI", tag, kind, count) + value
    block += bytes(4) + b"Canon\0" + struct.pack(order + "ii", -1, 3)
    for prefix in (b"", b"Exif\0\0"):
        assert read_exif(prefix + block) == Exif(orientation=8, maker="Canon", exposure_bias=-1 / 3)


def test_what_is_damaged_is_left_out():
    block = SHOT_BY_PILLOW.tobytes()
    for end in range(len(block)):
        read_exif(block[:end])
    generator = random.Random(7)
    for _ in range(2000):
        hurt = bytearray(block)
        for _ in range(generator.randint(1, 6)):
            hurt[generator.randrange(len(hurt))] = generator.randrange(256)
        found = read_exif(bytes(hurt))
        assert found is None or found.orientation in (None, *range(1, 9))


def test_files_that_are_cut_or_hurt_end_in_nothing_worse():
    generator = random.Random(8)
    files = [saved(kind, exif=SHOT_BY_PILLOW) for kind in ("JPEG", "PNG", "WEBP", "TIFF", "AVIF")]
    readers = (exif_of_jpeg, exif_of_png, exif_of_webp, read_exif, exif_of_heif)
    for data, read in zip(files, readers, strict=True):
        for _ in range(150):
            hurt = bytearray(data[: generator.randrange(1, len(data) + 1)])
            for _ in range(generator.randint(0, 5)):
                hurt[generator.randrange(len(hurt))] = generator.randrange(256)
            read(bytes(hurt))
            assert orientation_of_heif(bytes(hurt)) in range(1, 9)
            orientation_of_jpeg_xl(bytes(hurt))


def test_a_directory_that_points_to_itself_and_endless_counts_cost_nothing():
    itself = b"II" + struct.pack("<HIHHHII", 42, 8, 1, 0x8769, 4, 1, 8) + bytes(4)
    assert read_exif(itself) is None
    endless = b"II" + struct.pack("<HIHHHII", 42, 8, 65535, 0x010F, 2, 2**32 - 1, 0)
    assert read_exif(endless) is None


def png_with(name: bytes, content: bytes) -> bytes:
    """A PNG file with a chunk after its header, written by the format's definition."""
    plain = saved("PNG")
    chunk = struct.pack(">I", len(content)) + name + content
    return plain[:33] + chunk + struct.pack(">I", zlib.crc32(name + content)) + plain[33:]
