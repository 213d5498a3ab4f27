"""The panel at any wavelength: within its table of phase ranges, and beyond it."""

from __future__ import annotations

from dataclasses import replace

from optics.camera import Panel
from optics.slm import Modulator, PhaseResponse
from optics.slm.phase_range import max_phase

LOWEST, HIGHEST = 0.9, 1.15
"""Of the shortest and longest wavelength of a panel's table: where it is trusted."""


def phase_range_wavelengths(panel: Panel) -> tuple[float, float]:
    """Metres between which the panel's phase range is known."""
    known = [wavelength for wavelength, _ in panel.max_phase]
    return LOWEST * min(known), HIGHEST * max(known)


def panel_at(panel: Panel, wavelength: float) -> Panel:
    """The panel for light of any wavelength: beyond its table the path stays as at its end.

    A crystal's birefringence changes by a few per cent there, and so does the phase.
    """
    low, high = phase_range_wavelengths(panel)
    if low <= wavelength <= high:
        return panel
    end = min(max(wavelength, low), high)
    return substitute_panel(panel, end, wavelength, end / wavelength)


def substitute_panel(
    panel: Panel, known_wavelength: float, wavelength: float, factor: float
) -> Panel:
    """A panel that does at a wavelength what this one does at a known one, times a factor."""
    response = panel.response
    if response is not None:
        response = PhaseResponse((wavelength,), response.at(known_wavelength)[None])
    reach = max_phase(panel, known_wavelength) * factor
    return replace(panel, max_phase=((wavelength, reach),), response=response)


def modulator_at(panel: Panel, wavelength: float) -> Modulator:
    return Modulator(panel_at(panel, wavelength), wavelength)
