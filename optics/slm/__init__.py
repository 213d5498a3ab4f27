"""From grey levels to the light that leaves a liquid-crystal panel, and back.

`panel` describes the SLM as data, `lut` converts between grey levels and phase, `dynamics` models
the liquid crystal in time, and `coupling` the fringing fields of neighbouring pixels. `Modulator`
combines these effects with flicker, the gap between pixels, flatness, jitter and reflections.
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
