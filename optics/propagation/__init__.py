"""Propagate light through free space, by the cheapest method that keeps a tolerance.

A `FreeSpace` operator propagates a field from one plane to another, by the Rayleigh-Sommerfeld
integral or by Fresnel's (thesis Eq. 2.12). Each method has its own module. From sampling and
physics, it states where it is valid, what it costs and how large its error may be. The operator
uses the cheapest valid method.
"""

from optics.propagation.free_space_operator import FreeSpace, propagate
from optics.propagation.method_choice import METHODS
from optics.propagation.propagator import Propagator
from optics.propagation.span import FreeSpaceSpan

__all__ = ["METHODS", "FreeSpace", "FreeSpaceSpan", "Propagator", "propagate"]
