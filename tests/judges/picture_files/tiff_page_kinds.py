"""Kinds of TIFF files of several pages, microscopes' files, RAW files, and damaged ones."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import tifffile

from judges.picture_files import tiff_bytes as t
from judges.picture_files.tiff_bytes import FLOAT, Layout, Page, tiff_file, tiff_page
from judges.picture_files.truth import (
    Maker,
    Numbers,
    PictureFile,
    add_kind,
    last,
    quantised,
    save,
    scene,
    size,
)

_PAGES = ("page", "frame", "pictures")

DAMAGED = ("cut", "short", "truncat", "incomplete", "ends", "damaged", "corrupt", "broken")
"""Words by which a refusal says that a file isn't whole."""


def _pages(layouts: list[Layout], bands: list[int], same: bool = True) -> Maker:
    """Pages of a layout each; the first is what a reader without a word may take and tell."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        shape = size(rng)
        all_numbers = [
            _numbers(scene(rng, count, shape if same else size(rng)), layout)
            for layout, count in zip(layouts, bands, strict=True)
        ]
        written = [tiff_page(last(n), lay) for n, lay in zip(all_numbers, layouts, strict=True)]
        path = save(path, ".tif", tiff_file(written))
        return _of_pages(path, all_numbers, layouts[0])

    return make


def _numbers(light: Numbers, layout: Layout) -> Numbers:
    if layout.form == FLOAT:
        return light.astype(np.float32)
    return quantised(light, layout.bits)


def _of_pages(path: Path, numbers: list[Numbers], layout: Layout) -> PictureFile:
    return PictureFile(
        path,
        numbers[0],
        ("srgb",) if layout.bits == 8 else ("linear",),
        None if layout.form == FLOAT else 2.0**layout.bits - 1,
        pages=tuple(numbers),
        must_tell=_PAGES,
        must_name=_PAGES,
    )


def _with_reduced(first: bool, chained: bool) -> Maker:
    """A picture and a smaller one of it, before or behind it, in the chain or below it."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        shape = (2 * int(rng.integers(14, 20)) + 8, 2 * int(rng.integers(20, 30)) + 8)
        numbers = quantised(scene(rng, 3, shape), 16)
        small = numbers[:, ::2, ::2]
        whole = tiff_page(last(numbers), Layout(16, photometric=2, tags={254: (4, [0])}))
        reduced = tiff_page(last(small), Layout(16, photometric=2, tags={254: (4, [1])}))
        if chained:
            pages = [reduced, whole] if first else [whole, reduced]
        else:
            whole.below, pages = [reduced], [whole]
        path = save(path, ".tif", tiff_file(pages))
        words = (*_PAGES, "reduced", "preview", "thumbnail")
        return PictureFile(path, numbers, white=65535, must_tell=words, must_name=words)

    return make


def _with_mask(rng: np.random.Generator, path: Path) -> PictureFile:
    """A picture, and a page of one bit that says which pixels count."""
    numbers = quantised(scene(rng, 3), 8)
    mask = quantised(scene(rng, 1, numbers.shape[1:]), 1)
    tags: dict[int, t.Tag] = {254: (4, [4])}
    pages = [
        tiff_page(last(numbers), Layout(photometric=2)),
        tiff_page(mask[0], Layout(1, photometric=4, tags=tags)),
    ]
    path = save(path, ".tif", tiff_file(pages))
    words = (*_PAGES, "mask")
    return PictureFile(path, numbers, ("srgb",), 255, must_tell=words, must_name=words)


def _by_tifffile(frames: int, is_stack: bool, **options: Any) -> Maker:
    """As other programs write through tifffile: frames (count, rows, columns) of 16 bits."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = quantised(scene(rng, frames), 16)
        out = io.BytesIO()
        tifffile.imwrite(out, numbers if frames > 1 else numbers[0], **options)
        path = save(path, ".ome.tif" if options.get("ome") else ".tif", out.getvalue())
        if not is_stack:
            return PictureFile(path, numbers, white=65535)
        return _of_pages(path, [n[None] for n in numbers], Layout(16))

    return make


def _hyperstack(rng: np.random.Generator, path: Path) -> PictureFile:
    """Two times of three channels by ImageJ: six pages in the file's order."""
    numbers = quantised(scene(rng, 6), 16)
    out = io.BytesIO()
    rows, columns = numbers.shape[1:]
    stack = numbers.reshape(2, 3, rows, columns)
    tifffile.imwrite(out, stack, imagej=True, metadata={"axes": "TCYX", "mode": "composite"})
    path = save(path, ".tif", out.getvalue())
    return _of_pages(path, [n[None] for n in numbers], Layout(16))


