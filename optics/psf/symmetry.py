"""Expand symmetric patterns that are given in short, and compute their light by the symmetry."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import torch

from optics.accuracy import FLOAT32_ARITHMETIC, ErrorEstimate, MachineSpeed
from optics.camera import Camera
from optics.camera.pupil import defocus_curvature, pupil_amplitude
from optics.fourier import FourierGeometry
from optics.psf.chain_choice import chain_engines
from optics.psf.engine import PSFEngine, require_sample_shape
from optics.psf.panel_engine import PanelEngine
from optics.psf.phase_factor import phase_factor
from optics.psf.pixel_waves import CurvedPixelTransform
from optics.psf.request import PSFRequest
from optics.quarter_symmetry import mirror_quarter, quarter_shape


class SeparableEngine(PSFEngine):
    """Computes a separable pattern's light as a product of two one-dimensional integrals.

    The panel must be open and the lens' wave quadratic. Each axis takes one product of a matrix and
    a vector, in double precision. A pattern is given as the phases of all rows, then of all
    columns, (..., rows + columns), radians.
    """

    name = "one-dimensional transforms"

    def __init__(self, request: PSFRequest, camera: Camera) -> None:
        self._request, self._panel, n = request, camera.panel, request.numeric
        self._set_precision(double=True)
        geometry = FourierGeometry(camera.panel.plane, n.samples, n.scale)
        curvature = defocus_curvature(n.lens, n.distance, n.wavelength)
        self._transform = CurvedPixelTransform(
            geometry, torch.complex128, curvature, camera.panel.active_side
        )
        self.error = ErrorEstimate(0.0, "exact to rounding")
        rows, columns = camera.panel.shape
        self.sampling = f"{rows} rows and {columns} columns of the panel"
        self._product_count = rows * n.samples.shape[0] + columns * n.samples.shape[1]

    @cached_property
    def _kernels(self) -> tuple[torch.Tensor, torch.Tensor]:
        """The matrices (samples, pixels) along y and x."""
        y, x = (torch.eye(count, dtype=torch.complex128) for count in self._panel.shape)
        return self._transform.forward_axis(y, 0), self._transform.forward_axis(x, 1).mT

    @property
    def bytes(self) -> int:
        return 16 * self._product_count + 8 * self.sample_count

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        passes = self.sample_count * 4 * speed.touch
        return 6 * speed.call + 8 * self._product_count * speed.touch + passes

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return self._transform.planning_seconds(speed)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        plane = self._panel.plane
        return plane.coordinates(0), plane.coordinates(1)

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        """Compute the light of a separable pattern on the samples; ValueError for an amplitude."""
        if amplitude is not None:
            raise ValueError("amplitude is given; a separable pattern has a phase only")
        n, panel, shape = self._request.numeric, self._panel, self._panel.shape
        if phase is None:
            phase = torch.zeros(sum(shape), dtype=torch.float64)
        require_sample_shape("phase", phase, (sum(shape),))
        parts = torch.split(phase_factor(phase, torch.complex128), list(shape), dim=-1)
        y, x = (
            part @ kernel.mT.to(part.device)
            for part, kernel in zip(parts, self._kernels, strict=True)
        )
        area = n.samples.pitch[0] * n.samples.pitch[1]
        # As for PanelEngine: the area of a pixel squared, over the light of all pixels.
        scale = area * panel.active_side**2 / (n.scale**2 * shape[0] * shape[1])
        down, along = (one.real**2 + one.imag**2 for one in (y, x))
        light = scale * down[..., :, None] * along[..., None, :]
        return light.to(torch.float32) if n.tol >= 2 * FLOAT32_ARITHMETIC else light


SYMMETRIES = ("none", "quarter", "separable")
"""Names of the symmetries of a pattern."""


def symmetric_shape(symmetry: str, shape: tuple[int, int]) -> tuple[int, ...]:
    """Return the shape in which a symmetric pattern of a panel is given.

    Parameters
    ----------
    symmetry : str
        One of SYMMETRIES. "none": every pixel is given. "quarter": the pattern is mirrored in the
        middle of the panel's pixels, along both axes; given is its quarter right of and below it,
        with the middle row and column where their number is odd. "separable": the phase is the sum
        of one that depends on y and one on x; given are those of all rows, then of all columns.
    shape : tuple of int
        Rows and columns of the panel.

    Returns
    -------
    tuple of int
        The shape.

    Raises
    ------
    ValueError
        For another symmetry.
    """
    rows, columns = shape
    if symmetry == "quarter":
        return quarter_shape(shape)
    if symmetry == "separable":
        return (rows + columns,)
    if symmetry != "none":
        raise ValueError(f"symmetry is {symmetry!r}; choose {', '.join(SYMMETRIES)}")
    return shape


def expand_phase(symmetry: str, phase: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Expand the phase of a symmetric pattern to all pixels of a panel; differentiable.

    Parameters
    ----------
    symmetry : str
        One of SYMMETRIES.
    phase : torch.Tensor
        Radians, ``(..., *symmetric_shape(symmetry, shape))``.
    shape : tuple of int
        Rows and columns of the panel.

    Returns
    -------
    torch.Tensor
        Radians, ``(..., *shape)``; float64 for a separable pattern.

    Raises
    ------
    ValueError
        For another symmetry, or a phase of another shape.
    """
    given = symmetric_shape(symmetry, shape)
    if tuple(phase.shape[-len(given) :]) != given:
        raise ValueError(
            f"phase is {tuple(phase.shape)}; with symmetry {symmetry!r} it is {given} for a panel "
            f"of {shape[1]}x{shape[0]} pixels"
        )
    if symmetry == "quarter":
        return mirror_quarter(phase, shape)
    if symmetry == "separable":
        # Single precision doesn't hold the sum of thousands of waves.
        y, x = torch.split(phase.to(torch.float64), list(shape), dim=-1)
        return y[..., :, None] + x[..., None, :]
    return phase


def symmetric_engine(
    symmetry: str, request: PSFRequest, camera: Camera
) -> Callable[[], PSFEngine] | None:
    """Return a function that makes the engine for a symmetric pattern, or None without one.

    The lens' wave must be quadratic and the stop must not cut the panel; otherwise the light behind
    a symmetric pattern isn't symmetric. A panel apart from its lens must be so open that the lens
    may as well stand at it. The function raises ToleranceError where it isn't.
    """
    if (
        symmetry == "none"
        or request.sphere is not None
        or request.differentiable
        or not camera.lens.has_quadratic_phase
    ):
        return None
    if camera.separation:
        if symmetry == "separable":
            return None
        return chain_engines(request, camera, "collapsed", mirrored=True)["collapsed"]
    if float(pupil_amplitude(camera).min()) < 1:
        return None
    if symmetry == "separable":
        return lambda: SeparableEngine(request, camera)
    return lambda: PanelEngine(request, camera, mirrored=True)
