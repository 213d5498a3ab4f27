"""`labapp accuracy propagate`: measure every method for propagation through free space."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

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
from labapp.accuracy.references.psf_problem import draw_samples
from labapp.accuracy.work_precision import (
    LONGEST_CALL,
    Candidate,
    Comparison,
    Row,
    candidates_by_tolerance,
    measure,
    similar_wavelength,
)
from labapp.common.console import terminal_progress
from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from optics.accuracy import Budget
from optics.plane import Plane
from optics.propagation.free_space_operator import METHODS, FreeSpace
from optics.threads import single_threaded

TOLERANCES = tuple(10.0**-k for k in range(1, 9))


_MAX_METHOD_S = 2.0
"""Predicted processor seconds beyond which a method isn't tried; chosen."""

_MIN_SAMPLES, _MAX_SAMPLES = 8, 64
"""Fewest and most samples of the target that are compared; chosen."""

_MAX_PRODUCTS = 3e7
"""Values of the propagation kernel that the exact field may take; beyond that fewer samples are
compared. Chosen."""


@dataclass(frozen=True)
class FieldCase:
    """A field on a source plane, and the target plane on which it is to be computed.

    distance, wavelength: metres; a negative distance goes back.
    paraxial: selects the Fresnel model instead of the scalar one.
    """

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
        """The field's samples on the source plane."""
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
    """Build the case that the options of `labapp accuracy propagate` describe.

    light: "smooth" for three Gaussians that the samples resolve, two of them tilted; "cells" for
    squares of constant field with random phases, as an SLM shows them.
    Raises UserError for an unknown kind of field, or values that are impossible.
    """
    require_propagation(light, distance, wavelength)
    field: Light
    if light == "smooth":
        field = smooth_light(source)
    else:
        phase = np.random.default_rng(0).uniform(0, 2 * np.pi, source.shape)
        field = CellLight(source, np.exp(1j * phase))
    return FieldCase(light, field, target, distance, wavelength, paraxial)


def smooth_light(plane: Plane) -> SmoothLight:
    """Return three Gaussian beams that fill a plane.

    Two of them are tilted so that their spectra reach the edge of the plane's default band.
    """
    # At 5.4 widths from its middle a Gaussian has fallen to 2e-13. Plane and band extend that far.
    extent = 5.4
    half, band = (min(plane.shape) - 1) // 2 * plane.pitch[0], 0.25 / plane.pitch[0]
    wide, narrow = 0.6 * half / extent, extent / (math.pi * 0.75 * band)
    if wide < narrow:
        needed = 2 * math.ceil(extent * narrow / 0.6 / plane.pitch[0]) + 2
        raise UserError(f"--size {plane.shape[0]}: a smooth field takes {needed} samples or more.")
    tilt, corner = band - extent / (math.pi * wide), 0.25 * band
    gaussians = (
        Gaussian(1.0 + 0j, (0.0, 0.0), (0.0, 0.0), wide),
        Gaussian(0.7j, (0.3 * half, -0.2 * half), (-tilt, 0.0), wide),
        Gaussian(-0.5 + 0j, (-0.3 * half, 0.1 * half), (corner, -corner), narrow),
    )
    return SmoothLight(plane, gaussians)


class FieldReference:
    """The exact field on some samples of the target, as weighted real numbers.

    Half of the samples are drawn in proportion to their light, as far as a method tells where it
    arrives, and half evenly. They are weighted such that relative L2 errors estimate those of the
    whole target.
    """

    def __init__(self, case: FieldCase) -> None:
        try:
            rough = np.asarray(case.operator(1e-1)(case.samples).resolve_conj())
        except ValueError:
            rough = np.ones(case.target.shape, dtype=np.complex128)
        light = np.abs(rough) ** 2
        count = _MAX_SAMPLES
        y, x = (case.target.coordinates(axis).numpy() for axis in (0, 1))
        while True:
            self._where, self._weight = draw_samples(np.random.default_rng(0), light, count)
            rows, columns = np.divmod(self._where, case.target.shape[1])
            places = Places(y[rows], x[columns], case.distance, case.wavelength)
            products = product_count(case.field, places, paraxial=case.paraxial)
            if count <= _MIN_SAMPLES or products <= _MAX_PRODUCTS:
                break
            count //= 2
        self.exact_samples = self.weighted_samples(
            exact_field(case.field, places, paraxial=case.paraxial)
        )

    def samples_of(self, answer: Any) -> Real:
        """Return a method's field, of the whole target, where it is compared, with weights."""
        values = answer.reshape(-1)[self._where]
        return self.weighted_samples(
            np.asarray(values.resolve_conj() if torch.is_tensor(values) else values)
        )

    def weighted_samples(self, values: Complex) -> Real:
        """Weight field values, (samples,), and return real and imaginary parts, (2, samples)."""
        weighed = np.sqrt(self._weight) * values
        return np.stack([weighed.real, weighed.imag])


def candidates(case: FieldCase, reference: FieldReference, budget: Budget) -> Iterator[Candidate]:
    """Yield every free-space method at every tolerance."""

    def plan(*, tol: float, method: str | None, calls: int) -> FreeSpace:
        operator = case.operator(tol, method=method, calls=calls, budget=budget)
        predicted = operator.account.cpu_predicted
        if predicted > _MAX_METHOD_S:
            raise ValueError(
                f"the {operator.method} takes {predicted:.0f} s, and {_MAX_METHOD_S:g} s are tried"
            )
        return operator

    def build_call(operator: FreeSpace) -> Callable[[], Real]:
        field = case.samples
        if operator.account.precision == "float32":
            field = field.to(torch.complex64)
        return lambda: reference.samples_of(operator(field))

    row = Row("propagate", case.name, "", "float64", None)
    return candidates_by_tolerance(row, METHODS, TOLERANCES, plan, build_call)


def compare_methods(
    case: FieldCase, budget: Budget, adapters: Sequence[Callable[..., Any]] = ()
) -> Comparison:
    """Return what is measured of a field, with the exact one on some samples.

    adapters: to other libraries, see `labapp.accuracy.peers`.
    """
    reference = FieldReference(case)
    found = list(candidates(case, reference, budget))
    found += [one for adapter in adapters for one in adapter(case, reference.samples_of)]
    similar = replace(case, wavelength=similar_wavelength(case.wavelength))
    return Comparison(found, reference.exact_samples, candidates(similar, reference, budget))


@single_threaded
def accuracy_propagate(case: FieldCase, *, peers: bool, as_json: bool, plot: Path | None) -> None:
    """Measure error and time of every free-space method, and print the rows.

    peers: whether other libraries are measured as well.
    """
    adapters = installed_peers("propagate") if peers else []
    with terminal_progress() as progress:
        budget = Budget(speed=machine_speed(progress.part(0.0, 0.1)), seconds=LONGEST_CALL)
        found, truth, similar = compare_methods(case, budget, adapters)
        measured = measure(found, truth, progress.part(0.2, 1.0), warm_up=similar)
    show_measurements("Free space", case.name, measured, as_json, plot)
