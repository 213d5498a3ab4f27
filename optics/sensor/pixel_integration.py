"""Integrate light over the area of pixels, from samples that are finer than these."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import Budget, MachineSpeed, require_memory, require_time
from optics.fourier.banded_matrix import STEPS_PER_ROW, BandedMatrix
from optics.fourier.differentiation import apply_linear_map
from optics.plane import Plane

PIXEL_OVERSAMPLING = 1.5
"""Factor by which the samples of integrate_pixels() must be finer than the light's Nyquist rate."""


@dataclass(frozen=True)
class PixelIntegrationSettings:
    """Tune the integration of light over pixels.

    error_margin: relative L2 error of the light on pixels over the largest deviation of the
        weights' transfer function along an axis: 2 axes, times 2 because a pixel averages out fine
        fringes that count in the deviation. Derived.
    oversampling: ratios of the samples' rate to the light's Nyquist rate to choose from. Closer to
        1, the weights reach far. Chosen; the last one reaches every tolerance.
    widest_band: largest frequency in cycles per sample that weights are fitted for. Chosen.
    samples_per_digit: samples on either side of a pixel that another digit needs, times the
        oversampling beyond 1. Fitted to tolerances of 1e-3 to 1e-9 and the ratios above, which it
        meets within a quarter.
    first_digit_steps: samples on either side in which the error is first taken to fall to a tenth.
        Chosen.
    stalled_steps: steps of the search for the reach after which an error that hardly falls ends it.
        Chosen.
    max_reach: most samples on either side of a pixel that its weights use. Chosen: the error is
        down to rounding there.
    block: pixels in a row that are integrated by one matrix; measured to be the fastest. The
        samples per pixel are whole multiples of its inverse, so that the next block needs the same
        matrix.
    whole_samples: samples per pixel beyond which their number is whole. Chosen.
    """

    error_margin: float = 4.0
    oversampling: tuple[float, ...] = (1.15, 1.3, 1.5)
    widest_band: float = 0.48
    samples_per_digit: float = 0.75
    first_digit_steps: float = 2.0
    stalled_steps: int = 3
    max_reach: int = 96
    block: int = 16
    whole_samples: int = 64


_SETTINGS = PixelIntegrationSettings()

_FIT_SECONDS = 2e-9
"""Processor seconds in which the weights of a pixel are fitted, over its samples' third power;
measured at up to 750 samples."""

_CALLS_PER_FIT, _COSINES_PER_FIT, _PRODUCTS_PER_FIT = 0.26, 260.0, 450.0
"""Time to fit a pixel's weights: fixed, in calls; for each square of the samples on either side, in
cosines; for each third power of them, in multiplications in double precision. Measured for 2 to 64
samples on either side."""

_PASSES_PER_SAMPLE = 4.0
"""Passes over a sample in each axis' integration, its transposed copy included; measured."""

_NEGLIGIBLE = 0.03
"""Singular values of the weights' fit below this share of the tolerance, relative to the largest,
are left out. Chosen: the fit loses far less than the tolerance."""


