"""Compute the PSF on the sensor, for a lens or camera, an object distance and a wavelength."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import torch

from optics.accuracy import (
    Account,
    Budget,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    plan_budget,
)
from optics.camera import Camera, Lens
from optics.camera.pupil import Scalar, model_error, open_pupil_radius
from optics.plane import Plane
from optics.psf.dim_windows import CoarseAddedLightError
from optics.psf.engine import PSFEngine
from optics.psf.light_budget import LightBudget, compute_light_budget
from optics.psf.light_on_pixels import LightOnPixels, PixelLight
from optics.psf.panel_engine import PanelEngine
from optics.psf.pixel_request import PixelRequest
from optics.psf.request import PSFRequest
from optics.psf.symmetry import expand_phase
from optics.threads import in_full_precision
from optics.validation import accepts_numpy, require_tensor

# Relative error of derivatives in lengths over that of the light. Behind panels it was 10 at most
# where it was measured; three times as much is told.
_GRADIENT_ERROR_FACTOR = 30.0


class PSFOperator:
    """Computes the incoherent PSF of a lens or a camera; planned once, called many times.

    The model is the Fraunhofer integral of the generalised pupil (thesis Eq. 3.1). In a Camera,
    each panel pixel is a square of constant modulation. The unmodulated share is added in
    intensity, as light of the polarisation that the panel doesn't turn (thesis §5.6). Where the
    panel stands apart from the lens, the light goes on through free space, stop and lens, in
    Fresnel's approximation (thesis Eq. 5.1 to 5.7). A Lens stands alone.

    The result of a call is differentiable in phase, in amplitude, and in every length that is a 0-d
    tensor: distance, wavelength, the lens' focal length, f-number, focus distance and aberrations,
    the separation, the field and the pixels' centre. Autocast is switched off inside.

    Parameters
    ----------
    optics : Camera or Lens
        What forms the image.
    distance : float or 0-d torch.Tensor
        Metres from the object to the panel, or to a lens that stands alone; ``math.inf`` is
        allowed.
    wavelength : float or 0-d torch.Tensor
        Metres.
    pixels : Plane
        The sensor pixels whose light is computed, on the axis or off it; `Sensor.window` makes
        them.
    field : tuple of float or 0-d torch.Tensor, optional
        Metres (y, x) on the sensor from the axis to the point's geometric image, around which the
        pixels lie. On the axis by default.
    sphere : bool, optional
        Whether the point's wave over the panel is the exact spherical wave of thesis Eq. 5.1,
        amplitude included, instead of its parabola. False by default.
    integrate : bool, optional
        Whether the result is the light on whole pixels (the default), or the density of light at
        the pixels' centres times their area.
    unmodulated : float, optional
        Share of unmodulated light, 0 to 1; the panel's own by default.
    symmetry : str, optional
        How patterns are given: "none" (the default), "quarter" or "separable" (see
        `symmetric_shape`). Where the light is symmetric as well, the transforms are shorter.
    tol : float, optional
        Largest relative L2 error from sampling and arithmetic; 1e-3 by default.
    method : str, optional
        One of METHODS for a lens, PANEL_METHODS for a camera, or CHAIN_METHODS for a camera whose
        panel stands apart from its lens. By default the cheapest that keeps `tol`.
    pixel_tol : float, optional
        Part of `tol` that the integration over pixels may use, relative to the light on the pixels
        and just beside them; a hundredth by default.
    phase_slope : float, optional
        Radians per stop radius by which a phase given to a lens may change, for which its nodes are
        chosen; 20 by default. Give it where patterns will be given: the nodes then suit patterns
        that send little light to the window as well.
    calls : int, optional
        How often the operator will be called; that of the budget by default, 100. The method is
        chosen for the least time of planning and all calls.
    budget : Budget, optional
        The memory and processor time allowed, and the machine's speed.

    Attributes
    ----------
    camera : Camera or None
        The camera; None for a lens alone.
    unmodulated : float
        The share of unmodulated light that is added.
    pixels : Plane
        The pixels whose light is computed.
    engine : PSFEngine
        The method in use.

    Raises
    ------
    ToleranceError
        If `tol` can't be kept; the message names the smallest tolerance that can, and the remedy.
    ValueError
        For invalid arguments.
    """

    def __init__(
        self,
        optics: Camera | Lens,
        distance: Scalar,
        wavelength: Scalar,
        pixels: Plane,
        *,
        field: tuple[Scalar, Scalar] = (0.0, 0.0),
        sphere: bool = False,
        integrate: bool = True,
        unmodulated: float | None = None,
        symmetry: str = "none",
        tol: float = 1e-3,
        method: str | None = None,
        pixel_tol: float | None = None,
        phase_slope: float | None = None,
        calls: int | None = None,
        budget: Budget | None = None,
    ) -> None:
        self.camera = optics if isinstance(optics, Camera) else None
        self.unmodulated = _unmodulated_share(self.camera, unmodulated)
        self._asked = PixelRequest(
            optics,
            distance,
            wavelength,
            pixels,
            field,
            sphere,
            integrate,
            symmetry,
            tol,
            method,
            pixel_tol,
            phase_slope,
            plan_budget(budget, calls),
        )
        self.pixels = pixels
        self._planned = LightOnPixels(self._asked)
        self._last: tuple[LightOnPixels, PixelLight] | None = None

    @cached_property
    def _whole(self) -> LightOnPixels:
        """What computes the light of patterns that are given on all pixels of the panel."""
        if self._planned.symmetry == "none":
            return self._planned
        return LightOnPixels(replace(self._asked, symmetry="none"))

    @property
    def engine(self) -> PSFEngine:
        """The method in use."""
        return self._planned.engine

    @property
    def account(self) -> Account:
        """What planning and a call cost, and how accurate the light is: as of the last call.

        Before the first call, the error is that of the plan.
        """
        return _account(self, *(self._last or (self._planned, None)))

    @property
    def wavelength(self) -> Scalar:
        """The wavelength of the light, in metres."""
        return self._asked.wavelength

    @property
    def scale(self) -> Scalar:
        """The ratio of a pupil or panel position to its frequency in the field, in m².

        It is the wavelength times the image distance, or times the ray-matrix element B
        (`Camera.ray_matrix_b`) where the panel stands apart from the lens.
        """
        if self.camera is None:
            return self._planned.request.scale
        return self.wavelength * self.camera.ray_matrix_b

    @property
    def pixel_tol(self) -> float:
        """The relative L2 error that the integration over pixels may add; 0 without one."""
        return self._asked.integration_error

    @property
    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Positions (y, x) in the pupil, in metres, where phase and amplitude are given.

        The two tensors broadcast against each other. The method "axial", which is chosen by name
        only, takes patterns that are the same in all directions, on one radius (y = 0).
        """
        return self._planned.pattern_engine.points()

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of a call, in seconds, on a machine of the given speed."""
        integration = self._planned.integration
        return self.engine.cpu_seconds(speed) + (
            integration.cpu_seconds(speed) if integration else 0.0
        )

    @accepts_numpy
    @in_full_precision
    def __call__(
        self, phase: torch.Tensor | None = None, amplitude: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Compute the PSF of a phase and an amplitude.

        Parameters
        ----------
        phase : torch.Tensor or numpy.ndarray, optional
            Radians, (..., rows, columns) of the panel, or (..., points) of `points` for a lens.
            Zero by default. A symmetric pattern is given in short, as `symmetry` says.
        amplitude : torch.Tensor or numpy.ndarray, optional
            Of the same shape. One by default.

        Returns
        -------
        torch.Tensor or numpy.ndarray
            The share of the light that each pixel receives, ``(..., *pixels.shape)``: of what panel
            and stop would pass on the axis if they stood in one plane, so that vignetting shows as
            less light.
        """
        return self.evaluate(phase, amplitude)

    def evaluate(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: torch.Tensor | None = None,
        unmodulated_spectrum: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Compute what a call does, but from tensors only, and with known spectra if given.

        spectrum, unmodulated_spectrum: of the panel with the phase, and without it (see PSFStack).
        """
        require_tensor("phase", phase)
        require_tensor("amplitude", amplitude)
        self._planned.request.require_unchanged()
        spectra = (spectrum, unmodulated_spectrum)
        if self._planned.symmetry != "none":
            if amplitude is None:
                with suppress(ToleranceError):
                    return self._evaluate(self._planned, phase, None, spectra)
            # Light with an amplitude, or so dim here, takes a method for all patterns.
            spectra = (None, None)
        return self._evaluate(self._whole, self._expand(phase), self._expand(amplitude), spectra)

    def _evaluate(
        self,
        planned: LightOnPixels,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectra: tuple[torch.Tensor | None, torch.Tensor | None] = (None, None),
    ) -> torch.Tensor:
        """Compute the light of a pattern in the shape that was planned for, all shares of it.

        spectra: of the panel with and without the phase, where they are known already.
        """
        if not self.unmodulated or phase is None:
            light = planned.compute(phase, amplitude, spectra[0])
            self._last = planned, light.without_values()
            return light.values
        straight = planned.unmodulated(amplitude, spectrum=spectra[1], any_error=True)
        try:
            added = straight.added_light(self.unmodulated)
            light = planned.compute(phase, amplitude, spectra[0], added)
        except CoarseAddedLightError:
            straight = planned.unmodulated(amplitude, spectrum=spectra[1])
            added = straight.added_light(self.unmodulated)
            light = planned.compute(phase, amplitude, spectra[0], added)
        self._last = planned, light.without_values()
        other = straight.values.to(light.values.device)
        return (1 - self.unmodulated) * light.values + self.unmodulated * other

    def _expand(self, pattern: torch.Tensor | None) -> torch.Tensor | None:
        """Expand the phase or amplitude of a symmetric pattern to all pixels of the panel.

        Raises ValueError for the amplitude of a separable pattern, which isn't a sum.
        """
        if pattern is None or self.camera is None or self._asked.symmetry == "none":
            return pattern
        return expand_phase(self._asked.symmetry, pattern, self.camera.panel.shape)

    def unmodulated_psf(
        self,
        amplitude: torch.Tensor | None = None,
        *,
        cache_result: bool = False,
        spectrum: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Compute the PSF of light that gets no phase from the panel, as a copy of its own.

        amplitude: as in a call. Without one, the result is always cached: it is the same for every
        pattern.
        cache_result: whether the very same amplitude, unchanged, will be given again.
        spectrum: of the panel without a phase, where it is known already.
        """
        require_tensor("amplitude", amplitude)
        planned = self._planned
        planned.request.require_unchanged()
        if self._asked.symmetry != "none" and amplitude is not None:
            planned, amplitude, cache_result = self._whole, self._expand(amplitude), False
        light = planned.unmodulated(amplitude, cache_result=cache_result, spectrum=spectrum)
        self._last = planned, light.without_values()
        return light.values.clone()

    def needs_unmodulated_psf(self, amplitude: torch.Tensor | None) -> bool:
        """Tell whether a phase needs `unmodulated_psf`, which isn't computed yet."""
        return self.unmodulated > 0 and not self._planned.knows_unmodulated(amplitude)

    @accepts_numpy
    @in_full_precision
    def light_budget(
        self, phase: torch.Tensor | None = None, amplitude: torch.Tensor | None = None
    ) -> LightBudget:
        """Compute where the light of one pattern goes: through the stop, to the window, or blocked.

        Unmodulated light counts. The pattern is given as in a call. Raises ValueError for a lens
        alone.
        """
        if self.camera is None:
            raise ValueError("a lens alone has no panel whose light could be told apart")
        phase, amplitude = self._expand(phase), self._expand(amplitude)
        self._whole.request.require_unchanged()
        window = float(self._evaluate(self._whole, phase, amplitude).sum())
        return compute_light_budget(self._whole, phase, amplitude, self.unmodulated, window)


def _unmodulated_share(camera: Camera | None, share: float | None) -> float:
    """Return the share of light that gets no phase from the panel, the panel's own by default."""
    if camera is None:
        if share:
            raise ValueError(f"unmodulated is {share:g}; a lens without a panel modulates nothing")
        return 0.0
    share = camera.panel.unmodulated if share is None else share
    if not 0 <= share <= 1:
        raise ValueError(f"unmodulated is {share:g}; it is a share and must lie between 0 and 1")
    return share


def _account(operator: PSFOperator, planned: LightOnPixels, light: PixelLight | None) -> Account:
    """Account for a plan, and for the light of its last call, if there was any."""
    first, request, integration = planned.engine, planned.request, planned.integration
    engine, error, arithmetic, rest = first, first.error, first.arithmetic, operator.pixel_tol
    if light is not None:
        engine, error, arithmetic = light.engine, light.error, light.arithmetic
        rest = light.integration_error
    # Where another engine stood in for the first one, both were planned and called.
    tried = [first] if engine is first else [first, engine]
    speed = request.budget.speed
    call = sum(one.cpu_seconds(speed) for one in tried)
    planning = sum(one.planning_seconds(speed) + one.earlier_seconds for one in tried)
    kept = sum(one.bytes for one in tried)
    once = _unmodulated_seconds(first, speed) if operator.unmodulated else 0.0
    if integration is not None:
        each = integration.cpu_seconds(speed)
        call, once = call + each, once + (each if operator.unmodulated else 0.0)
        planning += integration.planning_seconds(speed)
        kept += integration.bytes
    rows, columns = request.samples.shape
    gradient_error = None
    if request.differentiable:
        # A length moves the light at the rim of the pupil most, where sampling errs most.
        gradient_error = ErrorEstimate(
            _GRADIENT_ERROR_FACTOR * (error.value + arithmetic),
            "estimate from the error of the light",
        )
    return Account(
        method=engine.name,
        sampling=f"{engine.sampling} to {columns}x{rows} samples of "
        f"{request.samples.pitch[1] * 1e6:.3g} µm",
        precision=engine.precision,
        tol=planned.tol,
        model=_model_error(request, planned.camera),
        sampling_error=ErrorEstimate(error.value + rest, error.how),
        arithmetic=ErrorEstimate(arithmetic, "estimate, from tests"),
        cpu_predicted=call,
        gradient_error=gradient_error,
        planning_predicted=planning + once,
        bytes=kept,
    )


def _unmodulated_seconds(engine: PSFEngine, speed: MachineSpeed) -> float:
    """Predict the seconds of light without a phase, which is computed once."""
    if isinstance(engine, PanelEngine):
        return engine.straight_seconds(speed)
    return engine.cpu_seconds(speed)


def _model_error(request: PSFRequest, camera: Camera | None) -> ErrorEstimate:
    """Estimate the error of the optical model."""
    n = request.numeric
    radius = n.radius
    if camera is not None and not n.separation:
        radius = open_pupil_radius(replace(camera, lens=n.lens))
    return model_error(n.lens, n.wavelength, radius)
