"""Integrate light over the area of a sensor's pixels."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import torch

from optics.accuracy import Budget, MachineSpeed, require_memory
from optics.plane import Plane, centred_crop

PIXEL_OVERSAMPLING = 1.5
"""Factor by which the samples of integrate_pixels() must be finer than the light's Nyquist rate."""


@dataclass(frozen=True)
class PixelIntegrationSettings:
    """Tune the integration of light over a sensor's pixels.

    Attributes
    ----------
    error_margin : float
        Relative L2 error of the light on pixels over the largest deviation of the weights' transfer
        function along an axis: 2 axes, times 2 because a pixel averages out fine fringes that count
        in the deviation. Derived.
    least_oversampling : float
        Smallest ratio of the samples' rate to the light's Nyquist rate. Closer to 1, the weights
        reach far. Chosen.
    ample_oversampling : float
        Oversampling where weights for less don't reach the tolerance. Chosen.
    factors : int
        Numbers of samples per pixel that are tried, from the smallest one on. Chosen.
    max_reach : int
        Most samples on either side of a pixel that its weights use. Chosen: the error is down to
        rounding there.
    block : int
        Pixels in a row that are integrated by one matrix; measured to be the fastest.
    """

    error_margin: float = 4.0
    least_oversampling: float = 1.03
    ample_oversampling: float = 1.5
    factors: int = 2
    max_reach: int = 96
    block: int = 16


_SETTINGS = PixelIntegrationSettings()


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


@dataclass(frozen=True, eq=False)
class PixelWeights:
    """Holds the weights of the samples around a sensor pixel in the light's integral over it.

    weights: float64, symmetric, with the pixel's centre in the middle. factor: samples per pixel.
    error: relative L2 error of the light on pixels.
    """

    weights: torch.Tensor
    factor: int
    error: float

    @property
    def reach(self) -> int:
        """The number of samples on either side of a sensor pixel's centre that its weights use."""
        return self.weights.numel() // 2

    @property
    def margin(self) -> int:
        """The whole sensor pixels around a pixel that its weights need, on each side."""
        return math.ceil(self.reach / self.factor)


