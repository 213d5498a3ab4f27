"""From pattern, camera, object distance and wavelength to the PSF on the sensor."""

from __future__ import annotations

import math
import time

import torch

from optics.accuracy import (
    FLOAT32_ARITHMETIC,
    FLOAT64_ARITHMETIC,
    Account,
    Budget,
    ErrorEstimate,
    Result,
    ToleranceError,
    cheapest,
)
from optics.camera import Camera
from optics.edge import require_finite, rounded_up, tensors_inside
from optics.fourier import Geometry, Transform, plan_transform
from optics.pixels import CurvedPixelTransform
from optics.plane import Plane
from optics.pupil import (
    cutoff_frequency,
    defocus_curvature,
    defocus_phase,
    paraxial_error,
    phase_step,
    pupil_amplitude,
    require_light,
)
from optics.sensor import PIXEL_INTEGRATION_ERROR, PixelIntegration

_STEEPEST_DEFOCUS = 200.0
"""Radians across a panel pixel beyond which the blur is far larger than any sensor."""


class PSFOperator:
    """The incoherent PSF of a camera, planned once and called for many patterns.

    The model is the Fraunhofer integral of the generalised pupil (thesis Eq. 3.1), with
    each panel pixel a square of one modulation, and the unmodulated share added in
    intensity, as light of the polarisation that the panel doesn't turn (§5.6). Defocus is
    taken as constant over a pixel where tol allows, and integrated inside it otherwise.

    Call with a phase in radians, (..., rows, columns) of the panel, tensor or array; the answer is
    (..., *shape), the share of the light leaving the panel that each sample receives.
    Differentiable in the phase.

    distance: metres from the object to the panel, math.inf allowed. wavelength: metres.
    shape: samples of the answer. oversample: samples per sensor pixel along each axis.
    integrate: whether samples are the light on whole sensor pixels (needs oversample 1)
    or the light on the sample's own share of the pixel. unmodulated: share of
    unmodulated light; the panel's own if None. tol: relative L2 error from sampling and
    arithmetic. Raises ToleranceError with the floor if tol can't be kept.
    """

    def __init__(
        self,
        camera: Camera,
        distance: float,
        wavelength: float,
        shape: tuple[int, int],
        *,
        oversample: int = 1,
        integrate: bool = True,
        unmodulated: float | None = None,
        tol: float = 1e-3,
        budget: Budget | None = None,
    ) -> None:
        self.unmodulated = camera.panel.unmodulated if unmodulated is None else unmodulated
        _require(distance, wavelength, oversample, integrate, self.unmodulated)
        budget = budget or Budget()
        pixel = camera.sensor.pitch / oversample
        wanted = Plane(shape, (pixel, pixel))
        cutoff = cutoff_frequency(camera, wavelength)
        self._integral = PixelIntegration(wanted, cutoff) if integrate else None
        self.image = self._integral.plane if self._integral else wanted
        sampling, curved = _sampling_error(camera, distance, wavelength, wanted, integrate, tol)
        double = tol - sampling.value < FLOAT32_ARITHMETIC
        self.dtype = torch.complex128 if double else torch.complex64
        scale = wavelength * camera.lens.image_distance
        geometry = Geometry(camera.panel.plane, self.image, scale)
        pupil = _generalised_pupil(camera, scale, self.image)
        self._envelope: torch.Tensor | None = None
        if curved:
            curvature = defocus_curvature(camera.lens, distance, wavelength)
            exact = CurvedPixelTransform(geometry, self.dtype, curvature, camera.panel.active_side)
            self.transform: Transform = cheapest([exact], budget, "a PSF far out of focus")
        else:
            self.transform = plan_transform(geometry, self.dtype, budget)
            defocus = defocus_phase(camera, distance, wavelength)
            pupil = torch.polar(pupil, defocus.remainder(2 * math.pi))
            self._envelope = _pixel_envelope(camera, scale, self.image)
        self._pupil = pupil.to(self.dtype)
        self._straight: torch.Tensor | None = None
        arithmetic = FLOAT64_ARITHMETIC if double else FLOAT32_ARITHMETIC
        self.account = Account(
            method=self.transform.name,
            sampling=f"{camera.panel.shape[1]}x{camera.panel.shape[0]} panel pixels to "
            f"{self.image.shape[1]}x{self.image.shape[0]} samples of "
            f"{self.image.pitch[1] * 1e6:.3g} µm",
            precision="float64" if double else "float32",
            tol=tol,
            model=paraxial_error(camera.lens),
            sampling_error=sampling,
            arithmetic=ErrorEstimate(arithmetic, "measured"),
            cpu_predicted=self.transform.cpu_seconds(budget.speed),
            bytes=self.transform.bytes,
        )

    def _intensity(self, pupil: torch.Tensor) -> torch.Tensor:
        field = self.transform(pupil)
        intensity = field.real**2 + field.imag**2
        if self._envelope is not None:
            intensity = intensity * self._envelope.to(intensity)
        return self._integral(intensity) if self._integral else intensity

    def _unmodulated_light(self, device: torch.device) -> torch.Tensor:
        if self._straight is None or self._straight.device != device:
            self._straight = self._intensity(self._pupil.to(device))
        return self._straight

    @tensors_inside
    def __call__(self, phase: torch.Tensor) -> torch.Tensor:
        if phase.shape[-2:] != self._pupil.shape:
            raise ValueError(
                f"phase is {tuple(phase.shape)}; the panel has {tuple(self._pupil.shape)} pixels"
            )
        require_finite("phase", phase)
        turns = phase.to(torch.float64) / (2 * math.pi)
        angle = (2 * math.pi) * (turns - torch.round(turns.detach()))
        modulation = torch.polar(torch.ones_like(angle), angle).to(self.dtype)
        light = self._intensity(self._pupil.to(phase.device) * modulation)
        if not self.unmodulated:
            return light
        straight = self._unmodulated_light(phase.device)
        return (1 - self.unmodulated) * light + self.unmodulated * straight


