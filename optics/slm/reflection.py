"""Compute the shares of light that leave the panel unmodulated."""

from __future__ import annotations

from optics.slm.panel import Panel


def front_reflection_share(panel: Panel) -> float:
    """Compute the share of the SLM's light that its cover glass reflects.

    This light adds in intensity, because the glass is far thicker than the coherence length, which
    at 550 nm and a band of 7 nm is wavelength² / band = 43 µm.
    """
    return panel.front_reflection / panel.reflectivity if panel.front_reflection else 0.0


def transmitted_unmodulated_share(panel: Panel) -> float:
    """Compute the share of the SLM's light that passed the liquid crystal unmodulated.

    This light has the polarisation whose phase the crystal doesn't change (thesis §5.6 gives 5 to
    10 %).
    """
    return (1 - front_reflection_share(panel)) * panel.unmodulated
