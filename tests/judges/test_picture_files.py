"""The judge of picture readers: its truth is that of peers, and no lie passes it."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from judges.picture_files import (
    CRASHED,
    KINDS,
    NAMED,
    RIGHT,
    UNNAMED,
    WRONG,
    judge_reader,
    make_file,
)
from judges.picture_files.truth import decoded
from labapp.common.errors import UserError

PILLOW = ("PNG, RGB of 8 bits", "PNG, interlaced RGB", "PNG, grey of 16 bits", "BMP of 24 bits")
PILLOW = (*PILLOW, "BMP of 4 bits", "BMP, runs", "PGM, text", "PPM", "TGA", "Sun raster", "PSD")
TIFFFILE = ("grey of 12 bits", "RGB of 16 bits, separate planes", "tiles of 16, odd edges")
TIFFFILE = (*TIFFFILE, "LZW, predictor, 16 bits", "LZW, predictor 3, float", "zstd, predictor")
TIFFFILE = (*TIFFFILE, "PackBits", "LERC inside", "BigTIFF, big endian, tiles", "big endian float")


@dataclass
class Seen:
    """What a reader returns."""

    levels: Any
    light: Any
    encoding: str
    white: float | None = None
    orientation: int = 1
    remarks: tuple[str, ...] = ()


@pytest.mark.parametrize("kind", PILLOW)
def test_what_is_in_a_file_is_what_pillow_finds_in_it(kind, tmp_path):
    file = make_file(kind, 3, tmp_path)
    with Image.open(file.path) as opened:
        picture = opened.convert("RGB") if opened.mode == "P" else opened
        levels = np.asarray(picture)
    np.testing.assert_array_equal(np.atleast_3d(levels), np.moveaxis(file.numbers, 0, -1))


@pytest.mark.parametrize("kind", TIFFFILE)
def test_what_is_in_a_tiff_is_what_tifffile_finds_in_it(kind, tmp_path):
    file = make_file(f"TIFF, {kind}", 3, tmp_path)
    levels = tifffile.imread(file.path)
    if levels.shape != file.numbers.shape:
        levels = np.moveaxis(np.atleast_3d(levels), -1, 0)
    np.testing.assert_array_equal(levels, file.numbers)


def reader(file, change=lambda seen: seen):
    """One that knows the truth, and changes it."""
    encoding = file.encodings[0]
    light = file.numbers.astype(float)
    if encoding != "linear":
        light = decoded(light / file.white, encoding)
    seen = Seen(file.numbers, light, encoding, file.white, file.orientation, file.must_tell)
    return lambda path, page: change(seen)


@pytest.mark.parametrize(
    "kind", ["TIFF, RGB of 16 bits", "PNG, RGB of 8 bits", "JPEG, YCbCr 4:4:4", "PFM, grey"]
)
def test_the_truth_passes(kind, tmp_path):
    file = make_file(kind, 0, tmp_path)
    (found,) = judge_reader(reader(file), [file])
    assert (found.counted, found.untold) == (RIGHT, "")


LIES = {
    "the negative": lambda s: replace(s, levels=s.levels.max() - s.levels, light=1 - s.light),
    "turned": lambda s: replace(s, levels=s.levels[:, ::-1], light=s.light[:, ::-1]),
    "blue first": lambda s: replace(s, levels=s.levels[::-1], light=s.light[::-1]),
    "transposed": lambda s: replace(s, levels=s.levels.swapaxes(1, 2)),
    "64 times": lambda s: replace(s, levels=64 * s.levels.astype(int)),
    "other light": lambda s: replace(s, light=s.light**2),
    "other encoding": lambda s: replace(s, encoding="linear", light=s.levels),
    "black": lambda s: replace(s, levels=0 * s.levels, light=0 * s.light),
    "one band": lambda s: replace(s, levels=s.levels[:1], light=s.light[:1]),
    "not finite": lambda s: replace(s, light=np.full_like(s.light, np.nan)),
}


@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("kind", ["PNG, RGB of 8 bits", "JPEG, YCbCr 4:4:4"])
def test_no_lie_passes(kind, lie, tmp_path):
    file = make_file(kind, 0, tmp_path)
    (found,) = judge_reader(reader(file, LIES[lie]), [file])
    assert found.verdict == WRONG


def raiser(error):
    def read(path, page):
        raise error

    return read


def test_refusals_are_held_against_what_the_file_is(tmp_path):
    kinds = ["TIFF, CMYK", "TIFF, RGB of 8 bits, separate planes", "TIFF, Thunderscan"]
    cmyk, usual, rare = (make_file(kind, 0, tmp_path) for kind in kinds)

    def verdict(file, message):
        return judge_reader(raiser(UserError(message)), [file])[0].verdict

    assert verdict(cmyk, "f: is CMYK. Give RGB.") == NAMED
    assert verdict(cmyk, "f: can't be read. Give no CMYK.") == UNNAMED
    assert verdict(usual, "f: separate planes are too much.") == UNNAMED
    assert verdict(rare, "f: is damaged (Thunderscan).") == UNNAMED
    assert judge_reader(raiser(ValueError()), [cmyk])[0].verdict == CRASHED


def test_what_libraries_print_is_heard(tmp_path):
    file = make_file("PNG, RGB of 8 bits", 0, tmp_path)

    def write(seen):
        os.write(2, b"libpng error\n")
        return seen

    def warn(seen):
        warnings.warn("overflow", stacklevel=1)
        return seen

    for change, text in ((write, "libpng error"), (warn, "overflow")):
        (found,) = judge_reader(reader(file, change), [file])
        assert (found.verdict, found.counted, found.leaked) == (RIGHT, CRASHED, text)


def test_each_draw_of_a_kind_is_another_file_and_the_same_each_time(tmp_path):
    for kind in ("TIFF, mixture", "PNG, mixture", "JPEG, arithmetic"):
        again = tmp_path / "again"
        again.mkdir(exist_ok=True)
        files = [
            make_file(kind, seed, folder)
            for seed, folder in ((0, tmp_path), (1, tmp_path), (0, again))
        ]
        first, second, third = (file.path.read_bytes() for file in files)
        assert first != second
        assert first == third


def test_there_are_enough_kinds():
    assert len(KINDS) >= 150
