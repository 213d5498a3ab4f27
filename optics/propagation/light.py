"""How much light a field has, and fields that are too strong or too weak for single precision."""

from __future__ import annotations

import torch

from optics.edge import require_finite

_LEAST, _MOST = 1e-20, 1e20
"""Sums of |u|² between which a field's spectrum, its kernels and their squares are all far from
what single precision can't hold, 1e-38 and 1e38."""


def squares(field: torch.Tensor) -> torch.Tensor:
    """Sum of |u|² of each field (..., rows, columns), float64; squared in its own precision."""
    parts = torch.view_as_real(field.detach().resolve_conj())
    return parts.square().sum(dim=(-3, -2, -1), dtype=torch.float64)


def float_light(field: torch.Tensor) -> torch.Tensor:
    """Sum of |u|² of each field (..., rows, columns), float64."""
    light = squares(field)
    if field.dtype == torch.complex128 or _ordinary(light):
        return light
    # The squares may have left single precision.
    return squares(field.to(torch.complex128))


def finite_light(name: str, field: torch.Tensor) -> torch.Tensor:
    """float_light(); raises ValueError for a field with NaN or infinite values.

    Each of them shows in the sum: where that is ordinary nobody has to look for them.
    """
    light = float_light(field)
    if not _ordinary(light):
        require_finite(name, field.detach())
    return light


def evened(
    field: torch.Tensor, light: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
    """Fields of ordinary strength, their light, and what they must be multiplied by.

    light: float_light() of the field. Nothing is done, and the factor is None, if all have
    an ordinary strength; else each field that is lit is divided by its largest part.
    """
    if _ordinary(light):
        return field, light, None
    parts = torch.view_as_real(field.detach().resolve_conj()).abs()
    peak = parts.amax(dim=(-3, -2, -1))
    peak = torch.where(peak > 0, peak, 1.0)[..., None, None]
    even = field / peak
    return even, float_light(even), peak


def shares(part: torch.Tensor, light: torch.Tensor) -> list[float]:
    """Part over light of all fields that are lit; a few numbers are quicker in a list."""
    return [p / whole for p, whole in zip(_listed(part), _listed(light), strict=True) if whole > 0]


def _listed(values: torch.Tensor) -> list[float]:
    numbers: list[float] = values.flatten().tolist()
    return numbers


def _ordinary(light: torch.Tensor) -> bool:
    """Whether that of all fields is."""
    return all(_LEAST < one < _MOST for one in _listed(light))
