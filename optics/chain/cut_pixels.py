"""Pixels that a stop's shadow cuts: what it costs to take a part of one as a dimmer whole."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera
from optics.chain.edge_scatter import window_frequencies
from optics.point.request import PSFRequest
from optics.pupil import vergence_error

Array = NDArray[np.float64]

_PLACES_ACROSS_PIXEL = 12
"""Places across a pixel at which the shadow is looked at."""

_MAX_PIXELS = 1024
"""Pixels that are looked at, evenly along the edge, to stand for all of them."""


def cut_pixel_error_share(request: PSFRequest, camera: Camera, direct_area: float) -> float:
    """Of the window's light, what is wrong where cut pixels pass light by their open area.

    request, camera: of a thin lens in the panel's plane, with the shadow for a stop. direct_area:
    square metres of the panel from which the window is lit, each weighed by the light.

    A pixel of the side a, of which the shadow leaves chi(s) open, sends to the frequency g

        c(g) = 1/a² integral of chi(s) exp(-2 pi i g s) ds

    instead of its open area times the envelope sinc(a g). In all directions together the
    difference has the energy of the variance of chi, the open share times the closed one
    (Parseval's theorem). But as both are equal for g = 0, a window at low frequencies sees
    little of it: the shift of the light's centre, 2 pi g times the first moment of chi, and
    more toward the pixel's first zero. So c(g) is summed over each pixel, at the frequencies
    that the lens turns from there into the window. The differences of pixels of any phases add
    in intensity, as their light does; where the pixels' gaps are large, the open area that counts
    is the whole pixel's.
    """
    pixel = _find_cut_pixels(camera)
    if not len(pixel):
        return 0.0
    q = request.numeric
    some = pixel[:: math.ceil(len(pixel) / _MAX_PIXELS)]
    whole = len(pixel) / len(some) * camera.panel.pitch**2
    place = [camera.panel.plane.coordinates(axis).numpy()[some[:, axis]] for axis in (0, 1)]
    middle = np.stack(place, axis=-1)
    turned = vergence_error(q.lens, q.distance) / q.wavelength * middle
    frequency = window_frequencies(q) - turned[:, None]
    open_area = _open_area_transform(camera, middle, camera.panel.pitch, 0 * frequency).real
    side = camera.panel.active_side
    within = _open_area_transform(camera, middle, side, frequency)
    if camera.panel.fill_factor == 1:
        # The same places: what is looked at is exact where it has to be.
        open_area = _open_area_transform(camera, middle, side, 0 * frequency).real
    envelope = _sampled_sinc_envelope(frequency, side).prod(axis=-1)
    error = float((np.abs(within - open_area * envelope) ** 2).mean(axis=1).sum()) * whole
    light = float((np.abs(within) ** 2).mean(axis=1).sum()) * whole
    dimmed = float((open_area * envelope**2).mean(axis=1).sum()) * whole
    total = max(direct_area - dimmed, 0.0) + light
    return error / total if total > 0 else math.inf


def _find_cut_pixels(camera: Camera) -> NDArray[np.int64]:
    """Rows and columns of the panel's pixels through which the stop's edge runs, (pixels, 2)."""
    panel, radius = camera.panel, camera.lens.stop_diameter / 2
    lines = [_pixel_boundaries(camera, axis) / radius for axis in (0, 1)]
    found = []
    for piece in (piece for loop in camera.lens.stop.loops for piece in loop.pieces):
        cuts = [piece.crossings(axis, lines[axis]) for axis in (0, 1)]
        t = np.unique(np.concatenate([[0.0], *cuts, [1.0]]))
        at = np.broadcast_arrays(*piece.points((t[1:] + t[:-1]) / 2))
        numbers = [np.searchsorted(line, p) - 1 for line, p in zip(lines, at, strict=True)]
        found.append(np.stack(numbers, axis=-1))
    pixels = np.unique(np.concatenate(found), axis=0)
    inside = (pixels >= 0) & (pixels < np.array(panel.shape))
    return np.asarray(pixels[inside.all(-1)])


def _pixel_boundaries(camera: Camera, axis: int) -> Array:
    """Metres of the lines between pixels along an axis."""
    line, pitch = camera.panel.plane.coordinates(axis).numpy(), camera.panel.pitch
    return np.append(line - pitch / 2, line[-1] + pitch / 2)


def _open_area_transform(
    camera: Camera, middle: Array, side: float, frequency: Array
) -> NDArray[np.complex128]:
    """Mean of chi(s) exp(-2 pi i f s) over squares, (pixels, frequencies).

    middle: (pixels, 2) metres. frequency: (pixels, frequencies, 2), cycles per metre.
    """
    inside = ((np.arange(_PLACES_ACROSS_PIXEL) + 0.5) / _PLACES_ACROSS_PIXEL - 0.5) * side
    y, x = (middle[:, axis, None] + inside for axis in (0, 1))
    radius, stop = camera.lens.stop_diameter / 2, camera.lens.stop
    y, x = y[:, :, None] / radius, x[:, None, :] / radius
    is_open = stop.opening.contains(y, x)
    for shape in stop.obscurations:
        is_open = is_open & ~shape.contains(y, x)
    turns = np.exp(-2j * math.pi * frequency[..., None] * inside)
    light = np.einsum("pyx,pfy,pfx->pf", is_open * 1.0, turns[:, :, 0], turns[:, :, 1])
    return np.asarray(light / _PLACES_ACROSS_PIXEL**2)


def _sampled_sinc_envelope(frequency: Array, side: float) -> Array:
    """The envelope sinc along each axis, of a sum over the places that are looked at."""
    turns = frequency * side
    return np.asarray(np.sinc(turns) / np.sinc(turns / _PLACES_ACROSS_PIXEL))
