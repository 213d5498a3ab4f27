"""Propagate a field from one plane to another by an operator that is planned once."""

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
    limit_planning_time,
    plan_budget,
    select_methods,
    unreachable_tolerance_error,
)
from optics.plane import Plane
from optics.propagation.method_choice import METHODS as METHODS
from optics.propagation.method_choice import methods_for_span, prepare_cheapest
from optics.propagation.propagator import Propagator
from optics.propagation.smooth_field import (
    SmoothFieldCheck,
    field_power,
    normalise_strength,
    power_shares,
)
from optics.propagation.span import FreeSpaceSpan, Scalar, SpanSettings
from optics.propagation.transfer_function import paraxial_phase_error
from optics.threads import in_full_precision
from optics.validation import accepts_numpy, require_unchanged_attributes, rounded_up

# What follows sets how FreeSpace chooses its plans and which tolerance it advises; all is chosen.

# Share of the tolerance that the first plan keeps, relative to all light of the source. The
# tolerance on the target then holds if a thousandth of the light reaches it.
_FIRST_PLAN_TOL_SHARE = 0.03

# Largest errors from rounding and from sampling that the first plan keeps, relative to all light
# of the source, where that takes little more time. It hardly takes more where it needs no double
# precision, and a small error can be told of a dim target.
_FINE_ROUNDING, _FINE_SAMPLING = 3e-6, 3e-8

# Largest error from rounding that takes double precision, and the largest error from sampling
# that the first plan then keeps. A second plan would take longer.
_SINGLE_ROUNDING, _FINEST_SAMPLING = 1.5e-6, 3e-10

# Times as long that planning and all calls may take for a fine first plan, and for a margin for
# dim targets at all.
_WORTH_FINE, _WORTH_DIM = 1.7, 2.0

# Share of the tolerance that a second plan keeps, once the light on the target is known.
_TIGHT_PLAN_TOL_SHARE = 0.7

# Share of the light that must reach the target for an advised tolerance to hold, where the advice
# is given before a field is known.
_ADVISED_LIGHT_SHARE = 0.5

_DIM_TARGET_SHARE = 0.01  # share of the light below which a target counts as dim

# Factor on an advised tolerance, because another plan may find slightly less light.
_ADVICE_MARGIN = 1.01

# Cost of a plan, in function calls, above which a cheaper plan is looked for. Planning itself
# costs about as much.
_EXPENSIVE_PLAN_CALLS = 100

# Processor time of choosing a method, and of checking and rescaling a field at each call, in
# function calls.
_CHOICE_CALLS, _OVERHEAD_CALLS = 4, 2