def pixel_transfer(rows: int, columns: int, factor: int) -> torch.Tensor:
    """Return the transfer function of a square pixel of fill factor 1, on an rfft2 grid.

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
    """Sample light at the pixels' centres from a grid that is finer than the pixels.

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
    """Weights of the samples around a pixel in the light's integral over it.

    weights: float64, (pixels, samples), for the pixels of a block, of which the first one's centre
    is on a sample; the middle one of the samples is the nearest to the pixel's centre. factor:
    samples per pixel, a multiple of the block's inverse. error: relative L2 error of the light on
    pixels. fits: samples on either side of a pixel in each fit that led to the weights, halved
    where the pixel's symmetry halved the fit.
    """

    weights: torch.Tensor
    factor: Fraction
    error: float
    fits: tuple[float, ...] = ()

    @property
    def reach(self) -> int:
        """Number of samples on either side of a pixel's centre that its weights use."""
        return self.weights.shape[1] // 2

    def fit_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds in which the weights were found."""
        each = (
            _CALLS_PER_FIT * speed.call
            + _COSINES_PER_FIT * half**2 * speed.cosine
            + _PRODUCTS_PER_FIT * half**3 * speed.multiply_add * speed.double
            for half in self.fits
        )
        return sum(each)

    @property
    def margin(self) -> int:
        """Whole pixels around a pixel that its weights need, on each side."""
        return math.ceil(self.reach / self.factor)


@functools.lru_cache(maxsize=256)
def pixel_weights(factor: Fraction, band: float, tol: float) -> PixelWeights:
    """Find the fewest weights that integrate band-limited light over a pixel.

    The transfer function of the weights must be that of the pixel, a sinc, wherever the light has
    frequencies. A fit by least squares at nodes that are dense near the band's edge is almost the
    best one. Elsewhere the function is free, so that the weights reach much less far than those of
    a band-limited interpolation.

    factor: samples per pixel, a multiple of 1/16 and 1 or more.
    band: the light's highest frequency in cycles per sample, below 1/2.
    tol: relative L2 error of the light on pixels that is allowed. The weights' error, measured at
        other frequencies than those of the fit, exceeds it only if it is beyond double precision.
    """
    # A pixel's centre between two samples is the hardest case, and one on a sample the easiest.
    offsets = sorted({_offset(factor, pixel) for pixel in range(_SETTINGS.block)}, key=abs)
    tried: dict[tuple[int, float], tuple[NDArray[np.float64], float]] = {}

    def fit(reach: int, offset: float) -> tuple[NDArray[np.float64], float]:
        """Fit once; the weights of a pixel on the other side of its sample are mirrored."""
        key = reach, abs(offset)
        if key not in tried:
            tried[key] = _fit_weights(factor, band, reach, abs(offset), tol)
        weights, error = tried[key]
        return (weights if offset >= 0 else weights[::-1]), error

    first = math.ceil(factor) // 2 + 1
    expected = max(first, math.floor(_expected_reach(0.5 / band, tol)))
    most = first + _SETTINGS.max_reach - 1
    reach = _least_reach(lambda one: fit(one, offsets[-1])[1], first, expected, most, tol)
    # An easier case may need a sample more, where rounding rules.
    while reach < most and fit(reach, offsets[-1])[1] <= tol:
        if max(fit(reach, one)[1] for one in offsets) <= tol:
            break
        reach += 1
    found = {one: fit(reach, one) for one in offsets}
    rows = [found[_offset(factor, pixel)][0] for pixel in range(_SETTINGS.block)]
    error = max(one[1] for one in found.values())
    fits = tuple(size if offset else size / 2 for size, offset in tried)
    return PixelWeights(torch.from_numpy(np.stack(rows)), factor, error, fits)


def _least_reach(
    error: Callable[[int], float], first: int, expected: int, most: int, tol: float
) -> int:
    """Return the least reach of weights from `first` on whose error is within a tolerance.

    The error falls about exponentially with the reach. Each step goes where the last two errors
    point to, within the reaches that are known to be too short and long enough. Where no reach up
    to `most` does, the one of the least error among those that were tried is returned.
    """
    short, enough = first - 1, most + 1
    tried: dict[int, float] = {}
    reach = min(max(expected, first), most)
    while enough - short > 1:
        tried[reach] = error(reach)
        if tried[reach] <= tol:
            enough = reach
        else:
            short = reach
        # A reach that gains nothing more has met rounding, which longer ones don't pass.
        if enough > most and len(tried) > _SETTINGS.stalled_steps:
            *_, before, last = sorted(tried)
            if tried[last] > 0.5 * tried[before]:
                break
        step = _step_towards(tol, tried, reach)
        reach = min(max(reach + step, short + 1), enough - 1, most)
    return enough if enough <= most else min(tried, key=lambda one: tried[one])


def _step_towards(tol: float, tried: dict[int, float], reach: int) -> int:
    """Return by how much the weights shall reach farther for a tolerance; negative for less.

    tried: errors by reach. The slope is that of the two reaches that were tried next to `reach`.
    """
    digits = math.log10(max(tried[reach], 1e-300) / max(tol, 1e-300))
    others = sorted((one for one in tried if one != reach), key=lambda one: abs(one - reach))
    slope = 1 / _SETTINGS.first_digit_steps
    if others:
        other = others[0]
        fall = math.log10(max(tried[other], 1e-300) / max(tried[reach], 1e-300)) / (reach - other)
        slope = fall if fall > 0 else slope
    step = digits / slope
    return math.ceil(step) if step > 0 else min(math.ceil(step), -1)


def _offset(factor: Fraction, pixel: int) -> float:
    """Return how far the centre of a pixel lies beyond the nearest sample, in samples."""
    return float(pixel * factor - _nearest_sample(factor, pixel))


def _nearest_sample(factor: Fraction, pixel: int) -> int:
    """Return the number of the sample next to a pixel's centre, from the first pixel's."""
    return math.floor(pixel * factor + Fraction(1, 2))


def _fit_weights(
    factor: Fraction, band: float, reach: int, offset: float, tol: float
) -> tuple[NDArray[np.float64], float]:
    """Fit the weights of 2 reach + 1 samples to a pixel's transfer function.

    offset: of the pixel's centre from the middle sample. Returns the weights and their error, which
    shall be within `tol`. What the samples can hardly tell apart gets no weight: huge weights of
    opposite signs would amplify rounding.
    """
    width = float(factor)
    negligible = min(max(_NEGLIGIBLE * tol, 1e-15), 1e-6)
    fitted: NDArray[np.float64] = band * np.sin(np.pi / 2 * np.linspace(0, 1, 4 * reach + 16))
    judged: NDArray[np.float64] = np.linspace(0, band, 8 * reach + 33, dtype=np.float64)
    if offset:
        places: NDArray[np.float64] = np.arange(-reach, reach + 1, dtype=np.float64) - offset
        wanted = np.concatenate((width * np.sinc(width * fitted), np.zeros(fitted.size)))
        weights, *_ = np.linalg.lstsq(_waves(fitted, places), wanted, rcond=negligible)
        cosines, sines = np.split(_waves(judged, places) @ weights / width, 2)
        deviation = np.hypot(cosines - np.sinc(width * judged), sines)
    else:
        half, *_ = np.linalg.lstsq(
            _cosines(fitted, reach), width * np.sinc(width * fitted), rcond=negligible
        )
        deviation = _cosines(judged, reach) @ half / width - np.sinc(width * judged)
        weights = np.concatenate((half[:0:-1], half))
    return np.asarray(weights, dtype=np.float64), _SETTINGS.error_margin * float(
        np.abs(deviation).max()
    )


def _waves(frequency: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the transfer functions of samples at places around a pixel's centre.

    The cosines stand above the sines, (2 frequencies, places).
    """
    turns = 2 * np.pi * np.outer(frequency, places)
    return np.concatenate((np.cos(turns), np.sin(turns)))


