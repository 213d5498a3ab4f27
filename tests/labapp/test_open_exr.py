"""OpenEXR against bytes by the format's definition and arrays that made the files."""

from __future__ import annotations

import io
import struct
from datetime import datetime
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from labapp.common.errors import UserError
from labapp.files.exif import Exif
from labapp.files.picture.open_exr import count_exr_pages, encode_open_exr, read_open_exr

PATH = Path("a.exr")
LIGHT = (np.random.default_rng(1).random((3, 12, 17)) * 1e3).astype(np.float32)


def exr(channels: dict[str, np.ndarray], **header: object) -> bytes:
    """A file that the library writes."""
    file = io.BytesIO()
    planes = {name: OpenEXR.Channel(np.ascontiguousarray(one)) for name, one in channels.items()}
    OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, planes).write(file)
    return file.getvalue()


def colours(light: np.ndarray = LIGHT) -> dict[str, np.ndarray]:
    return dict(zip("RGB", light, strict=True))


def by_hand(values: dict[str, np.ndarray], attributes: bytes = b"") -> bytes:
    """An uncompressed file of rows, after "OpenEXR File Layout"."""

    def attribute(name: bytes, kind: bytes, value: bytes) -> bytes:
        return name + b"\0" + kind + b"\0" + struct.pack("<I", len(value)) + value

    kinds = {"uint32": 0, "float16": 1, "float32": 2}
    rows, columns = next(iter(values.values())).shape
    names = sorted(values)
    listed = b"".join(
        name.encode() + b"\0" + struct.pack("<IIII", kinds[values[name].dtype.name], 0, 1, 1)
        for name in names
    )
    box = struct.pack("<4i", 0, 0, columns - 1, rows - 1)
    head = struct.pack("<II", 20000630, 2)
    head += attribute(b"channels", b"chlist", listed + b"\0")
    head += attribute(b"compression", b"compression", b"\0")
    head += attribute(b"dataWindow", b"box2i", box) + attribute(b"displayWindow", b"box2i", box)
    head += attribute(b"lineOrder", b"lineOrder", b"\0")
    head += attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1))
    head += attribute(b"screenWindowCenter", b"v2f", bytes(8))
    head += attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + attributes + b"\0"
    lines = []
    for row in range(rows):
        line = b"".join(values[name][row].tobytes() for name in names)
        lines.append(struct.pack("<iI", row, len(line)) + line)
    places = np.cumsum([0, *map(len, lines[:-1])]) + len(head) + 8 * rows
    return head + places.astype("<u8").tobytes() + b"".join(lines)


@pytest.mark.parametrize("kind", ["float16", "float32", "uint32"])
@pytest.mark.parametrize("names", ["RGB", "Y"])
def test_a_file_by_hand_is_read_bit_for_bit(kind, names):
    light = LIGHT[: len(names)].astype(kind)
    found = read_open_exr(PATH, by_hand(dict(zip(names, light, strict=True))))
    np.testing.assert_array_equal(found.values, light)
    assert found.values.dtype == kind
    words = {"float16": "half", "float32": "float", "uint32": "whole numbers"}[kind]
    assert (found.kind, found.white, found.pages, found.is_lossy) == (
        f"OpenEXR, {words}",
        None,
        1,
        False,
    )
    assert found.encoding is not None
    assert found.encoding.name == "linear"
    assert found.notes == ()


@pytest.mark.parametrize(
    ("compression", "is_lossy"),
    [
        *((name, False) for name in ("NO", "RLE", "ZIPS", "ZIP", "PIZ")),
        *((name, True) for name in ("PXR24", "B44", "B44A", "DWAA", "DWAB")),
    ],
)
def test_every_compression_is_read_and_lossy_ones_are_told(compression, is_lossy):
    data = exr(colours(), compression=getattr(OpenEXR, f"{compression}_COMPRESSION"))
    found = read_open_exr(PATH, data)
    assert found.is_lossy == is_lossy
    np.testing.assert_allclose(
        found.values, LIGHT, rtol=0.05 if is_lossy else 0, atol=10 * is_lossy
    )
    if compression == "PXR24":
        halves = exr(colours(LIGHT.astype("f2")), compression=OpenEXR.PXR24_COMPRESSION)
        found = read_open_exr(PATH, halves)
        assert not found.is_lossy
        np.testing.assert_array_equal(found.values, LIGHT.astype("f2"))


@pytest.mark.parametrize("bands", [1, 3])
def test_what_is_written_comes_back_to_the_bit(bands):
    light = LIGHT[:bands] * np.float32(1e-30)
    light[0, 0, :3] = [-1, 3e38, 1e-44]
    data = encode_open_exr(light)
    np.testing.assert_array_equal(read_open_exr(PATH, data).values, light)
    assert set(OpenEXR.File(io.BytesIO(data), separate_channels=True).channels()) == (
        {"Y"} if bands == 1 else {"R", "G", "B"}
    )


def test_tiles_and_windows():
    found = read_open_exr(
        PATH, exr(colours(), type=OpenEXR.tiledimage, tiles=OpenEXR.TileDescription())
    )
    np.testing.assert_array_equal(found.values, LIGHT)
    window = (np.array([5, -7], np.int32), np.array([21, 4], np.int32))
    display = (np.array([0, 0], np.int32), np.array([29, 19], np.int32))
    found = read_open_exr(PATH, exr(colours(), dataWindow=window, displayWindow=display))
    np.testing.assert_array_equal(found.values, LIGHT)
    assert found.notes == (
        "all its 17 x 12 pixels from column 5 and row -7 on were read, of which it means to show "
        "30 x 20 pixels from column 0 and row 0 on",
    )