def _bare_imagej(rng: np.random.Generator, path: Path) -> PictureFile:
    """ImageJ's stacks beyond 4 GB have one table for all frames, which follow each other."""
    numbers = quantised(scene(rng, 4), 16)
    text = "ImageJ=1.54f\nimages=4\nslices=4\nhyperstack=false\nmode=grayscale\n"
    page = tiff_page(numbers[0], Layout(16, tags={270: (2, text)}), ">")
    data = numbers.astype(">u2").tobytes()
    page.segments = [data]
    page.tags[279] = (4, [numbers[0].nbytes])
    path = save(path, ".tif", tiff_file([page], ">"))
    return _of_pages(path, [n[None] for n in numbers], Layout(16))


def _five_bands(separate: bool) -> Maker:
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = quantised(scene(rng, 5), 16)
        layout = Layout(16, separate=separate, extra=(0, 0, 0, 0))
        path = save(path, ".tif", tiff_file([tiff_page(last(numbers), layout)]))
        words = ("five", "5 ")
        return PictureFile(path, numbers, white=65535, must_name=words, must_tell=words)

    return make


def _dng(bits: int = 16, below: bool = True, lossless: bool = False, fault: str = "") -> Maker:
    """A mosaic RGGB with a preview, as cameras and converters write DNG 1.4."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        rows, columns = 2 * int(rng.integers(18, 30)), 2 * int(rng.integers(31, 40))
        black, white = 2**bits // 64, 2**bits - 2**bits // 32
        light = scene(rng, 1, (rows, columns))[0]
        mosaic = np.rint(black + light * 0.8 * (white - black)).astype(np.uint16)
        if fault == "empty":
            mosaic[:] = 0
        preview = quantised(scene(rng, 3, (rows // 4, columns // 4)), 8)
        raw = _raw_page(mosaic, bits, lossless, black, white, fault)
        head = _camera_tags(fault)
        small = tiff_page(last(preview), Layout(photometric=2, tags={254: (4, [1])}))
        if below:
            small.tags |= head
            small.below = [raw]
            pages = [small]
        else:
            raw.tags |= head
            pages = [raw, small]
        data = tiff_file(pages)
        if fault == "cut":
            data = data[: len(data) * 2 // 3]
        path = save(path, ".dng", data)
        words = ("raw", "dng", "mosaic", "colour filter", "bayer")
        if fault:
            names = {"cut": DAMAGED, "linear": ("linear",), "empty": ("empty", "zero", "dark")}
            names |= {"float": ("float",)}
            return PictureFile(path, None, valid=False, must_name=(*names[fault], "raw"))
        return PictureFile(
            path, mosaic[None], ("linear",), None, is_mosaic=True, must_name=words, must_tell=()
        )

    return make


def _raw_page(
    mosaic: Numbers, bits: int, lossless: bool, black: int, white: int, fault: str
) -> Page:
    tags: dict[int, t.Tag] = {
        254: (4, [0]),
        33421: (3, [2, 2]),
        33422: (1, [0, 1, 1, 2]),
        50714: (3, [black]),
        50717: (4, [white]),
    }
    layout = Layout(bits, photometric=32803, tags=tags)
    if fault == "linear":
        three = np.stack([mosaic] * 3, -1)
        return tiff_page(three, replace(layout, photometric=34892))
    if fault == "float":
        return tiff_page(mosaic.astype(np.float32), replace(layout, bits=32, form=FLOAT))
    page = tiff_page(mosaic, layout)
    if lossless:
        page.segments = [imagecodecs.ljpeg_encode(mosaic, bitspersample=bits)]
        page.tags[259] = (3, [7])
    return page


def _camera_tags(fault: str) -> dict[int, t.Tag]:
    matrix = [(9, 10), (-3, 10), (-1, 10), (-4, 10), (12, 10), (2, 10), (-1, 10), (2, 10), (6, 10)]
    tags: dict[int, t.Tag] = {
        271: (2, "Maker"),
        272: (2, "Model"),
        50706: (1, [1, 4, 0, 0]),
        50707: (1, [1, 1, 0, 0]),
        50708: (2, "Maker Model"),
        50721: (10, matrix),
        50728: (5, [(1, 2), (1, 1), (2, 3)]),
        50778: (3, [21]),
    }
    return tags if fault != "no matrix" else {k: v for k, v in tags.items() if k != 50721}


def _damaged(
    change: Callable[[bytes, np.random.Generator], bytes], words: tuple[str, ...]
) -> Maker:
    """A sound TIFF of 16 bits, with something done to its bytes."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = quantised(scene(rng), 16)
        page = tiff_page(last(numbers), Layout(16, photometric=2, strip=8))
        data = change(tiff_file([page]), rng)
        return PictureFile(save(path, ".tif", data), None, valid=False, must_name=words)

    return make


