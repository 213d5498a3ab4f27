"""`labapp accuracy psf`: every method for the PSF of a round lens, at every setting."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch

from labapp.accuracy.rows import Candidate, Row
from labapp.figures.quadrature import Picture, round_lens_picture
from optics.axial import AxialPSF
from optics.camera import Camera, Lens, Panel
from optics.fourier import ChirpTransform, Geometry, MatrixTransform, plan_transform
from optics.plane import Plane
from optics.pupil import defocus_phase, pupil_amplitude

_TOLERANCES = tuple(10.0**-k for k in range(1, 11))
_GRIDS = (64, 128, 256, 512, 1024, 2048)
_PRECISIONS = {"float32": torch.complex64, "float64": torch.complex128}


@dataclass(frozen=True)
class Case:
    """A round lens and a square window; SI units."""

    lens: Lens
    distance: float
    wavelength: float
    pitch: float
    size: int

    @property
    def name(self) -> str:
        lens = self.lens
        object_, focus = (
            "at infinity" if math.isinf(d) else f"at {d:g} m"
            for d in (self.distance, lens.focus_distance)
        )
        return (
            f"{lens.focal_length * 1e3:g} mm f/{lens.f_number:g}, {self.wavelength * 1e9:g} nm, "
            f"object {object_}, focus {focus}, "
            f"{self.size}² of {self.pitch * 1e6:g} µm"
        )

    def truth(self) -> Picture:
        """The exact integral at every pixel's centre, by direct quadrature."""
        return round_lens_picture(self.lens, self.distance, self.wavelength, self.pitch, self.size)


def candidates(case: Case) -> Iterator[Candidate]:
    """The Hankel transform by tolerance, and grids in the pupil by size and transform."""
    for tol in _TOLERANCES:
        row = Row("psf", case.name, "Hankel transform", "float64", tol)
        yield Candidate(row, partial(_hankel, case, tol))
    for grid in _GRIDS:
        for method in (MatrixTransform.name, ChirpTransform.name):
            for precision in _PRECISIONS:
                row = Row("psf", case.name, f"{grid}² grid, {method}", precision, None)
                yield Candidate(row, partial(_on_grid, case, grid, method, precision))


def _hankel(case: Case, tol: float) -> tuple[Callable[[], Any], float, int]:
    pixels = Plane((case.size, case.size), (case.pitch, case.pitch))
    operator = AxialPSF(case.lens, case.distance, case.wavelength, pixels, integrate=False, tol=tol)
    return operator, operator.account.error, operator.account.bytes


def _on_grid(
    case: Case, grid: int, method: str, precision: str
) -> tuple[Callable[[], Any], None, int]:
    """What most programs do: the pupil sampled on a square grid, and a discrete transform.

    Cells at the edge of the stop are weighted by their open area. How far the sum is from
    the integral, the grid doesn't know: no error is predicted.
    """
    pitch = case.lens.stop_diameter / (grid - 2)
    camera = Camera(Panel(shape=(grid, grid), pitch=pitch, fill_factor=1.0), case.lens)
    scale = case.wavelength * case.lens.image_distance
    pixels = Plane((case.size, case.size), (case.pitch, case.pitch))
    geometry = Geometry(camera.panel.plane, pixels, scale)
    transform = plan_transform(geometry, _PRECISIONS[precision], method=method)
    amplitude = pupil_amplitude(camera)
    phase = defocus_phase(camera, case.distance, case.wavelength)
    strength = pitch / scale * case.pitch / math.sqrt(float(amplitude.sum()))
    pupil = torch.polar(strength * amplitude, phase.remainder(2 * math.pi))
    pupil = pupil.to(_PRECISIONS[precision])

    def call() -> torch.Tensor:
        field = transform(pupil)
        return field.real**2 + field.imag**2

    return call, None, transform.bytes
