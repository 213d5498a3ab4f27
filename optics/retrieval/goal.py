"""Describe the goal of a phase retrieval: a PSF shape, a camera and a wavelength."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import torch

from optics.camera import Camera
from optics.camera.pupil import pupil_amplitude, with_stop_shadow_on_panel
from optics.plane import Plane
from optics.retrieval.far_field import FarField
from optics.retrieval.grid import design_plane, far_field_length
from optics.validation import require_wavelength


@dataclass(frozen=True, eq=False)
class RetrievalGoal:
    """The target PSF of a phase retrieval on the design grid, for a camera and a wavelength.

    target: intensity, (rows, columns), on any positive scale and zero beyond the window; it is
    stored as float64 with a peak of one. plane: from design_plane(). wavelength: metres. Raises
    ValueError for a target that no PSF can have, a plane of another grid, or a panel without light.
    """

    camera: Camera
    target: torch.Tensor
    plane: Plane
    wavelength: float

    def __post_init__(self) -> None:
        require_wavelength("wavelength", self.wavelength)
        target, plane = self.target, self.plane
        if tuple(target.shape) != plane.shape:
            raise ValueError(
                f"target is {tuple(target.shape)}; its plane has {plane.shape} samples"
            )
        if not (torch.isfinite(target).all() and target.min() >= 0 and target.sum() > 0):
            raise ValueError("target must be finite, nowhere negative and somewhere positive")
        fitting = design_plane(self.camera, self.wavelength, plane.shape)
        if any(abs(p / q - 1) > 1e-9 for p, q in zip(plane.pitch, fitting.pitch, strict=True)):
            raise ValueError(
                f"plane's pitch is {plane.pitch[0] * 1e6:.6g} x {plane.pitch[1] * 1e6:.6g} µm and "
                f"the design grid's is {fitting.pitch[0] * 1e6:.6g} µm; take the plane from "
                "design_plane()"
            )
        if plane.centre != (0.0, 0.0):
            raise ValueError(
                f"plane's centre is {plane.centre} m; design around the axis, and add a blaze"
            )
        if not self.amplitude.any():
            raise ValueError(
                "no light reaches the panel through the stop and its illumination; a pattern "
                "can't steer any: open the stop, or light the panel"
            )
        # Sums and squares of a target on an extreme scale would overflow.
        target = target.detach().to(torch.float64)
        object.__setattr__(self, "target", target / target.max())

    @property
    def far_field_samples(self) -> int:
        """Return the number of samples across the far field of a phase retrieval.

        The panel can steer light to all of them.
        """
        return far_field_length(self.camera)

    @functools.cached_property
    def amplitude(self) -> torch.Tensor:
        """Return the light's amplitude on the panel's pixels, which a phase retrieval can't change.

        The result is (rows, columns), float32. It includes the stop and the panel's illumination. A
        stop that is separated from the panel is replaced by its shadow on the panel.
        """
        amplitude = pupil_amplitude(with_stop_shadow_on_panel(self.camera))
        illumination = self.camera.panel.illumination
        if illumination is not None:
            light = illumination.at_pixels(self.camera.panel)
            amplitude = amplitude * torch.sqrt(light / light.mean())
        return amplitude.to(torch.float32)

    @functools.cached_property
    def power(self) -> float:
        """Return the total light of a phase retrieval: the intensity's sum over the design grid.

        The sum is computed from `amplitude` by Parseval's theorem.
        """
        return float(self.amplitude.to(torch.float64).square().sum()) * self.far_field_samples**2

    @functools.cached_property
    def target_intensity(self) -> torch.Tensor:
        """Return the phase retrieval's target scaled to all light of the panel.

        The result is (rows, columns), float32.
        """
        return (self.target / self.target.sum() * self.power).to(torch.float32)

    @functools.cached_property
    def far_field(self) -> FarField:
        """Return the phase retrieval's transform from all panel pixels to the target's window."""
        return FarField(self.camera.panel.shape, self.far_field_samples, self.plane.shape)
