"""Estimate the PSF error of taking panel pixels that a shadow cuts as dimmer whole ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera
from optics.chain.edge_scatter import window_frequencies
from optics.psf_engines.request import PSFRequest
from optics.pupil import vergence_error

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CutPixelSettings:
    """Tune how the error of cut panel pixels is estimated.

    Attributes
    ----------
    samples_across : int
        Samples across a pixel at which the stop's shadow is evaluated. Chosen.
    max_pixels : int
        Most pixels that are evaluated, evenly spaced along the edge, to represent all. Chosen.
    """

    samples_across: int = 12
    max_pixels: int = 1024


_SETTINGS = CutPixelSettings()


def cut_pixel_error_share(request: PSFRequest, camera: Camera, direct_area: float) -> float:
    """Estimate the share of a chain's window light that is wrong because of cut panel pixels.

    request, camera: of a thin lens in the panel's plane, whose stop is the shadow. direct_area:
    square metres of the panel from which the window is lit, weighted by the light.

    The shadow leaves the part chi(s) of a pixel of side a open. The pixel then sends the amplitude

        c(g) = 1/a² integral of chi(s) exp(-2 pi i g s) ds

    to the frequency g. The model takes its open area times the envelope sinc(a g) instead. Over all
    frequencies, the energy of the difference is the variance of chi, which is the open share times
    the closed share (Parseval's theorem). Both amplitudes are equal for g = 0, so the difference is
    small in a window at low frequencies: there it is the shift of the light's centre, 2 pi g times
    the first moment of chi. It grows toward the pixel's first zero. Therefore c(g) is computed for
    each pixel at the frequencies that the lens turns from that pixel into the window. The pixels'
    phases are unknown, so their differences add in intensity, as their light does. With a fill
    factor below 1, the open area is that of the whole pixel, gaps included.
    """
    pixel = _find_cut_pixels(camera)
    if not len(pixel):
        return 0.0
    q = request.numeric
    some = pixel[:: math.ceil(len(pixel) / _SETTINGS.max_pixels)]
    whole = len(pixel) / len(some) * camera.panel.pitch**2
    place = [camera.panel.plane.coordinates(axis).numpy()[some[:, axis]] for axis in (0, 1)]
    middle = np.stack(place, axis=-1)
    turned = vergence_error(q.lens, q.distance) / q.wavelength * middle
    frequency = window_frequencies(q) - turned[:, None]
    open_area = _open_area_transform(camera, middle, camera.panel.pitch, 0 * frequency).real
    side = camera.panel.active_side
    within = _open_area_transform(camera, middle, side, frequency)
    if camera.panel.fill_factor == 1:
        # The same samples as in `within` make the difference exactly 0 at frequency 0.
        open_area = _open_area_transform(camera, middle, side, 0 * frequency).real
    envelope = _sampled_sinc_envelope(frequency, side).prod(axis=-1)
    error = float((np.abs(within - open_area * envelope) ** 2).mean(axis=1).sum()) * whole
    light = float((np.abs(within) ** 2).mean(axis=1).sum()) * whole
    dimmed = float((open_area * envelope**2).mean(axis=1).sum()) * whole
    total = max(direct_area - dimmed, 0.0) + light
    return error / total if total > 0 else math.inf


def _find_cut_pixels(camera: Camera) -> NDArray[np.int64]:
    """Find the chain's panel pixels that the edge of the stop's shadow crosses, (pixels, 2).

    The result holds each pixel's row and column.
    """
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
    """Return the boundaries between the panel pixels of a chain along an axis, in metres."""
    line, pitch = camera.panel.plane.coordinates(axis).numpy(), camera.panel.pitch
    return np.append(line - pitch / 2, line[-1] + pitch / 2)


def _open_area_transform(
    camera: Camera, middle: Array, side: float, frequency: Array
) -> NDArray[np.complex128]:
    """Average chi(s) exp(-2 pi i f s) over the chain's panel pixels, (pixels, frequencies).

    chi is 1 where the stop's shadow leaves the panel open, and 0 elsewhere. middle: the pixels'
    centres, (pixels, 2), metres. frequency: (pixels, frequencies, 2), cycles per metre.
    """
    count = _SETTINGS.samples_across
    inside = ((np.arange(count) + 0.5) / count - 0.5) * side
    y, x = (middle[:, axis, None] + inside for axis in (0, 1))
    radius, stop = camera.lens.stop_diameter / 2, camera.lens.stop
    y, x = y[:, :, None] / radius, x[:, None, :] / radius
    is_open = stop.opening.contains(y, x)
    for shape in stop.obscurations:
        is_open = is_open & ~shape.contains(y, x)
    turns = np.exp(-2j * math.pi * frequency[..., None] * inside)
    light = np.einsum("pyx,pfy,pfx->pf", is_open * 1.0, turns[:, :, 0], turns[:, :, 1])
    return np.asarray(light / count**2)


def _sampled_sinc_envelope(frequency: Array, side: float) -> Array:
    """Return the envelope of a chain's panel pixel along each axis, for a sum over samples.

    An integral over the pixel has the envelope sinc instead.
    """
    turns = frequency * side
    return np.asarray(np.sinc(turns) / np.sinc(turns / _SETTINGS.samples_across))
