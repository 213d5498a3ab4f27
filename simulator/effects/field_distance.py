"""Bounds of the difference of two PSFs from their fields on a sample of the panel's pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from simulator.situation import Situation

MARGIN = 1.2
"""Factor, from audits, by which fields may differ more on the pixels outside a sample."""


@dataclass(frozen=True)
class PixelSample:
    """A sample of the panel's pixels in steps of rows and columns.

    aperture_share: share of each pixel that the stop leaves open.
    """

    rows: int
    columns: int
    aperture_share: torch.Tensor

    def __call__(self, values: torch.Tensor) -> torch.Tensor:
        """Return the values at the sample's pixels."""
        return values[:: self.rows, :: self.columns].contiguous()

    def mean(self, values: torch.Tensor) -> complex:
        """Average values at the sample's pixels over their open area."""
        weight = self.aperture_share**2
        return complex((values * weight).sum() / weight.sum())


def sample_pixels(s: Situation) -> PixelSample:
    """Sample at most 256 x 256 of the panel's pixels."""
    rows, columns = (max(1, math.ceil(n / 256)) for n in s.camera.panel.shape)
    share = s.pattern_probe.aperture_share[::rows, ::columns]
    return PixelSample(rows, columns, share.contiguous())


def covers_all_pixels(s: Situation) -> bool:
    """Whether the sample holds all of the panel's pixels."""
    return max(s.camera.panel.shape) <= 256


def margin(s: Situation) -> float:
    """Return the factor by which a bound from sampled pixels may be too small, 1 for all pixels."""
    return 1.0 if covers_all_pixels(s) else MARGIN


def describe_proof(s: Situation, what: str) -> str:
    """Say whether a bound from a sample of pixels is proved or audited."""
    return f"proved: {what}" if covers_all_pixels(s) else f"audited ×{MARGIN:g}: {what}"


def psf_distance_bound(pixels: PixelSample, one: torch.Tensor, other: torch.Tensor) -> float:
    """Bound ‖Δh‖₁ of the PSFs of two fields on sampled panel pixels.

    |p|² - |q|² is at most (|p| + |q|) |p - q|, whose integral is at most (‖p‖ + ‖q‖) ‖p - q‖
    (Cauchy-Schwarz); the light's power is the same on panel and sensor (Parseval). A phase that all
    pixels share makes no difference.
    """
    first, second = pixels.mean(one.abs() ** 2).real, pixels.mean(other.abs() ** 2).real
    common = abs(pixels.mean(one * other.conj()))
    away = math.sqrt(max(first + second - 2 * common, 0.0))
    return (math.sqrt(first) + math.sqrt(second)) * away


def phase_error_psf_bound(s: Situation, pixels: PixelSample, error: torch.Tensor) -> float:
    """Bound ‖Δh‖₁ of PSFs for a phase error of the panel in radians, for any field.

    A phase that all pixels share counts only where other light interferes with theirs: light from
    the gaps between pixels, or light that the panel doesn't modulate.
    """
    one = torch.polar(torch.ones_like(error), error)
    if not has_coherent_background(s):
        return psf_distance_bound(pixels, one, torch.ones_like(one))
    still = math.sqrt(pixels.mean((one - 1).abs() ** 2).real)
    return (2 + abs(s.interference)) * still


def has_coherent_background(s: Situation) -> bool:
    """Whether light that ignores the pattern interferes with light that the pattern modulates."""
    return bool(s.camera.panel.gap_reflection) or bool(s.interference)
