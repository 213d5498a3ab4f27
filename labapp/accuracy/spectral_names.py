"""Names of the PSFs that `labapp accuracy multispectral` knows. The module loads nothing slow."""

from __future__ import annotations

from labapp.common.errors import UserError

PSF_NAMES = ("ring", "spiral", "dots", "linear dispersion")
"""Shapes of the PSFs, all of which grow with the wavelength."""


def require_psf_name(name: str) -> None:
    """Raise UserError for a shape that isn't known."""
    if name not in PSF_NAMES:
        raise UserError(f"--psf {name}: is unknown. Take one of {', '.join(PSF_NAMES)}.")
