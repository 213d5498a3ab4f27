"""Checks options of `labapp accuracy`.

This module imports nothing heavy, so that a wrong option is refused at once.
"""

from __future__ import annotations

import math

from labapp.common.errors import UserError

CHAIN_PATTERNS = ("random", "cubic", "neutral")
"""Patterns that `labapp accuracy chain` can show on the panel."""

EDOF_PARTS = ("all", "design", "psf")
"""What `labapp accuracy edof` can measure."""

FIELD_KINDS = ("smooth", "cells")
"""Kinds of field that `labapp accuracy propagate` knows."""


def require_pattern(name: str) -> None:
    """Raise UserError for a pattern that isn't known."""
    if name not in CHAIN_PATTERNS:
        raise UserError(f"--pattern {name}: choose {', '.join(CHAIN_PATTERNS)}.")


def require_edof_part(name: str) -> None:
    """Raise UserError for a part that isn't measured."""
    if name not in EDOF_PARTS:
        raise UserError(f"--part {name}: choose {', '.join(EDOF_PARTS)}.")


def require_propagation(light: str, distance: float, wavelength: float) -> None:
    """Raise UserError for a kind of field, a distance or a wavelength that is impossible.

    The kind must be known, the distance finite and not 0, and the wavelength positive. Distance and
    wavelength are in metres.
    """
    if light not in FIELD_KINDS:
        raise UserError(f"--light {light}: choose {' or '.join(FIELD_KINDS)}.")
    if not (math.isfinite(distance) and distance):
        raise UserError(f"--distance {distance:g}: it must be finite and not 0, in metres.")
    if not (0 < wavelength < math.inf):
        raise UserError(f"--wavelength-nm {wavelength * 1e9:g}: it must be positive.")


def require_pitch(option: str, micrometres: float) -> None:
    """Raise UserError unless a sample pitch is positive and finite.

    option: its name in the message.
    """
    if not 0 < micrometres < math.inf:
        raise UserError(f"--{option} {micrometres:g}: it must be positive, in micrometres.")
