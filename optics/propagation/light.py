"""How much light a field has, and fields that are too strong or too weak for single precision."""

from __future__ import annotations

import torch

_LEAST, _MOST = 1e-20, 1e20
"""Sums of |u|² between which a field's spectrum, its kernels and their squares are all far from
what single precision can't hold, 1e-38 and 1e38."""


def float_light(field: torch.Tensor) -> torch.Tensor:
    """Sum of |u|² of each field (..., rows, columns), float64."""
    field = field.detach()
    light = (field.real**2 + field.imag**2).sum(dim=(-2, -1), dtype=torch.float64)
    if field.dtype == torch.complex128 or bool(_ordinary(light).all()):
        return light
    # The squares may have left single precision.
    return float_light(field.to(torch.complex128))


def evened(
    field: torch.Tensor, light: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
    """Fields of ordinary strength, their light, and what they must be multiplied by.

    light: float_light() of the field. Nothing is done, and the factor is None, if all have
    an ordinary strength; else each field that is lit is divided by its largest part.
    """
    if bool(_ordinary(light).all()):
        return field, light, None
    parts = torch.view_as_real(field.detach().resolve_conj()).abs()
    peak = parts.amax(dim=(-3, -2, -1))
    peak = torch.where(peak > 0, peak, 1.0)[..., None, None]
    even = field / peak
    return even, float_light(even), peak


def _ordinary(light: torch.Tensor) -> torch.Tensor:
    return (light > _LEAST) & (light < _MOST)
