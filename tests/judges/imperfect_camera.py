"""What a lens and a sensor that aren't ideal make of a picture: sums over places, rays and pixels.

All is done to a picture of an ideal camera on much finer pixels and a larger frame, with numpy and
scipy alone.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve, gaussian_filter, map_coordinates, spline_filter

from optics.camera import Camera, Ghost, Lens
from optics.light import Band, Spectrum

Array = NDArray[np.float64]


def imperfect(
    fine: Array,
    finer: int,
    camera: Camera,
    vibration: float,
    larger: float = 1.0,
    band: Band | None = None,
    light: Spectrum | None = None,
) -> Array:
    """Electrons on the camera's pixels.

    fine: irradiance as electrons of a whole pixel, at places `finer` of which lie along one; the
    axis is at n // 2. vibration: metres rms while it is exposed. larger: scale of its colour. band:
    a Gaussian filter's, if it shifts with the angle, and the spectrum of all light.
    """
    one, lens = camera.sensor, camera.lens
    down, along = ((np.arange(n) - n // 2) * one.pitch / finer for n in fine.shape)
    height = np.hypot(down[:, None], along)
    fine = fine * _falling(lens, _landing(lens, height))
    if band is not None and light is not None:
        fine = fine * _through_filter(band, light, lens, height)
    shaken = gaussian_filter(fine, vibration * finer / one.pitch, truncate=6) if vibration else fine
    places = [_places(n, finer) * one.pitch for n in one.shape]
    y, x = np.meshgrid(*places, indexing="ij")
    seen = _looked_up(shaken, finer / one.pitch, lens, y, x, larger)
    seen *= 1 - sum(ghost.share for ghost in camera.ghosts)
    for ghost in camera.ghosts:
        seen += _ghost(shaken, finer / one.pitch, ghost, y, x)
    pixels = seen.reshape(one.shape[0], finer, one.shape[1], finer).mean((1, 3))
    pixels = pixels * _share_past_dust(camera)
    a = one.crosstalk
    along = np.array([a, 1 - 2 * a, a])
    return np.asarray(convolve(pixels, along[:, None] * along, mode="nearest"))


def larger(lens: Lens, wavelength: float) -> float:
    """The scale of a colour's image."""
    curve = lens.lateral_colour
    return 1 + float(np.interp(wavelength, *np.array(curve).T)) if curve else 1.0


def out_of_focus(lens: Lens, wavelength: float, drift: float = 0.0) -> Lens:
    """A lens without colour that is as far from sharp as the lens is at a wavelength, and by drift.

    At its edge, the waves that converge on the image and on the sensor are apart by half of
    1/z - 1/z' times r². The Zernike polynomial (2, 0) goes from -√3 to √3.
    """
    if not (lens.axial_colour or drift):
        return lens
    z = float(lens.image_distance)
    behind = z + drift
    if lens.axial_colour:
        behind += float(np.interp(wavelength, *np.array(lens.axial_colour).T))
    edge = (1 / z - 1 / behind) * float(lens.stop_diameter) ** 2 / 8
    path = ((2, 0, float(edge) / (2 * 3**0.5)),)
    return replace(lens, axial_colour=(), aberrations=path)


def _through_filter(band: Band, light: Spectrum, lens: Lens, height: Array) -> Array:
    """Photons that pass the filter at each height, over those on the axis: sums over wavelengths.

    Thin films shift all wavelengths by the cosine within them (Macleod).
    """
    tangent = height / float(lens.image_distance)
    sines = np.sin(np.arctan(np.linspace(0, tangent.max(), 60)))
    shift = band.centre - band.centre * np.sqrt(1 - (sines / band.effective_index) ** 2)
    reach = 3 * band.fwhm + shift.max()
    waves = np.linspace(band.centre - reach, band.centre + reach, 20001)
    sent = np.interp(waves, light.wavelengths, light.values) * waves
    passed = []
    for sine in sines:
        cosine = np.sqrt(1 - (sine / band.effective_index) ** 2)
        passed.append((sent * 0.5 ** ((2 * (waves / cosine - band.centre) / band.fwhm) ** 2)).sum())
    known = np.linspace(0, tangent.max(), 60)
    return np.asarray(np.interp(tangent, known, np.array(passed) / passed[0]))


