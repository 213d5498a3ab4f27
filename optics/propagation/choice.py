"""Every way through free space that serves a question, and the cheapest of them."""

from __future__ import annotations

import math

from optics.accuracy import ToleranceError, unkeepable
from optics.propagation.angular_spectrum import AngularSpectrum
from optics.propagation.band_limited import BandLimitedAngularSpectrum
from optics.propagation.fresnel_matrix import FresnelMatrices
from optics.propagation.fresnel_single import SingleFresnel
from optics.propagation.fresnel_transfer import FresnelTransfer
from optics.propagation.fresnel_two_step import TwoStepFresnel
from optics.propagation.propagator import Propagator
from optics.propagation.rayleigh_sommerfeld import DirectQuadrature
from optics.propagation.scaled import ScaledAngularSpectrum
from optics.propagation.span import Span
from optics.propagation.tilted import TiltedAngularSpectrum

_CLASSES: tuple[type[Propagator], ...] = (
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

METHODS = tuple(method.name for method in _CLASSES)
"""Of free space; not all of them serve every question."""

_LONGEST = 3600.0
"""Seconds of a call beyond which nobody waits who wasn't told before."""


class Choice:
    """The methods that serve a span, the cheapest first, and why the others don't.

    method: one of METHODS, or None for all of them.
    """

    def __init__(self, span: Span, method: str | None) -> None:
        self._span, self._named = span, method is not None
        self._refusals: dict[str, ValueError] = {}
        self._offers: list[Propagator] = []
        for one in _CLASSES:
            if method in (None, one.name):
                self._ask(one)
        self._offers.sort(key=self._cost)

    def _cost(self, offer: Propagator) -> float:
        return offer.cpu_seconds(self._span.budget.speed)

    def _ask(self, method: type[Propagator]) -> None:
        try:
            offer = method(self._span)
            self._require_affordable(offer)
        except ValueError as error:
            self._refusals[method.name] = error
        else:
            self._offers.append(offer)

    def _require_affordable(self, offer: Propagator) -> None:
        memory, seconds = self._span.budget.memory, self._cost(offer)
        if offer.bytes > memory:
            raise ToleranceError(
                f"{offer.name} needs {offer.bytes / 1e6:.0f} MB and {memory / 1e6:.0f} MB are "
                "allowed; allow more memory, or ask for a smaller target or a larger tol"
            )
        if seconds > _LONGEST and not self._named:
            raise ToleranceError(
                f"{offer.name} would take {seconds / 3600:.0f} h; ask for a smaller target or a "
                f"larger tol, or for method={offer.name!r} to have it all the same"
            )

    @property
    def seconds(self) -> float:
        """Of the cheapest, in a call; infinite if none serves."""
        return self._cost(self._offers[0]) if self._offers else math.inf

    def prepared(self) -> Propagator:
        """The cheapest method that keeps its promise, prepared.

        Raises ToleranceError or ValueError with the reasons of those that can't.
        """
        for offer in self._offers:
            try:
                offer.prepare()
            except ToleranceError as error:
                self._refusals[offer.name] = error
                continue
            return offer
        raise self._refusal()

    def _refusal(self) -> ValueError:
        """Why the methods that are made for the question can't keep the tolerance; the least
        one that they can, if that is all.

        The two angular spectra by FFTs, and the tilted one without a tilt, are special cases
        of the scaled one, and say the same.
        """
        if len(self._refusals) == 1:
            return next(iter(self._refusals.values()))
        strict = {n: e for n, e in self._refusals.items() if isinstance(e, ToleranceError)}
        special = {AngularSpectrum.name, BandLimitedAngularSpectrum.name}
        if not any(self._span.tilt):
            special.add(TiltedAngularSpectrum.name)
        told = {name: error for name, error in strict.items() if name not in special}
        floors = [error.floor for error in strict.values() if error.floor is not None]
        if floors:
            return unkeepable(self._span.tol, min(floors))
        reasons = dict.fromkeys(map(str, (told or strict or self._refusals).values()))
        kind = ToleranceError if strict else ValueError
        return kind("; ".join(reasons))
