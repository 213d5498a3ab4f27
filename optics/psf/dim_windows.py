"""Keep errors small where a pattern sends little light: in windows, and by extreme amplitudes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.psf.edge_scatter import StopEdgeScatter

Window = tuple[slice, slice]
"""Rows and columns of samples."""


# Most rows of a window on which an error is measured. Chosen so that the measurement takes a
# fraction of a call.
_MEASURED_ROWS = 8

_ROW_MARGIN = 2.0  # factor on the error that is found there, because few rows are measured. Chosen.

# Share of the tolerance that the error of light that is added may use. Chosen.
_ADDED_ERROR_SHARE = 0.5


def window_norm(light: torch.Tensor, window: Window) -> torch.Tensor:
    """Return the L2 norm of light in a window, (...), float64."""
    inside = light[..., window[0], window[1]]
    norm = torch.linalg.vector_norm(inside, dim=(-2, -1))
    # The squares of very dim or bright light leave the range of single precision.
    if inside.dtype != torch.float64 and bool(((norm < 1e-15) | (norm > 1e15)).any()):
        norm = torch.linalg.vector_norm(inside.to(torch.float64), dim=(-2, -1))
    return norm.to(torch.float64)


@dataclass(frozen=True)
class AddedLight:
    """Tells of other light that is added to a PSF in intensity, and of its error.

    norm: L2 norm of that light over the window, relative to the units of the PSF.
    error: L2 norm of its error in these units.
    """

    norm: torch.Tensor
    error: torch.Tensor

    def relative_to(self, peak: torch.Tensor | None) -> AddedLight:
        """Convert to the units of light whose amplitude was divided by `peak`, (...)."""
        if peak is None:
            return self
        return AddedLight(self.norm / peak**2, self.error / peak**2)


class CoarseAddedLightError(Exception):
    """Tells that the error of added light leaves too little room for that of the other light."""


UNKNOWN_LIGHT = AddedLight(
    torch.tensor(math.inf, dtype=torch.float64), torch.zeros((), dtype=torch.float64)
)
"""Added light that may be any: what error it leaves room for isn't known yet."""


def error_beside(own: float, norm: torch.Tensor, added: AddedLight | None) -> float:
    """Return the relative L2 error of light together with what is added; the largest of a batch.

    Light isn't negative, so the norm of a sum is at least the root of the squares' sum. Nor is the
    sum's relative error larger than that of the worse part, as far as their norms add.

    own: relative L2 error of the light by itself.
    norm: its L2 norm in the window, (...).
    """
    if added is None:
        return own
    together = largest_ratio(
        own * norm + added.error.to(norm), torch.hypot(norm, added.norm.to(norm))
    )
    return min(together, max(own, largest_ratio(added.error, added.norm)))


def allowed_own_error(tol: float, norm: torch.Tensor, added: AddedLight | None) -> float:
    """Return the relative L2 error that light may have by itself, where `tol` holds for a sum.

    Raises CoarseAddedLightError if most of that error is the added light's, beyond `tol` of it.
    """
    if added is None:
        return tol
    room = tol * torch.hypot(norm, added.norm.to(norm))
    wrong, other = added.error.to(norm), added.norm.to(norm)
    if bool(((wrong > _ADDED_ERROR_SHARE * room) & (wrong > tol * other)).any()):
        raise CoarseAddedLightError
    allowed = torch.where(norm > 0, (room - wrong) / norm, math.inf)
    return max(tol, float(allowed.min()))


class EvenNoise:
    """Predicts the relative L2 error of light from errors of its field that spread like noise.

    The field is the true one plus a complex error of mean square n. The intensity I = |field|² then
    has an error of mean square 2 I n + 2 n² (Goodman, Statistical Optics, section 2.9).

    light: I, (..., rows, columns).
    envelope: n relative to the noise level, as a sum of products of functions of y, (terms, rows),
    and of x, (terms, columns); 1 if None.
    norm: what errors are relative to, (...).
    """

    def __init__(
        self,
        light: torch.Tensor,
        envelope: tuple[torch.Tensor, torch.Tensor] | None,
        window: Window,
        norm: torch.Tensor,
    ) -> None:
        inside = light[..., window[0], window[1]]
        if envelope is None:
            rows, columns = inside.shape[-2:]
            envelope = torch.ones(1, rows), torch.ones(1, columns)
        else:
            envelope = envelope[0][:, window[0]], envelope[1][:, window[1]]
        y, x = (one.to(light.device, torch.float64) for one in envelope)
        along_x = (inside @ x.mT.to(inside)).to(torch.float64)
        self._crossed = (along_x * y.mT).sum((-2, -1))
        self._square = float(((y @ y.mT) * (x @ x.mT)).sum())
        self._norm = norm

    def error(self, level: torch.Tensor) -> float:
        """Return the error for a noise level, (...); the largest of a batch."""
        squares = 2 * level * self._crossed + 2 * level**2 * self._square
        return largest_ratio(squares.sqrt(), self._norm)


