"""A judge of a panel in the lens: a sum over all points of all its pixels."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from judges.basics import positions
from judges.pixels import lines_of, on_pixels, scale_of
from judges.stops import covered
from judges.sums import Array, gauss, node_count, phasor
from judges.view import View
from judges.wave import steepest, turns
from optics.camera import Camera


def by_panel(view: View) -> Array:
    """Gauss-Legendre over every pixel of the panel and of the sensor"""
    return with_unmodulated(view, partial(_panel_light, view))


def with_unmodulated(view: View, light: Callable[[NDArray[np.complex128]], Array]) -> Array:
    """The light of a view's modulation, and its share that the pattern doesn't turn."""
    assert isinstance(view.optics, Camera)
    share = view.optics.panel.unmodulated
    lit = light(view.modulation())
    if not share:
        return lit
    return (1 - share) * lit + share * light(view.modulation(modulated=False))


def _panel_light(view: View, modulation: NDArray[np.complex128]) -> Array:
    assert isinstance(view.optics, Camera)
    panel, scale = view.optics.panel, scale_of(view)
    side = math.sqrt(panel.fill_factor) * panel.pitch
    # A pixel that the stop cuts reaches beyond it.
    reach = float(view.lens.stop_diameter) / 2 + math.sqrt(2) * panel.pitch
    reach = min(math.hypot(*panel.shape) * panel.pitch / 2, reach)
    inner, weight = gauss(node_count(side, steepest(view, reach)) - 32)
    covered = pixel_coverage(view.optics)
    factor = covered * modulation
    # Rows and columns without any light add nothing, and take as long as others.
    bright = [np.flatnonzero(factor.any(axis=1 - axis)) for axis in (0, 1)]
    y, x = (
        (positions(n, panel.pitch)[some, None] + inner * side / 2).ravel()
        for n, some in zip(panel.shape, bright, strict=True)
    )
    wy, wx = (np.tile(weight * side / 2, some.size) for some in bright)
    factor = np.kron(factor[np.ix_(*bright)], np.ones((inner.size, inner.size)))
    dark = factor == 0
    waves = turns(view.lens, view.distance, view.wavelength, y[:, None], x[None, :])
    wave = np.where(dark, 0, factor * phasor(np.where(dark, 0, waves)) * wy[:, None] * wx)
    v, u, wv, wu = lines_of(view)
    field = np.exp(-2j * np.pi / scale * np.outer(v, y)) @ wave
    field = field @ np.exp(-2j * np.pi / scale * np.outer(x, u))
    density = np.abs(field) ** 2 / (scale**2 * covered.sum() * side**2)
    return on_pixels(view, density, wv, wu)


def pixel_coverage(camera: Camera) -> Array:
    """The stop's share of every panel pixel"""
    return covered(camera.lens.stop, float(camera.lens.stop_diameter) / 2, camera.panel.plane)
