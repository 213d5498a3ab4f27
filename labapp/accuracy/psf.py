"""The methods for the PSF of a lens at every setting, as `labapp accuracy psf` measures them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import torch

from labapp.accuracy.references.lens_integral import lens_psf
from labapp.accuracy.references.round_lens import Picture, round_lens_psf
from labapp.accuracy.work_precision import (
    Candidate,
    Comparison,
    PlannedCall,
    Row,
    candidates_by_tolerance,
    similar_wavelength,
)
from labapp.prediction.lens_options import LensCase
from optics.accuracy import Budget
from optics.camera.pupil import pupil_phase
from optics.camera.stop_areas import coverage
from optics.fourier import FourierGeometry, plan_transform, valid_transforms
from optics.plane import Plane
from optics.progress import Progress
from optics.psf import PSFOperator

_TOLERANCES = tuple(10.0**-k for k in range(1, 11))
_GRIDS = (64, 128, 256, 512, 1024, 2048)
_PRECISIONS = {"float32": torch.complex64, "float64": torch.complex128}
_METHODS = {
    "axial": "along the radius",
    "scattered": "quadrature and non-uniform FFT",
    "sampled": "sampled pupil",
}


def exact_psf(case: LensCase, progress: Progress) -> Picture:
    """Return a lens's exact PSF at the centre of every pixel, by direct quadrature."""
    if case.is_clear_thin_on_axis:
        return round_lens_psf(case.lens, case.distance, case.wavelength, case.pitch, case.size)
    return lens_psf(case.lens, case.distance, case.wavelength, case.pixels, progress)


def compare_methods(
    case: LensCase, budget: Budget, progress: Progress, *, grids: bool
) -> Comparison:
    """Return what is measured of a lens's PSF, with the exact one."""
    truth = exact_psf(case, progress)
    similar = replace(case, wavelength=similar_wavelength(case.wavelength))
    found = list(candidates(case, budget, grids=grids))
    return Comparison(found, truth, candidates(similar, budget, grids=False))


def candidates(case: LensCase, budget: Budget, *, grids: bool = True) -> Iterator[Candidate]:
    """Yield the settings of the PSF of a lens, method by method.

    Methods that take a tolerance come once for each tolerance. Sampling the pupil on a square
    grid comes once for each grid size, precision and Fourier transform, if `grids` is true.
    """
    plan = partial(
        PSFOperator, case.lens, case.distance, case.wavelength, case.pixels, integrate=False,
        budget=budget,
    )  # fmt: skip
    row = Row("psf", case.name, "", "float64", None)
    found = candidates_by_tolerance(row, _METHODS, _TOLERANCES, plan, lambda operator: operator)
    for one in found:
        words = _METHODS.get(one.row.method, one.row.method)
        yield replace(one, row=replace(one.row, method=words))
    for grid in _GRIDS if grids else ():
        pitch = case.lens.stop_diameter / (grid - 2)
        scale = case.wavelength * case.lens.image_distance
        geometry = FourierGeometry(Plane((grid, grid), (pitch, pitch)), case.pixels, scale)
        for precision, dtype in _PRECISIONS.items():
            for transform in valid_transforms(geometry, dtype, 1e-6):
                words = f"{grid}² grid, {transform.name}"
                row = Row("psf", case.name, words, precision, None)
                yield Candidate(row, partial(_on_grid, case, geometry, dtype, transform.name))


def _on_grid(
    case: LensCase, geometry: FourierGeometry, dtype: torch.dtype, method: str
) -> PlannedCall:
    """Plan the usual method: Fourier transform the pupil on a square grid.

    Most programs use this method. Cells at the edge of the stop are weighted by their open area. No
    error is predicted, because this method can't tell how far its sum is from the integral.
    """
    lens, plane, radius = case.lens, geometry.pupil, case.lens.stop_diameter / 2
    assert isinstance(plane, Plane)
    transform = plan_transform(geometry, dtype, method=method, error=1e-6)
    amplitude = coverage(lens.stop, radius, plane)
    y, x = plane.mesh()
    phase = pupil_phase(lens, case.distance, case.wavelength, y / radius, x / radius)
    area = case.pixels.pitch[0] * case.pixels.pitch[1]
    strength = plane.pitch[0] / geometry.scale * math.sqrt(area / float(amplitude.sum()))
    pupil = torch.polar(strength * amplitude, phase.remainder(2 * math.pi)).to(dtype)

    def call() -> torch.Tensor:
        field = transform(pupil)
        return field.real**2 + field.imag**2

    return PlannedCall(call, transform.bytes)