@functools.lru_cache(maxsize=256)
def pixel_weights(factor: int, band: float, tol: float) -> PixelWeights:
    """Find the fewest weights that integrate band-limited light over a sensor pixel.

    The transfer function of the weights must be that of the pixel, a sinc, wherever the light has
    frequencies. A fit by least squares at nodes that are dense near the band's edge is almost the
    best one. Elsewhere the function is free, so that the weights reach much less far than those of
    a band-limited interpolation.

    Parameters
    ----------
    factor : int
        Samples per pixel, 1 or more.
    band : float
        The light's highest frequency in cycles per sample, below 1/2.
    tol : float
        Relative L2 error of the light on pixels that is allowed.

    Returns
    -------
    PixelWeights
        The weights. Their error, measured at other frequencies than those of the fit, exceeds `tol`
        only if that is beyond double precision.
    """
    best: PixelWeights | None = None
    for reach in range(factor // 2 + 1, factor // 2 + _SETTINGS.max_reach):
        found = _fit_weights(factor, band, reach)
        if best is None or found.error < best.error:
            best = found
        if found.error <= tol:
            break
    assert best is not None
    return best


def _fit_weights(factor: int, band: float, reach: int) -> PixelWeights:
    """Fit the weights of 2 reach + 1 samples to a sensor pixel's transfer function."""
    fitted = band * np.sin(np.pi / 2 * np.linspace(0, 1, 4 * reach + 16))
    half, *_ = np.linalg.lstsq(
        _cosines(fitted, reach), factor * np.sinc(factor * fitted), rcond=1e-15
    )
    judged = np.linspace(0, band, 8 * reach + 33)
    deviation = _cosines(judged, reach) @ half / factor - np.sinc(factor * judged)
    both = np.concatenate((half[:0:-1], half))
    error = _SETTINGS.error_margin * float(np.abs(deviation).max())
    return PixelWeights(torch.from_numpy(both), factor, error)


def _cosines(frequency: np.ndarray, reach: int) -> np.ndarray:
    """Return the transfer functions of pairs of samples at distances 0 to `reach` from a pixel."""
    cosines = 2 * np.cos(2 * np.pi * np.outer(frequency, np.arange(reach + 1)))
    cosines[:, 0] = 1
    return cosines


def pixel_margin(factor: int, tol: float = 1e-9) -> int:
    """Return how many whole sensor pixels integrate_pixels() needs around a pixel.

    Parameters
    ----------
    factor : int
        Samples per pixel along each axis.
    tol : float, optional
        Relative L2 error of the integral that is allowed; 1e-9 by default.

    Returns
    -------
    int
        Pixels on each side.
    """
    return pixel_weights(factor, 0.5 / PIXEL_OVERSAMPLING, tol).margin


def integrate_pixels(light: torch.Tensor, factor: int, tol: float = 1e-9) -> torch.Tensor:
    """Integrate light over a sensor's whole square pixels of `factor` by `factor` samples.

    The relative L2 error is at most `tol` for light that the samples resolve with
    PIXEL_OVERSAMPLING to spare, at least pixel_margin() pixels from the edges. Beyond the edges it
    counts as dark. The origin stays at n // 2.

    Parameters
    ----------
    light : torch.Tensor, (..., rows, columns)
        Light on the fine samples.
    factor : int
        Samples per pixel along each axis, 1 or more.
    tol : float, optional
        Relative L2 error that is allowed; 1e-9 by default.

    Returns
    -------
    torch.Tensor, (..., rows // factor, columns // factor)
        Light on each pixel: its integral in units of a sample, so that even light of 1 gives
        factor².
    """
    return _integrate_both_axes(light, pixel_weights(factor, 0.5 / PIXEL_OVERSAMPLING, tol))


def _integrate_both_axes(light: torch.Tensor, weights: PixelWeights) -> torch.Tensor:
    along_rows = _integrate_along_rows(light, weights)
    return _integrate_along_rows(along_rows.mT.contiguous(), weights).mT


def _integrate_along_rows(light: torch.Tensor, weights: PixelWeights) -> torch.Tensor:
    """Integrate light over sensor pixels along the last axis, (..., samples) to (..., pixels)."""
    factor, reach = weights.factor, weights.reach
    n = light.shape[-1]
    count = n // factor
    block = min(_SETTINGS.block, max(count, 1))
    blocks = math.ceil(count / block)
    before = reach - (n // 2 - (count // 2) * factor)
    span = (block - 1) * factor + 2 * reach + 1
    after = (blocks - 1) * block * factor + span - before - n
    padded = torch.nn.functional.pad(light, (before, after))
    parts = padded.unfold(-1, span, block * factor)
    pixels = parts @ _block_matrix(weights, block).to(light)
    return pixels.reshape(*light.shape[:-1], blocks * block)[..., :count]


@functools.lru_cache(maxsize=64)
def _block_matrix(weights: PixelWeights, block: int) -> torch.Tensor:
    """Return the matrix (samples, pixels) that integrates light over a block of sensor pixels."""
    long = weights.weights.numel()
    matrix = torch.zeros((block - 1) * weights.factor + long, block, dtype=torch.float64)
    for pixel in range(block):
        start = pixel * weights.factor
        matrix[start : start + long, pixel] = weights.weights
    return matrix


class PixelIntegration:
    """Integrates light over whole sensor pixels, and plans the finer samples that this takes.

    Call the object with the light on its `plane`, (..., rows, columns); the result is the light on
    each pixel, ``(..., *pixels.shape)``. The attribute `plane` is finer than the pixels and reaches
    beyond them by `margin` samples on each side. The fewer digits are asked for, the fewer samples
    there are.

    Parameters
    ----------
    pixels : Plane
        Pixels on which the light is wanted.
    cutoff : float
        Cycles per metre of the light's finest fringe.
    budget : Budget, optional
        Limit of the memory that may be used.
    tol : float, optional
        Relative L2 error of the light on pixels that is allowed; 1e-9 by default.

    Attributes
    ----------
    plane : Plane
        The samples.
    margin : int
        Samples beyond the pixels on each side.
    error : float
        Relative L2 error of the light on pixels, at most `tol` if double precision allows it.

    Raises
    ------
    ValueError
        As its subclass ToleranceError, if the fine samples take more memory than the budget allows.
    """

    def __init__(
        self, pixels: Plane, cutoff: float, budget: Budget | None = None, tol: float = 1e-9
    ) -> None:
        self._shape = pixels.shape
        self._weights = _cheapest_weights(pixels, cutoff, tol)
        self._factor, self.error = self._weights.factor, self._weights.error
        beyond = self._weights.margin
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
        rows, columns = self.plane.shape
        lines = rows * columns + columns * rows / self._factor
        each = _SETTINGS.block + 2 * self._weights.reach / self._factor
        return speed.call + lines * (each * speed.multiply_add + speed.touch)

    def __call__(self, light: torch.Tensor) -> torch.Tensor:
        """Compute the light on whole pixels, (..., rows, columns), from light on `plane`."""
        return centred_crop(_integrate_both_axes(light, self._weights), self._shape)


def _cheapest_weights(pixels: Plane, cutoff: float, tol: float) -> PixelWeights:
    """Choose the number of samples per sensor pixel that takes the fewest samples in all."""
    cycles = max(pixels.pitch) * cutoff
    least = max(1, math.ceil(2 * _SETTINGS.least_oversampling * cycles))
    found = [
        _weights_for(factor, cycles, tol) for factor in range(least, least + _SETTINGS.factors)
    ]
    if all(one.error > tol for one in found):
        ample = math.ceil(2 * _SETTINGS.ample_oversampling * cycles)
        found.append(_weights_for(ample, cycles, tol))
    good = [one for one in found if one.error <= tol] or found
    return min(good, key=lambda one: _sample_count(pixels, one))


def _weights_for(factor: int, cycles: float, tol: float) -> PixelWeights:
    """Find the weights of a sensor pixel's samples for light with some cycles per pixel at most."""
    # Light of half a percent more bandwidth shares the weights of light nearby.
    band = min(math.ceil(200 * cycles / factor) / 200, 0.5 / _SETTINGS.least_oversampling)
    return pixel_weights(factor, band, tol)


def _sample_count(pixels: Plane, weights: PixelWeights) -> int:
    rows, columns = (n + 2 * weights.margin for n in pixels.shape)
    return rows * columns * weights.factor**2
