"""The target PSF with its camera and wavelength, and the grid in the focal plane for it."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import scipy.fft
import torch

from optics.camera import Camera
from optics.camera.pupil import panel_to_focus_distance, pupil_amplitude, with_stop_shadow_on_panel
from optics.plane import Plane
from optics.retrieval.far_field import FarField
from optics.validation import require_positive, require_wavelength, rounded_down

OVERSAMPLING = 2
"""Sampling rate of the design grid over the pupil's Nyquist rate.

A coarser grid would miss speckle between its samples.
"""


def far_field_length(camera: Camera, oversampling: int = OVERSAMPLING) -> int:
    """Return the number of samples along an axis of the far field, all of which light can reach.

    It is the length of the Fourier transform from pixels to the design grid: at least
    `oversampling` times the longer side of the panel, and FFTs of that length are fast.
    """
    side = oversampling * max(camera.panel.shape)
    # A multiple of 16 is divisible by many superpixel sides.
    unit = 16 if side > 16**2 else 1
    return unit * int(scipy.fft.next_fast_len(math.ceil(side / unit), real=True))


def design_plane(
    camera: Camera, wavelength: float, window: tuple[int, int], oversampling: int = OVERSAMPLING
) -> Plane:
    """Choose the grid in the focal plane on which a PSF is designed, a window around the axis.

    Parameters
    ----------
    camera : Camera
        Camera whose panel steers the light.
    wavelength : float
        Metres.
    window : tuple of int
        (rows, columns) of the window in samples.
    oversampling : int, default 2
        How much finer than the pupil's Nyquist rate the grid is at least. With less than the
        default, speckle hides between the samples.

    Returns
    -------
    Plane
        The samples of the window, with a pitch in metres on the sensor.

    Raises
    ------
    ValueError
        If the wavelength isn't positive, the panel lies in the plane in focus or beyond it, or the
        window is larger than the panel can steer light to.
    """
    require_wavelength("wavelength", wavelength)
    panel_to_focus_distance(camera)
    length = far_field_length(camera, oversampling)
    if max(window) > length:
        raise ValueError(
            f"window is {window}; the panel steers light to {length} samples at most: choose a "
            "smaller target"
        )
    pitch = wavelength * camera.ray_matrix_b / (length * camera.panel.pitch)
    return Plane(window, (pitch, pitch))


def window_for_reach(camera: Camera, wavelength: float, reach: float) -> tuple[int, int]:
    """Choose the size of the window for light up to `reach` from the axis, with a dark margin.

    Parameters
    ----------
    camera : Camera
        Camera whose panel steers the light.
    wavelength : float
        Metres.
    reach : float
        Largest distance of the light from the axis along y or x, metres on the sensor.

    Returns
    -------
    tuple of int
        (rows, columns) of the window for `design_plane`; it is square.

    Raises
    ------
    ValueError
        If the reach isn't positive or is farther than the panel's pixels allow; the message gives
        the farthest reach.
    """
    require_positive("reach", reach, "m")
    pitch = design_plane(camera, wavelength, (1, 1)).pitch[0]
    length = far_field_length(camera)
    if 2 * reach > length * pitch:
        raise ValueError(
            f"the target reaches {reach * 1e6:.0f} µm from the axis and the panel steers light to "
            f"{rounded_down(length * pitch / 2 * 1e6)} µm at most; choose a smaller one"
        )
    # The window is 1.2 times as wide as the target, a multiple of 32 samples, and 128 at least.
    step = 32
    side = step * math.ceil(1.2 * 2 * reach / pitch / step)
    side = min(max(side, 128), length)
    return side, side


@dataclass(frozen=True, eq=False)
class RetrievalGoal:
    """A target PSF on the design grid, for a camera and a wavelength in metres.

    Raises ValueError for a target that no PSF can have, a plane of another grid, or a panel without
    light.

    target: intensity, (rows, columns), on any positive scale and zero beyond the window; it is
        stored as float64 with a peak of one.
    plane: from design_plane().
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
        """The number of samples across the far field that the panel can steer light to."""
        return far_field_length(self.camera)

    @functools.cached_property
    def amplitude(self) -> torch.Tensor:
        """The light's amplitude on the panel's pixels, (rows, columns) float32.

        It includes the panel's illumination and the stop, or its shadow on the panel.
        """
        amplitude = pupil_amplitude(with_stop_shadow_on_panel(self.camera))
        illumination = self.camera.panel.illumination
        if illumination is not None:
            light = illumination.at_pixels(self.camera.panel)
            amplitude = amplitude * torch.sqrt(light / light.mean())
        return amplitude.to(torch.float32)

    @functools.cached_property
    def power(self) -> float:
        """The intensity's sum over the whole far field, by Parseval's theorem."""
        return float(self.amplitude.to(torch.float64).square().sum()) * self.far_field_samples**2

    @functools.cached_property
    def target_intensity(self) -> torch.Tensor:
        """The target scaled to all light of the panel, (rows, columns) float32."""
        return (self.target / self.target.sum() * self.power).to(torch.float32)

    @functools.cached_property
    def far_field(self) -> FarField:
        """The transform from all panel pixels to the target's window."""
        return FarField(self.camera.panel.shape, self.far_field_samples, self.plane.shape)
