"""`labapp accuracy propagate`: every method for a way through free space, at every tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labapp.accuracy.command import print_rows, write_measured
from labapp.accuracy.peers import refuse
from labapp.accuracy.propagate_peers import peer_candidates
from labapp.accuracy.rows import Candidate, Row, measure
from labapp.asked import read_window
from labapp.console import watched
from labapp.errors import UserError
from labapp.figures.free_space_judge import Cells, Complex, Gaussians, Pulse, Real
from labapp.figures.free_space_problems import Judge, Problem
from labapp.files.writing import require_writable
from labapp.speed import machine_speed
from optics.accuracy import Budget
from optics.plane import Plane
from optics.propagation.operator import METHODS, FreeSpace
from optics.threads import single_threaded

TOLERANCES = tuple(10.0**-k for k in range(1, 9))
LIGHTS = ("smooth", "cells")

_MOST_SECONDS = 2.0
"""Predicted processor time beyond which a method isn't tried."""

_HELD = 5.4
"""Widths of a Gaussian that its plane and its band hold: 2e-13 of it is left there."""


@dataclass(frozen=True)
class FieldCase:
    """A field and where it is wanted, with samples of the exact answer; a problem in words."""

    light: str
    problem: Problem

    @property
    def name(self) -> str:
        p = self.problem
        model = "Fresnel" if p.paraxial else "scalar"
        return (
            f"{self.light}, {_told(p.source)}, {p.distance * 1e3:g} mm, "
            f"{p.wavelength * 1e9:g} nm, to {_told(p.target)}, {model}"
        )


def _told(plane: Plane) -> str:
    where = ""
    if any(plane.centre):
        where = f" at ({plane.centre[0] * 1e6:g}, {plane.centre[1] * 1e6:g}) µm"
    return f"{plane.shape[0]}² of {plane.pitch[0] * 1e6:g} µm{where}"


def asked_field(
    light: str,
    source: Plane,
    target: Plane,
    distance: float,
    wavelength: float,
    *,
    paraxial: bool,
) -> FieldCase:
    """What a command line asks; UserError for what can't be.

    smooth: three Gaussians, two of them tilted, that the samples resolve. cells: squares of
    constant field with random phases, as an SLM shows.
    """
    if light not in LIGHTS:
        raise UserError(f"--light {light}: choose {' or '.join(LIGHTS)}.")
    if not (math.isfinite(distance) and distance):
        raise UserError(f"--distance {distance:g}: it must be finite and not 0, in metres.")
    if not (0 < wavelength < math.inf):
        raise UserError(f"--wavelength-nm {wavelength * 1e9:g}: it must be positive.")
    shown = smooth_light(source) if light == "smooth" else random_cells(source)
    problem = Problem(source, shown, target, distance, wavelength, paraxial, 1e-3)
    return FieldCase(light, problem)


def read_plane(size: int, pitch_um: float, centre: str, name: str) -> Plane:
    """A square of samples; UserError for one that there can't be."""
    if not 0 < pitch_um < math.inf:
        raise UserError(f"--{name} {pitch_um:g}: it must be positive, in micrometres.")
    return read_window(size, pitch_um * 1e-6, centre)


def smooth_light(plane: Plane) -> Gaussians:
    """Three Gaussians that fill a plane, two of them tilted to the ends of its default band."""
    half, band = (min(plane.shape) - 1) // 2 * plane.pitch[0], 0.25 / plane.pitch[0]
    wide, narrow = 0.6 * half / _HELD, _HELD / (math.pi * 0.75 * band)
    if wide < narrow:
        needed = 2 * math.ceil(_HELD * narrow / 0.6 / plane.pitch[0]) + 2
        raise UserError(f"--size {plane.shape[0]}: a smooth field takes {needed} samples or more.")
    tilt, corner = band - _HELD / (math.pi * wide), 0.25 * band

    def pulse(middle: float, frequency: float, width: float) -> Pulse:
        return Pulse(middle * half, frequency, complex(width**-2))

    return Gaussians(
        (
            (1.0 + 0j, pulse(0.0, 0.0, wide), pulse(0.0, 0.0, wide)),
            (0.7j, pulse(0.3, -tilt, wide), pulse(-0.2, 0.0, wide)),
            (-0.5 + 0j, pulse(-0.3, corner, narrow), pulse(0.1, -corner, narrow)),
        )
    )


def random_cells(plane: Plane) -> Cells:
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, plane.shape)
    return Cells(plane, plane.pitch, np.exp(1j * phase))


class Reference:
    """The exact field on some samples, and the same samples of answers as real numbers.

    Samples are drawn half by their light and half evenly, and weighed so that relative L2
    errors are estimates of those of the whole target.
    """

    def __init__(self, case: FieldCase) -> None:
        self._judge = Judge(case.problem, _glimpse(case.problem))
        self.truth = self.seen(self._judge.truth())

    def of(self, answer: Any) -> Real:
        """An answer's, from a tensor or an array on the whole target."""
        values = answer.reshape(-1)[self._judge.where]
        return self.seen(np.asarray(values.resolve_conj() if torch.is_tensor(values) else values))

    def seen(self, values: Complex) -> Real:
        weighed = np.sqrt(self._judge.weight) * values
        return np.stack([weighed.real, weighed.imag])


def _glimpse(problem: Problem) -> Complex:
    """About where the light arrives; everywhere alike if even that can't be said."""
    try:
        return np.asarray(problem.operator(1e-1)(problem.field).resolve_conj())
    except ValueError:
        return np.ones(problem.target.shape, dtype=np.complex128)


def candidates(case: FieldCase, reference: Reference, budget: Budget) -> Iterator[Candidate]:
    """Every method at every tolerance; what refuses is a row that says why."""
    for method in METHODS:
        for tol in TOLERANCES:
            row = Row("propagate", case.name, method, "float64", tol)
            try:
                operator = case.problem.operator(tol, method=method, budget=budget)
                _require_quick(operator)
            except ValueError as error:
                yield Candidate(row, partial(refuse, error))
                continue
            row = replace(row, precision=operator.account.precision)
            yield Candidate(row, partial(_to_tolerance, case.problem.field, operator, reference))


def _require_quick(operator: FreeSpace) -> None:
    predicted = operator.account.cpu_predicted
    if predicted > _MOST_SECONDS:
        raise ValueError(
            f"the {operator.method} takes {predicted:.0f} s, and {_MOST_SECONDS:g} s are tried"
        )


def _to_tolerance(
    field: torch.Tensor, operator: FreeSpace, reference: Reference
) -> tuple[Callable[[], Any], float, int]:
    if operator.account.precision == "float32":
        field = field.to(torch.complex64)
    operator(field)
    account = operator.account
    return lambda: reference.of(operator(field)), account.error, account.bytes


@single_threaded
def accuracy_propagate(
    case: FieldCase, *, peers: bool, data: Path | None, plot: Path | None, force: bool
) -> None:
    """Measure every method for a case, print the table, and write rows and plot if asked."""
    for path in (data, plot):
        if path is not None:
            require_writable(path, force=force)
    with watched() as progress:
        budget = Budget(speed=machine_speed(progress.part(0.0, 0.1)))
        reference = Reference(case)
        found = list(candidates(case, reference, budget))
        if peers:
            found += peer_candidates(case.problem, case.name, reference.of)
        measured = measure(found, reference.truth, progress.part(0.2, 1.0))
    print_rows("Free space", case.name, measured.rows)
    write_measured(case.name, measured, data, plot)
