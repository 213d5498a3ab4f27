"""Measure a field's power, and rescale fields that exceed the range of single precision."""

from __future__ import annotations

import torch

from optics.validation import require_finite


def sum_squared_modulus(field: torch.Tensor) -> torch.Tensor:
    """Return the sum of ``|u|²`` of each propagated field (..., rows, columns), float64.

    The squares are computed in the precision of the field.
    """
    parts = torch.view_as_real(field.detach().resolve_conj())
    return parts.square().sum(dim=(-3, -2, -1), dtype=torch.float64)


def field_power(field: torch.Tensor) -> torch.Tensor:
    """Return the power of each propagated field (..., rows, columns): sum of ``|u|²``, float64."""
    light = sum_squared_modulus(field)
    if field.dtype == torch.complex128 or _suits_single_precision(light):
        return light
    # The squares may have exceeded the range of single precision.
    return sum_squared_modulus(field.to(torch.complex128))


def require_finite_power(name: str, field: torch.Tensor) -> torch.Tensor:
    """Return the power of a field to propagate; raise ValueError for NaN or infinite values.

    Any such value changes the sum, so the values are checked only where the sum is unusual.
    """
    light = field_power(field)
    if not _suits_single_precision(light):
        require_finite(name, field.detach())
    return light


def normalise_strength(
    field: torch.Tensor, light: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
    """Rescale fields for propagation in single precision.

    Returns the rescaled fields, their power, and the factor that undoes the rescaling.

    light: field_power() of the field. If the power of every field suits single precision, nothing
    is changed and the factor is None. Otherwise each field that isn't dark is divided by its
    largest real or imaginary part.
    """
    if _suits_single_precision(light):
        return field, light, None
    parts = torch.view_as_real(field.detach().resolve_conj()).abs()
    peak = parts.amax(dim=(-3, -2, -1))
    peak = torch.where(peak > 0, peak, 1.0)[..., None, None]
    even = field / peak
    return even, field_power(even), peak


def power_shares(part: torch.Tensor, light: torch.Tensor) -> list[float]:
    """Return the ratio part / light for each propagated field that isn't dark.

    The result is a list, because that is faster than a tensor for a few numbers.
    """
    return [
        p / whole for p, whole in zip(_as_list(part), _as_list(light), strict=True) if whole > 0
    ]


def _as_list(values: torch.Tensor) -> list[float]:
    numbers: list[float] = values.flatten().tolist()
    return numbers


def _suits_single_precision(light: torch.Tensor) -> bool:
    """Return whether the power of every field suits propagation in single precision."""
    # Within these limits a field's spectrum, its kernels and their squares stay far from the ends
    # of single precision, 1e-38 and 1e38.
    return all(1e-20 < one < 1e20 for one in _as_list(light))
