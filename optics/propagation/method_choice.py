"""List the free-space propagation methods and choose the cheapest for a span."""

from __future__ import annotations

import math
from functools import partial

from optics.accuracy import MethodChoice, select_methods
from optics.propagation.angular_spectrum import (
    AngularSpectrum,
    BandLimitedAngularSpectrum,
    ScaledAngularSpectrum,
)
from optics.propagation.fresnel_matrix import FresnelMatrices
from optics.propagation.fresnel_single import SingleFresnel
from optics.propagation.fresnel_transfer import FresnelTransfer
from optics.propagation.fresnel_two_step import TwoStepFresnel
from optics.propagation.propagator import Propagator
from optics.propagation.rayleigh_sommerfeld import DirectQuadrature
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.tilted import TiltedAngularSpectrum

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
    """Return the propagation methods that are valid for a span, the cheapest first.

    method: one of METHODS, or None for all of them.
    """
    return MethodChoice(
        [partial(_PROPAGATORS[name], span) for name in select_methods(METHODS, method)],
        span.budget,
        "light in free space",
        remedy="ask for a smaller target or a larger tol",
        # Without a named method, no call may take more than an hour.
        longest=math.inf if method else 3600.0,
    )


def prepare_cheapest(choice: MethodChoice[Propagator], tol: float) -> Propagator:
    """Prepare and return the cheapest propagation method that keeps the tolerance.

    Raises ToleranceError or ValueError with the reasons of all methods if there is none.
    """
    for offer in choice.prepared_candidates():
        return offer
    raise choice.refusal(tol)
