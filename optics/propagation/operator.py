"""A field on one plane, wanted on another: planned once, called many times."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Unpack

import torch

from optics.accuracy import (
    Account,
    Budget,
    ErrorEstimate,
    MachineSpeed,
    Result,
    ToleranceError,
    named,
    unkeepable,
)
from optics.edge import require_same, rounded_up, tensors_inside
from optics.plane import Plane
from optics.propagation.choice import METHODS as METHODS
from optics.propagation.choice import choice_for, prepared
from optics.propagation.light import evened, finite_light, float_light, shares
from optics.propagation.propagator import Propagator
from optics.propagation.smooth import Promise
from optics.propagation.span import Scalar, Span, SpanSettings
from optics.propagation.transfer import paraxial_error
from optics.threads import in_full_precision

_MARGIN = 0.03
"""Of the tolerance, that a first plan keeps for all the light there is: it then holds for
targets that a thousandth of the light reaches."""

_SPARE = 0.7
"""Of the tolerance that is left when the light on the target is known."""

_HALF = 0.5
"""Of the light: a tolerance that is advised before a field is known is kept where as much of
it reaches the target."""

_DIM = 0.01
"""Share of the light below which a target is dim."""

_UP = 1.01
"""Advice is rounded up by so much: the share of another plan's answer may be a little less."""

_DEAR = 100
"""Function calls that a plan may cost before a cheaper one is looked for: planning is as dear."""


