"""Describe a phase pattern by numbers that an optimiser moves, in one of several ways."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from optics.edof.parts_parametrisation import SumOfParts, depth_of_field_parts
from optics.edof.phase_parametrisation import PhaseParametrisation
from optics.edof.pixel_parametrisations import FreePhase, QuarterPhase, SeparablePhase
from optics.edof.radial_parametrisation import RadialPhase

__all__ = [
    "PARAMETRISATIONS",
    "FreePhase",
    "PhaseParametrisation",
    "QuarterPhase",
    "RadialPhase",
    "SeparablePhase",
    "SumOfParts",
    "depth_of_field_parts",
    "make_parametrisation",
]

PARAMETRISATIONS: Mapping[str, Callable[[tuple[int, int]], PhaseParametrisation]] = {
    "free": FreePhase,
    "quarter": QuarterPhase,
    "radial": RadialPhase,
    "separable": SeparablePhase,
    "separable-mirrored": lambda shape: SeparablePhase(shape, (True, True)),
}
"""The parametrisations that need no more than a panel's shape, by their names.

`SumOfParts` needs the parts.
"""


def make_parametrisation(name: str, shape: tuple[int, int]) -> PhaseParametrisation:
    """Return the parametrisation of a phase pattern by its name.

    Parameters
    ----------
    name : str
        One of PARAMETRISATIONS.
    shape : tuple of (int, int)
        (rows, columns) of the panel.

    Returns
    -------
    PhaseParametrisation
        The way to describe a pattern of that shape.

    Raises
    ------
    ValueError
        If there is no such name, or the shape isn't that of a panel.
    """
    if name not in PARAMETRISATIONS:
        raise ValueError(f"name is {name!r}; choose {', '.join(PARAMETRISATIONS)}")
    return PARAMETRISATIONS[name](shape)
