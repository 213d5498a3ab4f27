"""Panel, space, lens and stop, space, sensor: the light behind a panel apart from its lens.

GridEngine goes with FFTs from plane to plane, QuadratureEngine by quadrature over the stop for many
digits, and CollapsedEngine takes panel and lens as one plane while the difference is small.
"""

from optics.chain.engine_choice import CHAIN_METHODS, chain_engines
from optics.chain.grid import GridEngine
from optics.chain.light_budget import LightBudget, compute_light_budget
from optics.chain.panel_to_sensor import panel_spectrum

__all__ = [
    "CHAIN_METHODS",
    "GridEngine",
    "LightBudget",
    "chain_engines",
    "compute_light_budget",
    "panel_spectrum",
]
