"""Hold photographs in memory within a limit, and cut random grey patches from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.picture.colour_picture import Colours, read_screen_colours
from labapp.training.fingerprints import read_test_fingerprints
from labapp.training.manifest import DataManifest, Split, list_training_files
from labapp.training.near_duplicates import NearDuplicateFinder, refuse_near_duplicates
from optics.progress import Progress

Patch = NDArray[np.float32]

MEMORY_LIMIT = 2 * 2**30
"""Bytes that decoded pictures may take. Chosen: 4600 photographs of BSDS500's size."""

_SIDE_STEP = 2.0
"""Factor by which the longest side of large pictures shrinks while they take too much memory.
Chosen: a whole number, so that each pixel is a mean of whole ones."""

_FIRST_LONGEST_SIDE = 4096
"""Pixels of the longest side from which pictures are shrunk if they take too much memory. Chosen:
photographs of 16 megapixels have 4900."""

SHORTEST_EDGES = (400.0, 1600.0)
"""Range of the shortest edges to which photographs are averaged down. Chosen: photographs of 2 to
24 megapixels are blurred over one to three pixels, by demosaicing and by the lens."""

_AREA_CAP = 4.0
"""Most that a picture's probability may exceed that of one with the median area. Chosen, so that
a photograph of 16 megapixels among 200 of 0.15 is one of fifty draws, and not one of three."""


class TrainingPictures:
    """Cuts random patches from pictures in memory.

    A picture's probability is proportional to its area, up to `_AREA_CAP` times the median area.
    Raises UserError if pictures and splits differ in number, a picture has another shape or type,
    or the shortest edges are out of range.
    pictures: red, green and blue sRGB values, each (3, rows, columns).
    splits: what each picture is used for.
    shortest_edges: range of the pixels of the shortest edge to which a picture is averaged down
    before a patch is cut. It is drawn uniformly in its logarithm; smaller pictures stay as they
    are.
    """

    def __init__(
        self,
        pictures: Sequence[Colours],
        splits: Sequence[Split],
        shortest_edges: tuple[float, float] = SHORTEST_EDGES,
    ) -> None:
        if len(pictures) != len(splits):
            raise UserError(f"There are {len(pictures)} pictures and {len(splits)} splits.")
        for one in pictures:
            if one.ndim != 3 or one.shape[0] != 3 or one.dtype != np.uint8:
                raise UserError(
                    f"A picture is {one.dtype} {one.shape}; give uint8, (3, rows, columns)."
                )
        low, high = shortest_edges
        if not 1 <= low <= high < math.inf:
            raise UserError(
                f"Shortest edges from {low:g} to {high:g} pixels: give 1 or more, the smaller one "
                "first."
            )
        self._edges = low, high
        self._pictures: dict[Split, list[list[Colours]]] = {"training": [], "validation": []}
        for one, split in zip(pictures, splits, strict=True):
            self._pictures[split].append(_halve_repeatedly(one, low))
        self._cumulative: dict[tuple[Split, int], NDArray[np.float64]] = {}

    def patch(self, generator: np.random.Generator, side: int, split: Split = "training") -> Patch:
        """Cut a random grey patch from a random picture, (side, side), sRGB values, 0 to 1.

        The cut is averaged down, turned by a multiple of 90 degrees and mirrored at random, and its
        grey is a random mixture of the colours. Averages are of sRGB values. Raises UserError if no
        picture is as large as a patch.
        generator: the only source of random numbers.
        side: pixels along each side of the patch.
        split: which pictures to cut from.
        """
        cumulative = self._cumulative_probabilities(side, split)
        index = int(np.searchsorted(cumulative, generator.random(), side="right"))
        cut = self._cut(self._pictures[split][index], generator, side)
        mixture = generator.dirichlet(np.ones(3)).astype(np.float32) / np.float32(255)
        grey = np.tensordot(mixture, cut, 1)
        turned = np.rot90(grey, int(generator.integers(4)))
        mirrored = turned[:, ::-1] if generator.integers(2) else turned
        # Rounding may lead beyond white.
        return np.minimum(np.ascontiguousarray(mirrored), np.float32(1))

    def _cut(self, sizes: list[Colours], generator: np.random.Generator, side: int) -> Patch:
        """Return a random square of a picture, averaged down, (3, side, side).

        sizes: the picture, and what halving its sides again and again makes of it.
        """
        low, high = (max(edge, side) for edge in self._edges)
        edge = math.exp(generator.uniform(math.log(low), math.log(high)))
        picture = next(
            one for one in reversed(sizes) if min(one.shape[1:]) >= edge or one is sizes[0]
        )
        shortest = min(picture.shape[1:])
        size = min(max(round(side * shortest / edge), side), shortest)
        y, x = (int(generator.integers(n - size + 1)) for n in picture.shape[1:])
        cut = picture[:, y : y + size, x : x + size]
        if size > side:
            # Rounded to 8 bits, which takes a third of the time of averages in float32.
            cut = _average_down(cut, side, side)
        return cut.astype(np.float32)

    def _cumulative_probabilities(self, side: int, split: Split) -> NDArray[np.float64]:
        """Return the cumulative probabilities of a split's pictures, for patches of a side."""
        known = self._cumulative.get((split, side))
        if known is not None:
            return known
        if side < 1:
            raise UserError(f"A patch of {side} x {side} pixels: give a side of 1 or more.")
        shapes = [one[0].shape[1:] for one in self._pictures[split]]
        fits = np.array([min(shape) >= side for shape in shapes], dtype=bool)
        if not fits.any():
            raise UserError(
                f"No picture for {split} is as large as a patch, {side} x {side} pixels. Add "
                "larger pictures, or choose smaller patches."
            )
        areas = np.array([float(shape[0] * shape[1]) for shape in shapes])
        weights = np.where(fits, np.minimum(areas, _AREA_CAP * np.median(areas[fits])), 0.0)
        cumulative = np.cumsum(weights) / weights.sum()
        # Above every random number, whatever the rounding, from the last picture that fits on.
        cumulative[np.flatnonzero(fits)[-1] :] = 2.0
        self._cumulative[split, side] = cumulative
        return cumulative


