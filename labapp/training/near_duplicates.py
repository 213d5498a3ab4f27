"""Find training pictures that show what a test picture shows, and refuse them.

A network that learned from a test picture restores that picture too well. A copy rarely has the
same bytes: it was compressed again, resized, cropped, mirrored, turned, brightened or made grey.
Pictures are therefore compared by fingerprints, which are shifted over the candidate's thumbnail at
many scales, in eight orientations; the score is the correlation where both overlap, times the root
of that area's share of the test picture, relative to `_CROP_AREA`.

A coarse search of all scales and orientations picks a few, which a fine search decides.

What isn't found reliably: a crop to less than half of each side, a turn by more than 3 degrees from
a multiple of 90, and a crop that was squeezed as well into the test picture's shape turned by 90.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.picture.colour_picture import Colours
from labapp.training.fingerprints import (
    COARSE_SIDE,
    FINE_SIDE,
    UNITS,
    Fingerprint,
    Thumbnail,
    average_colours,
    fitted_shape,
    resize_grey,
    whiten,
)

THRESHOLD = 0.7
"""Least score of a near-duplicate; 1 is a perfect copy cropped to `_CROP_AREA`.

Measured to choose it: photographs that aren't copies scored up to 0.53 (118 of them, 11 test
pictures) and 0.64 (84, 17 test pictures, a beach); copies that were cropped to 0.6 of each side,
most of them also turned, mirrored, resized, brightened and compressed, scored 0.79 or more. Checked
on others: 183 photographs scored up to 0.51 with the 11, 148 up to 0.64 with the 17, and 51 new
such copies 0.80 or more.
"""

_COARSE_STEP, _FINE_STEP = 1.08, 1.03
"""Ratio between neighbouring scales of either search. Half a step displaces the border of a
thumbnail by less than a pixel."""

_SCALES = (0.48, 2.1)
"""Range of the candidate's scale relative to the test picture's: either may be a crop of the other,
to half of each side."""

_CROP_AREA = 0.36
"""Share of a test picture that a crop to 0.6 of each side leaves; the score is relative to it."""

_LEAST_OVERLAP = 0.2
"""Least share of a test picture that must overlap the candidate: a crop to half of each side, less
what thumbnails round. Chosen."""

_SAME_ELONGATION = 0.05
"""Difference of the logarithms of two pictures' elongations that cropping by eye and rounding make;
beyond it, a candidate may have been squeezed. Chosen."""

_ORIENTATIONS = 8
"""Multiples of 90 degrees, each as it is and mirrored, in the order of `_orientations`."""

_UPRIGHT, _TURNED = (0, 1, 4, 5), (2, 3, 6, 7)
"""Orientations that keep rows and columns, and those that swap them."""

_Place = tuple[float, int, tuple[int, int]]
"""Score, orientation and shape of a candidate's thumbnail, as the first search found them."""

_NAMED = 5
"""Near-duplicates that an error names. Chosen."""

_SHORTLIST = 3
"""Places, of the first search, that the fine search looks at for each test picture. Chosen."""


