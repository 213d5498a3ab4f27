"""A display with coloured stripes in each pixel, as a target (thesis §6.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from optics.fourier import FourierGeometry, plan_transform
from optics.light.bands import Band
from optics.light.spectrum import LONGEST_WAVELENGTH, SHORTEST_WAVELENGTH, Spectrum
from optics.plane import Plane
from optics.validation import require_positive
from simulator.scene.colours import Basis
from simulator.scene.drawable import STILL, Drawable, Shift
from simulator.scene.framed import require_colours
from simulator.scene.pixel_picture import along_both_axes, edges, window_matrix
from simulator.scene.target import Layer, Part, Target

PEAKS: Sequence[tuple[float, float]] = ((610e-9, 35e-9), (540e-9, 40e-9), (455e-9, 22e-9))
"""Centres and full widths at half maximum of red, green and blue, in metres: approximate values of
a liquid-crystal display in front of white diodes."""


def display_primaries(bands: Sequence[tuple[float, float]] = PEAKS) -> Basis:
    """Return Gaussian spectra of a display's red, green and blue, each with a peak of 1.

    Parameters
    ----------
    bands : sequence of tuple of float, default PEAKS
        Centre and full width at half maximum of red, green and blue, metres.

    Returns
    -------
    tuple of Spectrum
        Relative spectra of red, green and blue over the range of silicon.
    """
    nodes = np.linspace(SHORTEST_WAVELENGTH, LONGEST_WAVELENGTH, 801)
    red, green, blue = (
        Spectrum(tuple(nodes), tuple(Band(centre, fwhm).transmission(nodes)))
        for centre, fwhm in bands
    )
    return red, green, blue


@dataclass(frozen=True, eq=False)
class Windows(Drawable):
    """Picture of display pixels, each evenly lit in a window and black around the window.

    image: (rows, columns). pitch: of the pixels at the object, metres. rows, columns: beginning
    and end of the window within its pixel, in pitches.
    """

    has_exact_spectrum = True
    image: torch.Tensor
    pitch: float
    rows: tuple[float, float]
    columns: tuple[float, float]

    def extent(self, magnification: float, shift: Shift = STILL) -> tuple[float, float]:
        y, x = (
            (n * self.pitch / 2 + abs(part)) * magnification
            for n, part in zip(self.image.shape, shift, strict=True)
        )
        return y, x

    def light(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        side = self.pitch * magnification
        if side == 0:
            return torch.zeros(plane.shape)
        matrices = [
            window_matrix(n, side, moved * magnification, window, edges(plane, axis))
            for axis, n, moved, window in zip(
                (0, 1), self.image.shape, shift, (self.rows, self.columns), strict=True
            )
        ]
        return along_both_axes(self.image, *matrices)

    def spectrum(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        """Return the Fourier spectrum, computed window by window, without those beyond the plane.

        The harmonics of the pixel grid fall too slowly for sampling to resolve them.
        """
        side, (rows, columns) = self.pitch * magnification, plane.shape
        if side == 0:
            return torch.zeros(rows, columns // 2 + 1, dtype=torch.complex64)
        steps = [1 / (n * pitch) for n, pitch in zip(plane.shape, plane.pitch, strict=True)]
        half = columns // 2 + 1
        frequency = Plane((rows, half), (steps[0], steps[1]), (0.0, half // 2 * steps[1]))
        windows = (self.rows, self.columns)
        image, centre = self.image, []
        for axis in (0, 1):
            image, first = _visible_pixels(image, axis, plane, side, shift[axis] * magnification)
            middle = (image.shape[axis] // 2 + sum(windows[axis]) / 2) * side
            centre.append(first + middle - plane.centre[axis])
        pixels = Plane((image.shape[0], image.shape[1]), (side, side), (centre[0], centre[1]))
        points = plan_transform(FourierGeometry(pixels, frequency, 1.0))(image.to(torch.complex64))
        for axis, window in enumerate(windows):
            width = (window[1] - window[0]) * side
            opening = torch.sinc(frequency.coordinates(axis) * width) * width / plane.pitch[axis]
            points = points * (opening[:, None] if axis == 0 else opening).to(torch.float32)
        return torch.fft.ifftshift(points, dim=-2)


def _visible_pixels(
    image: torch.Tensor, axis: int, plane: Plane, side: float, shift: float
) -> tuple[torch.Tensor, float]:
    """Return the pixels along an axis that overlap the plane, one at least, and where they begin.

    The beginning is in metres on the plane.
    """
    n, ends = image.shape[axis], edges(plane, axis)
    start = shift - n * side / 2
    first = min(max(math.floor((ends[0] - start) / side), 0), n - 1)
    last = min(max(math.ceil((ends[-1] - start) / side), first + 1), n)
    return image.narrow(axis, first, last - first), start + first * side


@dataclass(frozen=True, eq=False)
class Display(Target):
    """Self-luminous display with red, green and blue stripes.

    Parameters
    ----------
    image : torch.Tensor
        Linear red, green and blue of the pixels, shape (rows, columns, 3), 0 to 1.
    pitch, distance : float
        Pitch of the pixels, and distance from the panel, in metres, positive.
    radiance : float
        Spectral radiance of a stripe that is fully on, at the peak of its primary, W / (sr m² m).
    primaries : tuple of Spectrum
        Relative spectra of red, green and blue, such as those of `display_primaries`.
    fill : float, default 0.9
        Side of a stripe's window over the side of its cell, along each axis, above 0, up to 1.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`; `light` must be None.

    Raises
    ------
    ValueError
        If the image isn't a finite colour picture, `pitch` isn't positive, `fill` is outside its
        range, or `light` is given.
    """

    image: torch.Tensor
    pitch: float
    distance: float
    radiance: float
    primaries: Basis
    fill: float = 0.9

    def __post_init__(self) -> None:
        super().__post_init__()
        require_colours(self.image)
        require_positive("pitch", self.pitch, "m")
        if not 0 < self.fill <= 1:
            raise ValueError(f"fill is {self.fill:g}; give a share above 0, up to 1")
        if self.light is not None:
            raise ValueError("a display shines by itself; give it no light")

    @property
    def size(self) -> tuple[float, float]:
        """Return height and width in metres."""
        rows, columns = self.image.shape[:2]
        return rows * self.pitch, columns * self.pitch

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        margin = (1 - self.fill) / 2
        rows = (margin, 1 - margin)
        parts = []
        for k, spectrum in enumerate(self.primaries):
            columns = (k + margin) / 3, (k + 1 - margin) / 3
            stripes = Windows(self.image[..., k].contiguous(), self.pitch, rows, columns)
            parts.append(Part(spectrum.with_scale(self.radiance), stripes))
        return (Layer(self.distance, tuple(parts)),)
