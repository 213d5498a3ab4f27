"""Reflectances of the ink and the paper of test charts."""

from __future__ import annotations

PAPER, INK = 0.9, 0.05
"""Approximate reflectances of white paper and of black ink."""


def require_tones(dark: float, bright: float) -> None:
    """Raise ValueError unless `dark` and `bright` are reflectances, the darker first."""
    if not 0 <= dark < bright <= 1:
        raise ValueError(
            f"dark is {dark:g} and bright is {bright:g}; give reflectances from 0 to 1, the "
            "darker first"
        )
