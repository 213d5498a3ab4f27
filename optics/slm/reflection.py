"""Light that leaves the panel without having been modulated."""

from __future__ import annotations

from optics.slm.panel import Panel


def front_reflection_share(panel: Panel) -> float:
    """Share of the light from the panel that its cover glass has reflected.

    It adds in intensity: the glass is far thicker than the coherence length, which at 550 nm
    and a band of 7 nm is wavelength² / band = 43 µm.
    """
    return panel.front_reflection / panel.reflectivity if panel.front_reflection else 0.0


def transmitted_unmodulated_share(panel: Panel) -> float:
    """Share of the light from the panel that went through it and wasn't modulated: of the
    polarisation that the crystal doesn't turn (thesis §5.6 has 5 to 10 %)."""
    return (1 - front_reflection_share(panel)) * panel.unmodulated