def _early_tables(compression: int, keep: float) -> Maker:
    """Tables before the pictures, as cameras write them, so that a cut takes pixels only."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = quantised(scene(rng), 16)
        layout = Layout(16, photometric=2, strip=8, compression=compression)
        page = tiff_page(last(numbers), layout)
        segments, page.segments = page.segments, []
        places = list(range(len(segments)))
        for _ in range(2):
            page.tags |= {273: (4, places), 279: (4, [len(s) for s in segments])}
            head = tiff_file([page])
            places = [len(head) + sum(map(len, segments[:i])) for i in range(len(segments))]
        whole = head + b"".join(segments)
        path = save(path, ".tif", whole[: int(len(whole) * keep)] if keep < 1 else whole)
        if keep < 1:
            return PictureFile(path, None, valid=False, must_name=DAMAGED)
        return PictureFile(path, numbers, white=65535)

    return make


def _flipped(data: bytes, rng: np.random.Generator) -> bytes:
    """Nonsense where the table stands."""
    at = int.from_bytes(data[4:8], "little")
    return data[:at] + rng.bytes(len(data) - at)


_GREY, _RGB = Layout(16), Layout(8, photometric=2)
for _name, _maker in {
    "two pages": _pages([_GREY] * 2, [1, 1]),
    "three pages of RGB": _pages([_RGB] * 3, [3] * 3),
    "pages of unequal size": _pages([_GREY] * 3, [1] * 3, same=False),
    "pages of mixed kinds": _pages([_GREY, _RGB, Layout(32, FLOAT)], [1, 3, 1], same=False),
    "smaller copy behind": _with_reduced(False, True),
    "smaller copy before": _with_reduced(True, True),
    "smaller copy below": _with_reduced(False, False),
    "mask as page": _with_mask,
    "tifffile's default of three frames": _by_tifffile(
        3, False, photometric="rgb", planarconfig="separate"
    ),
    "tifffile's default of four frames": _by_tifffile(4, True, photometric="minisblack"),
    "OME, three planes": _by_tifffile(3, True, ome=True),
    "OME, one plane, zlib": _by_tifffile(1, False, ome=True, compression="zlib"),
    "ImageJ, one frame": _by_tifffile(1, False, imagej=True),
    "ImageJ hyperstack": _hyperstack,
    "ImageJ stack under one table": _bare_imagej,
    "five bands": _five_bands(False),
    "five bands, separate planes": _five_bands(True),
    "cut in the middle": _damaged(lambda d, _: d[: len(d) // 2], DAMAGED),
    "cut in the tables": _damaged(lambda d, _: d[:-40], DAMAGED),
    "nonsense in the tables": _damaged(_flipped, (*DAMAGED, "not a tiff", "no tiff", "tag")),
    "header alone": _damaged(lambda d, _: d[:8], DAMAGED),
    "tables first": _early_tables(t.NONE, 1),
    "tables first, cut": _early_tables(t.NONE, 0.7),
    "tables first, LZW, cut": _early_tables(t.LZW, 0.7),
    "tables first, deflate, cut": _early_tables(t.DEFLATE, 0.7),
}.items():
    add_kind(f"TIFF, {_name}", _maker)

for _name, _maker in {
    "mosaic below its preview": _dng(),
    "mosaic before its preview": _dng(below=False),
    "mosaic of 12 bits": _dng(bits=12),
    "mosaic, lossless JPEG": _dng(bits=14, lossless=True),
    "linear": _dng(fault="linear"),
    "float": _dng(fault="float"),
    "all zero": _dng(fault="empty"),
    "cut": _dng(below=False, fault="cut"),
}.items():
    add_kind(f"DNG, {_name}", _maker)
