"""Distortion and scaling of a blurred picture, as the lens does it."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.ndimage
import torch
from numpy.typing import NDArray

from optics.camera import Camera, Lens
from optics.camera.camera import wavelengths_between
from optics.fourier import irfft2, rfft2
from optics.plane import Plane
from simulator.probing.picture_probe import MARGIN
from simulator.situation import Situation

Array = NDArray[np.float64]

_FINER: Final = 2
# Samples of the interpolated light along one of the picture's, and the degree of the spline
# between them. Chosen: together they miss .3 % of the finest detail that samples can have.
_SPLINE: Final = 5

DISTORTION_OPERATIONS = 200.0
"""Operations a sample of the picture, without those of the transforms; measured against them."""


@dataclass(frozen=True)
class DistortedFrame:
    """How far distortion moves what the frame holds, and how it changes areas.

    reach: largest way in metres from a pixel to its light's undistorted place. largest, least: gain
    of area.
    """

    reach: float
    largest: float
    least: float


_STRAIGHT = DistortedFrame(0.0, 1.0, 1.0)


def distorted_frame(camera: Camera) -> DistortedFrame:
    """Return what distortion does to a frame, up to its corners.

    Raises ValueError if light from beyond the picture's margin is brought into the frame.
    """
    if not any(camera.lens.distortion):
        return _STRAIGHT
    return _distorted_frame(camera.lens, camera.sensor.shape, camera.sensor.pitch)


@functools.lru_cache(maxsize=8)
def _distorted_frame(lens: Lens, shape: tuple[int, int], pitch: float) -> DistortedFrame:
    """Return what a lens' distortion does to a frame of (rows, columns) pixels."""
    by = lens.radial_distortion
    assert by is not None
    corner = math.hypot(*shape) * pitch / 2
    heights = np.linspace(0, corner, 129)
    before = by.undistorted(heights)
    reach, gain = float(np.abs(before - heights).max()), by.area_gain(before)
    pixels = reach / pitch
    if pixels > MARGIN:
        raise ValueError(
            f"distortion is {list(lens.distortion)}; it moves light by {pixels:.0f} pixels, "
            f"and the virtual bench follows it over {MARGIN}: give smaller coefficients, or a "
            "sensor of fewer pixels"
        )
    return DistortedFrame(reach, float(gain.max()), float(gain.min()))


def lateral_scales(s: Situation) -> tuple[float, float]:
    """Return the least and the largest scale of the images of all light."""
    lens = s.camera.lens
    if not lens.lateral_colour:
        return 1.0, 1.0
    band = s.band
    ranges = [band.support, *([band.leak_range] if band.leak else [])]
    found = [
        lens.image_scale(one)
        for ends in ranges
        for one in wavelengths_between(lens.lateral_colour, *ends)
    ]
    return min(found), max(found)


def moved_frame(s: Situation) -> DistortedFrame:
    """Return what distortion and the colours' scales do to a frame together.

    Raises ValueError if light from beyond the picture's margin is brought into the frame.
    """
    camera, bent = s.camera, distorted_frame(s.camera)
    low, high = lateral_scales(s)
    if low == high == 1:
        return bent
    corner = math.hypot(*camera.sensor.shape) * camera.sensor.pitch / 2
    reach = bent.reach + (corner + bent.reach) * max(1 / low - 1, 1 - 1 / high)
    if reach > MARGIN * camera.sensor.pitch:
        raise ValueError(
            f"lateral_colour changes the image's scale to {low:.4g} and {high:.4g}, which moves "
            f"light by {reach / camera.sensor.pitch:.0f} pixels, and the virtual bench follows it "
            f"over {MARGIN}: give smaller changes, or a sensor of fewer pixels"
        )
    least, largest = bent.least * min(low, 1.0) ** 2, bent.largest * max(high, 1.0) ** 2
    return DistortedFrame(reach, largest, least)


def distort(
    spectrum: torch.Tensor, plane: Plane, camera: Camera, *, bend: bool = True, scale: float = 1.0
) -> torch.Tensor:
    """Distort a picture, given and returned as its spectrum on a plane's samples.

    The light of each area is kept, and spread over its image; but with a curve of relative
    illumination, it is as bright as that says where it lands. bend: whether the lens' distortion
    counts. scale: by which the image is larger.
    """
    lens = camera.lens
    by = lens.radial_distortion if bend else None
    if by is None and scale == 1:
        return spectrum
    shape = [_FINER * n for n in plane.shape]
    known = irfft2(_padded(spectrum, plane.shape), shape).numpy() * _FINER**2
    y, x = (np.fft.ifftshift(plane.coordinates(axis).numpy()) for axis in (0, 1))
    height = np.hypot(y[:, None], x) / scale
    before = height if by is None else by.undistorted(height)
    back = np.divide(before, height, out=np.ones_like(height), where=height > 0) / scale
    places = [
        back * at * (_FINER / pitch) for at, pitch in zip((y[:, None], x), plane.pitch, strict=True)
    ]
    seen = scipy.ndimage.map_coordinates(known, places, order=_SPLINE, mode="grid-wrap")
    if not lens.relative_illumination:
        seen = seen / scale**2
    if by is not None and not lens.relative_illumination:
        # Beyond the frame areas may vanish; light as bright as that would ring into it.
        seen = seen / np.maximum(by.area_gain(before), distorted_frame(camera).least)
    return rfft2(torch.from_numpy(seen.astype(np.float32))).to(torch.complex64)


def _padded(spectrum: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Return a picture's spectrum on finer samples, without the Nyquist frequency."""
    rows, columns = shape
    finer = torch.zeros(_FINER * rows, _FINER * columns // 2 + 1, dtype=spectrum.dtype)
    half, kept = (rows - 1) // 2, (columns - 1) // 2 + 1
    finer[: half + 1, :kept] = spectrum[: half + 1, :kept]
    if half:
        finer[-half:, :kept] = spectrum[-half:, :kept]
    return finer
