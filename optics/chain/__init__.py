"""Compute the PSF of a panel that stands apart from its lens: the chain from panel to sensor.

The light goes from the panel through free space to the lens with its stop, and through free space
to the sensor. GridEngine propagates it by FFTs from plane to plane. QuadratureEngine integrates
over the stop by quadrature, for small tolerances. DirectEngine leaves out nothing, and integrates
along rows of the stop, for small panels, small windows and dark ones. CollapsedEngine treats panel
and lens as one plane, where the difference is small.
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
