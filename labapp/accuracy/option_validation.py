"""The words that questions about accuracy know; importing it loads nothing."""

from __future__ import annotations

import math

from labapp.common.errors import UserError

CHAIN_PATTERNS = ("random", "cubic", "neutral")
"""On a chain's panel."""

FIELD_KINDS = ("smooth", "cells")
"""Of a field that propagates."""


def require_pattern(name: str) -> None:
    """UserError for a pattern that isn't known."""
    if name not in CHAIN_PATTERNS:
        raise UserError(f"--pattern {name}: choose {', '.join(CHAIN_PATTERNS)}.")


def require_propagation(light: str, distance: float, wavelength: float) -> None:
    """UserError for a light that isn't known, or that can't go that far; metres."""
    if light not in FIELD_KINDS:
        raise UserError(f"--light {light}: choose {' or '.join(FIELD_KINDS)}.")
    if not (math.isfinite(distance) and distance):
        raise UserError(f"--distance {distance:g}: it must be finite and not 0, in metres.")
    if not (0 < wavelength < math.inf):
        raise UserError(f"--wavelength-nm {wavelength * 1e9:g}: it must be positive.")


def require_pitch(option: str, micrometres: float) -> None:
    """UserError for a distance between samples that there can't be."""
    if not 0 < micrometres < math.inf:
        raise UserError(f"--{option} {micrometres:g}: it must be positive, in micrometres.")
