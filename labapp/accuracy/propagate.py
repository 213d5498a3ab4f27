"""`labapp accuracy propagate`: every method for a way through free space, at every tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.accuracy.command import show_measurements
from labapp.accuracy.option_validation import require_propagation
from labapp.accuracy.peers import installed_peers
from labapp.accuracy.references.free_space import (
    CellLight,
    Complex,
    Gaussian,
    Light,
    Places,
    Real,
    SmoothLight,
    exact_field,
    product_count,
)
from labapp.accuracy.references.samples import draw_samples
from labapp.accuracy.work_precision import Candidate, Row, candidates_by_tolerance, measure
from labapp.common.console import terminal_progress
from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from optics.accuracy import Budget
from optics.plane import Plane
from optics.propagation.free_space_operator import METHODS, FreeSpace
from optics.threads import single_threaded

TOLERANCES = tuple(10.0**-k for k in range(1, 9))

_MOST_SECONDS = 2.0
"""Predicted processor time beyond which a method isn't tried."""

_SAMPLES, _FEWEST = 64, 8
"""Of the target that are compared: as many as _MOST_PRODUCTS values of the kernel allow."""

_MOST_PRODUCTS = 3e7

_GAUSSIAN_EXTENT = 5.4
"""Widths of a Gaussian that its plane and its band hold: 2e-13 of it is left there."""


@dataclass(frozen=True)
class FieldCase:
    """A field and where it is wanted."""

    light: str
    field: Light
    target: Plane
    distance: float
    wavelength: float
    paraxial: bool

    @property
    def source(self) -> Plane:
        return self.field.plane

    @property
    def samples(self) -> torch.Tensor:
        """Of the field, on its own plane."""
        return torch.from_numpy(self.field.samples)

    def operator(self, tol: float, **settings: Any) -> FreeSpace:
        return FreeSpace(
            self.source,
            self.target,
            self.distance,
            self.wavelength,
            cells=self.source.pitch if isinstance(self.field, CellLight) else None,
            paraxial=self.paraxial,
            tol=tol,
            **settings,
        )

    @property
    def name(self) -> str:
        model = "Fresnel" if self.paraxial else "scalar"
        return (
            f"{self.light}, {_describe_plane(self.source)}, {self.distance * 1e3:g} mm, "
            f"{self.wavelength * 1e9:g} nm, to {_describe_plane(self.target)}, {model}"
        )


def _describe_plane(plane: Plane) -> str:
    where = ""
    if any(plane.centre):
        where = f" at ({plane.centre[0] * 1e6:g}, {plane.centre[1] * 1e6:g}) µm"
    return f"{plane.shape[0]}² of {plane.pitch[0] * 1e6:g} µm{where}"


def field_case_from_options(
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
    require_propagation(light, distance, wavelength)
    field = smooth_light(source) if light == "smooth" else random_cells(source)
    return FieldCase(light, field, target, distance, wavelength, paraxial)


def smooth_light(plane: Plane) -> SmoothLight:
    """Three Gaussians that fill a plane, two of them tilted to the ends of its default band."""
    half, band = (min(plane.shape) - 1) // 2 * plane.pitch[0], 0.25 / plane.pitch[0]
    wide, narrow = 0.6 * half / _GAUSSIAN_EXTENT, _GAUSSIAN_EXTENT / (math.pi * 0.75 * band)
    if wide < narrow:
        needed = 2 * math.ceil(_GAUSSIAN_EXTENT * narrow / 0.6 / plane.pitch[0]) + 2
        raise UserError(f"--size {plane.shape[0]}: a smooth field takes {needed} samples or more.")
    tilt, corner = band - _GAUSSIAN_EXTENT / (math.pi * wide), 0.25 * band
    gaussians = (
        Gaussian(1.0 + 0j, (0.0, 0.0), (0.0, 0.0), wide),
        Gaussian(0.7j, (0.3 * half, -0.2 * half), (-tilt, 0.0), wide),
        Gaussian(-0.5 + 0j, (-0.3 * half, 0.1 * half), (corner, -corner), narrow),
    )
    return SmoothLight(plane, gaussians)


def random_cells(plane: Plane) -> CellLight:
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, plane.shape)
    return CellLight(plane, np.exp(1j * phase))


