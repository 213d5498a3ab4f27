"""Integrate light over the area of pixels, from samples that are finer than these."""

from __future__ import annotations

import functools
import math
from fractions import Fraction

import torch

from optics.accuracy import Budget, MachineSpeed, require_memory, require_time
from optics.fourier.differentiation import apply_linear_map
from optics.fourier.fitted_interpolation import BandedMatrix
from optics.plane import Plane
from optics.sensor.pixel_weights import (
    BLOCK,
    FIT_SECONDS,
    OVERSAMPLING,
    WIDEST_BAND,
    PixelWeights,
    expected_reach,
    pixel_weights,
)

PIXEL_OVERSAMPLING = 1.5
"""Factor by which the samples of integrate_pixels() must be finer than the light's Nyquist rate."""

# Samples per pixel beyond which their number is whole: all pixels then have the same weights, which
# are dear to fit. Chosen.
_WHOLE_SAMPLES = 64

_PASSES_PER_SAMPLE = 4.0  # in each axis' integration, its transposed copy included; measured


def pixel_transfer(rows: int, columns: int, factor: int) -> torch.Tensor:
    """Return the transfer function of a square pixel of fill factor 1, on an rfft2 grid.

    Parameters
    ----------
    rows, columns, factor : int
        Size of the picture in samples, whose origin is in the corner, and samples per pixel along
        each axis.

    Returns
    -------
    torch.Tensor, (rows, columns // 2 + 1), float64
        Product of the two sinc functions, 1 at frequency zero.
    """
    fy = torch.fft.fftfreq(rows, 1 / factor, dtype=torch.float64)[:, None]
    fx = torch.fft.rfftfreq(columns, 1 / factor, dtype=torch.float64)[None, :]
    return torch.sinc(fy) * torch.sinc(fx)


