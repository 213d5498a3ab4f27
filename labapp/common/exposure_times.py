"""Exposures in whole microseconds, as cameras count, so that equal ones are equal numbers."""

from __future__ import annotations


def round_exposure(seconds: float) -> float:
    """Return an exposure in seconds, rounded to whole microseconds."""
    return round(seconds * 1e6) / 1e6


def exposure_from_ms(milliseconds: float) -> float:
    """Return an exposure of a plan in seconds, rounded to whole microseconds."""
    return round(milliseconds * 1e3) / 1e6


def exposure_in_ms(seconds: float) -> float:
    """Return an exposure in milliseconds for a plan, rounded to whole microseconds."""
    return round(seconds * 1e6) / 1e3
