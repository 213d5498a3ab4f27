"""Light in free space: one file a kind of method, the cheapest that keeps a tolerance.

A FreeSpace carries a field from one plane to another, by Rayleigh and Sommerfeld's integral or
by Fresnel's (thesis Eq. 2.12). Every method states from sampling and physics where it serves,
what it costs and how far off it may be; the operator takes the cheapest.
"""

from optics.propagation.free_space_operator import FreeSpace, propagate
from optics.propagation.method_choice import METHODS
from optics.propagation.propagator import Propagator
from optics.propagation.span import FreeSpaceSpan

__all__ = ["METHODS", "FreeSpace", "FreeSpaceSpan", "Propagator", "propagate"]
