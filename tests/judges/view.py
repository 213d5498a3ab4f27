"""What a PSF case asks: whose light, from where, on which pixels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera, Lens
from optics.plane import Plane
from optics.psf import PSFOperator

WAVELENGTH = 550e-9

Plate = Callable[[Any, Any], Any]
"""A phase in radians at (y, x) metres in the pupil of a lens."""


@dataclass(frozen=True)
class View:
    """A point's light behind a lens or a camera, asked of the library and of a judge alike.

    optics, pixels, distance, wavelength, integrate, method, phase_slope: as in PSFOperator.
    phase: of the panel's pixels, or a Plate before a lens. amplitude: of the panel's pixels.
    Tensors where derivatives are wanted.
    """

    optics: Camera | Lens
    pixels: Plane
    distance: Any = 2.0
    wavelength: Any = WAVELENGTH
    integrate: bool = True
    method: str | None = None
    phase_slope: float = 20.0
    phase: NDArray[Any] | torch.Tensor | Plate | None = None
    amplitude: NDArray[Any] | torch.Tensor | None = None

    @property
    def lens(self) -> Lens:
        return self.optics.lens if isinstance(self.optics, Camera) else self.optics

    def operator(self, tol: float) -> PSFOperator:
        return PSFOperator(
            self.optics,
            self.distance,
            self.wavelength,
            self.pixels,
            integrate=self.integrate,
            method=self.method,
            phase_slope=self.phase_slope,
            tol=tol,
            **self.settings,
        )

    @property
    def settings(self) -> dict[str, Any]:
        """What PSFOperator is told besides."""
        return {}

    def shown(self, operator: PSFOperator) -> torch.Tensor | None:
        """The phase that the operator is given."""
        if callable(self.phase):
            y, x = operator.points
            return torch.as_tensor(self.phase(y, x))
        return None if self.phase is None else torch.as_tensor(self.phase)

    def light(self, operator: PSFOperator, phase: torch.Tensor | None = None) -> torch.Tensor:
        """The operator's answer to this view's modulation, or to another phase."""
        amplitude = None if self.amplitude is None else torch.as_tensor(self.amplitude)
        return operator(self.shown(operator) if phase is None else phase, amplitude)

    def modulation(self, modulated: bool = True) -> NDArray[np.complex128]:
        """What every panel pixel multiplies the light with."""
        assert isinstance(self.optics, Camera)
        factor = np.ones(self.optics.panel.shape, dtype=np.complex128)
        if self.amplitude is not None:
            factor = factor * np.asarray(self.amplitude)
        if modulated and self.phase is not None:
            turn = np.asarray(self.phase, np.longdouble) / (8 * np.arctan(np.longdouble(1)))
            factor = factor * np.exp(2j * np.pi * (turn - np.rint(turn)).astype(np.float64))
        return factor

    def __str__(self) -> str:
        rows, columns = self.pixels.shape
        pitch = " x ".join(f"{p * 1e6:.3g}" for p in dict.fromkeys(self.pixels.pitch))
        what = f"{rows}x{columns} {'pixels' if self.integrate else 'points'} of {pitch} µm"
        if any(float(c) for c in self.pixels.centre):
            what += " at ({}) mm".format(", ".join(f"{c * 1e3:.3g}" for c in self.pixels.centre))
        parts = [_lens_in_words(self.lens), f"object {_metres(self.distance)}", what]
        if isinstance(self.optics, Camera):
            panel = self.optics.panel
            pixels = "x".join(map(str, panel.shape))
            parts.insert(0, f"panel {pixels} of {panel.pitch * 1e6:g} µm")
        if self.method:
            parts.append(self.method)
        return ", ".join(parts)


def _lens_in_words(lens: Lens) -> str:
    words = f"{float(lens.focal_length) * 1e3:.3g} mm f/{float(lens.f_number):.3g}"
    if lens.kind != "thin":
        words = f"{lens.kind} {words}"
    if not lens.has_clear_stop:
        shapes = (lens.stop.opening, *lens.stop.obscurations)
        words += " behind " + " less ".join(_shape_in_words(shape) for shape in shapes)
    for n, m, path in lens.aberrations:
        words += f", Z({n}, {m}) {float(path) * 1e9:.3g} nm"
    return f"{words}, focus {_metres(lens.focus_distance)}"


def _shape_in_words(shape: Any) -> str:
    (field,) = (f.name for f in fields(shape) if f.name in ("radius", "corners"))
    return f"{getattr(shape, field):g} R" if field == "radius" else f"{len(shape.corners)} corners"


def _metres(distance: Any) -> str:
    return "∞" if math.isinf(distance) else f"{float(distance):.4g} m"
