"""Measure how fine the detail of patterns on the points of a pupil is."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from optics.psf.phase_factor import wrap_phase

_SLOPE_SAMPLES = 3000  # points at which the slope is evaluated. Chosen.

# Nearest points to each of them, itself included, to which slopes are measured. Chosen.
_NEIGHBOURS = 7

# Slope of the waves by which a phase may vary without further nodes, radians per stop radius.
# Chosen: the nodes have harmonics to spare for it.
_SLOW_VARIATION = 3.0

_SPARE_SLOPE = 5.0  # slope, radians per stop radius, for which nodes are to spare. Chosen.

# Brightest points of an amplitude at which its detail is measured besides. Chosen.
_BRIGHT_SAMPLES = 300


class PatternDetail:
    """Measures how steep a phase is between neighbouring points, and how fine a pattern's detail.

    What a linear interpolation misses grows with the square of the slope that plane waves have. So
    the root mean square of what it misses, compared with that of plane waves on the same points,
    tells the slope of the detail, also of a spot that is seen at a single point.

    y, x: pupil points in stop radii, one-dimensional, or a column and a row. A random sample is
    used, and for every amplitude its brightest points.
    slope: radians per stop radius of the plane waves to compare with.
    tol: relative L2 error that light with the pattern must keep.
    """

    def __init__(self, y: torch.Tensor, x: torch.Tensor, slope: float, tol: float) -> None:
        shape = (y + x).shape
        self._places = np.stack([p.expand(shape).ravel().numpy() for p in (y, x)], axis=1)
        self._tree, self._slope, self._tol = cKDTree(self._places), slope, tol
        count = min(_SLOPE_SAMPLES, len(self._places))
        some = np.random.default_rng(0).choice(len(self._places), count, replace=False)
        near, self._distances, weights = self._neighbours(some)
        self._sample = some, near, weights
        angles = np.arange(4) * (math.pi / 4)
        waves = np.exp(1j * slope * (self._places @ np.stack([np.sin(angles), np.cos(angles)]))).T
        self._missed_by_waves = math.sqrt(
            np.mean([_missed_share(wave, *self._sample) ** 2 for wave in waves])
        )

    def phase_slope(self, phase: torch.Tensor) -> float:
        """Return the slope of the finest detail of exp(i phase), radians per stop radius.

        It is the steepest slope s and, for a phase that varies like a wave of slope k, as many more
        of its harmonics as have amplitudes above the tolerance: Bessel functions of s / k. The
        nodes have harmonics to spare for a slow variation.

        phase: (..., points), radians. The largest of a batch counts, as in all that follows.
        """
        at, near, weights = self._sample
        flat = phase.cpu().to(torch.float64).reshape(-1, len(self._places))
        turned = wrap_phase(flat[:, near] - flat[:, at, None]).numpy()
        rounding = _rounding(phase)
        far = self._distances > 0
        # Over the spacing of close nodes, rounding alone would look steep.
        steps = np.maximum(np.abs(turned) - 2 * rounding, 0.0)
        slope = float((steps[:, far] / self._distances[far]).max()) if far.any() else 0.0
        if not slope > 0:
            return 0.0
        rounded = (1 + (weights**2).sum(-1)).mean() * rounding**2
        missed = np.sqrt(np.maximum(((weights * turned).sum(-1) ** 2).mean(1) - rounded, 0.0))
        # A wave of slope k whose steepest slope is s bends by k s at most, and by k s / sqrt(2) in
        # the root mean square. A parabola bends by 1 everywhere, half of it along either axis.
        parabola = (self._places**2).sum(1) / 2
        bent = (weights * (parabola[near] - parabola[at][:, None])).sum(1)
        size = float(np.sqrt((bent**2).mean())) / math.sqrt(2)
        variation = float(missed.max()) / size * math.sqrt(2) / slope if size > 0 else 0.0
        harmonics = 2.5 * (slope / max(variation, 1e-9)) ** (1 / 3) - 1.2 * math.log10(self._tol)
        return slope + max(variation - _SLOW_VARIATION, 0.0) * harmonics

    def amplitude_slope(self, amplitude: torch.Tensor) -> float:
        """Return the slope, radians per stop radius, for which an amplitude needs nodes.

        An amplitude has no steepest slope: that of plane waves with as fine detail is taken. Where
        its spectrum falls as a Gaussian does, a factor leads from the root mean square to where the
        tolerance is reached.

        amplitude: (..., points).
        """
        flat = amplitude.cpu().reshape(-1, len(self._places)).resolve_conj().numpy()
        found = [self._missed_by_interpolation(values.astype(np.complex128)) for values in flat]
        least = np.finfo(np.float64).eps
        detail = self._slope * math.sqrt(max(found) / max(self._missed_by_waves, least))
        return max(math.sqrt(max(1.0, -math.log(self._tol))) * detail - _SPARE_SLOPE, 0.0)

    def _missed_by_interpolation(self, values: NDArray[np.complex128]) -> float:
        """Return the share of an amplitude that interpolation misses."""
        if not values.any():
            return 0.0
        count = min(_BRIGHT_SAMPLES, values.size)
        bright = np.argpartition(np.abs(values), -count)[-count:]
        near, _, weights = self._neighbours(bright)
        return max(
            _missed_share(values, *self._sample), _missed_share(values, bright, near, weights)
        )

    def _neighbours(
        self, at: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return neighbours of points, their distances, and weights for their interpolation.

        The weights are the smallest that reproduce linear functions.
        """
        neighbours = min(_NEIGHBOURS, len(self._places))
        away, near = self._tree.query(self._places[at], k=neighbours)
        away, near = (np.reshape(one, (at.size, -1)) for one in (away, near))
        scale = np.maximum(away.max(1), 1e-300)[:, None, None]
        near = near[:, 1:]
        offsets = (self._places[near] - self._places[at][:, None]) / scale
        linear = np.concatenate([np.ones((*near.shape, 1)), offsets], axis=2)
        return near, away[:, 1:], np.linalg.pinv(linear)[:, 0]


def _missed_share(
    values: NDArray[np.complex128],
    at: NDArray[np.int64],
    near: NDArray[np.int64],
    weights: NDArray[np.float64],
) -> float:
    missed = values[at] - (weights * values[near]).sum(1)
    size = float(np.linalg.norm(values[at]))
    return float(np.linalg.norm(missed)) / size if size > 0 else 0.0


def _rounding(phase: torch.Tensor) -> float:
    """Return by how much a phase may be off where it was computed in its own precision.

    Two of the last digits of its largest number, in radians. Whole numbers are as they are.
    """
    if not phase.is_floating_point():
        return 0.0
    return 2 * torch.finfo(phase.dtype).eps * float(phase.detach().abs().max())
