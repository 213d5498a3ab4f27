"""Convert between grey levels and phase at a wavelength by look-up tables."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import torch

from optics.slm.panel import Panel, max_phase, neighbouring_cells
from optics.validation import accepts_numpy, require_finite


def flatness_phase(panel: Panel, wavelength: float) -> torch.Tensor:
    """Compute the phase of the known flatness, an optical path, in radians, (rows, columns)."""
    assert panel.flatness is not None
    return panel.flatness.at_pixels(panel) * (2 * math.pi / wavelength)


@accepts_numpy
def grey_to_phase(panel: Panel, grey: torch.Tensor, wavelength: float) -> torch.Tensor:
    """Compute the phase that grey levels give to light of a wavelength.

    Without a measured response the phase grows linearly with the level. Differentiable in the
    response.

    Parameters
    ----------
    panel, grey : Panel, torch.Tensor or numpy.ndarray
        The panel, and whole levels, (..., rows, columns); of any shape if the panel is uniform.
    wavelength : float
        Metres.

    Returns
    -------
    torch.Tensor or numpy.ndarray
        Phase in radians, float64, of the shape of `grey`.

    Raises
    ------
    ValueError
        If the panel lacks a level, or the shape or the wavelength isn't the panel's.
    """
    require_levels(panel, grey)
    curves = _phase_curves(panel, wavelength)
    if curves.shape[:2] == (1, 1):
        return curves[0, 0].to(grey.device)[grey.to(torch.int64)]
    _require_shape("grey", grey, panel)
    parts = [
        table.phase(grey[..., rows, :].to(torch.int64))
        for rows, table in _row_curves(panel, curves)
    ]
    return torch.cat(parts, dim=-2)


@accepts_numpy
def phase_to_grey(
    panel: Panel, phase: torch.Tensor, wavelength: float, orders: int = 1
) -> torch.Tensor:
    """Compute the grey levels that give a phase to light of a wavelength.

    The panel's flatness is subtracted first if it is known. To show a phase uncorrected, use
    ``replace(panel, flatness=None)``. Each pixel gets the nearest level on its own curve. The
    levels are continuous in the phase, except for the jumps at which the phase is wrapped.

    Parameters
    ----------
    panel, phase : Panel, torch.Tensor or numpy.ndarray
        The panel, and radians, (..., rows, columns); of any shape if the panel is uniform.
    wavelength : float
        Metres.
    orders : int, optional
        Number of waves of the range that are used, beginning at the first level. The phase is
        wrapped modulo 2 pi `orders`, so that more orders make fewer jumps. 1 by default.

    Returns
    -------
    torch.Tensor or numpy.ndarray
        Grey levels, uint8, of the shape of `phase`.

    Raises
    ------
    ValueError
        If the panel's range is fewer waves, the phase isn't finite, or the wavelength isn't the
        panel's.
    """
    require_finite("phase", phase)
    require_orders(panel, wavelength, orders)
    curves = _phase_curves(panel, wavelength).detach()
    phase = phase.to(torch.float64)
    if panel.flatness is not None:
        _require_shape("phase", phase, panel)
        phase = phase - flatness_phase(panel, wavelength).to(phase.device)
    if curves.shape[:2] == (1, 1):
        return _nearest_levels(curves[0, 0].to(phase.device), phase, orders)
    _require_shape("phase", phase, panel)
    parts = [
        table.nearest_levels(phase[..., rows, :], orders)
        for rows, table in _row_curves(panel, curves)
    ]
    return torch.cat(parts, dim=-2)


def is_uniform(panel: Panel) -> bool:
    """Tell whether all pixels have the same phase at the same grey level."""
    return panel.response is None or tuple(panel.response.shares.shape[1:3]) == (1, 1)


def whole_waves(panel: Panel, wavelength: float) -> int:
    """Return the number of whole waves in the phase range; 0 if it is below one wave."""
    return _range_in_waves(_phase_curves(panel, wavelength))[1]


def require_orders(panel: Panel, wavelength: float, orders: int) -> None:
    """Raise ValueError if the phase range is less than `orders` whole waves anywhere."""
    reach, waves = _range_in_waves(_phase_curves(panel, wavelength))
    said = f"the panel reaches {reach / math.pi:.2f} pi at {wavelength * 1e9:.0f} nm"
    if waves == 0:
        raise ValueError(f"{said} and a pattern needs 2 pi; choose a shorter wavelength")
    if not (1 <= orders <= waves and orders == int(orders)):
        several = f" to {waves}" if waves > 1 else ""
        raise ValueError(f"orders is {orders}; {said}: choose 1{several}")


def _phase_curves(panel: Panel, wavelength: float) -> torch.Tensor:
    """Return all levels' phase in radians, (region rows, region columns, levels), float64."""
    reach = max_phase(panel, wavelength)
    if panel.response is not None:
        return reach * panel.response.at(wavelength)
    levels = torch.arange(panel.levels, dtype=torch.float64)
    return (levels * (reach / (panel.levels - 1)))[None, None]


def _range_in_waves(curves: torch.Tensor) -> tuple[float, int]:
    """Return the smallest phase range of all regions in radians, and the whole waves in it."""
    reach = float((curves[..., -1] - curves[..., 0]).detach().min())
    # A range one level short of a whole wave is enough: the next level would repeat the first.
    return reach, math.floor(reach / (2 * math.pi * (1 - 1 / curves.shape[-1])) + 1e-12)


