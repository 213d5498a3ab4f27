"""How far two fields on a panel are apart, on some of its pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from simulator.situation import Situation

SIDE = 256
"""Pixels along each axis that are looked at, at most; a pattern's are much alike."""

MARGIN = 1.2
"""Audited: other pixels than those that are looked at may differ by so much more."""


@dataclass(frozen=True)
class PixelSample:
    """Some pixels: every few along each axis, and how open the stop leaves each."""

    rows: int
    columns: int
    aperture_share: torch.Tensor

    def __call__(self, values: torch.Tensor) -> torch.Tensor:
        return values[:: self.rows, :: self.columns].contiguous()

    def mean(self, values: torch.Tensor) -> complex:
        """Over what is open."""
        weight = self.aperture_share**2
        return complex((values * weight).sum() / weight.sum())


def sample_pixels(s: Situation) -> PixelSample:
    rows, columns = (max(1, math.ceil(n / SIDE)) for n in s.camera.panel.shape)
    return PixelSample(
        rows, columns, s.pattern_probe.aperture_share[::rows, ::columns].contiguous()
    )


def covers_all_pixels(s: Situation) -> bool:
    """Whether all pixels are looked at."""
    return max(s.camera.panel.shape) <= SIDE


def margin(s: Situation) -> float:
    return 1.0 if covers_all_pixels(s) else MARGIN


def describe_proof(s: Situation, what: str) -> str:
    return f"proved: {what}" if covers_all_pixels(s) else f"audited ×{MARGIN:g}: {what}"


def psf_distance_bound(pixels: PixelSample, one: torch.Tensor, other: torch.Tensor) -> float:
    """‖Δh‖₁ at most, of PSFs of two fields of the same pixels.

    |p|² - |q|² is at most (|p| + |q|) |p - q|, whose integral is at most (‖p‖ + ‖q‖) ‖p - q‖
    (Cauchy-Schwarz), and light is the same on panel and sensor (Parseval). A phase that is the
    same for all pixels is no difference.
    """
    first, second = pixels.mean(one.abs() ** 2).real, pixels.mean(other.abs() ** 2).real
    common = abs(pixels.mean(one * other.conj()))
    away = math.sqrt(max(first + second - 2 * common, 0.0))
    return (math.sqrt(first) + math.sqrt(second)) * away


def phase_error_psf_bound(s: Situation, pixels: PixelSample, error: torch.Tensor) -> float:
    """‖Δh‖₁ at most, of a phase error in radians, whatever the field.

    What is common to all pixels counts only where other light interferes with theirs: the
    gap's, or what the panel doesn't turn.
    """
    one = torch.polar(torch.ones_like(error), error)
    if not has_coherent_background(s):
        return psf_distance_bound(pixels, one, torch.ones_like(one))
    still = math.sqrt(pixels.mean((one - 1).abs() ** 2).real)
    beats = abs(complex(s.path.interference)) if s.path is not None else 0.0
    return (2 + beats) * still


def has_coherent_background(s: Situation) -> bool:
    """Whether light that no pattern turns interferes with what is turned."""
    beats = s.path is not None and abs(complex(s.path.interference)) > 0
    return bool(s.camera.panel.gap_reflection) or beats