class FreeSpace:
    """Propagate light from plane to plane through free space; plan once, call many times.

    Call it with a field ``(..., *source.shape)``, tensor or array. The result is the field on the
    target, ``(..., *target.shape)``, complex64 or complex128 as `tol` needs it, without the factor
    exp(i k distance). `adjoint` is its conjugate transpose. Both are differentiable in the field,
    and in distance, wavelength and the target's centre where these are 0-d tensors. Mixed
    precision (autocast) is switched off inside.

    `account` describes the plan. A call updates it: its errors are then relative to the light that
    reached the target. For a smooth field in the paraxial model, it contains the error of that
    model for this field. For a dim target, it describes the tighter plan, and its `cpu_predicted`
    is the time of all plans that the call needs.

    The light that reaches the target isn't known before the call. Where the first plan's result is
    dimmer than its error allows, the same field is propagated again, by the cheapest method that
    keeps the tolerance, or by the named one. That may take many times the time that was predicted
    first. A plan that takes more time than the budget allows is refused.

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
    calls : int, optional
        How often the operator will be called: the method is chosen for the least time of planning
        and all calls together. That of the budget by default, 100.
    budget : Budget, optional
        The memory and processor time allowed, and the machine's speed.
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
        calls: int | None = None,
        budget: Budget | None = None,
        **settings: Unpack[SpanSettings],
    ) -> None:
        if not 0 < tol < math.inf:
            raise ValueError(f"tol is {tol:g}; it must be positive, as 1e-3")
        select_methods(METHODS, method)
        budget = plan_budget(budget, calls)
        self.span = FreeSpaceSpan(
            source, target, distance, wavelength, tol=tol, budget=budget, **settings
        )
        self._method = method
        self._model_error_estimate = _model_error(self.span)
        self._smooth_field_check = SmoothFieldCheck(self.span) if self.span.cells is None else None
        with limit_planning_time(budget.seconds):
            self._propagator = self._first_plan()
        self._tight_propagator: Propagator | None = None
        self._lost_share = 0.0
        self.account = self._build_account(self._propagator)

    @property
    def method(self) -> str:
        """The name of the method in use."""
        return self._propagator.name

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of a call by the first plan at a machine's speed, in seconds.

        For a dim target, `account.cpu_predicted` includes the time of the tighter plans as well.
        """
        return self._call_seconds(self._propagator, speed)

    def _call_seconds(self, propagator: Propagator, speed: MachineSpeed) -> float:
        """Predict the processor time of a call by a plan, with the checks of its field."""
        check = self._smooth_field_check
        checking = check.cpu_seconds(speed) if check else 0.0
        overhead = _OVERHEAD_CALLS * speed.call
        return propagator.cpu_seconds(speed) + overhead + checking

    def _first_plan(self) -> Propagator:
        """Plan with a margin for a target that a small share of the light reaches.

        It is dropped if no method keeps it, or if a plan without it is much cheaper.
        """
        tol = self.span.tol
        dim = _FIRST_PLAN_TOL_SHARE * tol
        rounding = min(dim, _FINE_ROUNDING)
        needs_double = rounding < _SINGLE_ROUNDING
        finest = _FINEST_SAMPLING if needs_double else _FINE_SAMPLING
        fine = replace(self.span, tol=rounding, finest_sampling=finest)
        plan = methods_for_span(fine, self._method)
        for looser, times in ((dim, _WORTH_FINE), (tol, _WORTH_DIM)):
            if plan.seconds <= _EXPENSIVE_PLAN_CALLS * self.span.budget.speed.call:
                break
            loose = methods_for_span(replace(self.span, tol=looser), self._method)
            cheaper = times * loose.total_seconds < plan.total_seconds
            plan = loose if cheaper or not math.isfinite(plan.seconds) else plan
        try:
            return prepare_cheapest(plan, tol)
        except ToleranceError as error:
            if error.floor is None:
                raise
            raise unreachable_tolerance_error(
                tol, error.floor / math.sqrt(_ADVISED_LIGHT_SHARE)
            ) from error

    def _build_account(self, propagator: Propagator, share: float = 1.0) -> Account:
        """Build the account for a target that gets a share of the source's light."""
        span, planned, speed = self.span, propagator.error, self.span.budget.speed
        sampling, arithmetic = _errors_on_target(propagator, share)
        sampling += math.sqrt(self._lost_share) * _spread(propagator, share)
        how = planned.how if share == 1 else f"{planned.how}, for the light on the target"
        if self._lost_share:
            how = f"{how}; estimate for light beyond the field's band and edges"
        check = self._smooth_field_check
        planning = check.planning_seconds(speed) if check else 0.0
        plans = 0.0
        for plan in (self._propagator, self._tight_propagator):
            if plan is not None:
                plans += plan.planning_seconds(speed) + _CHOICE_CALLS * speed.call
        (rows, columns), pitch = span.target.shape, span.target.pitch
        return Account(
            method=propagator.name,
            sampling=f"{propagator.sampling} to {columns}x{rows} samples of "
            f"{pitch[1] * 1e6:.3g} µm",
            precision=propagator.precision,
            tol=span.tol,
            model=self._model_error_estimate,
            sampling_error=ErrorEstimate(sampling, how),
            arithmetic=ErrorEstimate(arithmetic, "estimate, from tests"),
            cpu_predicted=self._call_seconds(propagator, speed),
            planning_predicted=planning + plans,
            bytes=propagator.bytes,
        )

    @accepts_numpy
    @in_full_precision
    def __call__(self, field: torch.Tensor) -> torch.Tensor:
        """Compute the field on the target, ``(..., *target.shape)``.

        field: that on the source, ``(..., *source.shape)``.
        """
        field, light, peak = self._checked_field(field, self.span.source)
        check = self._smooth_field_check
        if check:
            spectrum, self._lost_share = check.checked_spectrum(field, light)
            if self.span.paraxial:
                how = "estimate: paraxial, over the field's spectrum; a scalar wave"
                self._model_error_estimate = ErrorEstimate(
                    check.paraxial_field_error(spectrum), how
                )
                self.account = replace(self.account, model=self._model_error_estimate)
        answer = self._propagate_within_tol(field, light * self.span.sample_area)
        return answer if peak is None else answer * peak

    def _propagate_within_tol(self, field: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """Use the first plan, then tighter plans until the tolerance is kept."""
        propagator, seconds, tol = self._propagator, 0.0, self.span.tol
        y, x = self.span.target.pitch
        while True:
            # As many fields at a time as the memory holds.
            together = max(self.span.budget.memory // propagator.bytes, 1)
            answer = _apply_in_chunks(propagator.forward, field, together)
            # On a dark target the first share consists of rounding errors, so the loop goes on
            # until the error of a plan suits the share that it finds.
            found = power_shares(field_power(answer) * (y * x), light)
            # The least of a batch, where a dark field doesn't count. NaN ends the search for a
            # plan, because no plan keeps such a tolerance.
            share = min(found, default=1.0) if all(map(math.isfinite, found)) else math.nan
            if sum(_errors_on_target(propagator, share)) <= tol:
                break
            seconds += propagator.cpu_seconds(self.span.budget.speed)
            propagator = self._tighter_plan(propagator, share)
            # The account is updated first, so that it explains a long call while it runs.
            account = self._build_account(propagator)
            self.account = replace(account, cpu_predicted=seconds + account.cpu_predicted)
        account = self._build_account(propagator, share)
        self.account = replace(account, cpu_predicted=seconds + account.cpu_predicted)
        if account.error > tol:
            raise ToleranceError(
                f"tol {tol:g} can't be kept on a target that {share:.2g} of the light "
                f"reaches: as much as {self._lost_share:.2g} of the field's light lies outside "
                "carrier ± band or at the source's edges. Sample it finer, on a larger plane, or "
                f"ask for tol {rounded_up(account.error)} or more"
            )
        return answer

    @accepts_numpy
    @in_full_precision
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose, from target to source samples."""
        field, _, peak = self._checked_field(field, self.span.target)
        together = max(self.span.budget.memory // self._propagator.bytes, 1)
        answer = _apply_in_chunks(self._propagator.adjoint, field, together)
        return answer if peak is None else answer * peak

    def _checked_field(
        self, field: torch.Tensor, plane: Plane
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Check a field on a plane, and return what normalise_strength() makes of it.

        Raises ValueError for other samples than the plane's, values that aren't finite, or if a
        tensor length of the span changed after planning.
        """
        if tuple(field.shape[-2:]) != plane.shape:
            raise ValueError(f"field is {tuple(field.shape)}; its plane has {plane.shape} samples")
        field = field if field.is_complex() else field.to(torch.complex128)
        if self.span.has_tensor_lengths:
            lengths = ("distance", "wavelength", "target")
            require_unchanged_attributes(
                lengths, self.span.numeric, replace(self.span).numeric, "FreeSpace"
            )
        return normalise_strength(field)

    def _tighter_plan(self, last: Propagator, share: float) -> Propagator:
        """Return a plan that keeps the tolerance on a dim target.

        last: the plan that found the target's light, a share of the source's.
        """
        tight = self._tight_propagator
        if tight is not None and sum(_errors_on_target(tight, share)) <= self.span.tol:
            return tight
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
        """Return a ToleranceError for a dim target that names the least tolerance.

        That follows from the floor of all plans, or from the tolerance that the last plan kept. It
        isn't known where the result is no larger than the plan's error.
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


def _apply_in_chunks(
    function: Callable[[torch.Tensor], torch.Tensor], field: torch.Tensor, together: int
) -> torch.Tensor:
    """Apply a function to a batch of fields, `together` at a time."""
    batch = field.shape[:-2]
    if math.prod(batch) <= together:
        return function(field).resolve_conj()
    flat = field.reshape(-1, *field.shape[-2:])
    done = torch.cat([function(part) for part in torch.split(flat, together)]).resolve_conj()
    return done.reshape(*batch, *done.shape[-2:])


def _errors_on_target(propagator: Propagator, share: float) -> tuple[float, float]:
    """Return a plan's errors from sampling and from rounding, relative to the target's light.

    share: that of the source's light on the target; NaN if unknown.
    """
    dimness = math.sqrt(min(share, 1.0))
    if dimness == 0:
        return math.inf, math.inf
    return propagator.error.value / dimness, propagator.arithmetic * _spread(propagator, share)


def _spread(propagator: Propagator, share: float) -> float:
    """Return how much larger a field's noise is on the target than in all its light.

    It spreads as rounding errors do. share: the share of the light on the target.
    """
    return max(math.sqrt(propagator.rounding_share / min(share, 1.0)), 1.0)


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
    """Plan a FreeSpace operator, call it once, and return the field with its account.

    Parameters
    ----------
    field : torch.Tensor or numpy.ndarray
        The field on the source, ``(..., *source.shape)``.
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
        The memory and processor time allowed, and the machine's speed.
    **settings : SpanSettings
        `cells`, `carrier`, `band`, `tilt` and `paraxial`, as for FreeSpaceSpan.

    Returns
    -------
    Result of torch.Tensor
        The complex field on the target, ``(..., *target.shape)``, without the factor
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
        source,
        target,
        distance,
        wavelength,
        tol=tol,
        method=method,
        calls=1,
        budget=budget,
        **settings,
    )
    value = operator(field)
    return Result(value, operator.account.with_cpu_spent(time.process_time() - started))
