"""Every way through free space that serves a question, and the cheapest of them."""

from __future__ import annotations

import math
from functools import partial

from optics.accuracy import Choice, named
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
from optics.propagation.span import Span
from optics.propagation.tilted import TiltedAngularSpectrum

_CLASSES: dict[str, type[Propagator]] = {
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

METHODS = tuple(_CLASSES)
"""Of free space; not all of them serve every question."""

_LONGEST = 3600.0
"""Seconds of a call beyond which nobody waits who wasn't told before."""


def choice_for(span: Span, method: str | None) -> Choice[Propagator]:
    """The methods that serve a span, the cheapest first; method: one of METHODS, or all."""
    return Choice(
        [partial(_CLASSES[name], span) for name in named(METHODS, method)],
        span.budget,
        "light in free space",
        remedy="ask for a smaller target or a larger tol",
        longest=math.inf if method else _LONGEST,
    )


def prepared(choice: Choice[Propagator], tol: float) -> Propagator:
    """The cheapest method that keeps its promise, prepared.

    Raises ToleranceError or ValueError with the reasons of those that can't.
    """
    for offer in choice.prepared():
        return offer
    raise choice.refusal(tol)
