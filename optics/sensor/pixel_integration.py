"""Integrate light over the area of a sensor's pixels."""

from __future__ import annotations

import functools
import math

import numpy as np
import torch

from optics.accuracy import Budget, MachineSpeed, require_memory
from optics.gauss_legendre import gauss_legendre
from optics.plane import Plane, centred_crop

PIXEL_OVERSAMPLING = 1.5
"""Factor by which the samples of integrate_pixels() must be finer than the light's Nyquist rate."""

_REACH = 20
"""Samples beyond a pixel's edge that the interpolation uses."""

_ATTENUATION = 200.0
"""Attenuation of the interpolation's stop band in dB, from Kaiser's formula for _REACH and
PIXEL_OVERSAMPLING."""

PIXEL_INTEGRATION_ERROR = 1e-9
"""Relative L2 error of integrate_pixels(), measured against quadrature with a margin of ten."""


def pixel_transfer(rows: int, columns: int, factor: int) -> torch.Tensor:
    """Return the transfer function of a square sensor pixel of fill factor 1, on an rfft2 grid.

    Parameters
    ----------
    rows, columns : int
        Size of the picture in samples. Its origin is in the corner.
    factor : int
        Samples per pixel along each axis.

    Returns
    -------
    torch.Tensor, (rows, columns // 2 + 1), float64
        Product of the two sinc functions, 1 at frequency zero.
    """
    fy = torch.fft.fftfreq(rows, 1 / factor, dtype=torch.float64)[:, None]
    fx = torch.fft.rfftfreq(columns, 1 / factor, dtype=torch.float64)[None, :]
    return torch.sinc(fy) * torch.sinc(fx)


def sample_pixels(light: torch.Tensor, factor: int) -> torch.Tensor:
    """Sample the light at the sensor's pixel centres from a grid that is finer than the pixels.

    The origin stays at n // 2 for even and odd sizes.

    Parameters
    ----------
    light : torch.Tensor, (..., rows, columns)
        Picture on the fine grid.
    factor : int
        Samples per pixel along each axis.

    Returns
    -------
    torch.Tensor, (..., rows // factor, columns // factor)
        One sample per pixel; a view.
    """
    rows, columns = (n // factor for n in light.shape[-2:])
    y = light.shape[-2] // 2 - (rows // 2) * factor
    x = light.shape[-1] // 2 - (columns // 2) * factor
    return light[..., y::factor, x::factor][..., :rows, :columns]


def pixel_margin(factor: int) -> int:
    """Return how many whole sensor pixels integrate_pixels() needs around a pixel.

    Parameters
    ----------
    factor : int
        Samples per pixel along each axis.

    Returns
    -------
    int
        Pixels on each side.
    """
    return math.ceil((_REACH + factor / 2) / factor)


@functools.cache
def _pixel_kernel(factor: int) -> torch.Tensor:
    """Compute the weights of the samples around a sensor pixel in its integral, float64.

    The origin is in the middle. Each weight is the integral over the pixel of the interpolation of
    one sample, a sinc under a Kaiser window (Kaiser 1974). Light below a third of the sampling rate
    passes unchanged.
    """
    sample = np.arange(-_REACH - factor // 2, _REACH + factor // 2 + 1)
    nodes, weights = gauss_legendre(8)
    parts = np.arange(2 * factor)[:, None] / 2 - factor / 2 + 0.25
    away = sample[:, None] - (parts + nodes / 4).ravel()
    inside = np.sqrt(np.clip(1 - (away / _REACH) ** 2, 0, None))
    window = np.i0(0.1102 * (_ATTENUATION - 8.7) * inside) / np.i0(0.1102 * (_ATTENUATION - 8.7))
    weight = np.tile(weights / 4, 2 * factor)
    return torch.from_numpy((np.sinc(away) * window * (np.abs(away) <= _REACH)) @ weight)


def integrate_pixels(light: torch.Tensor, factor: int) -> torch.Tensor:
    """Integrate light over a sensor's whole square pixels of `factor` by `factor` samples.

    The relative L2 error is at most PIXEL_INTEGRATION_ERROR for light that the samples resolve with
    PIXEL_OVERSAMPLING to spare, at least pixel_margin() pixels from the edges. Beyond the edges it
    counts as dark. The origin stays at n // 2.

    Parameters
    ----------
    light : torch.Tensor, (..., rows, columns)
        Light on the fine samples.
    factor : int
        Samples per pixel along each axis, 1 or more.

    Returns
    -------
    torch.Tensor, (..., rows // factor, columns // factor)
        Light on each pixel: its integral in units of a sample, so that even light of 1 gives
        factor².
    """
    kernel = _pixel_kernel(factor).to(light)
    return _integrate_along_rows(_integrate_along_rows(light, kernel, factor).mT, kernel, factor).mT


class PixelIntegration:
    """Integrates light over whole sensor pixels, and plans the finer samples that this takes.

    Call the object with the light on its `plane`, (..., rows, columns); the result is the light on
    each pixel, ``(..., *pixels.shape)``. The attribute `plane` is finer than the pixels and reaches
    beyond them by `margin` samples on each side.

    Parameters
    ----------
    pixels : Plane
        Pixels on which the light is wanted.
    cutoff : float
        Cycles per metre of the light's finest fringe.
    budget : Budget, optional
        Limit of the memory that may be used.

    Raises
    ------
    ValueError
        As its subclass ToleranceError, if the fine samples take more memory than the budget allows.
    """

    def __init__(self, pixels: Plane, cutoff: float, budget: Budget | None = None) -> None:
        self._shape = pixels.shape
        nyquist = 2 * max(pixels.pitch) * cutoff
        self._factor = max(1, math.ceil(PIXEL_OVERSAMPLING * nyquist))
        beyond = pixel_margin(self._factor)
        window = (pixels.shape[0] + 2 * beyond, pixels.shape[1] + 2 * beyond)
        self.margin = beyond * self._factor
        self.plane = Plane(window, pixels.pitch, pixels.centre).with_finer_pitch(self._factor)
        allowed = (budget or Budget()).memory
        what = f"the light on whole pixels, with {self._factor}x{self._factor} samples in each,"
        require_memory(what, self.bytes, allowed, "ask for fewer pixels")

    @property
    def _samples(self) -> int:
        return self.plane.shape[0] * self.plane.shape[1]

    @property
    def bytes(self) -> int:
        """The memory in bytes of the sensor pixels' fine samples, with and without padding.

        The samples are in single precision.
        """
        return 2 * 4 * self._samples

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of one integration over sensor pixels, in seconds."""
        taps = _pixel_kernel(self._factor).numel() / self._factor * (1 + 1 / self._factor)
        return speed.call + self._samples * taps * speed.tap

    def __call__(self, light: torch.Tensor) -> torch.Tensor:
        """Compute the light on whole pixels, (..., rows, columns), from light on `plane`."""
        return centred_crop(integrate_pixels(light, self._factor), self._shape)


def _integrate_along_rows(light: torch.Tensor, kernel: torch.Tensor, factor: int) -> torch.Tensor:
    n, half = light.shape[-1], kernel.numel() // 2
    count = n // factor
    first = n // 2 - (count // 2) * factor
    padded = torch.nn.functional.pad(light, (half - first, half))
    lines = padded.reshape(-1, 1, padded.shape[-1])
    pixels = torch.nn.functional.conv1d(lines, kernel[None, None], stride=factor)
    return pixels[..., :count].reshape(*light.shape[:-1], count)