def _wrap_phase(phase: torch.Tensor, first: torch.Tensor, period: float) -> torch.Tensor:
    """Wrap a phase by whole periods into the interval from `first` to `first` + period."""
    turns = (phase - first) / period
    return first + period * (turns - torch.floor(turns))


def _nearest_levels(curve: torch.Tensor, phase: torch.Tensor, orders: int) -> torch.Tensor:
    """Find the grey levels nearest to a phase, on one curve for all pixels, uint8."""
    period = 2 * math.pi * orders
    end = curve[:1] + period
    # A phase one period beyond the first level is shown by the first level.
    used = torch.cat([curve[curve < end], end])
    middles = (used[1:] + used[:-1]) / 2
    level = torch.bucketize(_wrap_phase(phase, curve[0], period), middles)
    return (level % (len(used) - 1)).to(torch.uint8)


class _RowCurves:
    """Phase curves of some rows of pixels, interpolated between region columns."""

    def __init__(self, curves: torch.Tensor, columns: int) -> None:
        self._curves = curves
        rows, regions, self._levels = curves.shape
        before, behind, self._share = neighbouring_cells(regions, columns)
        row = torch.arange(rows)[:, None] * regions
        self._before, self._behind = ((row + c) * self._levels for c in (before, behind))

    def phase(self, level: torch.Tensor, curves: torch.Tensor | None = None) -> torch.Tensor:
        flat = (self._curves if curves is None else curves).flatten().to(level.device)
        low, high = (flat[at.to(level.device) + level] for at in (self._before, self._behind))
        return torch.lerp(low, high, self._share.to(level.device))

    def nearest_levels(self, phase: torch.Tensor, orders: int) -> torch.Tensor:
        """Find the grey levels nearest to a phase, uint8; each pixel has its own curve."""
        zero = torch.zeros_like(phase, dtype=torch.int64)
        first, period = self.phase(zero), 2 * math.pi * orders
        wanted = _wrap_phase(phase, first, period)
        # By bisection: a level's number is the count of midpoints between neighbouring levels that
        # lie below the phase, with none after the last level.
        middles = (self._curves[..., 1:] + self._curves[..., :-1]) / 2
        middles = torch.nn.functional.pad(middles, (0, 1), value=math.inf)
        level = zero
        for bit in reversed(range((self._levels - 1).bit_length())):
            tried = level + (1 << bit)
            fits = tried < self._levels
            at = torch.where(fits, tried, 1) - 1
            level = torch.where(fits & (self.phase(at, middles) < wanted), tried, level)
        miss = (self.phase(level) - wanted).abs()
        # A phase one period beyond the first level is shown by the first level.
        return torch.where(first + period - wanted <= miss, zero, level).to(torch.uint8)


def _row_curves(panel: Panel, curves: torch.Tensor) -> Iterator[tuple[slice, _RowCurves]]:
    """Yield blocks of 64 rows with their phase curves, so that the memory is bounded."""
    rows, columns = panel.shape
    before, behind, share = neighbouring_cells(curves.shape[0], rows)
    for start in range(0, rows, 64):
        block = slice(start, min(start + 64, rows))
        low, high = curves[before[block]], curves[behind[block]]
        yield block, _RowCurves(torch.lerp(low, high, share[block, None, None]), columns)


def _require_shape(name: str, value: torch.Tensor, panel: Panel) -> None:
    if tuple(value.shape[-2:]) != panel.shape:
        raise ValueError(
            f"{name} is {tuple(value.shape)}; the panel differs from pixel to pixel and needs "
            f"{panel.shape}"
        )


def require_levels(panel: Panel, grey: torch.Tensor) -> None:
    """Raise ValueError unless grey levels are whole and within the panel's."""
    if grey.is_floating_point() or grey.is_complex() or grey.dtype == torch.bool:
        raise ValueError(f"grey is {grey.dtype}; give whole levels, as uint8")
    if not grey.numel():
        return
    low, high = int(grey.min()), int(grey.max())
    if low < 0 or high >= panel.levels:
        raise ValueError(
            f"grey goes from {low} to {high}; the panel's levels are 0 to {panel.levels - 1}"
        )


def require_grey(panel: Panel, grey: np.ndarray) -> None:
    """Raise an error unless an array of grey levels can be displayed.

    Parameters
    ----------
    panel, grey : Panel, numpy.ndarray
        The panel, and grey levels, uint8, (rows, columns) of the panel.

    Raises
    ------
    TypeError, ValueError
        If the array's type isn't uint8, its shape isn't the panel's, or the panel lacks a level.
    """
    if grey.dtype != np.uint8:
        raise TypeError(f"the pattern's type is {grey.dtype}; the panel shows uint8 grey levels")
    if grey.shape != panel.shape:
        raise ValueError(
            f"the pattern is {grey.shape[-1]}x{grey.shape[0]} pixels; "
            f"the panel needs {panel.shape[1]}x{panel.shape[0]}"
            if grey.ndim == 2
            else f"the pattern has {grey.ndim} axes; the panel needs rows and columns"
        )
    if grey.max() >= panel.levels:
        raise ValueError(
            f"the pattern has level {grey.max()}; the panel's levels are 0 to {panel.levels - 1}"
        )