def largest_ratio(error: torch.Tensor, norm: torch.Tensor) -> float:
    """Return the largest relative error of a batch; 0 for dark light without an error."""
    ratio = torch.where(error > 0, error / norm, 0.0)
    return float(ratio.max()) if ratio.numel() else 0.0


def row_error(
    field: torch.Tensor,
    light: torch.Tensor,
    missing: Callable[[torch.Tensor], torch.Tensor],
    scale: float,
    window: Window,
    norm: torch.Tensor,
) -> tuple[float, int]:
    """Measure the relative L2 error of light on some rows of its window.

    The rows are drawn by systematic sampling: half of the probability is in proportion to their
    squared light, to which relative errors mostly belong, and half is even. The draw is always the
    same for the same light. Returns the error with a margin, the largest of a batch, and the number
    of rows on which it was measured.

    field: complex, (..., rows, columns).
    light: its intensity in the units of the result.
    missing: returns the field that was left out on rows of the samples whose numbers it gets.
    scale: intensity over ``|field|²``.
    window: rows and columns of the samples that count.
    norm: what errors are relative to, (...).
    """
    inside = light[..., window[0], window[1]].to(torch.float64)
    chosen, weights = _draw_rows((inside**2).sum(-1).reshape(-1, inside.shape[-2]))
    if not chosen.size:
        return 0.0, 0
    rows = torch.from_numpy(chosen + window[0].start)
    found = field.index_select(-2, rows.to(field.device))[..., window[1]]
    other = missing(rows)[..., window[1]]
    change = scale * (2 * (found.conj() * other).real + other.abs() ** 2).to(torch.float64)
    squares = ((change**2).sum(-1) * torch.from_numpy(weights).to(change.device)).sum(-1)
    return _ROW_MARGIN * largest_ratio(squares.sqrt(), norm), chosen.size