def test_parts_are_pages():
    parts = [OpenEXR.Part({}, {"Y": OpenEXR.Channel(LIGHT[k].copy())}, f"p{k}") for k in range(3)]
    file = io.BytesIO()
    OpenEXR.File(parts).write(file)
    assert count_exr_pages(PATH, file.getvalue()) == 3
    for k in range(3):
        found = read_open_exr(PATH, file.getvalue(), k)
        assert found.pages == 3
        np.testing.assert_array_equal(found.values, LIGHT[k : k + 1])
    for k in (-1, 3):
        with pytest.raises(UserError, match="holds 3 pictures, counted from 0"):
            read_open_exr(PATH, file.getvalue(), k)


def test_other_channels_are_left_out_and_told():
    found = read_open_exr(PATH, exr({**colours(), "A": LIGHT[0], "Z": LIGHT[1]}))
    np.testing.assert_array_equal(found.values, LIGHT)
    assert "transparency was left out" in found.notes[0]
    assert found.notes[1] == "its channels Z were left out"
    found = read_open_exr(PATH, exr({"depth": LIGHT[0]}))
    assert found.notes == ("its only channel, 'depth', was taken as grey",)
    layer = exr({f"view.{name}": one for name, one in colours().items()} | {"view.A": LIGHT[0]})
    found = read_open_exr(PATH, layer)
    np.testing.assert_array_equal(found.values, LIGHT)
    assert found.notes[0] == "its layer 'view' was taken as the picture"


def test_channels_that_are_no_picture_are_refused_by_name():
    two = {f"{layer}.{name}": one for layer in "pq" for name, one in colours().items()}
    with pytest.raises(UserError, match="of the layers p, q, none of which is the picture"):
        read_open_exr(PATH, exr(two))
    with pytest.raises(UserError, match="of the channels G, R, none of which"):
        read_open_exr(PATH, exr({"R": LIGHT[0], "G": LIGHT[1]}))
    with pytest.raises(UserError, match="of luminance and chroma"):
        read_open_exr(PATH, exr({"Y": LIGHT[0], "RY": LIGHT[1], "BY": LIGHT[2]}))


def test_several_samples_a_pixel_and_fewer_than_pixels_are_refused_by_name():
    deep = np.empty((2, 3), object)
    for at in np.ndindex(deep.shape):
        deep[at] = np.ones(2, np.float32)
    data = exr({"Z": deep}, type=OpenEXR.deepscanline, compression=OpenEXR.ZIPS_COMPRESSION)
    with pytest.raises(UserError, match="is a deep OpenEXR file"):
        read_open_exr(PATH, data)
    file = io.BytesIO()
    sparse = {name: OpenEXR.Channel(LIGHT[0, :, :16].copy(), 2, 2) for name in "RGB"}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, sparse).write(file)
    with pytest.raises(UserError, match="have fewer samples than pixels"):
        read_open_exr(PATH, file.getvalue())


def test_the_header_tells_exposure_and_colours():
    data = exr(
        colours(),
        expTime=0.25,
        aperture=2.0,
        isoSpeed=200.0,
        cameraModel="X1",
        capDate="2024:05:06 07:08:09",
        chromaticities=(0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329),
    )
    found = read_open_exr(PATH, data)
    assert found.exif == Exif(0.25, 2, 200, model="X1", taken=datetime(2024, 5, 6, 7, 8, 9))
    assert found.notes == (
        "its colours have other primaries than sRGB (chromaticities); they are kept",
    )
    same = exr(colours(), chromaticities=(0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329))
    assert read_open_exr(PATH, same).notes == ()


def test_damaged_files_are_named_and_nothing_else_is_said(capfd):
    # Numbers that deflate makes smaller, so that it notices what is changed.
    data = exr(colours(np.rint(LIGHT / 100)), compression=OpenEXR.ZIP_COMPRESSION)
    generator = np.random.default_rng(2)
    files = [data[:size] for size in (5, 100, len(data) // 2, len(data) - 1)]
    hurt = bytearray(data)
    hurt[-300:-250] = bytes(50)
    files.append(bytes(hurt))
    for one in files:
        with pytest.raises(UserError, match=r"^a\.exr: is a damaged or incomplete OpenEXR file"):
            read_open_exr(PATH, one)
    refused = 0
    for _ in range(200):
        noisy = np.frombuffer(data, np.uint8).copy()
        places = generator.integers(0, 450, 3)
        noisy[places] = generator.integers(0, 256, 3)
        try:
            read_open_exr(PATH, noisy.tobytes())
        except UserError:
            refused += 1
    assert refused > 50
    print("what others print stays")
    said = capfd.readouterr()
    assert (said.out, said.err) == ("what others print stays\n", "")


def test_a_picture_that_is_much_larger_than_its_file_is_not_read():
    data = bytearray(by_hand(colours()))
    at = data.index(b"box2i\0") + 10
    data[at : at + 16] = struct.pack("<4i", 0, 0, 59_999, 59_999)
    with pytest.raises(UserError, match=r"would take 43\.2 GB"):
        read_open_exr(PATH, bytes(data))
    tiles = OpenEXR.TileDescription()
    tiles.ySize = 1 << 22
    data = exr(colours(), type=OpenEXR.tiledimage, tiles=tiles)
    with pytest.raises(UserError, match="is a damaged or incomplete OpenEXR file"):
        read_open_exr(PATH, data)
