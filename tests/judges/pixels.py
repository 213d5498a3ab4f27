"""Where the light is looked at: rows and columns on the sensor, and pixels made of them."""

from __future__ import annotations

import numpy as np

from judges.basics import positions
from judges.sums import Array, gauss, node_count
from judges.view import View
from optics.camera import Camera


def lines_of(view: View) -> tuple[Array, Array, Array, Array]:
    """Rows and columns on the sensor in metres, and the metres that each stands for."""
    found = []
    for n, pitch, centre in zip(
        view.pixels.shape, view.pixels.pitch, view.pixels.centre, strict=True
    ):
        at = positions(n, pitch, float(centre))
        if not view.integrate:
            found += [at, np.full(n, pitch)]
            continue
        inside, weight = gauss(node_count(pitch, 2 * np.pi * _cutoff(view)) - 36)
        found += [
            (at[:, None] + inside * pitch / 2).ravel(),
            np.tile(weight * pitch / 2, n),
        ]
    v, wv, u, wu = found
    return v, u, wv, wu


def on_pixels(view: View, density: Array, wv: Array, wu: Array) -> Array:
    """Light on pixels from its density on the rows and columns of lines_of()."""
    rows, columns = view.pixels.shape
    light = density * wv[:, None] * wu
    return light.reshape(rows, -1, columns, light.shape[1] // columns).sum((1, 3))


def _cutoff(view: View) -> float:
    """Cycles per metre of the finest fringe, of a stop or of the panel pixels behind it."""
    width = float(view.lens.stop_diameter)
    if isinstance(view.optics, Camera) and not float(view.optics.separation):
        panel = view.optics.panel
        width = min(width + 2 * panel.pitch, max(panel.shape) * panel.pitch)
    return width / scale_of(view)


def scale_of(view: View) -> float:
    return float(view.wavelength) * float(view.lens.image_distance)
