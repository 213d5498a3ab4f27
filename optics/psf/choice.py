"""Choose the cheapest engine that keeps the tolerance of a request, or tell what would."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

from optics.accuracy import (
    MethodChoice,
    ToleranceError,
    select_methods,
    unreachable_tolerance_error,
)
from optics.camera import Camera
from optics.plane import Plane
from optics.psf.axial import AxialEngine
from optics.psf.chain_choice import CHAIN_METHODS, chain_engines
from optics.psf.engine import PSFEngine
from optics.psf.lens_nodes import ScatteredNodesEngine
from optics.psf.panel_engine import PanelEngine
from optics.psf.panel_methods import PANEL_METHODS
from optics.psf.reference_probe import ReferenceProbe
from optics.psf.request import PSFRequest
from optics.psf.sampled import SampledEngine
from optics.validation import rounded_up

METHODS = ("axial", "scattered", "sampled")
"""Names of the methods for a lens alone. Behind a panel the methods are Fourier transforms."""

# Radians in a lens' wave beyond which numbers of nodes are no exact doubles; nobody can sum so
# many.
_COUNTABLE_TURN = 1e15

# Room in a tolerance that is advised for a panel apart from its lens: a window that gets a
# twentieth to a tenth of an even panel's light is then bright enough.
_DIM_ROOM = 10.0

# Seconds that trying out whether a method keeps a tolerance may take; beyond, its plan counts.
_LONGEST_TRIAL = 0.2


def require_method(method: str | None, camera: Camera | None) -> None:
    """Raise ValueError for a name that isn't a method of the lens, or of the camera's chain."""
    if camera is None:
        select_methods(METHODS, method, "a lens")
    elif camera.separation:
        select_methods(CHAIN_METHODS + PANEL_METHODS, method, "a panel apart from its lens")


@dataclass(frozen=True)
class EngineChoice:
    """Chooses the cheapest engine that keeps the tolerance of a request.

    camera: None for a lens alone.
    method: the only one that may serve; None for any.
    reserved_tol: part of the caller's tolerance that the request's tolerance doesn't include.
    for_patterns: whether the engine must take any pattern, also one without the lens' symmetry; a
    method that is named is taken as it is.
    """

    request: PSFRequest
    camera: Camera | None
    method: str | None
    reserved_tol: float
    for_patterns: bool = False

    def prepare_cheapest(self) -> PSFEngine:
        """Prepare the cheapest method that keeps the tolerance and fits the memory.

        Raises ToleranceError, whose message names a tolerance that can be kept or another remedy.
        """
        choice = self._sorted_methods()
        for engine in choice.prepared_candidates():
            engine.earlier_seconds = choice.wasted_seconds
            return engine
        refusal = choice.refusal(self.request.tol + self.reserved_tol)
        if not isinstance(refusal, ToleranceError):
            raise refusal
        if refusal.floor is not None:
            refusal = self.refusal_with_tolerance(refusal.floor + self.reserved_tol)
            if refusal.floor is not None:
                raise refusal
        raise self._refusal_with_remedies(refusal)

    def prepared_others(self, tried_engines: Iterable[PSFEngine]) -> Iterator[PSFEngine]:
        """Yield further methods that keep the tolerance, the cheapest first.

        Each is prepared just before it is yielded.
        """
        return self._sorted_methods(tried_engines).prepared_candidates()

    def _sorted_methods(self, tried_engines: Iterable[PSFEngine] = ()) -> MethodChoice[PSFEngine]:
        """Sort the methods that may serve and weren't tried yet."""
        tried = {one.name for one in tried_engines}
        return MethodChoice(
            [make for name, make in self._engine_factories().items() if name not in tried],
            self.request.budget,
            "a PSF",
            remedy="ask for fewer pixels, or bring the object closer to the plane in focus",
        )

    def _engine_factories(self) -> dict[str, Callable[[], PSFEngine]]:
        """Return, by name, a function that makes the engine, for each method that may serve."""
        request, camera, method = self.request, self.camera, self.method
        if camera is not None and camera.separation:
            return chain_engines(request, camera, method)
        if camera is not None:
            return {"panel": partial(PanelEngine, request, camera, transform=method)}
        _require_countable_turns(request)
        probe = ReferenceProbe(request)
        makers: dict[str, Callable[[], PSFEngine]] = {
            "axial": partial(AxialEngine, request),
            "scattered": partial(ScatteredNodesEngine, request, probe),
        }
        if method or request.tol >= SampledEngine.MIN_TOLERANCE:
            makers["sampled"] = partial(SampledEngine, request, probe)
        if self.for_patterns and method is None:
            del makers["axial"]
        return {name: makers[name] for name in select_methods(makers, method)}

    def refusal_with_tolerance(self, floor: float) -> ToleranceError:
        """Return a ToleranceError that names a tolerance, `floor` or above, that can be kept.

        An engine plans anew for another tolerance and can't predict exactly which error remains. So
        the candidate tolerances are tested, by planning. For a panel apart from its lens, the named
        tolerance leaves room for patterns that send less light into the window than an even panel,
        if possible. Planning takes a tenth of a second, so the search bisects: an engine that keeps
        one tolerance also keeps a larger one.
        """
        promised = self.request.tol + self.reserved_tol
        if math.isnan(promised):
            return unreachable_tolerance_error(promised, floor)
        candidates = list(_candidate_tolerances(floor))
        for room in self._rooms:

            def can_keep(tol: float, room: float = room) -> bool:
                """Tell whether `tol` can be kept, and `tol / room`."""
                asked = {(tol - self.reserved_tol) / part for part in (room, 1.0)}
                return all(self._can_keep(replace(self.request, tol=one)) for one in asked)

            # A floor that is known to hold for a lens mostly does.
            first = 0 if room == 1 and candidates and can_keep(candidates[0]) else None
            if first is None:
                first = bisect_left(candidates, True, key=can_keep)
            if first < len(candidates):
                return unreachable_tolerance_error(promised, candidates[first])
        return unreachable_tolerance_error(promised, math.inf)

    def _refusal_with_remedies(self, refusal: ToleranceError) -> ToleranceError:
        """Return a refusal with the remedies that were found to help, or with none."""
        found = []
        for tries in _remedies(self.request.numeric, self.reserved_tol, refusal):
            for words, other in tries:
                tighter = (replace(other, tol=other.tol / room) for room in self._rooms)
                if all(map(self._can_keep, tighter)):
                    found.append(words)
                    break
            # Planning takes about a tenth of a second: two remedies are enough.
            if len(found) == 2:
                break
        told = ToleranceError(refusal.reason, ", or ".join(found))
        told.needed_bytes, told.needed_seconds = refusal.needed_bytes, refusal.needed_seconds
        return told

    @property
    def _rooms(self) -> tuple[float, ...]:
        """The rooms in a tolerance that advice tries, the largest first.

        Behind a panel apart from its lens, a pattern may leave the window little of the light.
        """
        apart = self.camera is not None and self.camera.separation
        return (_DIM_ROOM, 1.0) if apart else (1.0,)

    def _can_keep(self, request: PSFRequest) -> bool:
        """Tell whether any method predicts that it keeps another request's tolerance.

        A method that has to measure its error is tried if that is soon done.
        """
        for one in replace(self, request=request)._sorted_methods().candidates:
            error = getattr(one, "error", None)
            if error is not None:
                if error.value + one.arithmetic <= request.tol:
                    return True
            elif one.planning_seconds(request.budget.speed) > _LONGEST_TRIAL:
                return True
            else:
                with suppress(ToleranceError):
                    one.prepare()
                    return True
        return False


