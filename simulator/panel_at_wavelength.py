"""The panel at any wavelength, within and beyond its table of phase ranges."""

from __future__ import annotations

from dataclasses import replace

from optics.camera import Panel
from optics.slm import Modulator, PhaseResponse
from optics.slm.panel import max_phase


def panel_at(panel: Panel, wavelength: float) -> Panel:
    """Return the panel for light of any wavelength.

    The panel's table of phase ranges is used from 0.9 times its shortest wavelength to 1.15 times
    its longest one. Beyond, the optical path is that at the table's end; a liquid crystal's
    birefringence, and so the phase, changes by a few per cent there.
    """
    known = [one for one, _ in panel.max_phase]
    low, high = 0.9 * min(known), 1.15 * max(known)
    if low <= wavelength <= high:
        return panel
    end = min(max(wavelength, low), high)
    response = panel.response
    if response is not None:
        response = PhaseResponse((wavelength,), response.at(end)[None])
    reach = max_phase(panel, end) * (end / wavelength)
    return replace(panel, max_phase=((wavelength, reach),), response=response)


def modulator_at(panel: Panel, wavelength: float) -> Modulator:
    """Return the panel's modulator for any wavelength in metres."""
    return Modulator(panel_at(panel, wavelength), wavelength)
