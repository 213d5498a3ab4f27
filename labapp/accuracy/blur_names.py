"""The blurs that restorations are compared on, by name.

This module imports nothing heavy, so that the command line can check a name at once.
"""

from __future__ import annotations

from typing import Any

from labapp.common.errors import UserError

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


def require_blur(name: str, border: str) -> None:
    """Raise UserError for a blur or border that isn't known."""
    if name not in BLUR_NAMES:
        raise UserError(f"--blur {name}: is unknown. Take one of {', '.join(BLUR_NAMES)}.")
    if border not in BORDERS:
        raise UserError(f"--border {border}: is no such one. Take {' or '.join(BORDERS)}.")