def _require_countable_turns(request: PSFRequest) -> None:
    """Raise ToleranceError if a lens' wave turns faster than samples can be counted."""
    bound = request.numeric.phase_slope_bound
    steepest = max(bound.largest_slope(1.0), bound.azimuthal(1.0))
    if steepest < _COUNTABLE_TURN:
        return
    raise ToleranceError(
        f"tol {request.tol:g} can't be kept: the wave turns by {steepest:.2g} rad across the stop "
        "towards the farthest pixel; check the units of the lens, the distance and the pixels "
        "(all are metres), and ask for pixels nearer to the axis"
    )


def _candidate_tolerances(floor: float) -> Iterator[float]:
    """Yield rounded tolerances from `floor` up to 1, in growing steps."""
    step = 1.0
    while floor < 1:
        yield float(rounded_up(floor))
        step = min(2.0, step + 0.125)
        floor *= step


_TOLERANCES = (10.0, 100.0, 1000.0, 1e4, 1e6)  # multiples of the tolerance that are tried

_SMALLER = (2, 4, 16)  # divisors of the window's sides that are tried

_NEARER = (0.5, 0.1, 0.0)  # shares of the defocus at which the object is tried

_MEMORY = (1.05, 2.0, 4.0)  # multiples of the memory that a method needs at least, which are tried

