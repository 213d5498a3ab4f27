"""Try remedies for a PSF that is refused, and tell those that help.

A remedy is tried by planning: nothing large is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

from optics.accuracy import ToleranceError
from optics.plane import Plane
from optics.psf_engines.request import PSFRequest
from optics.validation import rounded_up

_TOLERANCES = (10.0, 100.0, 1000.0, 1e4, 1e6)
"""Multiples of the tolerance that are tried."""

_SMALLER = (2, 4, 16)
"""Divisors of the window's sides that are tried."""

_NEARER = (0.5, 0.1, 0.0)
"""Shares of the defocus at which the object is tried."""

_MEMORY = (1.05, 2.0, 4.0)
"""Multiples of the memory that a method needs at least, which are tried."""

CanKeep = Callable[[PSFRequest], bool]


def refusal_with_remedies(
    refusal: ToleranceError, request: PSFRequest, reserved_tol: float, can_keep: CanKeep
) -> ToleranceError:
    """Return a PSF's refusal with the remedies that were found to help, or with none.

    can_keep: tells by planning whether a request can be met. reserved_tol: part of the caller's
    tolerance that the request's doesn't include.
    """
    request = request.numeric
    remedies = (
        _more_memory(request, refusal.needed_bytes),
        _more_time(request, refusal.needed_seconds),
        _nearer_object(request),
        _larger_tolerance(request, reserved_tol),
        _smaller_window(request),
        _window_at_the_image(request),
    )
    found = []
    for tries in remedies:
        # Planning takes about a tenth of a second: two remedies are enough.
        words = next((words for words, other in tries if can_keep(other)), None)
        found += [words] if words else []
        if len(found) == 2:
            break
    told = ToleranceError(refusal.reason, ", or ".join(found))
    told.needed_bytes, told.needed_seconds = refusal.needed_bytes, refusal.needed_seconds
    return told


Tries = Iterator[tuple[str, PSFRequest]]


def _larger_tolerance(q: PSFRequest, reserved_tol: float) -> Tries:
    """Yield a PSF's larger tolerances below 1."""
    for factor in _TOLERANCES:
        tol = float(rounded_up(factor * (q.tol + reserved_tol)))
        if tol < 1:
            yield f"ask for tol {tol:g} or more", replace(q, tol=tol - reserved_tol)


def _more_memory(q: PSFRequest, needed: int | None) -> Tries:
    """Yield a PSF's larger budgets of memory."""
    for factor in _MEMORY if needed else ():
        memory = math.ceil(factor * (needed or 0) / 1e6) * 1_000_000
        words = f"allow more memory: {memory // 1_000_000} MB"
        yield words, replace(q, budget=replace(q.budget, memory=memory))


def _more_time(q: PSFRequest, needed: float | None) -> Tries:
    """Yield a PSF's larger budget of processor time, where it's less than a day."""
    if needed and 1.1 * needed < 86400:
        seconds = float(rounded_up(1.1 * needed))
        yield (
            f"allow more time: {seconds:g} s",
            replace(q, budget=replace(q.budget, seconds=seconds)),
        )


def _smaller_window(q: PSFRequest) -> Tries:
    """Yield a PSF's smaller windows about the same centre."""
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
    """Yield distances of a PSF's object that are closer to the plane in focus."""
    focus = q.lens.focus_distance - q.separation
    if not focus > 0 or q.sphere is not None or q.distance == focus:
        return
    for share in _NEARER:
        vergence = 1 / focus + share * (1 / q.distance - 1 / focus)
        distance = float(f"{1 / vergence:.3g}") if vergence > 0 else math.inf
        words = f"bring the object closer to the plane in focus, to {distance:g} m"
        yield words, replace(q, distance=distance)


def _window_at_the_image(q: PSFRequest) -> Tries:
    """Yield a PSF's window around the image of its point."""
    if any(q.samples.centre):
        yield (
            "ask for pixels around the point's image",
            replace(q, samples=Plane(q.samples.shape, q.samples.pitch)),
        )