def _halve_repeatedly(picture: Colours, edge: float) -> list[Colours]:
    """Return a picture, and its means over 2 x 2, 4 x 4, ... pixels.

    They save work where a patch is averaged down a lot. The shortest edge stays above `edge`.
    """
    sizes = [picture]
    while min(sizes[-1].shape[1:]) >= 2 * edge:
        rows, columns = (n // 2 for n in sizes[-1].shape[1:])
        whole = sizes[-1][:, : 2 * rows, : 2 * columns]
        sizes.append(_average_down(whole, rows, columns))
    return sizes


def _average_down(picture: Colours, rows: int, columns: int) -> Colours:
    """Return a picture's means over the areas of so many pixels."""
    size = columns, rows
    return np.stack([cv2.resize(one, size, interpolation=cv2.INTER_AREA) for one in picture])


def read_training_data(
    folders: Sequence[Path],
    *,
    test_pictures: Sequence[Path] = (),
    smallest_side: int = 128,
    shortest_edges: tuple[float, float] = SHORTEST_EDGES,
    progress: Progress | None = None,
) -> tuple[TrainingPictures, DataManifest]:
    """Read all pictures of folders into memory, and list them.

    The list's `notes()` say what the user should know. Raises UserError if there are no pictures or
    only one, a file isn't a picture, a picture is smaller than a patch or is a near-duplicate of a
    test picture.
    folders: as for `list_training_files`.
    test_pictures: pictures, folders of pictures, or files of fingerprints, of what the result will
    be tested on. Near-duplicates of these among the training's pictures are refused.
    smallest_side: pixels along each side of the largest patch that will be cut.
    shortest_edges: as for `TrainingPictures`.
    """
    files, left_out = list_training_files(folders)
    finder = None
    if test_pictures:
        finder = NearDuplicateFinder(read_test_fingerprints(test_pictures))
    held, matches = _HeldPictures(smallest_side), []
    for index, (file, entry) in enumerate(files):
        if progress is not None:
            progress.report(index / len(files), f"read {entry.path}")
        picture = read_screen_colours(file)
        rows, columns = picture.shape[1:]
        if min(rows, columns) < smallest_side:
            raise UserError(
                f"{file}: is {columns} x {rows} pixels, smaller than a patch of "
                f"{smallest_side} x {smallest_side}. Take it out of the folder, or choose smaller "
                "patches."
            )
        test = None if finder is None else finder.find(picture)
        if test is not None:
            matches.append((str(file), test))
        held.add(picture)
    refuse_near_duplicates(matches)
    if progress is not None:
        progress.report(1.0, f"read {len(files)} pictures")
    entries = tuple(entry for _, entry in files)
    manifest = DataManifest(pictures=entries, left_out=left_out, longest_side=held.longest_side)
    splits = [one.split for one in entries]
    return TrainingPictures(held.pictures, splits, shortest_edges), manifest


class _HeldPictures:
    """Keeps decoded pictures within the memory limit, by averaging large ones down."""

    def __init__(self, smallest_side: int) -> None:
        self._smallest_side = smallest_side
        self.pictures: list[Colours] = []
        self.longest_side: int | None = None

    def add(self, picture: Colours) -> None:
        """Take in a picture, and shrink the largest if all take too much memory."""
        self.pictures.append(self._shrunk(picture))
        while sum(one.nbytes for one in self.pictures) > MEMORY_LIMIT:
            side = self.longest_side
            self.longest_side = _FIRST_LONGEST_SIDE if side is None else round(side / _SIDE_STEP)
            if self.longest_side < self._smallest_side:
                raise UserError(
                    f"{len(self.pictures)} pictures take more than {MEMORY_LIMIT / 2**30:.0f} GiB "
                    f"even at {side} pixels. Give fewer pictures."
                )
            self.pictures = [self._shrunk(one) for one in self.pictures]

    def _shrunk(self, picture: Colours) -> Colours:
        """Return a picture averaged down to the longest side, if there is one.

        Its shortest side stays as large as a patch.
        """
        rows, columns = picture.shape[1:]
        scale = 1.0 if self.longest_side is None else self.longest_side / max(rows, columns)
        scale = max(scale, self._smallest_side / min(rows, columns))
        if scale >= 1:
            return picture
        return _average_down(picture, math.ceil(rows * scale), math.ceil(columns * scale))