class FreeSpace:
    """Light from one plane to another, planned once and called many times.

    The models and the meaning of all arguments are those of optics.propagation.span.Span:
    source and target planes, distance and wavelength in metres, cells, carrier, band, tilt,
    paraxial. tol: relative L2 error of the complex field on the target, from sampling and
    arithmetic. method: one of METHODS; the cheapest that keeps tol if None. budget: memory
    allowed, and the machine's speed.

    Call with a field (..., *source.shape), tensor or array; the answer is (..., *target.shape),
    complex64 or complex128 as tol needs it, without the factor exp(i k distance). adjoint() is
    its conjugate transpose. Differentiable in the field, in distance, wavelength and the
    target's centre where these are 0-d tensors. Mixed precision (autocast) is kept out.

    account is that of the plan, and of the last call where that told more: of a smooth field in
    the paraxial model, what the model leaves out; of a dim target, the tighter plan, and in
    cpu_predicted the time of all plans that the call needs.

    How much light arrives isn't known before. Where the first plan's answer is dimmer than its
    error allows, the same field is sent again, by the cheapest method that keeps the tolerance,
    or by the named one: that may take many times what was predicted first. More than an hour is
    refused, unless the method is named.

    Raises ValueError for a smooth field that its samples don't resolve, or that hasn't died
    away at their edges; ToleranceError if tol can't be kept, with the floor and the remedy.
    """

    def __init__(
        self,
        source: Plane,
        target: Plane,
        distance: Scalar,
        wavelength: Scalar,
        *,
        tol: float = 1e-3,
        method: str | None = None,
        budget: Budget | None = None,
        **settings: Unpack[SpanSettings],
    ) -> None:
        if not 0 < tol < math.inf:
            raise ValueError(f"tol is {tol:g}; it must be positive, as 1e-3")
        named(METHODS, method)
        budget = budget or Budget()
        self.span = Span(source, target, distance, wavelength, tol=tol, budget=budget, **settings)
        self._method = method
        self._model = _model_error(self.span)
        self._promise = Promise(self.span) if self.span.cells is None else None
        self._propagator = self._first_plan()
        self._twin: Propagator | None = None
        self.account = self._accounted(self._propagator)

    @property
    def method(self) -> str:
        """The name of the method in use."""
        return self._propagator.name

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predicted processor time of one call by the first plan, on a machine of such a speed;
        account.cpu_predicted has what a dim target takes besides."""
        return self._propagator.cpu_seconds(speed)

    def _first_plan(self) -> Propagator:
        """With a margin for a target that gets a small share of the light; without, if only
        that can be kept, or if it is so much cheaper that it is worth a try."""
        speed, tol = self.span.budget.speed, self.span.tol
        plan = choice_for(replace(self.span, tol=_MARGIN * tol), self._method)
        if plan.seconds > _DEAR * speed.call:
            loose = choice_for(self.span, self._method)
            cheaper = 2 * loose.seconds < plan.seconds or not math.isfinite(plan.seconds)
            plan = loose if cheaper else plan
        try:
            return prepared(plan, tol)
        except ToleranceError as error:
            if error.floor is None:
                raise
            raise unkeepable(tol, error.floor / math.sqrt(_HALF)) from error

    def _accounted(self, propagator: Propagator) -> Account:
        span = self.span
        (rows, columns), pitch = span.target.shape, span.target.pitch
        return Account(
            method=propagator.name,
            sampling=f"{propagator.sampling} to {columns}x{rows} samples of "
            f"{pitch[1] * 1e6:.3g} µm",
            precision=propagator.precision,
            tol=span.tol,
            model=self._model,
            sampling_error=propagator.error,
            arithmetic=ErrorEstimate(propagator.arithmetic, "bound, from tests"),
            cpu_predicted=propagator.cpu_seconds(span.budget.speed),
            bytes=propagator.bytes,
        )

    @tensors_inside
    @in_full_precision
    def __call__(self, field: torch.Tensor) -> torch.Tensor:
        field = self._checked(field, self.span.source, "field")
        self._require_unchanged()
        field, light, peak = evened(field, finite_light("field", field))
        if self._promise:
            self._look_at(self._promise, field, light)
        answer = self._sent(field, light * self.span.area)
        return answer if peak is None else answer * peak

    def _sent(self, field: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """By the first plan, or by tighter ones until the tolerance is kept."""
        propagator, seconds = self._propagator, 0.0
        while True:
            answer = self._in_chunks(propagator, propagator.forward, field)
            # Of a dark target the first share is rounding: it is looked at until it holds.
            share = self._share(answer, light)
            if self._kept_by(propagator, share):
                return answer
            seconds += propagator.cpu_seconds(self.span.budget.speed)
            propagator = self._tighter(propagator, share)
            # Told before it is done, to whoever wonders what takes so long.
            account = self._accounted(propagator)
            self.account = replace(account, cpu_predicted=seconds + account.cpu_predicted)

    def _look_at(self, promise: Promise, field: torch.Tensor, light: torch.Tensor) -> None:
        """Refuse a field that isn't smooth; tell what the model leaves out of one that is."""
        spectrum = promise.kept(field, light)
        if self.span.paraxial:
            how = "estimate: paraxial, over the field's spectrum; a scalar wave"
            self._model = ErrorEstimate(promise.paraxial_shortfall(spectrum), how)
            self.account = replace(self.account, model=self._model)

    @tensors_inside
    @in_full_precision
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """The conjugate transpose of the call: from the target's samples to the source's."""
        field = self._checked(field, self.span.target, "field")
        self._require_unchanged()
        field, _, peak = evened(field, finite_light("field", field))
        answer = self._in_chunks(self._propagator, self._propagator.adjoint, field)
        return answer if peak is None else answer * peak

    def _checked(self, field: torch.Tensor, plane: Plane, name: str) -> torch.Tensor:
        if tuple(field.shape[-2:]) != plane.shape:
            raise ValueError(f"{name} is {tuple(field.shape)}; its plane has {plane.shape} samples")
        return field if field.is_complex() else field.to(torch.complex128)

    def _in_chunks(
        self,
        propagator: Propagator,
        function: Callable[[torch.Tensor], torch.Tensor],
        field: torch.Tensor,
    ) -> torch.Tensor:
        """As many fields at a time as the memory holds."""
        together = max(self.span.budget.memory // propagator.bytes, 1)
        batch = field.shape[:-2]
        if math.prod(batch) <= together:
            return function(field).resolve_conj()
        flat = field.reshape(-1, *field.shape[-2:])
        parts = [function(part) for part in torch.split(flat, together)]
        done = torch.cat(parts).resolve_conj()
        return done.reshape(*batch, *done.shape[-2:])

    def _share(self, answer: torch.Tensor, light: torch.Tensor) -> float:
        """The least share of its light that any field brings to the target; 1 if all are dark."""
        y, x = self.span.target.pitch
        found = shares(float_light(answer) * (y * x), light)
        # No plan keeps a tolerance of NaN.
        return min(found, default=1.0) if all(map(math.isfinite, found)) else math.nan

    def _kept_by(self, propagator: Propagator, share: float) -> bool:
        error = propagator.error.value + propagator.arithmetic
        return error <= self.span.tol * math.sqrt(min(share, 1.0))

    def _tighter(self, last: Propagator, share: float) -> Propagator:
        """A plan that keeps the tolerance for the little light that reaches the target.

        last: the plan by which that light was found.
        """
        if self._twin is not None and self._kept_by(self._twin, share):
            return self._twin
        tol = self.span.tol * math.sqrt(share) * _SPARE
        try:
            if not tol > 0:
                raise ToleranceError("no light at all")
            self._twin = prepared(choice_for(replace(self.span, tol=tol), self._method), tol)
        except ToleranceError as error:
            raise self._too_dim(last, share, error) from error
        return self._twin

    def _too_dim(self, last: Propagator, share: float, why: ToleranceError) -> ToleranceError:
        """The refusal for a share of the light, with the tolerance that would do.

        That is one for which a plan can be made: the floor of all plans, or what the last one
        was made for. It isn't known for an answer that is no more than the plan's error.
        """
        planned = last.span.tol if why.floor is None else why.floor
        found = math.sqrt(share) > 2 * (last.error.value + last.arithmetic)
        least = _UP * planned / (_SPARE * math.sqrt(share)) if found else math.inf
        kept = f"tol {self.span.tol:g} can't be kept"
        if share >= _DIM and least < 1:
            return ToleranceError(
                f"{kept} on a target that {share:.2g} of the light reaches; ask for tol "
                f"{rounded_up(least)} or more"
            )
        advice = f", or for tol {rounded_up(least)} or more" if least < 1 else ""
        return ToleranceError(
            f"{kept}: hardly any light reaches the target, a share of "
            f"{'' if found else 'at most '}{share:.2g}; ask for a target that is larger or "
            f"nearer to the light{advice}"
        )

    def _require_unchanged(self) -> None:
        """Raise ValueError if a tensor has got another value since the plan was made."""
        if self.span.changeable:
            lengths = ("distance", "wavelength", "target")
            require_same(lengths, self.span.numeric, replace(self.span).numeric, "FreeSpace")


def _model_error(span: Span) -> ErrorEstimate:
    if not span.paraxial:
        return ErrorEstimate(0.0, "none beyond that of a scalar wave")
    n = span.numeric
    reach = math.hypot(*(max(map(abs, n.lateral(axis))) / n.distance for axis in (0, 1)))
    bands = (abs(c) + b for c, b in zip(n.carrier, n.bands, strict=True))
    frequency = min(reach / n.wavelength, math.hypot(*bands))
    error = paraxial_error(n.wavelength, n.distance, frequency)
    return ErrorEstimate(min(1.0, error), "estimate: paraxial, the steepest rays; a scalar wave")


def propagate(
    field: torch.Tensor,
    source: Plane,
    target: Plane,
    distance: Scalar,
    wavelength: Scalar,
    *,
    tol: float = 1e-3,
    method: str | None = None,
    budget: Budget | None = None,
    **settings: Unpack[SpanSettings],
) -> Result[torch.Tensor]:
    """The field on the target, with its account; plans a FreeSpace and calls it once."""
    started = time.process_time()
    operator = FreeSpace(
        source, target, distance, wavelength, tol=tol, method=method, budget=budget, **settings
    )
    value = operator(field)
    return Result(value, operator.account.spent(time.process_time() - started))