def _draw_rows(energy: torch.Tensor) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Draw rows of a batch; return their numbers, and a weight for the sum over each.

    energy: squared light of every row, (pictures, rows).
    """
    rows = energy.shape[-1]
    if rows <= _MEASURED_ROWS or not energy.numel():
        return np.arange(rows if energy.numel() else 0), np.ones(rows if energy.numel() else 0)
    total = energy.sum(-1, keepdim=True)
    shares = torch.where(total > 0, energy / total, 1 / rows).mean(0).cpu().numpy()
    chance = 0.5 * shares + 0.5 / rows
    chance /= chance.sum()
    steps = (np.arange(_MEASURED_ROWS) + 0.5) / _MEASURED_ROWS
    drawn = np.minimum(np.searchsorted(np.cumsum(chance), steps), rows - 1)
    chosen, times = np.unique(drawn, return_counts=True)
    return chosen, times / (_MEASURED_ROWS * chance[chosen])


# Share of the light behind an evenly lit panel that the window must get for an estimate made for
# that panel to hold. Chosen.
_EXPECTED_WINDOW_LIGHT = 0.8

# Exponent of a dim window's relative brightness, by which its error estimate is enlarged further:
# light in a dim window comes from few directions of a pattern, so it is less even than the
# estimate assumes. Chosen.
_LOW_LIGHT_EXPONENT = 1 / 8

# Factor on the divisor of a dim window's error estimate. Chosen: without it, three of 800
# gratings and waves on small panels exceeded their estimates, by a fifth at most.
_LOW_LIGHT_MARGIN = 0.75


class LowLightCorrection:
    """Finds the number by which an error estimate for an evenly lit panel must be divided.

    Such an estimate assumes that the panel sends the same light to all frequencies. A pattern may
    send less light to the window than an even panel, and more to the frequencies from which the
    stop's edge scatters light into the window. These frequencies may lie in the passing band, which
    goes through the stop beside the window, or far away. A pattern may also send light to the
    window smoothly, without speckles, and then the interference with scattered light counts more.

    window_slices: rows and columns of the window.
    light: (..., rows, columns).
    measure_passing_brightness: returns the panel's brightness in the passing band, relative to an
    even panel: the least and the greatest of a batch. It is called only if needed.
    """

    def __init__(
        self,
        edge_scatter: StopEdgeScatter,
        window_slices: tuple[slice, slice],
        light: torch.Tensor,
        amplitude: torch.Tensor | None,
        measure_passing_brightness: Callable[[], tuple[float, float]],
    ) -> None:
        self._passing_share = min(max(edge_scatter.passing_share, 1e-9), 1 - 1e-3)
        self._measure_passing_brightness = measure_passing_brightness
        total = 1.0 if amplitude is None else float((amplitude.detach().abs() ** 2).mean())
        even = edge_scatter.window_share * total
        self.brightness = math.inf
        if light.numel() and even > 0:
            seen = light.detach()[..., window_slices[0], window_slices[1]]
            each = seen.sum(dim=(-2, -1))
            # A window without any light allows no estimate.
            if float(each.min()) > 0:
                square = seen.shape[-2] * seen.shape[-1] * seen.square().sum(dim=(-2, -1))
                smooth = (square / each**2 / edge_scatter.normalised_second_moment).clamp(max=1.0)
                seen_share = float((each * smooth).min()) / even
                self.brightness = seen_share / _EXPECTED_WINDOW_LIGHT

    @cached_property
    def _passing_brightness(self) -> tuple[float, float]:
        with torch.no_grad():
            return self._measure_passing_brightness()

    def error_divisor(self, within: float) -> float:
        """Return the number, at most 1, that divides the error estimate in a dim window.

        within: share of the squared error that light in the passing band contributes.
        """
        most = within / self._passing_share + (1 - within) / (1 - self._passing_share)
        if self.brightness >= most:
            return 1.0
        least, brightest = self._passing_brightness
        beside = max(1 - least * self._passing_share, 0.0) / (1 - self._passing_share)
        wrong = within * brightest + (1 - within) * beside
        if not wrong > 0:
            return 1.0
        divisor = (
            min(1.0, math.sqrt(self.brightness / wrong))
            * min(1.0, self.brightness) ** _LOW_LIGHT_EXPONENT
        )
        return divisor * _LOW_LIGHT_MARGIN if divisor < 1 else 1.0

    @property
    def uniform_error_divisor(self) -> float:
        """The divisor, at most 1, of an error estimate that holds for any pattern."""
        return min(1.0, math.sqrt(self.brightness))


# Peak amplitude below which, or above whose inverse, its square may exceed the range of single
# precision, also in a dim window.
_LEAST_PEAK = 1e-12

_BRIGHTEST_PEAK = 1e150  # largest amplitude whose light, and sums of it, double precision holds

# Peak amplitude whose square is near the smallest number of double precision.
_DARKEST_PEAK = 1e-150


def normalise_amplitude(
    amplitude: torch.Tensor | None, sample_axes: int
) -> tuple[torch.Tensor | None, torch.Tensor | None]:
    """Scale the amplitude of every pattern in a batch to a peak of 1.

    Returns the amplitude and the old peaks, one for each pattern, float64. The peaks are None if
    they are all 1. A pattern whose amplitude is zero, not finite, or so small that double precision
    doesn't hold its square, keeps it, with a peak of 1. Raises ValueError for amplitudes whose
    square double precision doesn't hold.

    sample_axes: number of axes at the end that hold one pattern.
    """
    if amplitude is None or not amplitude.numel():
        return amplitude, None
    axes = tuple(range(-min(sample_axes, amplitude.ndim), 0))
    peak = _peak(amplitude.detach(), axes)
    if bool((peak.isfinite() & (peak > _BRIGHTEST_PEAK)).any()):
        raise ValueError(
            f"amplitude reaches {float(peak.max()):.3g}; its light, the square, is more than "
            f"doubles hold: give one of at most {_BRIGHTEST_PEAK:g}"
        )
    peak = torch.where((peak > _DARKEST_PEAK) & peak.isfinite(), peak, 1.0)
    if bool((peak == 1).all()):
        return amplitude, None
    if _is_extreme(peak):
        # Numbers near the end of single precision's range lose digits, or become NaN in a division.
        wide = torch.complex128 if amplitude.is_complex() else torch.float64
        amplitude, peak = amplitude.to(wide), peak.to(torch.float64)
    return amplitude * peak.reciprocal(), peak.squeeze(axes).to(torch.float64)


def _peak(amplitude: torch.Tensor, axes: tuple[int, ...]) -> torch.Tensor:
    """Return the largest modulus of every pattern."""
    if amplitude.device.type != "cpu":
        return amplitude.abs().amax(axes, keepdim=True)
    # numpy computes the moduli of complex numbers in an eighth of torch's time.
    moduli = np.abs(amplitude.resolve_conj().resolve_neg().numpy())
    return torch.from_numpy(np.asarray(moduli.max(axes, keepdims=True)))


def scale_light(light: torch.Tensor, peak: torch.Tensor | None) -> torch.Tensor:
    """Scale the light of normalise_amplitude() back, by the squares of the amplitudes' peaks.

    The result is float64 where single precision might not hold it.
    """
    if peak is None:
        return light
    wide = light.to(torch.float64) if _is_extreme(peak) else light
    return wide * (peak**2).to(wide)[..., None, None]


def _is_extreme(peak: torch.Tensor) -> bool:
    """Tell whether single precision might not hold the light of amplitudes with these peaks."""
    return bool((peak < _LEAST_PEAK).any() or (peak > 1 / _LEAST_PEAK).any())