Tries = Iterator[tuple[str, PSFRequest]]


def _remedies(q: PSFRequest, reserved_tol: float, refusal: ToleranceError) -> tuple[Tries, ...]:
    """Return what may help against a refusal, in words and as requests to try."""
    return (
        _more_memory(q, refusal.needed_bytes),
        _more_time(q, refusal.needed_seconds),
        _nearer_object(q),
        _larger_tolerance(q, reserved_tol),
        _smaller_window(q),
        _window_at_the_image(q),
    )


def _larger_tolerance(q: PSFRequest, reserved_tol: float) -> Tries:
    """Yield larger tolerances below 1."""
    for factor in _TOLERANCES:
        tol = float(rounded_up(factor * (q.tol + reserved_tol)))
        if tol < 1:
            yield f"ask for tol {tol:g} or more", replace(q, tol=tol - reserved_tol)


def _more_memory(q: PSFRequest, needed: int | None) -> Tries:
    """Yield larger budgets of memory."""
    for factor in _MEMORY if needed else ():
        memory = math.ceil(factor * (needed or 0) / 1e6) * 1_000_000
        words = f"allow more memory: {memory // 1_000_000} MB"
        yield words, replace(q, budget=replace(q.budget, memory=memory))


def _more_time(q: PSFRequest, needed: float | None) -> Tries:
    """Yield a larger budget of processor time, where it's less than a day."""
    if needed and 1.1 * needed < 86400:
        seconds = float(rounded_up(1.1 * needed))
        yield (
            f"allow more time: {seconds:g} s",
            replace(q, budget=replace(q.budget, seconds=seconds)),
        )


def _smaller_window(q: PSFRequest) -> Tries:
    """Yield smaller windows about the same centre."""
    plane = q.samples
    sides = [
        (n - 2 * margin) * pitch / (pixel or pitch)
        for n, margin, pitch, pixel in zip(plane.shape, q.margin, plane.pitch, q.pixel, strict=True)
    ]
    for divisor in _SMALLER:
        rows, columns = (math.floor(side / divisor) for side in sides)
        if min(rows, columns) < 1:
            return
        shape = tuple(
            min(n, 2 * margin + math.ceil((n - 2 * margin) / divisor))
            for n, margin in zip(plane.shape, q.margin, strict=True)
        )
        smaller = Plane((shape[0], shape[1]), plane.pitch, plane.centre)
        words = f"ask for fewer pixels: {rows} x {columns} about the same centre"
        yield words, replace(q, samples=smaller)


def _nearer_object(q: PSFRequest) -> Tries:
    """Yield distances of the object that are closer to the plane in focus."""
    focus = q.lens.focus_distance - q.separation
    if not focus > 0 or q.sphere is not None or q.distance == focus:
        return
    for share in _NEARER:
        vergence = 1 / focus + share * (1 / q.distance - 1 / focus)
        distance = float(f"{1 / vergence:.3g}") if vergence > 0 else math.inf
        words = f"bring the object closer to the plane in focus, to {distance:g} m"
        yield words, replace(q, distance=distance)


def _window_at_the_image(q: PSFRequest) -> Tries:
    """Yield a window around the image of the point, if the one asked for lies elsewhere."""
    if any(q.samples.centre):
        yield (
            "ask for pixels around the point's image",
            replace(q, samples=Plane(q.samples.shape, q.samples.pitch)),
        )
