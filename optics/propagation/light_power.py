"""How much light a field has, and fields that are too strong or too weak for single precision."""

from __future__ import annotations

import torch

from optics.validation import require_finite

_LEAST, _MOST = 1e-20, 1e20
"""Sums of |u|² between which a field's spectrum, its kernels and their squares are all far from
what single precision can't hold, 1e-38 and 1e38."""


def sum_squared_modulus(field: torch.Tensor) -> torch.Tensor:
    """Sum of |u|² of each field (..., rows, columns), float64; squared in its own precision."""
    parts = torch.view_as_real(field.detach().resolve_conj())
    return parts.square().sum(dim=(-3, -2, -1), dtype=torch.float64)


def field_power(field: torch.Tensor) -> torch.Tensor:
    """Sum of |u|² of each field (..., rows, columns), float64."""
    light = sum_squared_modulus(field)
    if field.dtype == torch.complex128 or _suits_single_precision(light):
        return light
    # The squares may have left single precision.
    return sum_squared_modulus(field.to(torch.complex128))


def require_finite_power(name: str, field: torch.Tensor) -> torch.Tensor:
    """field_power(); raises ValueError for a field with NaN or infinite values.

    Each of them shows in the sum: where that is ordinary nobody has to look for them.
    """
    light = field_power(field)
    if not _suits_single_precision(light):
        require_finite(name, field.detach())
    return light


def normalise_strength(
    field: torch.Tensor, light: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
    """Fields of ordinary strength, their light, and what they must be multiplied by.

    light: field_power() of the field. Nothing is done, and the factor is None, if all have
    an ordinary strength; else each field that is lit is divided by its largest part.
    """
    if _suits_single_precision(light):
        return field, light, None
    parts = torch.view_as_real(field.detach().resolve_conj()).abs()
    peak = parts.amax(dim=(-3, -2, -1))
    peak = torch.where(peak > 0, peak, 1.0)[..., None, None]
    even = field / peak
    return even, field_power(even), peak


def power_shares(part: torch.Tensor, light: torch.Tensor) -> list[float]:
    """Part over light of all fields that are lit; a few numbers are quicker in a list."""
    return [
        p / whole for p, whole in zip(_as_list(part), _as_list(light), strict=True) if whole > 0
    ]


def _as_list(values: torch.Tensor) -> list[float]:
    numbers: list[float] = values.flatten().tolist()
    return numbers


def _suits_single_precision(light: torch.Tensor) -> bool:
    """Whether that of all fields is."""
    return all(_LEAST < one < _MOST for one in _as_list(light))