def _require(
    distance: float, wavelength: float, oversample: int, integrate: bool, unmodulated: float
) -> None:
    """Raise ValueError for an argument that makes no PSF."""
    require_light(distance, wavelength)
    if oversample < 1:
        raise ValueError(f"oversample is {oversample}; it must be at least 1")
    if integrate and oversample != 1:
        raise ValueError(f"oversample is {oversample}; pixels are integrated at oversample 1")
    if not 0 <= unmodulated <= 1:
        raise ValueError(
            f"unmodulated is {unmodulated:g}; it is a share and must lie between 0 and 1"
        )


def _generalised_pupil(camera: Camera, scale: float, image: Plane) -> torch.Tensor:
    """The stop (thesis Eq. 3.2), of such a strength that intensities are shares of the light."""
    amplitude = pupil_amplitude(camera)
    active = camera.panel.active_side**2
    # A pixel that the stop covers in part passes light by its open area.
    power = float(amplitude.sum()) * active
    if power == 0:
        raise ValueError(f"f_number {camera.lens.f_number:g} closes the stop: no light passes")
    return amplitude * (active / scale * math.sqrt(image.pitch[0] * image.pitch[1] / power))


def _pixel_envelope(camera: Camera, scale: float, image: Plane) -> torch.Tensor:
    """The intensity that one square panel pixel sends to the image plane, 1 on the axis."""
    side = camera.panel.active_side
    y, x = image.mesh()
    return (torch.sinc(y * side / scale) * torch.sinc(x * side / scale)) ** 2


def _sampling_error(
    camera: Camera, distance: float, wavelength: float, image: Plane, integrate: bool, tol: float
) -> tuple[ErrorEstimate, bool]:
    """The error of the cheapest sampling that keeps `tol`, and whether it curves the pixels.

    Raises ToleranceError with the floor.
    """
    rest = PIXEL_INTEGRATION_ERROR if integrate else 0.0
    floor = rest + FLOAT64_ARITHMETIC
    if not floor <= tol:
        raise ToleranceError(f"tol {tol:g} can't be kept; ask for tol {rounded_up(floor)} or more")
    flat = _flat_pixel_error(camera, distance, wavelength, image)
    if flat + floor <= tol:
        return ErrorEstimate(rest + flat, "estimate"), False
    step = phase_step(camera, distance, wavelength)
    if step > _STEEPEST_DEFOCUS:
        raise ToleranceError(
            f"tol {tol:g} can't be kept: defocus changes by {step:.2g} rad across a panel pixel; "
            "bring the object closer to the plane in focus"
        )
    return ErrorEstimate(rest, "bound"), True


def _flat_pixel_error(camera: Camera, distance: float, wavelength: float, image: Plane) -> float:
    """What it costs to take defocus as constant over a panel pixel.

    With a step of s rad across a pixel, its light on the axis is overrated by s²/24 in
    amplitude; where the image lies t rad per pixel off the axis, by s t / 12 on one side of
    the pupil and underrated on the other. Light goes to t = pi at most, where a panel can
    steer it.
    """
    step = phase_step(camera, distance, wavelength)
    corner = 0.5 * math.hypot(*(n * p for n, p in zip(image.shape, image.pitch, strict=True)))
    scale = wavelength * camera.lens.image_distance
    steered = min(2 * math.pi * camera.panel.pitch * corner / scale, math.pi)
    return step * (step / 12 + steered / 10)


def nyquist_samples(camera: Camera, wavelength: float) -> float:
    """Samples per sensor pixel, along an axis, that just resolve the PSF's finest fringe."""
    return 2 * camera.sensor.pitch * cutoff_frequency(camera, wavelength)


def psf(
    camera: Camera,
    phase: torch.Tensor,
    distance: float,
    wavelength: float,
    shape: tuple[int, int],
    *,
    tol: float = 1e-3,
) -> Result[torch.Tensor]:
    """The PSF on sensor pixels, with its account; plans and calls a PSFOperator."""
    started = time.process_time()
    operator = PSFOperator(camera, distance, wavelength, shape, tol=tol)
    value = operator(phase)
    return Result(value, operator.account.spent(time.process_time() - started))
