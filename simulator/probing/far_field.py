"""The light of one field far behind a panel: one period of its orders, and what falls where."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np
import scipy.fft
import torch
from numpy.typing import NDArray

from optics.fourier import fft

Array = NDArray[np.float64]
Light = NDArray[np.float32]

_LOWER = 1.6
"""Between samples light may be so much brighter: half a sample away, sinc(1/4)^-4."""

_FEW, _TOPS = 64, 1.15
"""Samples among which the brightest place is looked for between them; of more, some lie so near
the top of a fringe (audited)."""

_TAPS = 4
"""Samples to either side by which an amplitude is known between them."""


class FarField:
    """|field's Fourier transform|² at twice its Nyquist rate; all of it is a light of 1.

    light: (2 rows, 2 columns) of a field's, the axis in the corner, over one period of the orders
    of the panel's pixels along each axis. side: of a pixel's opening, over the pitch. Distances
    are told in shares of a period.
    """

    def __init__(self, field: torch.Tensor, side: float) -> None:
        rows, columns = (2 * n for n in field.shape)
        far = fft(fft(field, columns, -1), rows, -2).numpy()
        light = far.real**2 + far.imag**2
        total = light.sum(dtype=np.float64)
        if not total > 0:
            raise ValueError("no light passes the stop: open it, or move it before the panel")
        self._top = _peak_intensity(far, light) / total
        self.light: Light = light * np.float32(1 / total)
        self._side = side

    @property
    def bytes(self) -> int:
        """Once all of it was asked for: the light twice, and the transfer function."""
        return 2 * self.light.nbytes + 16 * _frequency_count(self.light.shape) ** 2

    def _envelope(self, axis: int, orders: int = 0) -> Array:
        """What one pixel makes of the light along an axis, up to an order on each side."""
        places = np.fft.fftfreq(self.light.shape[axis])
        steps = np.arange(-orders, orders + 1)
        return np.asarray(
            (self._side * np.sinc(self._side * (places[:, None] + steps)) ** 2).sum(1)
        )

    def order_share(self, orders: int) -> float:
        """Of the light, in the orders up to one on each side."""
        along = self.light @ self._envelope(1, orders).astype(np.float32)
        return float(along.astype(np.float64) @ self._envelope(0, orders))

    @cached_property
    def peak(self) -> float:
        """Share of the light that falls on a square period, if all of it were as bright as the
        brightest place."""
        return float(self._top * self._side**2 * self.light.size)

    @cached_property
    def zeroth_order_light(self) -> Light:
        """The middle order's light."""
        down, along = (self._envelope(axis).astype(np.float32) for axis in (0, 1))
        return np.asarray(self.light * down[:, None] * along)

    def _ensquared_sums(self, light: Light) -> Array:
        """Sums of samples in squares around the axis, whose half sides are k + 1/2 steps: half a
        period along the shorter axis has as many as it has samples."""
        steps = min(light.shape) // 2
        # Four samples may be added in single precision; a million may not.
        sums = _fold_axis(_fold_axis(light, 0), 1).astype(np.float64)
        for axis in (1, 0):
            sums = np.add.reduceat(sums, _ring_starts(light.shape[axis], steps), axis)
        return np.asarray(np.diagonal(sums.cumsum(0).cumsum(1)))

    @cached_property
    def ensquared_share(self) -> Array:
        """Share of the middle order's light within these squares."""
        total = self._ensquared_sums(self.zeroth_order_light)
        return np.asarray(total / total[-1])

    @cached_property
    def beyond_energy(self) -> Array:
        """Integral of the squared density of the middle order's light over the period's area,
        beyond these squares; that of even light is 1. Exact: h is sampled at its Nyquist rate."""
        total = self._ensquared_sums(self.zeroth_order_light**2)
        return np.asarray(self.light.size * np.maximum(total[-1] - total, 0.0))

    @cached_property
    def energy(self) -> float:
        """The same of all of it."""
        return float(self.light.size * (self.zeroth_order_light.astype(np.float64) ** 2).sum())

    @cached_property
    def transfer(self) -> NDArray[np.complex64]:
        """Of the middle order's light, one row a frequency y and one column x; see radii()."""
        spectrum = scipy.fft.rfft2(self.zeroth_order_light)
        kept = _frequency_count(self.light.shape)
        return np.asarray(np.concatenate([spectrum[:kept, :kept], spectrum[-kept + 1 :, :kept]]))


def _peak_intensity(far: NDArray[np.complex64], light: Light) -> float:
    """The most of a light, between its samples as well."""
    most = float(light.max())
    places = np.argwhere(light > most / _LOWER)
    if len(places) > _FEW:
        return _TOPS * most
    span = np.arange(-_TAPS, _TAPS + 1)
    between = np.linspace(-0.5, 0.5, 5)[:, None] - span
    weights = np.sinc(between) * np.cos(np.pi * between / (2 * _TAPS + 2)) ** 2
    # The field fills the first half of what was transformed: its middle is a ramp of phase here.
    turns = [np.exp(0.5j * np.pi * span * (1 - 2 / n)) for n in far.shape]
    for y, x in places:
        rows, columns = (y + span) % far.shape[0], (x + span) % far.shape[1]
        patch = far[np.ix_(rows, columns)] * turns[0][:, None] * turns[1]
        most = max(most, float(np.abs(weights @ patch @ weights.T).max()) ** 2)
    return most


def _frequency_count(shape: tuple[int, ...]) -> int:
    """Frequencies of each axis that are looked at, from 0: up to half the shorter one's."""
    return min(shape) // 2


def radii(shape: tuple[int, ...]) -> Array:
    """Of a transfer function's entries, in shares of the samples in a period: cycles per period."""
    kept = _frequency_count(shape)
    down = np.concatenate([np.arange(kept), np.arange(-kept + 1, 0)])
    return np.hypot(down[:, None], np.arange(kept))


def _fold_axis(light: Light, axis: int) -> Light:
    """Both directions of an axis as one: index k stands for samples k and -k."""
    half = light.shape[axis] // 2
    if axis == 0:
        folded = light[: half + 1].copy()
        folded[1:half] += light[:half:-1]
    else:
        folded = light[:, : half + 1].copy()
        folded[:, 1:half] += light[:, :half:-1]
    return folded


@lru_cache(maxsize=16)
def _ring_starts(samples: int, steps: int) -> NDArray[np.intp]:
    """Where each ring begins along a folded axis: ring k is beyond k - 1 steps, up to k."""
    away = np.arange(samples // 2 + 1) * (2 * steps / samples)
    rings = np.minimum(np.ceil(away - 1e-9), steps).astype(int)
    return np.asarray(np.searchsorted(rings, np.arange(steps + 1)), dtype=np.intp)
