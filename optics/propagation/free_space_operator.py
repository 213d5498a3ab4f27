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
    select_methods,
    unreachable_tolerance_error,
)
from optics.plane import Plane
from optics.propagation.light_power import (
    field_power,
    normalise_strength,
    power_shares,
    require_finite_power,
)
from optics.propagation.method_choice import METHODS as METHODS
from optics.propagation.method_choice import methods_for_span, prepare_cheapest
from optics.propagation.propagator import Propagator
from optics.propagation.smooth_field_check import SmoothFieldCheck
from optics.propagation.span import FreeSpaceSpan, Scalar, SpanSettings
from optics.propagation.transfer_function import paraxial_phase_error
from optics.threads import in_full_precision
from optics.validation import accepts_numpy, require_unchanged_attributes, rounded_up

_MARGIN = 0.03
"""Of the tolerance, that a first plan keeps for all the light there is: it then holds for
targets that a thousandth of the light reaches."""

_TIGHT_PLAN_TOL_SHARE = 0.7
"""Of the tolerance that is left when the light on the target is known."""

_ADVISED_LIGHT_SHARE = 0.5
"""Of the light: a tolerance that is advised before a field is known is kept where as much of
it reaches the target."""

_DIM_TARGET_SHARE = 0.01
"""Share of the light below which a target is dim."""

_ADVICE_MARGIN = 1.01
"""Advice is rounded up by so much: the share of another plan's answer may be a little less."""

_EXPENSIVE_PLAN_CALLS = 100
"""Function calls that a plan may cost before a cheaper one is looked for: planning is as dear."""


