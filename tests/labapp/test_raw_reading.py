"""RAW files read as their sensors' mosaics: the truth is the array that tifffile wrote."""

from __future__ import annotations

import io
import os
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import rawpy
import tifffile
from judges.raw_files import AREA, BLACK, BLACK_REPEAT, WHITE, data_offset, dng, with_number

from labapp.common.errors import UserError
from labapp.common.library_text import collect_library_text
from labapp.files.raw import is_raw, read_raw
from labapp.files.raw.libraw import MESSAGE

PATH = Path("photo.dng")
SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "cases" / "pictures"

CAMERA = np.array([[0.9, -0.3, -0.1], [-0.4, 1.2, 0.2], [-0.1, 0.2, 0.7]])
XTRANS = ("GRGGBG", "BGBRGR", "GBGGRG", "GBGRGR", "RGRBGB", "GRGGBG")


def numbers(bits=12, shape=(62, 78), seed=0):
    return np.random.default_rng(seed).integers(1, 2**bits, shape).astype(np.uint16)


def refused(data, *words):
    """The file is RAW, and its reading ends in an error with these words."""
    assert is_raw(data, PATH)
    with pytest.raises(UserError) as error:
        read_raw(PATH, data)
    for word in (str(PATH), *words):
        assert word in str(error.value)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("storage", "bits", "part"),
    [
        ("plain", 16, None), ("plain", 16, (16, 32)), ("plain", 16, (7, 0)),
        ("packed", 10, None), ("packed", 12, None), ("packed", 14, None),
        ("deflate", 16, None), ("deflate", 16, (16, 32)),
        ("ljpeg1", 12, None), ("ljpeg1", 14, (32, 48)), ("ljpeg1", 12, (24, 0)),
        ("ljpeg2", 12, None), ("ljpeg2", 16, (32, 48)),
    ],
)  # fmt: skip
def test_every_lossless_storage_gives_the_numbers_of_the_array(storage, bits, part, order):
    mosaic = numbers(bits)
    file = dng(mosaic, bits=bits, storage=storage, part=part, order=order)
    found = read_raw(PATH, file)
    np.testing.assert_array_equal(found.mosaic, mosaic)
    assert found.pattern == ("RG", "GB")
    assert found.white == 2**bits - 1 if storage not in ("plain", "deflate") else 65535


def test_two_lossless_tiles_a_row_that_libraw_mixes_up_are_read():
    mosaic = numbers(12, (64, 64))
    found = read_raw(PATH, dng(mosaic, bits=12, storage="ljpeg2", part=(32, 32)))
    np.testing.assert_array_equal(found.mosaic, mosaic)


def test_8_bit_numbers_keep_their_scale():
    mosaic = (numbers(8)).astype(np.uint8)
    found = read_raw(PATH, dng(mosaic))
    np.testing.assert_array_equal(found.mosaic, mosaic)
    assert found.white == 255


@pytest.mark.parametrize(
    "pattern", [("RG", "GB"), ("GR", "BG"), ("GB", "RG"), ("BG", "GR"), XTRANS]
)
def test_the_pattern_is_the_tags(pattern):
    found = read_raw(PATH, dng(numbers(), pattern))
    assert found.pattern == pattern
    assert found.channels == "RGB"


@pytest.mark.parametrize("area", [(0, 0, 62, 78), (3, 0, 60, 77), (2, 5, 61, 78), (1, 1, 62, 78)])
def test_black_levels_stay_with_their_pixels_in_an_active_area(area):
    """LibRaw begins at even rows and columns, and then exchanges the levels of the colours."""
    top, left, bottom, right = area
    mosaic, levels = numbers(), [[10, 20], [30, 40]]
    tags = {
        AREA: ("l", area), WHITE: ("l", 4000),
        BLACK_REPEAT: ("h", (2, 2)), BLACK: ("h", (10, 20, 30, 40)),
    }  # fmt: skip
    found = read_raw(PATH, dng(mosaic, tags=tags))
    np.testing.assert_array_equal(found.mosaic, mosaic[top:bottom, left:right])
    assert found.pattern == ("RG", "GB")
    dark = [[levels[y % 2][x % 2] for x in range(right - left)] for y in range(bottom - top)]
    np.testing.assert_array_equal(found.dark_levels, dark)
    expected = (found.mosaic - np.array(dark)) / (4000 - np.array(dark))
    np.testing.assert_allclose(found.light(), expected, rtol=1e-6, atol=1e-7)


