"""Panel, space, lens and stop, space, sensor: the light behind a panel apart from its lens.

GridEngine goes with FFTs from plane to plane, NodesEngine by quadrature over the stop for many
digits, and CollapsedEngine takes panel and lens as one plane while the difference is small.
"""

from optics.chain.choice import CHAIN_METHODS as CHAIN_METHODS
from optics.chain.choice import chain_engines as chain_engines
from optics.chain.grid import GridEngine as GridEngine
from optics.chain.lens_pass import spectrum_of as spectrum_of
from optics.chain.light import Light as Light
from optics.chain.light import passed_light as passed_light