class FreeSpace:
    """Propagates light from plane to plane through free space; planned once, called many times.

    Call it with a field (..., *source.shape), tensor or array. The result is the field on the
    target, (..., *target.shape), complex64 or complex128 as `tol` needs it, without the factor
    exp(i k distance). `adjoint` is its conjugate transpose. Both are differentiable in the field,
    and in distance, wavelength and the target's centre where these are 0-d tensors. Mixed
    precision (autocast) is switched off inside.

    `account` describes the plan, and the last call where that revealed more. For a smooth field in
    the paraxial model it then says what the model leaves out. For a dim target it describes the
    tighter plan, and its `cpu_predicted` is the time of all plans that the call needs.

    How much light arrives isn't known beforehand. Where the first plan's result is dimmer than its
    error allows, the same field is propagated again, by the cheapest method that keeps the
    tolerance, or by the named one. That may take many times what was predicted first. More than an
    hour is refused, unless the method is named.

    Parameters
    ----------
    source : Plane
        The plane on which the field is known.
    target : Plane
        The plane on which the field is computed.
    distance : float or 0-d torch.Tensor
        Metres from source to target; a negative distance propagates backward.
    wavelength : float or 0-d torch.Tensor
        Metres.
    tol : float, optional
        Largest relative L2 error of the complex field on the target, from sampling and arithmetic;
        1e-3 by default.
    method : str, optional
        One of METHODS. By default the cheapest that keeps `tol`.
    budget : Budget, optional
        The memory allowed, and the machine's speed.
    **settings : SpanSettings
        What else describes the propagation: `cells`, `carrier`, `band`, `tilt` and `paraxial`, with
        the meaning they have for FreeSpaceSpan.

    Attributes
    ----------
    span : FreeSpaceSpan
        The propagation as data.
    account : Account
        What a call costs and how accurate it is.

    Raises
    ------
    ValueError
        For invalid arguments. In a call, for a smooth field that its samples don't resolve, or that
        hasn't died away at their edges.
    ToleranceError
        If `tol` can't be kept; the message names the smallest tolerance that can, and the remedy.

    References
    ----------
    Thesis Eq. 2.12; J. W. Goodman, Introduction to Fourier Optics, section 3.5.
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
        select_methods(METHODS, method)
        budget = budget or Budget()
        self.span = FreeSpaceSpan(
            source, target, distance, wavelength, tol=tol, budget=budget, **settings
        )
        self._method = method
        self._model_error_estimate = _model_error(self.span)
        self._smooth_field_check = SmoothFieldCheck(self.span) if self.span.cells is None else None
        self._propagator = self._first_plan()
        self._tight_propagator: Propagator | None = None
        self.account = self._build_account(self._propagator)

    @property
    def method(self) -> str:
        """The name of the method in use."""
        return self._propagator.name

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of one call by the first plan, in seconds.

        `speed` is that of the machine. `account.cpu_predicted` includes what a dim target takes
        besides.
        """
        return self._propagator.cpu_seconds(speed)

    def _first_plan(self) -> Propagator:
        """With a margin for a target that gets a small share of the light; without, if only
        that can be kept, or if it is so much cheaper that it is worth a try."""
        speed, tol = self.span.budget.speed, self.span.tol
        plan = methods_for_span(replace(self.span, tol=_MARGIN * tol), self._method)
        if plan.seconds > _EXPENSIVE_PLAN_CALLS * speed.call:
            loose = methods_for_span(self.span, self._method)
            cheaper = 2 * loose.seconds < plan.seconds or not math.isfinite(plan.seconds)
            plan = loose if cheaper else plan
        try:
            return prepare_cheapest(plan, tol)
        except ToleranceError as error:
            if error.floor is None:
                raise
            raise unreachable_tolerance_error(
                tol, error.floor / math.sqrt(_ADVISED_LIGHT_SHARE)
            ) from error

    def _build_account(self, propagator: Propagator) -> Account:
        span = self.span
        (rows, columns), pitch = span.target.shape, span.target.pitch
        return Account(
            method=propagator.name,
            sampling=f"{propagator.sampling} to {columns}x{rows} samples of "
            f"{pitch[1] * 1e6:.3g} µm",
            precision=propagator.precision,
            tol=span.tol,
            model=self._model_error_estimate,
            sampling_error=propagator.error,
            arithmetic=ErrorEstimate(propagator.arithmetic, "bound, from tests"),
            cpu_predicted=propagator.cpu_seconds(span.budget.speed),
            bytes=propagator.bytes,
        )

    @accepts_numpy
    @in_full_precision
    def __call__(self, field: torch.Tensor) -> torch.Tensor:
        """Propagate a field (..., *source.shape) to the target, (..., *target.shape)."""
        field = self._validate_field(field, self.span.source, "field")
        self._require_unchanged()
        field, light, peak = normalise_strength(field, require_finite_power("field", field))
        if self._smooth_field_check:
            self._check_smooth_field(self._smooth_field_check, field, light)
        answer = self._propagate_within_tol(field, light * self.span.sample_area)
        return answer if peak is None else answer * peak

    def _propagate_within_tol(self, field: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """By the first plan, or by tighter ones until the tolerance is kept."""
        propagator, seconds = self._propagator, 0.0
        while True:
            answer = self._in_chunks(propagator, propagator.forward, field)
            # Of a dark target the first share is rounding: it is looked at until it holds.
            share = self._least_light_share(answer, light)
            if self._is_tolerance_kept(propagator, share):
                return answer
            seconds += propagator.cpu_seconds(self.span.budget.speed)
            propagator = self._tighter_plan(propagator, share)
            # Told before it is done, to whoever wonders what takes so long.
            account = self._build_account(propagator)
            self.account = replace(account, cpu_predicted=seconds + account.cpu_predicted)

    def _check_smooth_field(
        self, promise: SmoothFieldCheck, field: torch.Tensor, light: torch.Tensor
    ) -> None:
        """Refuse a field that isn't smooth; tell what the model leaves out of one that is."""
        spectrum = promise.checked_spectrum(field, light)
        if self.span.paraxial:
            how = "estimate: paraxial, over the field's spectrum; a scalar wave"
            self._model_error_estimate = ErrorEstimate(promise.paraxial_field_error(spectrum), how)
            self.account = replace(self.account, model=self._model_error_estimate)

    @accepts_numpy
    @in_full_precision
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose of the call, from the target's samples to the source's."""
        field = self._validate_field(field, self.span.target, "field")
        self._require_unchanged()
        field, _, peak = normalise_strength(field, require_finite_power("field", field))
        answer = self._in_chunks(self._propagator, self._propagator.adjoint, field)
        return answer if peak is None else answer * peak

    def _validate_field(self, field: torch.Tensor, plane: Plane, name: str) -> torch.Tensor:
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

    def _least_light_share(self, answer: torch.Tensor, light: torch.Tensor) -> float:
        """The least share of its light that any field brings to the target; 1 if all are dark."""
        y, x = self.span.target.pitch
        found = power_shares(field_power(answer) * (y * x), light)
        # No plan keeps a tolerance of NaN.
        return min(found, default=1.0) if all(map(math.isfinite, found)) else math.nan

    def _is_tolerance_kept(self, propagator: Propagator, share: float) -> bool:
        error = propagator.error.value + propagator.arithmetic
        return error <= self.span.tol * math.sqrt(min(share, 1.0))

    def _tighter_plan(self, last: Propagator, share: float) -> Propagator:
        """A plan that keeps the tolerance for the little light that reaches the target.

        last: the plan by which that light was found.
        """
        if self._tight_propagator is not None and self._is_tolerance_kept(
            self._tight_propagator, share
        ):
            return self._tight_propagator
        tol = self.span.tol * math.sqrt(share) * _TIGHT_PLAN_TOL_SHARE
        try:
            if not tol > 0:
                raise ToleranceError("no light at all")
            self._tight_propagator = prepare_cheapest(
                methods_for_span(replace(self.span, tol=tol), self._method), tol
            )
        except ToleranceError as error:
            raise self._dim_target_error(last, share, error) from error
        return self._tight_propagator

    def _dim_target_error(
        self, last: Propagator, share: float, why: ToleranceError
    ) -> ToleranceError:
        """The refusal for a share of the light, with the tolerance that would do.

        That is one for which a plan can be made: the floor of all plans, or what the last one
        was made for. It isn't known for an answer that is no more than the plan's error.
        """
        planned = last.span.tol if why.floor is None else why.floor
        found = math.sqrt(share) > 2 * (last.error.value + last.arithmetic)
        least = (
            _ADVICE_MARGIN * planned / (_TIGHT_PLAN_TOL_SHARE * math.sqrt(share))
            if found
            else math.inf
        )
        kept = f"tol {self.span.tol:g} can't be kept"
        if share >= _DIM_TARGET_SHARE and least < 1:
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
        if self.span.has_tensor_lengths:
            lengths = ("distance", "wavelength", "target")
            require_unchanged_attributes(
                lengths, self.span.numeric, replace(self.span).numeric, "FreeSpace"
            )


def _model_error(span: FreeSpaceSpan) -> ErrorEstimate:
    if not span.paraxial:
        return ErrorEstimate(0.0, "none beyond that of a scalar wave")
    n = span.numeric
    reach = math.hypot(*(max(map(abs, n.lateral_range(axis))) / n.distance for axis in (0, 1)))
    bands = (abs(c) + b for c, b in zip(n.carrier, n.half_bandwidths, strict=True))
    frequency = min(reach / n.wavelength, math.hypot(*bands))
    error = paraxial_phase_error(n.wavelength, n.distance, frequency)
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
    """Propagate a field from one plane to another, and return it with its account.

    It plans a FreeSpace and calls it once.

    Parameters
    ----------
    field : torch.Tensor or numpy.ndarray
        The field on the source, (..., *source.shape).
    source : Plane
        The plane on which the field is known.
    target : Plane
        The plane on which the field is computed.
    distance : float or 0-d torch.Tensor
        Metres from source to target; a negative distance propagates backward.
    wavelength : float or 0-d torch.Tensor
        Metres.
    tol : float, optional
        Largest relative L2 error of the complex field on the target, from sampling and arithmetic;
        1e-3 by default.
    method : str, optional
        One of METHODS. By default the cheapest that keeps `tol`.
    budget : Budget, optional
        The memory allowed, and the machine's speed.
    **settings : SpanSettings
        `cells`, `carrier`, `band`, `tilt` and `paraxial`, as for FreeSpaceSpan.

    Returns
    -------
    Result of torch.Tensor
        The complex field on the target, (..., *target.shape), without the factor
        exp(i k distance), and its account, with the processor time spent.

    Raises
    ------
    ValueError
        For invalid arguments, and for a smooth field that its samples don't resolve or that hasn't
        died away at their edges.
    ToleranceError
        If `tol` can't be kept.
    """
    started = time.process_time()
    operator = FreeSpace(
        source, target, distance, wavelength, tol=tol, method=method, budget=budget, **settings
    )
    value = operator(field)
    return Result(value, operator.account.with_cpu_spent(time.process_time() - started))
