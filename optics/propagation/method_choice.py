"""All methods of free space by name, and the choice of the cheapest for a span."""

from __future__ import annotations

import math
from functools import partial
from operator import attrgetter

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


def methods_for_span(span: FreeSpaceSpan, method: str | None) -> MethodChoice[Propagator]:
    """Return the methods that are valid for a span, the cheapest first.

    method: one of METHODS, or None for all of them that are worth a comparison.
    """
    budget, least_seconds = span.budget, math.inf

    def plan(kind: type[Propagator]) -> Propagator:
        nonlocal least_seconds
        if least_seconds < kind.search_calls * budget.speed.call:
            raise ToleranceError(f"{kind.name} isn't compared, because another method is quicker")
        propagator = kind(span)
        if propagator.bytes <= budget.memory:
            least_seconds = min(least_seconds, propagator.total_seconds(budget))
        return propagator

    kinds = [_PROPAGATORS[name] for name in select_methods(METHODS, method)]
    return MethodChoice(
        [partial(plan, kind) for kind in sorted(kinds, key=attrgetter("search_calls"))],
        budget,
        "light in free space",
        remedy="ask for a smaller target or a larger tol",
    )


def prepare_cheapest(choice: MethodChoice[Propagator], tol: float) -> Propagator:
    """Prepare and return the cheapest method that keeps the tolerance.

    Raises ToleranceError or ValueError with the reasons of all methods if there is none.
    """
    for offer in choice.prepared_candidates():
        return offer
    raise choice.refusal(tol)