class FieldReference:
    """The exact field on some samples, and the same samples of answers as real numbers.

    Samples are drawn half by their light and half evenly, and weighed so that relative L2
    errors are estimates of those of the whole target.
    """

    def __init__(self, case: FieldCase) -> None:
        light = np.abs(_rough_field(case)) ** 2
        count = _SAMPLES
        while True:
            self._where, self._weight = draw_samples(np.random.default_rng(0), light, count)
            places = _places(case, self._where)
            if count <= _FEWEST or _product_count(case, places) <= _MOST_PRODUCTS:
                break
            count //= 2
        self.exact_samples = self.weighted_samples(
            exact_field(case.field, places, paraxial=case.paraxial)
        )

    def samples_of(self, answer: Any) -> Real:
        """An answer's, from a tensor or an array on the whole target."""
        values = answer.reshape(-1)[self._where]
        return self.weighted_samples(
            np.asarray(values.resolve_conj() if torch.is_tensor(values) else values)
        )

    def weighted_samples(self, values: Complex) -> Real:
        weighed = np.sqrt(self._weight) * values
        return np.stack([weighed.real, weighed.imag])


def _places(case: FieldCase, where: NDArray[np.int64]) -> Places:
    """Of samples of the target, by their numbers."""
    rows, columns = np.divmod(where, case.target.shape[1])
    y, x = (case.target.coordinates(axis).numpy() for axis in (0, 1))
    return Places(y[rows], x[columns], case.distance, case.wavelength)


def _product_count(case: FieldCase, places: Places) -> float:
    return product_count(case.field, places, paraxial=case.paraxial)


def _rough_field(case: FieldCase) -> Complex:
    """About where the light arrives; everywhere alike if even that can't be said."""
    try:
        return np.asarray(case.operator(1e-1)(case.samples).resolve_conj())
    except ValueError:
        return np.ones(case.target.shape, dtype=np.complex128)


def candidates(case: FieldCase, reference: FieldReference, budget: Budget) -> Iterator[Candidate]:
    """Every method at every tolerance; what refuses is a row that says why."""

    def build_call(operator: FreeSpace) -> Callable[[], Real]:
        field = case.samples
        if operator.account.precision == "float32":
            field = field.to(torch.complex64)
        operator(field)
        return lambda: reference.samples_of(operator(field))

    row = Row("propagate", case.name, "", "float64", None)
    return candidates_by_tolerance(
        row, METHODS, TOLERANCES, partial(_plan_within_time_limit, case, budget), build_call
    )


def _plan_within_time_limit(
    case: FieldCase, budget: Budget, *, tol: float, method: str
) -> FreeSpace:
    operator = case.operator(tol, method=method, budget=budget)
    predicted = operator.account.cpu_predicted
    if predicted > _MOST_SECONDS:
        raise ValueError(
            f"the {operator.method} takes {predicted:.0f} s, and {_MOST_SECONDS:g} s are tried"
        )
    return operator


@single_threaded
def accuracy_propagate(case: FieldCase, *, peers: bool, as_json: bool, plot: Path | None) -> None:
    """Measure every method for a case, print table or rows, and draw the plot if asked."""
    adapters = installed_peers("propagate") if peers else []
    with terminal_progress() as progress:
        budget = Budget(speed=machine_speed(progress.part(0.0, 0.1)))
        reference = FieldReference(case)
        found = list(candidates(case, reference, budget))
        found += [one for adapter in adapters for one in adapter(case, reference.samples_of)]
        measured = measure(found, reference.exact_samples, progress.part(0.2, 1.0))
    show_measurements("Free space", case.name, measured, as_json, plot)
