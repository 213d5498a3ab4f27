"""What charts are printed with."""

from __future__ import annotations

PAPER, INK = 0.9, 0.05
"""Reflectances of white paper and of black ink, about."""


def require_tones(dark: float, bright: float) -> None:
    """Raise a ValueError where they aren't two reflectances, the darker first."""
    if not 0 <= dark < bright <= 1:
        raise ValueError(
            f"dark is {dark:g} and bright is {bright:g}; give reflectances from 0 to 1, the "
            "darker first"
        )