def test_black_levels_by_row_and_column_are_added():
    by_row, by_column = np.arange(62) / 4, np.arange(78.0)
    tags = {
        BLACK_REPEAT: ("h", (1, 3)), BLACK: ("r", (5, 6.5, 7)),
        50715: ("q", by_column), 50716: ("q", by_row),
    }  # fmt: skip
    found = read_raw(PATH, dng(numbers(), tags=tags))
    cell = np.tile([5, 6.5, 7], 26)
    np.testing.assert_allclose(found.dark_levels, by_row[:, None] + by_column + cell)


def test_a_table_makes_numbers_linear():
    mosaic, table = numbers(8), np.arange(200) ** 2
    found = read_raw(PATH, dng(mosaic, tags={50712: ("h", table)}))
    np.testing.assert_array_equal(found.mosaic, np.minimum(mosaic, 199).astype(int) ** 2)
    assert found.white == 199**2


def test_what_the_camera_states_is_read_and_orientation_is_not_applied():
    camera = {
        274: ("h", 6), 33434: ("r", 0.008), 33437: ("r", 2.8), 34855: ("h", 400),
        50721: ("q", np.eye(3).ravel()), 50778: ("h", 17),
        50722: ("q", CAMERA.ravel()), 50779: ("h", 21), 50728: ("r", (0.5, 1, 0.7)),
    }  # fmt: skip
    mosaic = numbers()
    found = read_raw(PATH, dng(mosaic, camera=camera, tags={51041: ("d", (1e-4, 1e-6))}))
    np.testing.assert_array_equal(found.mosaic, mosaic)
    assert found.orientation == 6
    told = found.exposure
    assert (told.exposure_time, told.f_number, told.iso) == (0.008, 2.8, 400)
    assert (found.maker, found.model) == ("Judge", "Box")
    np.testing.assert_allclose(found.colour.matrix, CAMERA, atol=1e-6)
    np.testing.assert_allclose(found.colour.white, [0.5, 1, 0.7], atol=1e-6)
    np.testing.assert_allclose(found.colour.noise, [[1e-4, 1e-6]] * 3)


def test_matrix_and_white_follow_the_order_of_the_files_planes():
    """CFAPlaneColor may name green first; channels are red, green and blue all the same."""
    camera = {50721: ("q", CAMERA.ravel()), 50728: ("r", (0.5, 1, 0.7))}
    found = read_raw(PATH, dng(numbers(), camera=camera, tags={50710: ("b", bytes([1, 0, 2]))}))
    np.testing.assert_allclose(found.colour.matrix, CAMERA[[1, 0, 2]], atol=1e-6)
    np.testing.assert_allclose(found.colour.white, [1, 0.5, 0.7], atol=1e-6)


def test_wells_that_are_full_below_the_white_level_are_seen():
    mosaic = np.minimum(numbers(), 3000)
    assert read_raw(PATH, dng(mosaic, tags={WHITE: ("l", 4095)})).clip_level == 3000
    assert read_raw(PATH, dng(numbers(), tags={WHITE: ("l", 3500)})).clip_level == 3500


def test_a_sensor_without_filters_is_grey():
    mosaic = numbers()
    found = read_raw(PATH, dng(mosaic, None, photometric=34892))
    np.testing.assert_array_equal(found.mosaic, mosaic)
    assert found.pattern is None


def test_a_plain_tiff_with_a_mosaic_is_read_by_its_tags():
    mosaic = numbers()
    file = dng(mosaic, ("GR", "BG"), version=False, camera={})
    plain = file.replace(b"\x0f\x01\x02\x00", b"\x0e\x01\x02\x00")  # the maker as a description
    found = read_raw(PATH, plain)
    np.testing.assert_array_equal(found.mosaic, mosaic)
    assert found.pattern == ("GR", "BG")