def _cosines(frequency: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Return the transfer functions of pairs of samples at distances 0 to `reach` from a pixel."""
    cosines: NDArray[np.float64] = 2 * np.cos(2 * np.pi * np.outer(frequency, np.arange(reach + 1)))
    cosines[:, 0] = 1
    return cosines


def pixel_margin(factor: int, tol: float = 1e-9) -> int:
    """Return how many whole pixels integrate_pixels() needs around a pixel.

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
    return pixel_weights(Fraction(factor), 0.5 / PIXEL_OVERSAMPLING, tol).margin


def integrate_pixels(light: torch.Tensor, factor: int, tol: float = 1e-9) -> torch.Tensor:
    """Integrate light over whole square pixels of `factor` by `factor` samples.

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
    weights = pixel_weights(Fraction(factor), 0.5 / PIXEL_OVERSAMPLING, tol)
    shape = (light.shape[-2] // factor, light.shape[-1] // factor)
    return _integrate_both_axes(light, (weights, weights), shape)


def _integrate_both_axes(
    light: torch.Tensor, weights: tuple[PixelWeights, PixelWeights], shape: tuple[int, int]
) -> torch.Tensor:
    """Integrate light over pixels along both axes, to (..., *shape)."""
    rows, columns = light.shape[-2:]
    y = _integration_matrix(weights[0], rows, shape[0], light.dtype)
    x = _integration_matrix(weights[1], columns, shape[1], light.dtype)

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
    each pixel, ``(..., *pixels.shape)``. The attribute `plane` is finer than the pixels and reaches
    beyond them by `margin` samples on each side. The fewer digits are asked for, the fewer samples
    there are.

    Parameters
    ----------
    pixels : Plane
        Pixels on which the light is wanted.
    cutoff : float or tuple of float
        Cycles per metre of the light's finest fringe; two along y and x where they differ.
    budget : Budget, optional
        Limit of the memory that may be used.
    tol : float, optional
        Relative L2 error of the light on pixels that is allowed; 1e-9 by default.

    Attributes
    ----------
    plane : Plane
        The samples.
    margin : tuple of int
        Samples beyond the pixels on each side, along y and x.
    error : float
        Relative L2 error of the light on pixels, at most `tol` if double precision allows it.

    Raises
    ------
    ValueError
        As its subclass ToleranceError, if the fine samples take more memory than the budget allows.
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
        budget = budget or Budget()
        _require_few_fringes(pixels, both, budget)
        self._fitted: list[PixelWeights] = []
        y, x = (
            _cheapest_weights(
                pixels.shape[axis], pixels.pitch[axis] * both[axis], tol, self._fitted
            )
            for axis in (0, 1)
        )
        self._weights = (y, x)
        self.error = max(one.error for one in self._weights)
        beyond = [
            math.ceil((n // 2) * one.factor) + one.reach + 1
            for n, one in zip(pixels.shape, self._weights, strict=True)
        ]
        rows, columns = (2 * half + 1 for half in beyond)
        pitch_y, pitch_x = (
            pitch / float(one.factor)
            for pitch, one in zip(pixels.pitch, self._weights, strict=True)
        )
        self.plane = Plane((rows, columns), (pitch_y, pitch_x), pixels.centre)
        margin_y, margin_x = (
            max(half - math.ceil(n * one.factor / 2), 0)
            for half, n, one in zip(beyond, pixels.shape, self._weights, strict=True)
        )
        self.margin = (margin_y, margin_x)
        per_pixel = "x".join(f"{float(one.factor):g}" for one in self._weights)
        what = f"the light on whole pixels, with {per_pixel} samples in each,"
        require_memory(what, self.bytes, budget.memory, "ask for fewer pixels")

    @property
    def _samples(self) -> int:
        return self.plane.shape[0] * self.plane.shape[1]

    @property
    def bytes(self) -> int:
        """Memory in bytes of the fine samples in single precision, with and without padding."""
        return 2 * 4 * self._samples

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of what is kept for all calls, in seconds.

        Weights that were kept from an earlier plan cost nothing.
        """
        rows = STEPS_PER_ROW * sum(self._shape) * speed.step
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


def _require_few_fringes(pixels: Plane, cutoff: tuple[float, float], budget: Budget) -> None:
    """Raise ToleranceError for pixels whose fine samples are beyond memory or time."""
    parts = [max(1.0, 2 * pixels.pitch[axis] * cutoff[axis]) for axis in (0, 1)]
    rows, columns = (n * part for n, part in zip(pixels.shape, parts, strict=True))
    what = f"the light on whole pixels, with {parts[0]:.3g}x{parts[1]:.3g} samples in each,"
    remedy = "ask for fewer pixels, or smaller ones (their pitch is in metres)"
    require_memory(what, 2 * 4 * rows * columns, budget.memory, remedy)
    require_time(what, _FIT_SECONDS * max(parts) ** 3, budget.seconds, remedy)


def _cheapest_weights(
    count: int, cycles: float, tol: float, fitted: list[PixelWeights]
) -> PixelWeights:
    """Choose the number of samples per pixel that takes the fewest samples along an axis.

    count: pixels along the axis. cycles: of the light's finest fringe, per pixel. fitted: gets the
    weights that weren't kept from earlier.
    """

    def expected_samples(ratio: float) -> float:
        return count * float(_samples_per_pixel(ratio, cycles)) + 2 * _expected_reach(ratio, tol)

    found: list[PixelWeights] = []
    for ratio in sorted(_SETTINGS.oversampling, key=expected_samples):
        factor = _samples_per_pixel(ratio, cycles)
        # Light of half a percent more bandwidth shares the weights of light nearby.
        band = min(math.ceil(200 * cycles / float(factor)) / 200, _SETTINGS.widest_band)
        misses = pixel_weights.cache_info().misses
        found.append(pixel_weights(factor, band, tol))
        if pixel_weights.cache_info().misses > misses:
            fitted.append(found[-1])
        if found[-1].error <= tol:
            return found[-1]
    return min(found, key=lambda one: one.error)


def _samples_per_pixel(oversampling: float, cycles: float) -> Fraction:
    """Return how many samples along a pixel resolve light of some cycles per pixel.

    oversampling: of the samples, over the light's Nyquist rate, at least.
    """
    parts = max(math.ceil(2 * oversampling * cycles * _SETTINGS.block), _SETTINGS.block)
    if parts > _SETTINGS.whole_samples * _SETTINGS.block:
        # All pixels then have the same weights, which are dear to fit.
        parts = math.ceil(parts / _SETTINGS.block) * _SETTINGS.block
    return Fraction(parts, _SETTINGS.block)


def _expected_reach(oversampling: float, tol: float) -> float:
    """Estimate how far the weights of a pixel reach, in samples."""
    digits = -math.log10(tol) if tol > 1e-16 else 16.0
    return _SETTINGS.samples_per_digit * max(digits, 0.0) / max(oversampling - 1, 0.05)
