"""Keep errors small where a pattern sends little light: in windows, and by extreme amplitudes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

Window = tuple[slice, slice]
"""Rows and columns of samples."""


@dataclass(frozen=True)
class RowErrorSettings:
    """Tune how the error is measured on some rows of a window.

    rows: most rows that are measured. Chosen so that the measurement takes a fraction of a call.
    margin: factor on the error that is found there, because few rows are measured. Chosen.
    """

    rows: int = 8
    margin: float = 2.0


@dataclass(frozen=True)
class AddedLightSettings:
    """Tune how light shares its tolerance with other light that is added to it.

    error_share: share of the tolerance that the error of the added light may use. Chosen.
    """

    error_share: float = 0.5


_ADDED_SETTINGS = AddedLightSettings()
_SETTINGS = RowErrorSettings()


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
    if bool(((wrong > _ADDED_SETTINGS.error_share * room) & (wrong > tol * other)).any()):
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
    return _SETTINGS.margin * largest_ratio(squares.sqrt(), norm), chosen.size


def _draw_rows(energy: torch.Tensor) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Draw rows of a batch; return their numbers, and a weight for the sum over each.

    energy: squared light of every row, (pictures, rows).
    """
    rows = energy.shape[-1]
    if rows <= _SETTINGS.rows or not energy.numel():
        return np.arange(rows if energy.numel() else 0), np.ones(rows if energy.numel() else 0)
    total = energy.sum(-1, keepdim=True)
    shares = torch.where(total > 0, energy / total, 1 / rows).mean(0).cpu().numpy()
    chance = 0.5 * shares + 0.5 / rows
    chance /= chance.sum()
    steps = (np.arange(_SETTINGS.rows) + 0.5) / _SETTINGS.rows
    drawn = np.minimum(np.searchsorted(np.cumsum(chance), steps), rows - 1)
    chosen, times = np.unique(drawn, return_counts=True)
    return chosen, times / (_SETTINGS.rows * chance[chosen])


_LEAST_PEAK = 1e-12
"""Peak amplitude below which, or above whose inverse, its square may exceed the range of single
precision, also in a dim window."""

_BRIGHTEST_PEAK = 1e150
"""Largest amplitude whose light, and sums of it, double precision holds."""

_DARKEST_PEAK = 1e-150
"""Peak amplitude whose square is near the smallest number of double precision."""


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
