"""Every way through free space that serves a request, and the cheapest of them."""

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
"""Of free space; not all of them serve every request."""

_MAX_CALL_SECONDS = 3600.0
"""Seconds of a call beyond which nobody waits who wasn't told before."""


def methods_for_span(span: FreeSpaceSpan, method: str | None) -> MethodChoice[Propagator]:
    """The methods that serve a span, the cheapest first; method: one of METHODS, or all."""
    return MethodChoice(
        [partial(_PROPAGATORS[name], span) for name in select_methods(METHODS, method)],
        span.budget,
        "light in free space",
        remedy="ask for a smaller target or a larger tol",
        longest=math.inf if method else _MAX_CALL_SECONDS,
    )


def prepare_cheapest(choice: MethodChoice[Propagator], tol: float) -> Propagator:
    """The cheapest method that keeps its promise, prepared.

    Raises ToleranceError or ValueError with the reasons of those that can't.
    """
    for offer in choice.prepared_candidates():
        return offer
    raise choice.refusal(tol)
