"""All methods of free space by name, and the choice of the cheapest for a span."""

from __future__ import annotations

import math
from functools import partial

from optics.accuracy import MethodChoice, ToleranceError, select_methods
from optics.propagation.angular_spectrum import (
    AngularSpectrum,
    BandLimitedAngularSpectrum,
    FresnelTransfer,
    ScaledAngularSpectrum,
    TiltedAngularSpectrum,
)
from optics.propagation.fresnel_matrix import FresnelMatrices
from optics.propagation.fresnel_steps import SingleFresnel, TwoStepFresnel
from optics.propagation.propagator import Propagator
from optics.propagation.rayleigh_sommerfeld import DirectQuadrature
from optics.propagation.span import FreeSpaceSpan

_PROPAGATORS: dict[str, type[Propagator]] = {
    one.name: one
    for one in (
        AngularSpectrum,
        BandLimitedAngularSpectrum,
        ScaledAngularSpectrum,
        TiltedAngularSpectrum,
        FresnelTransfer,
        FresnelMatrices,
        SingleFresnel,
        TwoStepFresnel,
        DirectQuadrature,
    )
}

METHODS = tuple(_PROPAGATORS)
"""Names of all propagation methods. A method may not be valid for every span."""


_SEARCH_CALLS = {
    FresnelMatrices.name: 0,
    DirectQuadrature.name: 0,
    SingleFresnel.name: 16,
    AngularSpectrum.name: 8,
    BandLimitedAngularSpectrum.name: 8,
    ScaledAngularSpectrum.name: 8,
    FresnelTransfer.name: 8,
    TiltedAngularSpectrum.name: 40,
    TwoStepFresnel.name: 40,
}
"""Total processor time, in function calls, below which another method isn't compared with this one.

Comparing takes time as well. The tilted angular spectrum is hardly ever the fastest between
parallel planes, and the search for a two-step plane takes as long as ten calls.
"""


def methods_for_span(span: FreeSpaceSpan, method: str | None) -> MethodChoice[Propagator]:
    """Return the methods that are valid for a span, the cheapest first.

    method: one of METHODS, or None for all of them that are worth a comparison.
    """
    comparison = _Comparison(span)
    names = sorted(select_methods(METHODS, method), key=lambda name: _SEARCH_CALLS[name])
    return MethodChoice(
        [partial(comparison.propagator, name) for name in names],
        span.budget,
        "light in free space",
        remedy="ask for a smaller target or a larger tol",
    )


class _Comparison:
    """Plan methods one after the other, as long as that may be worth its time."""

    def __init__(self, span: FreeSpaceSpan) -> None:
        self._span, self._least_seconds = span, math.inf

    def propagator(self, name: str) -> Propagator:
        """Return a method of METHODS; raise ToleranceError where another is quicker than a plan."""
        budget = self._span.budget
        if self._least_seconds < _SEARCH_CALLS[name] * budget.speed.call:
            raise ToleranceError(f"{name} isn't compared, because another method is quicker")
        propagator = _PROPAGATORS[name](self._span)
        if propagator.bytes <= budget.memory:
            self._least_seconds = min(self._least_seconds, propagator.total_seconds(budget))
        return propagator


def prepare_cheapest(choice: MethodChoice[Propagator], tol: float) -> Propagator:
    """Prepare and return the cheapest method that keeps the tolerance.

    Raises ToleranceError or ValueError with the reasons of all methods if there is none.
    """
    for offer in choice.prepared_candidates():
        return offer
    raise choice.refusal(tol)
