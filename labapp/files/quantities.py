"""Numbers in files and requests: types with their allowed ranges, and exposures.

Exposures are whole microseconds, as cameras count, so that equal ones are equal numbers.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from labapp.files.table import LightUnit

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Nanometres = Annotated[Positive, LightUnit()]
"""Wavelength of light in nanometres."""

NanometresText = Annotated[str, Field(pattern=r"^[0-9]+(\.[0-9]+)?$"), LightUnit()]
"""Wavelength of light in nanometres as the key of a table."""

Amount = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]


def round_exposure(seconds: float) -> float:
    """Return an exposure in seconds, rounded to whole microseconds."""
    return round(seconds * 1e6) / 1e6


def exposure_from_ms(milliseconds: float) -> float:
    """Return milliseconds of exposure in seconds, rounded to whole microseconds."""
    return round(milliseconds * 1e3) / 1e6


def exposure_in_ms(seconds: float) -> float:
    """Return seconds of exposure in milliseconds, rounded to whole microseconds."""
    return round(seconds * 1e6) / 1e3
