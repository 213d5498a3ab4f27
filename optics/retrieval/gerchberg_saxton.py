"""The Gerchberg-Saxton algorithm (thesis §3.3.2; Gerchberg and Saxton, Optik 35, 237, 1972)."""

from __future__ import annotations

import math

import torch

from optics.camera import Camera
from optics.edge import require_positive, tensors_inside
from optics.fourier import Geometry, Transform, plan_transform
from optics.plane import Plane
from optics.progress import Progress
from optics.pupil import pupil_amplitude
from optics.threads import single_threaded

_OVERSAMPLING = 2
"""The design grid is twice finer than the pupil's Nyquist rate: on a coarser one speckle
hides between the samples."""

STARTS = ("quadratic", "random")


def design_plane(camera: Camera, wavelength: float, window: tuple[int, int]) -> Plane:
    """The grid in the focal plane on which a PSF is designed and judged."""
    require_positive("wavelength", wavelength, "m")
    scale = wavelength * camera.lens.image_distance
    pitch = scale / (_OVERSAMPLING * max(camera.panel.shape) * camera.panel.pitch)
    return Plane(window, (pitch, pitch))


def design_transform(camera: Camera, plane: Plane, wavelength: float) -> Transform:
    """The transform from the panel to a design plane."""
    scale = wavelength * camera.lens.image_distance
    return plan_transform(Geometry(camera.panel.plane, plane, scale))


def starting_phase(
    camera: Camera,
    target: torch.Tensor,
    plane: Plane,
    wavelength: float,
    start: str,
    generator: torch.Generator,
) -> torch.Tensor:
    """The phase that the iterations start from.

    "random": uniform over one wave in every pixel, as in the thesis. "quadratic": the
    lens that spreads light over the target's extent, from which fewer speckles grow.
    """
    if start == "random":
        return torch.rand(camera.panel.shape, generator=generator) * 2 * math.pi
    if start != "quadratic":
        raise ValueError(f"start is {start!r}; choose one of {', '.join(STARTS)}")
    y, x = plane.mesh()
    support = target > 0.5 * target.max()
    extents = [float((axis.abs() * support).max()) for axis in (y, x)]
    scale = wavelength * camera.lens.image_distance
    phase = torch.zeros(camera.panel.shape, dtype=torch.float64)
    for coordinate, extent, n in zip(
        camera.panel.plane.mesh(), extents, camera.panel.shape, strict=True
    ):
        half = n * camera.panel.pitch / 2
        phase = phase + math.pi * extent / (scale * half) * coordinate**2
    return phase


@tensors_inside
@single_threaded
def gerchberg_saxton(
    camera: Camera,
    target: torch.Tensor,
    plane: Plane,
    wavelength: float,
    *,
    iterations: int,
    generator: torch.Generator,
    start: str = "quadratic",
    progress: Progress | None = None,
) -> torch.Tensor:
    """A phase pattern whose PSF has the target's shape, (rows, columns) in radians.

    target: intensity on `plane` (see design_plane), any positive scale; zero beyond it.
    In every iteration the panel's amplitude and the target's amplitude replace those of
    the wave, and its phases stay. Raises ValueError for an empty or negative target, or one
    of another shape than the plane's.
    """
    require_positive("wavelength", wavelength, "m")
    if iterations < 1:
        raise ValueError(f"iterations is {iterations}; at least 1 is needed")
    if target.shape != plane.shape:
        raise ValueError(f"target is {tuple(target.shape)}; its plane has {plane.shape} samples")
    if not (torch.isfinite(target).all() and target.min() >= 0 and target.sum() > 0):
        raise ValueError("target must be finite, nowhere negative and somewhere positive")
    progress = progress or Progress()
    transform = design_transform(camera, plane, wavelength)
    stop = pupil_amplitude(camera).to(torch.float32)
    amplitude = torch.sqrt(target / target.sum()).to(torch.float32)
    phase = starting_phase(camera, target, plane, wavelength, start, generator)
    pupil = torch.polar(stop, phase.to(torch.float32))
    for iteration in range(iterations):
        progress.report(iteration / iterations, f"Gerchberg-Saxton {iteration + 1}/{iterations}")
        back = transform.adjoint(_with_amplitude(transform(pupil), amplitude))
        pupil = _with_amplitude(back, stop)
    return torch.angle(pupil)


def _with_amplitude(field: torch.Tensor, amplitude: torch.Tensor) -> torch.Tensor:
    """The field's phase on another amplitude; where the field is zero, phase zero."""
    size = field.abs()
    dark = size == 0
    return torch.where(dark, torch.ones_like(field), field / size.masked_fill(dark, 1)) * amplitude
