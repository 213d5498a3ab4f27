"""The names that options of `labapp accuracy` take, and the options' checks.

This module imports nothing heavy, so that a wrong option is refused at once.
"""

from __future__ import annotations

import math
from typing import Any

from labapp.common.errors import UserError

CHAIN_PATTERNS = ("random", "cubic", "neutral")
"""Patterns that `labapp accuracy chain` can show on the panel."""

EDOF_PARTS = ("all", "design", "psf")
"""What `labapp accuracy edof` can measure."""

FIELD_KINDS = ("smooth", "cells")
"""Kinds of field that `labapp accuracy propagate` knows."""

BLUR_NAMES: dict[str, tuple[str, tuple[Any, ...]]] = {
    "disk of 3": ("disk", (3.0,)),
    "disk of 5": ("disk", (5.0,)),
    "disk of 7": ("disk", (7.0,)),
    "Gaussian of 1.5": ("gaussian", (1.5,)),
    "Gaussian of 3": ("gaussian", (3.0,)),
    "box of 9": ("box", (9,)),
    "line of 15": ("line", (15.0, 0.5)),
    "shake of 20": ("shake", (20.0, 1)),
    "shake of 30": ("shake", (30.0, 2)),
    "ring of 12 and a tenth in its centre": ("circle", (12.0, 0.1)),
    "ring of 8": ("shape", ("ring", 8.0)),
    "spiral of 10": ("shape", ("spiral", 10.0)),
    "heart of 9": ("shape", ("heart", 9.0)),
}
"""By the name of a blur: the function of `labapp.accuracy.blurs` that computes its PSF, and the
arguments of that function. Lengths are in pixels, angles in radians."""

BORDERS = ("unknown", "periodic")

PSF_NAMES = ("ring", "spiral", "dots", "linear dispersion")
"""Shapes of the PSFs of `labapp accuracy multispectral`; all grow with the wavelength."""


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


def require_blur(name: str, border: str) -> None:
    """Raise UserError for a blur or border that isn't known."""
    if name not in BLUR_NAMES:
        raise UserError(f"--blur {name}: is unknown. Take one of {', '.join(BLUR_NAMES)}.")
    if border not in BORDERS:
        raise UserError(f"--border {border}: is no such one. Take {' or '.join(BORDERS)}.")


def require_psf_name(name: str) -> None:
    """Raise UserError for a shape that isn't known."""
    if name not in PSF_NAMES:
        raise UserError(f"--psf {name}: is unknown. Take one of {', '.join(PSF_NAMES)}.")