def test_a_makers_file_comes_as_libraw_gives_it():
    mosaic = numbers(12, (400, 600))
    camera = {271: ("s", "Canon"), 272: ("s", "Canon EOS 5D"), 274: ("h", 8)}
    file = dng(mosaic, version=False, camera=camera)
    found = read_raw(Path("photo.cr2"), file)
    np.testing.assert_array_equal(found.mosaic, mosaic)
    assert (found.pattern, found.orientation) == (("RG", "GB"), 8)
    assert (found.maker, found.model) == ("Canon", "Canon EOS 5D")
    with rawpy.RawPy() as raw:
        raw.open_buffer(io.BytesIO(file))
        raw.unpack()
        assert found.white == raw.white_level
        np.testing.assert_array_equal(found.colour.matrix, raw.rgb_xyz_matrix[:3])


@pytest.mark.parametrize("at", [0, 6, 60, 1200, 4000, 8000, -1])
def test_cut_files_are_refused_by_name(at):
    file = dng(numbers())
    cut = file[: len(file) + at if at < 0 else at]
    refused(cut, "empty" if at == 0 else "cut")


def test_damaged_lossless_jpeg_is_refused(capfd):
    file = dng(numbers(), bits=12, storage="ljpeg1")
    start = data_offset(file) + 2000
    refused(file[:start] + b"\xff\xd9" + bytes(len(file) - start - 2), "damaged")
    assert capfd.readouterr() == ("", "")


def test_pictures_that_are_no_mosaic_are_refused_by_name():
    mosaic = numbers()
    colours = np.stack([mosaic] * 3, -1)
    refused(dng(colours, None, photometric=34892), "linear", "16-bit TIFF")
    refused(dng(mosaic.astype(np.float32)), "floating-point")
    refused(dng(mosaic.astype(np.uint32)), "32 bits")
    refused(with_number(dng(mosaic), 259, 34892), "lossy JPEG")
    refused(with_number(dng(mosaic), 259, 52546), "JPEG XL")
    refused(with_number(dng(mosaic), 259, 4711), "unknown compression 4711")
    refused(with_number(dng(mosaic), 254, 1), "without RAW numbers")
    refused(dng(mosaic, None), "without RAW numbers")


def test_contradictions_are_refused_by_name():
    mosaic = numbers()
    refused(dng(mosaic, tags={AREA: ("l", (0, 0, 63, 78))}), "active area")
    refused(dng(mosaic, tags={BLACK: ("h", (1, 2))}), "2 black levels for 1 x 1")
    refused(dng(mosaic, tags={BLACK: ("h", 500), WHITE: ("l", 400)}), "white must be above black")
    refused(dng(mosaic, tags={50711: ("h", 2)}), "filters can't be told")
    refused(with_number(dng(mosaic), 258, 12), "12 bits", "7254 bytes", "9672 are stored")


def test_baseline_jpeg_inside_is_refused_as_lossy():
    file = dng(numbers(), bits=12, storage="ljpeg1")
    lossy = imagecodecs.jpeg_encode(numbers(8).astype(np.uint8))
    at = data_offset(file)
    refused(file[:at] + lossy + bytes(max(len(file) - at - len(lossy), 0)), "JPEG", "only nearly")


@pytest.mark.parametrize("kind", ["grey", "rgb", "text", "empty"])
def test_other_files_are_not_raw(tmp_path, kind):
    path = tmp_path / "picture.tif"
    if kind in ("grey", "rgb"):
        shape = (9, 11) if kind == "grey" else (9, 11, 3)
        tifffile.imwrite(path, np.zeros(shape, np.uint16), photometric=None)
    else:
        path.write_bytes(b"" if kind == "empty" else b"no picture")
    assert not is_raw(path.read_bytes(), path)


def test_libraws_lines_are_kept_from_the_terminal_and_others_are_not(capfd):
    with collect_library_text(MESSAGE) as messages:
        os.write(2, b"unknown file: data corrupted at 1378\nsomething else\n")
        os.write(2, b"a: b.dng: Unexpected end of file\n")
    assert messages == ["data corrupted at 1378", "Unexpected end of file"]
    assert capfd.readouterr().err == "something else\n"


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.exists(), reason="needs the data beside the checkout")
def test_the_shared_cameras_mosaic_is_read_and_not_its_preview():
    path = SHARED / "camera.dng"
    with tifffile.TiffFile(path) as file:
        mosaic = file.pages[0].pages[0].asarray()
    found = read_raw(path)
    np.testing.assert_array_equal(found.mosaic, mosaic)
    assert (found.pattern, found.white, found.black.tolist()) == (("RG", "GB"), 4095, [[128]])
