"""Compute light on the sensor's pixels by the planned engine, or by what stands in for it.

A pattern may send so little light to the window that the plan can't keep the tolerance. Four things
may stand in then, and all are chosen here: an engine for patterns, where a lens' was chosen for its
symmetry; another method of a chain; a finer integration over the pixels; and, for unmodulated light
beside a pattern's, an error that is smaller than it had to be.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    ErrorEstimate,
    ToleranceError,
    limit_planning_time,
    unreachable_tolerance_error,
)
from optics.psf.axial import AxialEngine
from optics.psf.chain_grid import GridEngine
from optics.psf.choice import EngineChoice
from optics.psf.dim_windows import (
    UNKNOWN_LIGHT,
    AddedLight,
    largest_ratio,
    normalise_amplitude,
    scale_light,
    window_norm,
)
from optics.psf.engine import BehindPanelEngine, PSFEngine
from optics.psf.panel_engine import PanelEngine
from optics.psf.pixel_request import PixelRequest
from optics.psf.request import PSFRequest
from optics.psf.symmetry import symmetric_engine
from optics.validation import rounded_down

# Factor on the error that brighter light beside the pixels makes, which isn't spread evenly.
# Chosen; 6 was needed where few pixels lie in a null of the envelope.
_BESIDE_FACTOR = 8.0

# Smallest error of the integration over pixels that is planned for, near double precision's
# rounding.
_FINEST_PIXEL_TOL = 1e-13

# Share of the tolerance that the light keeps, where a method does, so that derivatives in lengths
# keep the tolerance. Chosen.
_DERIVATIVE_TOL_SHARE = 0.03

# Share of the tolerance that the light without a pattern keeps, where a method does, if patterns
# are expected on a lens' points: with one, the window may get less light. Chosen; nodes' errors
# fall so fast with their number that it takes few more.
_PATTERN_TOL_SHARE = 0.01


@dataclass(frozen=True)
class PixelLight:
    """Holds the light of one call on the pixels, and what is known of it.

    values: (..., rows, columns).
    engine: the one that computed it, whose own figures change with its next call.
    error, arithmetic: relative L2 errors of the light on the samples.
    own_error: the error of this light without other light that is added to it.
    norm: L2 norm over the window on the samples, (...); None where it isn't known.
    integration_error: relative L2 error of the integration over pixels.
    """

    values: torch.Tensor
    engine: PSFEngine
    error: ErrorEstimate
    arithmetic: float
    own_error: float
    norm: torch.Tensor | None
    integration_error: float

    def without_values(self) -> PixelLight:
        """Return what is known of the light without itself: it may be large, and in a graph."""
        return replace(self, values=torch.empty(0))

    def added_light(self, share: float) -> AddedLight | None:
        """Tell of a share of this light in the units of the rest, which is a PSF of its own."""
        if self.norm is None or share == 1:
            return None
        norm = self.norm * (share / (1 - share))
        return AddedLight(norm, self.own_error * norm)


@dataclass(frozen=True)
class _KnownLight:
    """Light of no phase that was computed for an amplitude.

    keeps_tol: whether its error is within the tolerance, as far as it can be.
    """

    amplitude: torch.Tensor | None
    light: PixelLight
    keeps_tol: bool


class LightOnPixels:
    """Computes the light that a PixelRequest asks for, of patterns in one shape; planned once.

    symmetry: how patterns are given: as asked, or "none" where no engine serves that symmetry.
    engine: the one that is planned.

    Raises ToleranceError if the tolerance can't be kept.
    """

    def __init__(self, asked: PixelRequest) -> None:
        self._asked, self.camera, self.tol = asked, asked.camera, asked.tol
        self.integration = asked.integration
        rest, request = asked.integration_error, asked.on_samples()
        with limit_planning_time(asked.budget.seconds):
            if not max(asked.floor, rest + 20 * FLOAT64_ARITHMETIC) <= asked.tol:
                raise EngineChoice(request, self.camera, asked.method, rest).refusal_with_tolerance(
                    asked.floor
                )
            engine, self.symmetry = self._symmetric_engine(request), asked.symmetry
            if engine is None:
                expects_patterns = self.camera is None and asked.phase_slope is not None
                request, engine = self._plan_engine(request, expects_patterns=expects_patterns)
                self.symmetry = "none"
        self.request, self.engine = request, engine
        self._fallback_engine: PSFEngine | None = None
        self._finer: LightOnPixels | None = None
        self._known: list[_KnownLight] = []

    def _symmetric_engine(self, request: PSFRequest) -> PSFEngine | None:
        """Prepare the engine for symmetric patterns; None if there is none that suits.

        A named method is one for all patterns.
        """
        if self.camera is None or self._asked.method is not None:
            return None
        make = symmetric_engine(self._asked.symmetry, request, self.camera)
        if make is None:
            return None
        with suppress(ToleranceError):
            engine = make()
            engine.prepare()
            return engine
        return None

    def _plan_engine(
        self, request: PSFRequest, *, expects_patterns: bool, for_patterns: bool = False
    ) -> tuple[PSFRequest, PSFEngine]:
        """Prepare the cheapest engine, to a smaller tolerance if that is possible and needed.

        It is needed with derivatives, and for patterns on the points of a lens, of whose light the
        window may get less than without one. Returns the request that is kept, and its engine.

        expects_patterns: whether to leave room for such patterns.
        for_patterns: whether the engine takes any of them.
        """
        asked = self._asked
        choice = EngineChoice(
            request, self.camera, asked.method, asked.integration_error, for_patterns
        )
        shares = []
        if request.differentiable and asked.method is None:
            shares.append(_DERIVATIVE_TOL_SHARE)
        if expects_patterns:
            shares.append(_PATTERN_TOL_SHARE)
        if shares:
            pattern_tol = request.tol if expects_patterns else None
            tight = replace(request, tol=min(shares) * request.tol, pattern_tol=pattern_tol)
            with suppress(ToleranceError):
                return tight, replace(choice, request=tight).prepare_cheapest()
        return request, choice.prepare_cheapest()

    @cached_property
    def pattern_engine(self) -> PSFEngine:
        """The engine for light with a pattern.

        The first one, unless it was chosen for the symmetry of a lens, which a pattern needn't
        have. One that the caller named is kept.
        """
        if self._asked.method is not None or not isinstance(self.engine, AxialEngine):
            return self.engine
        tol = self._asked.tol - self._asked.integration_error
        request = replace(self.request, tol=tol, pattern_tol=None)
        return self._plan_engine(request, expects_patterns=True, for_patterns=True)[1]

    def compute(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: torch.Tensor | None = None,
        added: AddedLight | None = None,
    ) -> PixelLight:
        """Compute the light of a pattern.

        spectrum: of the panel with the pattern, where it is known already.
        added: tells of light that will be added to it.
        """
        peak = None
        if amplitude is not None:
            axes = self.pattern_engine.points()[0].ndim
            amplitude, peak = normalise_amplitude(amplitude, axes)
        light = self._light_on_samples(phase, amplitude, spectrum, added)
        if self.integration:
            light = self._integrate(light, added)
            left = self._asked.tol - light.error.value - light.arithmetic
            if light.integration_error > left:
                light = self._finer_light(light, left, phase, amplitude, added)
        return replace(light, values=scale_light(light.values, peak)) if peak is not None else light

    def _light_on_samples(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: torch.Tensor | None,
        added: AddedLight | None,
    ) -> PixelLight:
        """Compute the light on the samples, by another method if the first one fails."""
        plain = phase is None and amplitude is None
        engine = self.engine if plain else self.pattern_engine
        try:
            if spectrum is not None and isinstance(engine, GridEngine):
                values = engine.intensity_from_spectrum(spectrum, phase, amplitude, added)
            elif isinstance(engine, BehindPanelEngine):
                values = engine.intensity(phase, amplitude, added)
            else:
                values = engine.intensity(phase, amplitude)
        except ToleranceError:
            for other in self._other_engines():
                with suppress(ToleranceError):
                    assert isinstance(other, BehindPanelEngine)
                    values = other.intensity(phase, amplitude, added)
                    self._fallback_engine = other
                    return self._describe(values, other.used_engine)
            raise
        return self._describe(values, engine.used_engine)

    def _other_engines(self) -> Iterator[PSFEngine]:
        """Yield the engines that may stand in for a chain's first one.

        The one that was used last comes first. There are none if the caller named a method.
        """
        if self._asked.method is not None or not self._is_chain:
            return
        tried = [self.engine]
        if self._fallback_engine is not None:
            tried.append(self._fallback_engine)
            yield self._fallback_engine
        choice = EngineChoice(self.request, self.camera, None, self._asked.integration_error)
        yield from choice.prepared_others(tried)

    @property
    def _is_chain(self) -> bool:
        """Whether the panel stands apart from the lens."""
        return self.camera is not None and self.request.numeric.separation > 0

    def _describe(self, values: torch.Tensor, engine: PSFEngine) -> PixelLight:
        """Hold what an engine tells of its last call."""
        error, norm = engine.error.value + engine.arithmetic, None
        if isinstance(engine, BehindPanelEngine):
            error = engine.own_error
        if self._is_chain:
            if not self.integration:
                norm = window_norm(values.detach(), self.request.window_slices)
        elif isinstance(engine, PanelEngine):
            norm = engine.light_norm
        return PixelLight(values, engine, engine.error, engine.arithmetic, error, norm, 0.0)

    def _integrate(self, samples: PixelLight, added: AddedLight | None) -> PixelLight:
        """Integrate light over the pixels; the error is a share of the light on all samples.

        Those beside the pixels may be far brighter than the others.
        """
        assert self.integration is not None
        everywhere = (slice(None), slice(None))
        values = self.integration(samples.values)
        # Even light has this norm on the samples; any other light has a larger one there.
        seen = window_norm(values.detach(), everywhere) / math.sqrt(
            self.integration.samples_per_pixel
        )
        norm = seen if self._is_chain else samples.norm
        if added is not None and added is not UNKNOWN_LIGHT:
            seen = torch.hypot(seen, added.norm.to(seen))
        dimness = largest_ratio(window_norm(samples.values.detach(), everywhere), seen)
        error = self.integration.error * max(1.0, 1.0 + _BESIDE_FACTOR * (dimness - 1.0))
        return replace(samples, values=values, norm=norm, integration_error=error)

    def _finer_light(
        self,
        coarse: PixelLight,
        left: float,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None,
    ) -> PixelLight:
        """Compute the light with a finer integration over pixels, beside which there is much light.

        left: of the tolerance, for the integration. Raises ToleranceError if there is none.
        """
        planned, needed = self._asked.integration_error, coarse.integration_error
        finer = planned * left / needed / 2
        if self.camera is None and not (phase is None and amplitude is None):
            raise self._coarse_integration_error(finer)
        if not finer > _FINEST_PIXEL_TOL:
            least = 2.5 * _FINEST_PIXEL_TOL * needed / planned
            floor = least + 1.1 * (coarse.error.value + coarse.arithmetic)
            raise unreachable_tolerance_error(self._asked.tol, max(floor, 1.1 * self._asked.tol))
        if self._finer is None or self._finer._asked.integration_error > finer:
            self._finer = self._with_integration_to(finer)
        return self._finer.compute(phase, amplitude, None, added)

    def _with_integration_to(self, tol: float) -> LightOnPixels:
        """Plan the same with a finer integration, for patterns in the same shape."""
        other = LightOnPixels(replace(self._asked, pixel_tol=tol, symmetry=self.symmetry))
        if other.symmetry != self.symmetry:
            raise ToleranceError(f"symmetry {self.symmetry!r} has no method for these pixels")
        return other

    def _coarse_integration_error(self, finer: float) -> ToleranceError:
        """Return the refusal of a pattern on a lens' points, whose pixels need the error `finer`.

        A lens that is planned anew takes its pattern at other points, so that the caller has to.
        """
        reason = (
            f"tol {self._asked.tol:g} can't be kept: far more light lies beside the pixels than "
            "there"
        )
        if finer > _FINEST_PIXEL_TOL:
            with suppress(ToleranceError):
                self._with_integration_to(finer)
                remedy = f"plan a PSFOperator with pixel_tol={rounded_down(finer)}"
                return ToleranceError(reason, remedy)
        return ToleranceError(reason)

    def unmodulated(
        self,
        amplitude: torch.Tensor | None,
        *,
        cache_result: bool = False,
        spectrum: torch.Tensor | None = None,
        any_error: bool = False,
    ) -> PixelLight:
        """Compute light without a phase, or take what is known of it.

        cache_result: whether this very amplitude will be given again, unchanged.
        any_error: whether what a chain's first method gives is taken even if its error exceeds the
        tolerance: beside a pattern's light, errors of dim light seldom matter.
        """
        keeps = not self.request.differentiable and (amplitude is None or cache_result)
        for known in self._known if keeps else []:
            if known.amplitude is amplitude and (any_error or known.keeps_tol):
                return known.light
        added = UNKNOWN_LIGHT if any_error and self._is_chain else None
        light = self.compute(None, amplitude, spectrum, added)
        if keeps and not light.values.requires_grad:
            keeps_tol = added is None or light.own_error <= self.request.tol
            others = [one for one in self._known if one.amplitude is not amplitude]
            self._known = [*others[-1:], _KnownLight(amplitude, light, keeps_tol)]
        return light

    def knows_unmodulated(self, amplitude: torch.Tensor | None) -> bool:
        """Tell whether light without a phase is known for an amplitude."""
        return any(known.amplitude is amplitude for known in self._known)