def _places(count: int, finer: int) -> Array:
    inside = (np.arange(finer) + 0.5) / finer - 0.5
    return np.asarray((np.arange(count)[:, None] - count // 2 + inside).ravel())


def _looked_up(
    picture: Array, per_metre: float, lens: Lens, y: Array, x: Array, larger: float
) -> Array:
    """The straight picture where each place's light comes from, as bright as areas change."""
    y, x = y / larger, x / larger
    height = np.hypot(y, x)
    before = _before(lens, height)
    scale = before / height
    index = [at * scale * per_metre + n // 2 for at, n in zip((y, x), picture.shape, strict=True)]
    seen: Array = map_coordinates(picture, index, order=3)
    if lens.relative_illumination:
        return seen
    seen = seen / larger**2
    if not any(lens.distortion):
        return seen
    step = 1e-4 * height
    radial = (_before(lens, height + step) - _before(lens, height - step)) / (2 * step)
    return seen * radial * scale


def _ghost(picture: Array, per_metre: float, ghost: Ghost, y: Array, x: Array) -> Array:
    """The mean of the picture over all points whose discs hold each place, times its share.

    A point at r becomes a disc around M r, which holds x if x + d = M r for an offset d in it. The
    light is M² times thinner than in the picture.
    """
    known = spline_filter(picture, 3)
    side = (np.arange(24) + 0.5) / 12 - 1
    dy, dx = (part.ravel() for part in np.meshgrid(side, side))
    inside = dy**2 + dx**2 <= 1
    radius = ghost.blur_diameter / 2
    total = np.zeros_like(y)
    for one, other in zip(dy[inside] * radius, dx[inside] * radius, strict=True):
        from_y, from_x = (y + one) / ghost.magnification, (x + other) / ghost.magnification
        index = [
            at * per_metre + n // 2 for at, n in zip((from_y, from_x), picture.shape, strict=True)
        ]
        total += map_coordinates(known, index, order=3, prefilter=False)
    return ghost.share * total / int(inside.sum()) / ghost.magnification**2


def _landing(lens: Lens, height: Array) -> Array:
    """By Brown's formula: where a point at this height is imaged, as whose light counts."""
    k1, k2 = lens.distortion
    t = height / float(lens.image_distance)
    return np.asarray(height * (1 + k1 * t**2 + k2 * t**4))


def _before(lens: Lens, height: Array) -> Array:
    """By bisection of Brown's formula."""
    if not any(lens.distortion):
        return height
    k1, k2 = lens.distortion
    low, high = np.zeros_like(height), 1.5 * height
    for _ in range(48):
        middle = (low + high) / 2
        t = middle / float(lens.image_distance)
        under = middle * (1 + k1 * t**2 + k2 * t**4) < height
        low, high = np.where(under, middle, low), np.where(under, high, middle)
    return np.asarray((low + high) / 2)


def _falling(lens: Lens, height: Array) -> Array:
    pairs = lens.relative_illumination
    found = np.full_like(height, pairs[-1][1] if pairs else 1.0)
    for (inner, more), (outer, less) in pairwise(pairs):
        here = (height >= inner) & (height <= outer)
        share = (height**2 - inner**2) / (outer**2 - inner**2)
        found = np.where(here, more + (less - more) * share, found)
    return found


def _share_past_dust(camera: Camera) -> Array:
    """Rays from points all over the stop to points all over each pixel: how many pass."""
    one, lens = camera.sensor, camera.lens
    found = np.ones(one.shape)
    if not one.dust:
        return found
    side = (np.arange(60) + 0.5) / 30 - 1
    sy, sx = (part.ravel() for part in np.meshgrid(side, side))
    inside = sy**2 + sx**2 <= 1
    radius, step = float(lens.stop_diameter) / 2, one.dust_distance / float(lens.image_distance)
    sy, sx = sy[inside] * radius, sx[inside] * radius
    fine = _places(1, 5) * one.pitch
    reach = radius * step + one.pitch
    for i in range(one.shape[0]):
        for j in range(one.shape[1]):
            py, px = (k - n // 2 for k, n in zip((i, j), one.shape, strict=True))
            near = [
                speck for speck in one.dust
                if np.hypot(py * one.pitch - speck[0], px * one.pitch - speck[1])
                < 1.5 * (reach + speck[2])
            ]  # fmt: skip
            if near:
                gy, gx = (
                    (p * one.pitch + fine)[:, None] * (1 - step) + s * step
                    for p, s in ((py, sy), (px, sx))
                )
                free = np.ones((5, 5, len(sy)), bool)
                for y, x, diameter in near:
                    free &= (gy[:, None] - y) ** 2 + (gx - x) ** 2 > diameter**2 / 4
                found[i, j] = free.mean()
    return found