class NearDuplicateFinder:
    """Compares pictures with the fingerprints of test pictures, at least one."""

    def __init__(self, fingerprints: Sequence[Fingerprint]) -> None:
        if not fingerprints:
            raise UserError("There is no test picture to compare with. Name a picture or a folder.")
        self.names = [one.name for one in fingerprints]
        self._coarse = _Templates([one.coarse for one in fingerprints], COARSE_SIDE)
        self._fine = _Templates([one.fine for one in fingerprints], FINE_SIDE)

    def find(self, picture: Colours) -> str | None:
        """Return the name of the test picture that a picture is a near-duplicate of, or None.

        picture: (3, rows, columns).
        """
        scores = self.scores(picture)
        best = int(np.argmax(scores))
        return self.names[best] if scores[best] >= THRESHOLD else None

    def scores(self, picture: Colours) -> NDArray[np.float64]:
        """Return how much a picture resembles each test picture, (test pictures,).

        picture: (3, rows, columns).
        """
        grey = average_colours(picture)
        places: list[list[_Place]] = [[] for _ in self.names]
        for shape, tests, orientations in self._coarse_searches(grey.shape):
            thumbnail = whiten(resize_grey(grey, shape))
            found = self._coarse.match(thumbnail, tests, orientations)
            for i, j in np.ndindex(found.shape):
                places[tests[i]].append((float(found[i, j]), orientations[j], shape))
        scores = np.zeros(len(self.names))
        for test, of_test in enumerate(places):
            for _, orientation, shape in sorted(of_test, reverse=True)[:_SHORTLIST]:
                for fine in _fine_shapes(shape):
                    thumbnail = whiten(resize_grey(grey, fine))
                    found = self._fine.match(thumbnail, [test], [orientation])
                    scores[test] = max(scores[test], float(found[0, 0]))
        return scores

    def _coarse_searches(
        self, shape: tuple[int, ...]
    ) -> Iterator[tuple[tuple[int, int], Sequence[int], Sequence[int]]]:
        """Yield shapes of a candidate's thumbnail, and the tests and orientations to compare.

        A candidate of other proportions than a test picture may have been squeezed. It is then
        also stretched to the test picture's proportions, upright and turned.
        """
        for scale in _coarse_scales(*_SCALES):
            fitted = fitted_shape(shape, COARSE_SIDE * scale)
            yield fitted, range(len(self.names)), range(_ORIENTATIONS)
        by_shape: dict[tuple[int, int], list[int]] = {}
        for test, own in enumerate(self._coarse.shapes):
            if abs(math.log(_elongation(own) / _elongation(shape))) > _SAME_ELONGATION:
                by_shape.setdefault(own, []).append(test)
        for own, tests in by_shape.items():
            for scale in _coarse_scales(_SCALES[0], 1.0):
                rows, columns = fitted_shape(own, COARSE_SIDE * scale)
                yield (rows, columns), tests, _UPRIGHT
                yield (columns, rows), tests, _TURNED


def refuse_near_duplicates(matches: Sequence[tuple[str, str]]) -> None:
    """Raise UserError if there are near-duplicates of test pictures.

    matches: names of each training picture, and of the test picture that it resembles.
    """
    if not matches:
        return
    shown = "\n".join(
        f"{name}: shows what the test picture {test} shows." for name, test in matches[:_NAMED]
    )
    more = len(matches) - _NAMED
    rest = f" So do {more} more." if more > 0 else ""
    raise UserError(
        f"{shown}{rest}\nA test would praise what was learnt by heart. Take such pictures out of "
        "the folder, or test on others."
    )


class _Templates:
    """Test pictures' thumbnails in all eight orientations, ready to be searched for."""

    def __init__(self, thumbnails: Sequence[NDArray[np.int8]], side: int) -> None:
        self._side = side
        unit = np.float32(UNITS)
        self._oriented = [list(_orientations(one.astype(np.float32) / unit)) for one in thumbnails]
        self._period = scipy.fft.next_fast_len(side + round(side * _SCALES[1]) + 1, real=True)
        self._energies = [[_summed_area(one**2) for one in row] for row in self._oriented]
        padded = np.zeros((len(thumbnails), _ORIENTATIONS, side, side), np.float32)
        for test, row in enumerate(self._oriented):
            for orientation, one in enumerate(row):
                padded[test, orientation, : one.shape[0], : one.shape[1]] = one
        shape = (self._period, self._period)
        self._spectra = scipy.fft.rfft2(padded, shape).conj()

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Shapes of the templates, upright, (rows, columns)."""
        return [(row[0].shape[0], row[0].shape[1]) for row in self._oriented]

    def match(
        self, candidate: Thumbnail, tests: Sequence[int], orientations: Sequence[int]
    ) -> NDArray[np.float64]:
        """Return the best scores of a candidate over all shifts, (tests, orientations)."""
        shape = (self._period, self._period)
        chosen = self._spectra[np.ix_(tests, orientations)]
        # A negative counts too, hence the absolute values.
        sums = np.abs(scipy.fft.irfft2(scipy.fft.rfft2(candidate, shape) * chosen, shape))
        energy = _summed_area(candidate**2)
        scores = np.zeros(sums.shape[:2])
        for i, j in np.ndindex(scores.shape):
            scores[i, j] = self._score_peak(sums[i, j], energy, tests[i], orientations[j])
        return scores

    def _score_peak(
        self, sums: NDArray[np.float32], energy: NDArray[np.float64], test: int, orientation: int
    ) -> float:
        """Return the score at the shift where a template's correlation stands out most."""
        own = self._energies[test][orientation]
        shape, candidate = ((one.shape[0] - 1, one.shape[1] - 1) for one in (own, energy))
        # Local contrasts are alike everywhere, so that energies are nearly proportional to areas.
        weights = _overlap_weights(shape, candidate, self._side, self._period)
        weighted = sums * weights
        y, x = divmod(int(np.argmax(weighted)), self._period)
        if not weighted[y, x]:
            return 0.0
        dy, dx = (int(_shifts(self._side, self._period)[place]) for place in (y, x))
        top, bottom = max(dy, 0), min(dy + shape[0], candidate[0])
        left, right = max(dx, 0), min(dx + shape[1], candidate[1])
        energies = _box_sum(energy, top, bottom, left, right)
        energies *= _box_sum(own, top - dy, bottom - dy, left - dx, right - dx)
        if not energies > 0:
            return 0.0
        share = (bottom - top) * (right - left) / (shape[0] * shape[1])
        return float(sums[y, x] / np.sqrt(energies) * np.sqrt(share / _CROP_AREA))


