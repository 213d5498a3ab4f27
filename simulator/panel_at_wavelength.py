"""The panel at any wavelength, within and beyond its table of phase ranges."""

from __future__ import annotations

from dataclasses import replace

from optics.camera import Panel
from optics.slm import Modulator, PhaseResponse
from optics.slm.panel import max_phase


def phase_range_wavelengths(panel: Panel) -> tuple[float, float]:
    """Return the shortest and longest wavelength (m) at which the table of phase ranges holds.

    The table is used from 0.9 times its shortest wavelength to 1.15 times its longest one.
    """
    known = [wavelength for wavelength, _ in panel.max_phase]
    return 0.9 * min(known), 1.15 * max(known)


def panel_at(panel: Panel, wavelength: float) -> Panel:
    """Return the panel for light of any wavelength.

    Beyond the panel's table, the optical path is that at the table's end. A liquid crystal's
    birefringence, and so the phase, changes by a few per cent there.
    """
    low, high = phase_range_wavelengths(panel)
    if low <= wavelength <= high:
        return panel
    end = min(max(wavelength, low), high)
    return substitute_panel(panel, end, wavelength, end / wavelength)


def substitute_panel(
    panel: Panel, known_wavelength: float, wavelength: float, factor: float
) -> Panel:
    """Return a panel that acts at `wavelength` like `panel` at `known_wavelength`.

    factor: multiplies the phase.
    """
    response = panel.response
    if response is not None:
        response = PhaseResponse((wavelength,), response.at(known_wavelength)[None])
    reach = max_phase(panel, known_wavelength) * factor
    return replace(panel, max_phase=((wavelength, reach),), response=response)


def modulator_at(panel: Panel, wavelength: float) -> Modulator:
    """Return the panel's modulator for any wavelength in metres."""
    return Modulator(panel_at(panel, wavelength), wavelength)