def sample_pixels(light: torch.Tensor, factor: int) -> torch.Tensor:
    """Sample light at the pixels' centres from a grid that is finer than the pixels.

    The origin stays at n // 2 for even and odd sizes.

    Parameters
    ----------
    light, factor : torch.Tensor, (..., rows, columns), int
        Picture on the fine grid, and samples per pixel along each axis.

    Returns
    -------
    torch.Tensor, (..., rows // factor, columns // factor)
        One sample per pixel; a view.
    """
    rows, columns = (n // factor for n in light.shape[-2:])
    y = light.shape[-2] // 2 - (rows // 2) * factor
    x = light.shape[-1] // 2 - (columns // 2) * factor
    return light[..., y::factor, x::factor][..., :rows, :columns]


def pixel_margin(factor: int, tol: float = 1e-9) -> int:
    """Return how many whole pixels integrate_pixels() needs around a pixel.

    Parameters
    ----------
    factor, tol : int, float, optional
        Samples per pixel along each axis, and relative L2 error that is allowed, 1e-9 by default.

    Returns
    -------
    int
        Pixels on each side.
    """
    return pixel_weights(Fraction(factor), 0.5 / PIXEL_OVERSAMPLING, tol).margin


def integrate_pixels(light: torch.Tensor, factor: int, tol: float = 1e-9) -> torch.Tensor:
    """Integrate light over whole square pixels of `factor` by `factor` samples.

    The relative L2 error is at most `tol` for light that the samples resolve with
    PIXEL_OVERSAMPLING to spare, at least pixel_margin() pixels from the edges. Beyond the edges it
    counts as dark. The origin stays at n // 2.

    Parameters
    ----------
    light, factor : torch.Tensor, (..., rows, columns), int
        Light on the fine samples, and samples per pixel along each axis, 1 or more.
    tol : float, optional
        Relative L2 error that is allowed; 1e-9 by default.

    Returns
    -------
    torch.Tensor, (..., rows // factor, columns // factor)
        Light on each pixel: its integral in units of a sample, so that even light of 1 gives
        factor².
    """
    weights = pixel_weights(Fraction(factor), 0.5 / PIXEL_OVERSAMPLING, tol)
    rows, columns = (n // factor for n in light.shape[-2:])
    return _integrate_both_axes(light, (weights, weights), (rows, columns))


def _integrate_both_axes(
    light: torch.Tensor, weights: tuple[PixelWeights, PixelWeights], shape: tuple[int, int]
) -> torch.Tensor:
    """Integrate light over pixels along both axes, to (..., *shape)."""
    y, x = (
        _integration_matrix(one, samples, count, light.dtype)
        for one, samples, count in zip(weights, light.shape[-2:], shape, strict=True)
    )

    def forward(picture: torch.Tensor) -> torch.Tensor:
        return x.forward(y.forward(picture).mT.contiguous()).mT

    def adjoint(picture: torch.Tensor) -> torch.Tensor:
        return y.adjoint(x.adjoint(picture.mT.contiguous()).mT.contiguous())

    if light.ndim == 2:
        return apply_linear_map(forward, adjoint, light)
    found = [apply_linear_map(forward, adjoint, one) for one in light.flatten(0, -3)]
    if not found:
        # An empty batch keeps its derivatives.
        return light[..., : shape[0], : shape[1]]
    return torch.stack(found).reshape(*light.shape[:-2], *shape)


@functools.lru_cache(maxsize=64)
def _integration_matrix(
    weights: PixelWeights, samples: int, count: int, dtype: torch.dtype
) -> BandedMatrix:
    """Return the matrix that integrates light over pixels along one axis.

    The middle one of `samples`, at samples // 2, is the centre of the middle one of `count` pixels.
    Beyond the samples, light counts as dark.
    """
    block, reach = weights.weights.shape[0], weights.reach
    pixel = torch.arange(count) - count // 2
    numerator, denominator = weights.factor.numerator, weights.factor.denominator
    nearest = torch.div(2 * pixel * numerator + denominator, 2 * denominator, rounding_mode="floor")
    first = nearest + samples // 2 - reach
    entries = weights.weights[pixel % block]
    columns = first[:, None] + torch.arange(2 * reach + 1)
    entries = torch.where((columns >= 0) & (columns < samples), entries, 0.0)
    return BandedMatrix(entries.to(dtype), first, samples)


class PixelIntegration:
    """Integrates light over whole pixels, and plans the finer samples that this takes.

    Call the object with the light on its `plane`, (..., rows, columns); the result is the light on
    each pixel, ``(..., *pixels.shape)``. The fewer digits are asked for, the fewer samples there
    are.

    Parameters
    ----------
    pixels : Plane
        Pixels on which the light is wanted.
    cutoff : float or tuple of float
        Cycles per metre of the light's finest fringe; two along y and x where they differ.
    budget, tol : Budget, float, optional
        Limit of the memory, and relative L2 error that is allowed, 1e-9 by default.

    Attributes
    ----------
    plane, margin : Plane, tuple of int
        The samples, which reach beyond the pixels by so many on each side, along y and x.
    error : float
        Relative L2 error of the light on pixels, at most `tol` if double precision allows it.

    Raises
    ------
    ToleranceError
        If the fine samples take more memory than the budget allows.
    """

    def __init__(
        self,
        pixels: Plane,
        cutoff: float | tuple[float, float],
        budget: Budget | None = None,
        tol: float = 1e-9,
    ) -> None:
        self._shape = pixels.shape
        both = cutoff if isinstance(cutoff, tuple) else (cutoff, cutoff)
        cycles = [pitch * one for pitch, one in zip(pixels.pitch, both, strict=True)]
        budget = budget or Budget()
        _require_few_fringes(pixels.shape, cycles, budget)
        self._fitted: list[PixelWeights] = []
        y, x = (
            _cheapest_weights(count, one, tol, self._fitted)
            for count, one in zip(pixels.shape, cycles, strict=True)
        )
        self._weights = (y, x)
        self.error = max(one.error for one in self._weights)
        beyond = [
            math.ceil((n // 2) * one.factor) + one.reach + 1
            for n, one in zip(pixels.shape, self._weights, strict=True)
        ]
        rows, columns = (2 * half + 1 for half in beyond)
        pitch = pixels.pitch[0] / float(y.factor), pixels.pitch[1] / float(x.factor)
        self.plane = Plane((rows, columns), pitch, pixels.centre)
        margin_y, margin_x = (
            max(half - math.ceil(n * one.factor / 2), 0)
            for half, n, one in zip(beyond, pixels.shape, self._weights, strict=True)
        )
        self.margin = (margin_y, margin_x)
        per_pixel = "x".join(f"{float(one.factor):g}" for one in self._weights)
        what = f"the light on whole pixels, with {per_pixel} samples in each,"
        require_memory(what, self.bytes, budget.memory, "ask for fewer pixels")

    @property
    def bytes(self) -> int:
        """Memory in bytes of the fine samples in single precision, with and without padding."""
        return 2 * 4 * math.prod(self.plane.shape)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of what is kept for all calls, in seconds.

        Weights that were kept from an earlier plan cost nothing.
        """
        rows = BandedMatrix.STEPS_PER_ROW * sum(self._shape) * speed.step
        return 2 * speed.call + rows + sum(one.fit_seconds(speed) for one in self._fitted)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of one integration, in seconds."""
        rows, columns = self.plane.shape
        y, x = self._weights
        lines = rows * columns * (1 / float(x.factor) + 1 / float(y.factor) / float(x.factor))
        each = 16 * float(x.factor) + 2 * x.reach
        touched = _PASSES_PER_SAMPLE * rows * columns * (1 + 1 / float(x.factor))
        return speed.call + lines * each * speed.multiply_add + touched * speed.touch

    def __call__(self, light: torch.Tensor) -> torch.Tensor:
        """Compute the light on whole pixels, (..., rows, columns), from light on `plane`."""
        return _integrate_both_axes(light, self._weights, self._shape)

    @property
    def samples_per_pixel(self) -> float:
        """Number of samples in the area of a pixel."""
        y, x = self._weights
        return float(y.factor * x.factor)


def _require_few_fringes(shape: tuple[int, int], cycles: list[float], budget: Budget) -> None:
    """Raise ToleranceError for pixels whose fine samples are beyond memory or time."""
    parts = [max(1.0, 2 * one) for one in cycles]
    rows, columns = (n * part for n, part in zip(shape, parts, strict=True))
    what = f"the light on whole pixels, with {parts[0]:.3g}x{parts[1]:.3g} samples in each,"
    remedy = "ask for fewer pixels, or smaller ones (their pitch is in metres)"
    require_memory(what, 2 * 4 * rows * columns, budget.memory, remedy)
    require_time(what, FIT_SECONDS * max(parts) ** 3, budget.seconds, remedy)


def _cheapest_weights(
    count: int, cycles: float, tol: float, fitted: list[PixelWeights]
) -> PixelWeights:
    """Choose the samples per pixel that are fewest along an axis of `count` pixels.

    cycles: of the light's finest fringe, per pixel. fitted: gets the weights that weren't kept from
    earlier.
    """

    def expected_samples(ratio: float) -> float:
        return count * float(_samples_per_pixel(ratio, cycles)) + 2 * expected_reach(ratio, tol)

    found: list[PixelWeights] = []
    for ratio in sorted(OVERSAMPLING, key=expected_samples):
        factor = _samples_per_pixel(ratio, cycles)
        # Light of half a percent more bandwidth shares the weights of light nearby.
        band = min(math.ceil(200 * cycles / float(factor)) / 200, WIDEST_BAND)
        misses = pixel_weights.cache_info().misses
        found.append(pixel_weights(factor, band, tol))
        if pixel_weights.cache_info().misses > misses:
            fitted.append(found[-1])
        if found[-1].error <= tol:
            return found[-1]
    return min(found, key=lambda one: one.error)


def _samples_per_pixel(oversampling: float, cycles: float) -> Fraction:
    """Return how many samples along a pixel resolve light of some cycles per pixel."""
    parts = max(math.ceil(2 * oversampling * cycles * BLOCK), BLOCK)
    if parts > _WHOLE_SAMPLES * BLOCK:
        parts = math.ceil(parts / BLOCK) * BLOCK
    return Fraction(parts, BLOCK)
