"""Model the SLM: from grey levels to the light that leaves a liquid-crystal panel, and back.

There is one module for each effect: the panel as data; its phase range over wavelengths; the
response to grey levels and its inverse; the liquid crystal in time; flicker; the coupling of
neighbouring pixels; the gap between pixels; flatness; jitter; reflections. `Modulator` combines
the effects that a panel has.
"""

from optics.slm.lut import grey_to_phase, phase_to_grey, require_grey
from optics.slm.modulator import Modulator
from optics.slm.panel import Panel, PanelMap, PhaseResponse, max_phase

__all__ = [
    "Modulator",
    "Panel",
    "PanelMap",
    "PhaseResponse",
    "grey_to_phase",
    "max_phase",
    "phase_to_grey",
    "require_grey",
]
