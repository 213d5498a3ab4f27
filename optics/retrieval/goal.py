"""What a retrieval is asked for: a PSF shape, and the camera that shall give it."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import torch

from optics.camera import Camera
from optics.plane import Plane
from optics.pupil import pupil_amplitude
from optics.retrieval.far_field import FarField
from optics.retrieval.grid import design_plane, far_field_length
from optics.stop_shadow import with_stop_shadow_on_panel
from optics.validation import require_positive


@dataclass(frozen=True, eq=False)
class RetrievalGoal:
    """A target intensity on a window of the design grid, for a camera and a wavelength.

    target: (rows, columns), any positive scale; zero beyond the window; kept as float64 with a
    peak of one. plane: from design_plane(). wavelength: metres. Raises ValueError for a target
    that no PSF can have, a plane of another grid, or a panel that gets no light.
    """

    camera: Camera
    target: torch.Tensor
    plane: Plane
    wavelength: float

    def __post_init__(self) -> None:
        require_positive("wavelength", self.wavelength, "m")
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
        # Sums and squares of extreme scales would run over.
        target = target.detach().to(torch.float64)
        object.__setattr__(self, "target", target / target.max())

    @property
    def far_field_samples(self) -> int:
        """Samples across the far field that the panel reaches."""
        return far_field_length(self.camera)

    @functools.cached_property
    def amplitude(self) -> torch.Tensor:
        """Of the light on the panel's pixels behind the stop, (rows, columns), float32.

        The illumination counts: what the panel doesn't get, no phase can steer. A stop that
        stands apart counts by its shadow on the panel.
        """
        amplitude = pupil_amplitude(with_stop_shadow_on_panel(self.camera))
        illumination = self.camera.panel.illumination
        if illumination is not None:
            light = illumination.at_pixels(self.camera.panel)
            amplitude = amplitude * torch.sqrt(light / light.mean())
        return amplitude.to(torch.float32)

    @functools.cached_property
    def power(self) -> float:
        """All light on the design grid when the field is `amplitude`: Parseval's sum."""
        return float(self.amplitude.to(torch.float64).square().sum()) * self.far_field_samples**2

    @functools.cached_property
    def target_intensity(self) -> torch.Tensor:
        """The target with all the light there is, (rows, columns), float32."""
        return (self.target / self.target.sum() * self.power).to(torch.float32)

    @functools.cached_property
    def far_field(self) -> FarField:
        """From all pixels of the panel to the target's window."""
        return FarField(self.camera.panel.shape, self.far_field_samples, self.plane.shape)
