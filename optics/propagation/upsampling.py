"""Interpolate a band-limited field between its samples before it is propagated."""

from __future__ import annotations

import torch

from optics.fourier import unit_phasor


def upsample(field: torch.Tensor, factor: int, carrier: float) -> torch.Tensor:
    """Upsample a field for propagation by `factor` along its last axis.

    The field's spectrum is padded with zeros. The first of each group of `factor` samples coincides
    with a sample of the field. carrier: turns from sample to sample, at the middle of the spectrum.
    The result is exact for a field that is dark at its ends; otherwise the field is continued
    periodically.
    """
    if factor == 1:
        return field
    n = field.shape[-1]
    spectrum = torch.fft.fft(field * _carrier_phasor(n, -carrier, field))
    order = torch.fft.fftshift(spectrum, dim=-1)
    first = _first(n, factor)
    padded = torch.nn.functional.pad(order, (first, n * factor - n - first))
    fine = torch.fft.ifft(torch.fft.ifftshift(padded, dim=-1)) * factor
    return fine * _carrier_phasor(n * factor, carrier / factor, field)


def upsample_adjoint(fine: torch.Tensor, factor: int, carrier: float) -> torch.Tensor:
    """Apply the conjugate transpose of `upsample` to a propagated field on finer samples."""
    if factor == 1:
        return fine
    n = fine.shape[-1] // factor
    spectrum = torch.fft.fft(fine * _carrier_phasor(n * factor, -carrier / factor, fine))
    first = _first(n, factor)
    order = torch.fft.fftshift(spectrum, dim=-1)[..., first : first + n]
    return torch.fft.ifft(torch.fft.ifftshift(order, dim=-1)) * _carrier_phasor(n, carrier, fine)


def _first(n: int, factor: int) -> int:
    """Return the index of the field's lowest frequency in the propagator's padded spectrum."""
    return (n * factor) // 2 - n // 2


def _carrier_phasor(n: int, turns: float, like: torch.Tensor) -> torch.Tensor:
    index = torch.arange(n, dtype=torch.float64)
    return unit_phasor(turns * index, like.dtype).to(like.device)