def _shifts(side: int, period: int) -> NDArray[np.intp]:
    """Return a template's shift along one axis at each place of a periodic correlation."""
    places = np.arange(period)
    return np.where(places < period - side, places, places - period)


@functools.lru_cache(maxsize=512)
def _overlap_weights(
    shape: tuple[int, int], candidate: tuple[int, int], side: int, period: int
) -> NDArray[np.float32]:
    """Return 1 / sqrt(area) of the overlap of a template and a candidate at each shift.

    It is 0 where they overlap less than `_LEAST_OVERLAP` of the template.
    """
    shift = _shifts(side, period)
    lengths = [
        np.clip(np.minimum(shift + own, other) - np.maximum(shift, 0), 0, None)
        for own, other in zip(shape, candidate, strict=True)
    ]
    area = np.outer(*lengths)
    enough = area >= _LEAST_OVERLAP * shape[0] * shape[1]
    return np.where(enough, 1 / np.sqrt(np.maximum(area, 1)), 0).astype(np.float32)


def _coarse_scales(low: float, high: float) -> NDArray[np.float64]:
    """Return the scales of the first search, about evenly spaced in their logarithm."""
    steps = math.ceil(math.log(high / low) / math.log(_COARSE_STEP))
    return np.geomspace(low, high, steps + 1)


def _elongation(shape: tuple[int, ...]) -> float:
    """Return the longest side over the shortest."""
    return max(shape) / min(shape)


def _fine_shapes(coarse: tuple[int, int]) -> list[tuple[int, int]]:
    """Return three shapes for the fine search around one of the first search."""
    largest = round(FINE_SIDE * _SCALES[1])
    shapes = []
    for factor in (1 / _FINE_STEP, 1.0, _FINE_STEP):
        enlarged = (round(FINE_SIDE / COARSE_SIDE * n * factor) for n in coarse)
        rows, columns = (min(max(8, n), largest) for n in enlarged)
        shapes.append((rows, columns))
    return shapes


def _orientations(thumbnail: Thumbnail) -> Iterator[Thumbnail]:
    """Yield a thumbnail turned by multiples of 90 degrees, each as it is and mirrored."""
    for turns in range(4):
        turned = np.rot90(thumbnail, turns)
        yield turned
        yield turned[:, ::-1]


def _summed_area(values: Thumbnail) -> NDArray[np.float64]:
    """Return sums over all boxes that begin at the first pixel, (rows + 1, columns + 1)."""
    sums = np.zeros((values.shape[0] + 1, values.shape[1] + 1))
    sums[1:, 1:] = values.astype(np.float64).cumsum(0).cumsum(1)
    return sums


def _box_sum(sums: NDArray[np.float64], y0: int, y1: int, x0: int, x1: int) -> float:
    """Return the sum over a box, from summed areas."""
    return float(sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0])
