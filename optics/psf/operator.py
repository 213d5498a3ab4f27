"""Compute the PSF on the sensor, for a lens or camera, an object distance and a wavelength."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    Account,
    Budget,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    limit_planning_time,
    plan_budget,
    require_memory,
    unreachable_tolerance_error,
)
from optics.camera import Camera, Lens
from optics.camera.pupil import (
    Scalar,
    cutoff_frequencies,
    model_error,
    open_pupil_radius,
    require_valid_source,
)
from optics.plane import Plane
from optics.psf.axial import AxialEngine
from optics.psf.behind_panel import BehindPanelEngine
from optics.psf.chain_grid import GridEngine
from optics.psf.choice import (
    fallback_engines,
    prepare_cheapest_engine,
    require_method,
    tolerance_error_with_advice,
)
from optics.psf.dim_windows import (
    UNKNOWN_LIGHT,
    AddedLight,
    CoarseAddedLightError,
    largest_ratio,
    normalise_amplitude,
    scale_light,
    window_norm,
)
from optics.psf.engine import PSFEngine
from optics.psf.light_budget import LightBudget, compute_light_budget
from optics.psf.operator_inputs import (
    build_spherical_wave,
    numeric_optics,
    require_pixels,
    require_slope,
    require_symmetry,
    resolve_unmodulated_share,
    validate_field_position,
)
from optics.psf.panel_engine import PanelEngine
from optics.psf.request import PSFRequest
from optics.psf.symmetry import expand_phase, symmetric_engine
from optics.sensor import PixelIntegration
from optics.threads import in_full_precision
from optics.validation import (
    accepts_numpy,
    as_number,
    require_positive,
    require_tensor,
    require_tolerance,
    rounded_down,
)


@dataclass(frozen=True)
class PSFOperatorSettings:
    """Tune how a PSFOperator plans for sensor pixels, for patterns, and for derivatives in lengths.

    pixel_tol_share: share of the tolerance that the integration over pixels may use. Chosen.
    beside_factor: factor on the error that brighter light beside the pixels makes, which isn't
    spread evenly. Chosen; 6 was needed where few pixels lie in a null of the envelope.
    finest_pixel_tol: smallest error of that integration that is planned for, near double
    precision's rounding.
    derivative_tol_share: share of the tolerance that the light keeps, where a method does, so that
    derivatives keep the tolerance. Chosen.
    phase_slope: radians per stop radius by which a phase on a lens' points may change unless
    stated. Chosen.
    pattern_tol_share: share of the tolerance that the light without a pattern keeps, where a method
    does, if patterns are expected on a lens' points: with one, the window may get less light.
    Chosen; nodes' errors fall so fast with their number that it takes few more.
    gradient_error_factor: relative error of derivatives over that of the light. Behind panels it
    was 10 at most where it was measured; three times as much is told.
    """

    pixel_tol_share: float = 0.01
    beside_factor: float = 8.0
    finest_pixel_tol: float = 1e-13
    derivative_tol_share: float = 0.03
    phase_slope: float = 20.0
    pattern_tol_share: float = 0.01
    gradient_error_factor: float = 30.0


_SETTINGS = PSFOperatorSettings()


class PSFOperator:
    """Computes the incoherent PSF of a lens or a camera; planned once, called many times.

    The model is the Fraunhofer integral of the generalised pupil (thesis Eq. 3.1). In a Camera,
    each panel pixel is a square of constant modulation. The unmodulated share is added in
    intensity, as light of the polarisation that the panel doesn't turn (thesis §5.6). Where the
    panel stands apart from the lens, the light goes on through free space, stop and lens, in
    Fresnel's approximation (thesis Eq. 5.1 to 5.7). A Lens stands alone.

    Call the operator with a phase and an amplitude to get the PSF; see `__call__`. The result is
    differentiable in phase, in amplitude, and in every length that is a 0-d tensor: distance,
    wavelength, the lens' focal length, f-number, focus distance and aberrations, the separation,
    the field and the pixels' centre. Mixed precision (autocast) is switched off inside.

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
        `optics.psf.symmetry.symmetric_shape`). Where the light is symmetric as well, the
        Fourier transforms are shorter; elsewhere, patterns are expanded to the panel.
    tol : float, optional
        Largest relative L2 error from sampling and arithmetic; 1e-3 by default.
    method : str, optional
        One of METHODS for a lens, the name of a Fourier transform for a camera, or one of
        CHAIN_METHODS for a camera whose panel stands apart from its lens. By default the cheapest
        that keeps `tol`.
    pixel_tol : float, optional
        Part of `tol` that the integration over pixels may use, relative to the light on the pixels
        and just beside them; a hundredth by default. Where that light is far brighter than the
        pixels', a finer integration stands in.
    phase_slope : float, optional
        Radians per stop radius by which a phase given to a lens may change. The quadrature nodes
        are chosen for it beforehand. Give it where patterns will be given: the nodes then suit
        patterns that send little light to the window as well. Otherwise they suit 20.
    calls : int, optional
        How often the operator will be called: the method is chosen for the least time of planning
        and all calls together. That of the budget by default, 100.
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

    References
    ----------
    Thesis Eq. 3.1, Eq. 5.1 to 5.7, §5.6.
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
        budget = plan_budget(budget, calls)
        self._plan_again = partial(
            PSFOperator,
            optics,
            distance,
            wavelength,
            pixels,
            field=field,
            sphere=sphere,
            integrate=integrate,
            unmodulated=unmodulated,
            tol=tol,
            method=method,
            pixel_tol=pixel_tol,
            phase_slope=phase_slope,
            budget=budget,
        )
        self.camera = camera = optics if isinstance(optics, Camera) else None
        self._symmetry = require_symmetry(symmetry, camera)
        lens = optics.lens if isinstance(optics, Camera) else optics
        self.unmodulated = resolve_unmodulated_share(camera, unmodulated)
        require_valid_source(distance, wavelength)
        require_tolerance(tol)
        require_method(method, camera)
        require_pixels(pixels)
        require_slope(phase_slope)
        self.pixels = pixels
        cutoff = cutoff_frequencies(numeric_optics(optics), as_number(wavelength))
        # The integration's part shrinks with the tolerance that is asked for instead.
        floor = 20 * FLOAT64_ARITHMETIC / (1 - 2 * _SETTINGS.pixel_tol_share)
        self._pixel_integration = None
        if integrate:
            # Below the floor nothing is kept: no weights are sought for what is refused anyway.
            if pixel_tol is not None:
                require_positive("pixel_tol", pixel_tol, "")
            pixel_tol = pixel_tol or _SETTINGS.pixel_tol_share * max(floor, tol)
            self._pixel_integration = PixelIntegration(pixels, cutoff, budget, pixel_tol)
        else:
            rows, columns = pixels.shape
            what = f"the light at {columns}x{rows} points"
            require_memory(what, 8.0 * rows * columns, budget.memory, "ask for fewer pixels")
        samples = self._pixel_integration.plane if self._pixel_integration else pixels
        rest = self._pixel_integration.error if self._pixel_integration else 0.0
        margin = self._pixel_integration.margin if self._pixel_integration else (0, 0)
        request = PSFRequest(
            lens,
            distance,
            wavelength,
            samples,
            tol - rest,
            budget,
            margin,
            _SETTINGS.phase_slope if phase_slope is None else phase_slope,
            camera.separation if camera else 0.0,
            validate_field_position(field),
            build_spherical_wave(camera, distance, wavelength, field) if sphere else None,
            pixels.pitch if integrate else (0.0, 0.0),
        )
        if not max(floor, rest + 20 * FLOAT64_ARITHMETIC) <= tol:
            with limit_planning_time(budget.seconds):
                raise tolerance_error_with_advice(request, camera, method, rest, floor)
        self._cached_unmodulated_psfs: list[_UnmodulatedLight] = []
        self._method, self._reserved_tol = method, rest
        expects_patterns = camera is None and phase_slope is not None
        with limit_planning_time(budget.seconds):
            symmetric = _plan_symmetric_engine(request, camera, method, symmetry)
            self._expands = symmetric is None and symmetry != "none"
            self._request, self.engine = symmetric or _plan_engine(
                request, camera, method, rest, expects_patterns=expects_patterns
            )
        self._fallback_engine: PSFEngine | None = None
        self._last_engine = self.engine
        self._finer_operator: PSFOperator | None = None
        self._last_norm = torch.zeros(())
        self._tol, self._integration_error = tol, rest
        self._model_error_estimate = self._model_error(request)

    @property
    def account(self) -> Account:
        """What planning and a call cost, and how accurate the light is: as of the last call.

        Before the first call, the error is that of the plan.
        """
        request, tol, rest = self._request, self._tol, self._integration_error
        engine, speed = self._last_engine, request.budget.speed
        # Where another engine stood in for the first one, both were planned and called.
        tried = [self.engine] if engine is self.engine else [self.engine, engine]
        rows, columns = request.samples.shape
        integral = self._pixel_integration.cpu_seconds(speed) if self._pixel_integration else 0.0
        sampling = ErrorEstimate(engine.error.value + rest, engine.error.how)
        return Account(
            method=engine.name,
            sampling=f"{engine.sampling} to {columns}x{rows} samples of "
            f"{request.samples.pitch[1] * 1e6:.3g} µm",
            precision=engine.precision,
            tol=tol,
            model=self._model_error_estimate,
            sampling_error=sampling,
            arithmetic=ErrorEstimate(engine.arithmetic, "estimate, from tests"),
            cpu_predicted=sum(one.cpu_seconds(speed) for one in tried) + integral,
            gradient_error=self._gradient_error,
            planning_predicted=sum(
                one.planning_seconds(speed) + one.earlier_seconds for one in tried
            )
            + self._straight_seconds(speed)
            + (self._pixel_integration.planning_seconds(speed) if self._pixel_integration else 0.0),
            bytes=sum(one.bytes for one in tried)
            + (self._pixel_integration.bytes if self._pixel_integration else 0),
        )

    @property
    def _gradient_error(self) -> ErrorEstimate | None:
        """The relative L2 error of derivatives in lengths, as of the last call, by an estimate.

        A length moves the light at the rim of the pupil most, which is where sampling errs most.
        """
        if not self._request.differentiable:
            return None
        engine = self._last_engine
        error = _SETTINGS.gradient_error_factor * (engine.error.value + engine.arithmetic)
        return ErrorEstimate(error, "estimate from the error of the light")

    def _straight_seconds(self, speed: MachineSpeed) -> float:
        """Predict the seconds of unmodulated light, which is computed once."""
        engine = self.engine
        if not self.unmodulated:
            return 0.0
        integral = self._pixel_integration.cpu_seconds(speed) if self._pixel_integration else 0.0
        if isinstance(engine, PanelEngine):
            return engine.straight_seconds(speed) + integral
        return engine.cpu_seconds(speed) + integral

    def _model_error(self, request: PSFRequest) -> ErrorEstimate:
        """Estimate the error of the optical model."""
        n = request.numeric
        radius = n.radius
        if self.camera is not None and not n.separation:
            radius = open_pupil_radius(replace(self.camera, lens=n.lens))
        return model_error(n.lens, n.wavelength, radius)

    @property
    def wavelength(self) -> Scalar:
        """The wavelength of the light, in metres."""
        return self._request.wavelength

    @property
    def scale(self) -> Scalar:
        """The ratio of a pupil or panel position to its frequency in the field, in m².

        It is the wavelength times the image distance, or times the ray-matrix element B
        (`Camera.ray_matrix_b`) where the panel stands apart from the lens.
        """
        if self.camera is None:
            return self._request.scale
        return self._request.wavelength * self.camera.ray_matrix_b

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of a call, in seconds, on a machine of the given speed."""
        integral = self._pixel_integration.cpu_seconds(speed) if self._pixel_integration else 0.0
        return self.engine.cpu_seconds(speed) + integral

    @property
    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Positions (y, x) in the pupil, in metres, where phase and amplitude are given.

        The two tensors broadcast against each other. The method "axial", which is chosen by name
        only, takes patterns that are the same in all directions, on one radius (y = 0).
        """
        return self._pattern_engine.points()

    @cached_property
    def _pattern_engine(self) -> PSFEngine:
        """The engine for light with a pattern.

        The first one, unless it was chosen for the symmetry of a lens, which a pattern needn't
        have. One that the caller named is kept.
        """
        if self._method is not None or not isinstance(self.engine, AxialEngine):
            return self.engine
        asked = replace(self._request, tol=self._tol - self._reserved_tol, pattern_tol=None)
        _, engine = _plan_engine(
            asked, None, None, self._reserved_tol, expects_patterns=True, for_patterns=True
        )
        return engine

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
            The share of the light leaving the pupil that each pixel receives,
            ``(..., *pixels.shape)``.
            It is a share of what panel and stop would pass on the axis if they stood in one plane,
            so that vignetting shows as less light.
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

        Parameters
        ----------
        phase : torch.Tensor or None
            As in a call.
        amplitude : torch.Tensor or None
            As in a call.
        spectrum : torch.Tensor, optional
            The spectrum of the panel with the phase, where it is known already (see PSFStack).
        unmodulated_spectrum : torch.Tensor, optional
            The spectrum of the panel without the phase, where it is known already.

        Returns
        -------
        torch.Tensor
            The PSF, ``(..., *pixels.shape)``.
        """
        require_tensor("phase", phase)
        require_tensor("amplitude", amplitude)
        self._request.require_unchanged()
        if self._symmetry != "none" and amplitude is not None:
            whole = (self._expand(phase), self._expand(amplitude))
            return self._whole_pattern_operator.evaluate(*whole, spectrum, unmodulated_spectrum)
        if self._expands:
            phase = self._expand(phase)
        try:
            return self._evaluate_phase(phase, amplitude, spectrum, unmodulated_spectrum)
        except ToleranceError:
            if self._symmetry == "none" or self._expands:
                raise
            # The light that a symmetric pattern sends here takes a method for all patterns.
            return self._whole_pattern_operator.evaluate(self._expand(phase), None)

    def _evaluate_phase(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: torch.Tensor | None,
        unmodulated_spectrum: torch.Tensor | None,
    ) -> torch.Tensor:
        """Compute the light of a phase in the shape that the engine takes, as `evaluate` does."""
        if not self.unmodulated or phase is None:
            return self._light_on_pixels(phase, amplitude, spectrum)
        straight = self._unmodulated_light(amplitude, spectrum=unmodulated_spectrum, any_error=True)
        added = straight.added_light(self.unmodulated)
        try:
            light = self._light_on_pixels(phase, amplitude, spectrum, added)
        except CoarseAddedLightError:
            straight = self._unmodulated_light(amplitude, spectrum=unmodulated_spectrum)
            added = straight.added_light(self.unmodulated)
            light = self._light_on_pixels(phase, amplitude, spectrum, added)
        other = straight.light.to(light.device)
        return (1 - self.unmodulated) * light + self.unmodulated * other

    def _expand(self, pattern: torch.Tensor | None) -> torch.Tensor | None:
        """Expand the phase or amplitude of a symmetric pattern to all pixels of the panel.

        Raises ValueError for the amplitude of a separable pattern, which isn't a sum.
        """
        if pattern is None or self.camera is None:
            return pattern
        return expand_phase(self._symmetry, pattern, self.camera.panel.shape)

    @cached_property
    def _whole_pattern_operator(self) -> PSFOperator:
        """The same operator for patterns that are given on all pixels."""
        return self._plan_again()

    def unmodulated_psf(
        self,
        amplitude: torch.Tensor | None = None,
        *,
        cache_result: bool = False,
        spectrum: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Compute the PSF of light that gets no phase from the panel.

        Parameters
        ----------
        amplitude : torch.Tensor, optional
            As in a call. Without one, the result is always cached: it is the same for every
            pattern.
        cache_result : bool, optional
            Whether the very same amplitude tensor, unchanged, will be given again.
        spectrum : torch.Tensor, optional
            The spectrum of the panel without a phase, where it is known already.

        Returns
        -------
        torch.Tensor
            The PSF, ``(..., *pixels.shape)``; a copy that may be written into.
        """
        require_tensor("amplitude", amplitude)
        self._request.require_unchanged()
        if self._symmetry != "none" and amplitude is not None:
            return self._whole_pattern_operator.unmodulated_psf(self._expand(amplitude))
        straight = self._unmodulated_light(amplitude, cache_result=cache_result, spectrum=spectrum)
        return straight.light.clone()

    def _unmodulated_light(
        self,
        amplitude: torch.Tensor | None,
        *,
        cache_result: bool = False,
        spectrum: torch.Tensor | None = None,
        any_error: bool = False,
    ) -> _UnmodulatedLight:
        """Compute unmodulated light, or take it from the cache without a copy.

        any_error: whether what a chain's first method gives is taken even if its error exceeds the
        tolerance: beside a pattern's light, errors of dim light seldom matter.
        """
        keeps = not self._request.differentiable and (amplitude is None or cache_result)
        for known in self._cached_unmodulated_psfs if keeps else []:
            if known.amplitude is amplitude and (any_error or known.keeps_tol):
                return known
        added = UNKNOWN_LIGHT if any_error and self._is_chain else None
        light = self._light_on_pixels(None, amplitude, spectrum, added)
        engine, norm = self._last_engine, self._last_norm if self._is_chain else None
        error = engine.error.value + engine.arithmetic
        if isinstance(engine, BehindPanelEngine):
            error = engine.own_error
        if isinstance(engine, PanelEngine) and not self._is_chain:
            norm = engine.light_norm
        keeps_tol = added is None or error <= self._request.tol
        straight = _UnmodulatedLight(amplitude, light, norm, error, keeps_tol)
        if keeps and not light.requires_grad:
            others = [
                one for one in self._cached_unmodulated_psfs if one.amplitude is not amplitude
            ]
            self._cached_unmodulated_psfs = [*others[-1:], straight]
        return straight

    def needs_unmodulated_psf(self, amplitude: torch.Tensor | None) -> bool:
        """Tell whether a phase needs `unmodulated_psf`, which isn't computed yet."""
        return self.unmodulated > 0 and not any(
            known.amplitude is amplitude for known in self._cached_unmodulated_psfs
        )

    def _light_on_pixels(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: torch.Tensor | None = None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        """Compute the light on the sensor's pixels; `added` tells of light that is added to it."""
        peak = None
        if amplitude is not None:
            amplitude, peak = normalise_amplitude(amplitude, self.points[0].ndim)
        light = self._intensity_with_fallback(phase, amplitude, spectrum, added)
        if self._pixel_integration:
            samples, light = light, self._pixel_integration(light)
            # Even light has this norm on the samples; any other light has a larger one there.
            whole = window_norm(light.detach(), (slice(None), slice(None)))
            self._last_norm = whole / math.sqrt(self._pixel_integration.samples_per_pixel)
            self._integration_error = self._measure_integration_error(samples, added)
            if self._integration_error > self._tol_left_for_integration:
                light = self._finer_light_on_pixels(phase, amplitude, added)
        elif self._is_chain:
            self._last_norm = window_norm(light.detach(), self._request.window_slices)
        return scale_light(light, peak)

    @property
    def _is_chain(self) -> bool:
        """Whether the panel stands apart from the lens."""
        return self.camera is not None and self._request.numeric.separation > 0

    @property
    def _tol_left_for_integration(self) -> float:
        """What the engine left of the tolerance in its last call."""
        engine = self._last_engine
        return self._tol - engine.error.value - engine.arithmetic

    def _measure_integration_error(self, samples: torch.Tensor, added: AddedLight | None) -> float:
        """Return the relative L2 error that the integration over pixels adds.

        It is a share of the light on all samples, of which those beside the pixels may be far
        brighter than the others.

        samples: of the last call's light.
        """
        assert self._pixel_integration is not None
        planned, seen = self._pixel_integration.error, self._last_norm
        whole = window_norm(samples.detach(), (slice(None), slice(None)))
        if added is not None and added is not UNKNOWN_LIGHT:
            seen = torch.hypot(seen, added.norm.to(seen))
        dimness = largest_ratio(whole, seen)
        return planned * max(1.0, 1.0 + _SETTINGS.beside_factor * (dimness - 1.0))

    def _finer_light_on_pixels(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None, added: AddedLight | None
    ) -> torch.Tensor:
        """Compute the light with a finer integration over pixels, beside which there is much light.

        Raises ToleranceError if there is none.
        """
        assert self._pixel_integration is not None
        planned, needed = self._pixel_integration.error, self._integration_error
        finer = planned * self._tol_left_for_integration / needed / 2
        given = phase is not None or amplitude is not None
        if given and self.camera is None:
            raise self._coarse_integration_error(finer)
        if not finer > _SETTINGS.finest_pixel_tol:
            engine, least = self._last_engine, 2.5 * _SETTINGS.finest_pixel_tol * needed / planned
            floor = least + 1.1 * (engine.error.value + engine.arithmetic)
            raise unreachable_tolerance_error(self._tol, max(floor, 1.1 * self._tol))
        if self._finer_operator is None or self._finer_operator.pixel_tol > finer:
            symmetry = "none" if self._expands else self._symmetry
            self._finer_operator = self._plan_again(pixel_tol=finer, symmetry=symmetry)
        other = self._finer_operator
        light = other._light_on_pixels(phase, amplitude, None, added)
        self._last_engine, self._integration_error = other._last_engine, other._integration_error
        self._last_norm = other._last_norm
        return light

    def _coarse_integration_error(self, finer: float) -> ToleranceError:
        """Return the refusal of a pattern on a lens' points, whose pixels need the error `finer`.

        A lens that is planned anew takes its pattern at other points, so that the caller has to.
        """
        reason = (
            f"tol {self._tol:g} can't be kept: far more light lies beside the pixels than there"
        )
        if finer > _SETTINGS.finest_pixel_tol:
            with suppress(ToleranceError):
                self._plan_again(pixel_tol=finer)
                return ToleranceError(
                    reason, f"plan a PSFOperator with pixel_tol={rounded_down(finer)}"
                )
        return ToleranceError(reason)

    @property
    def pixel_tol(self) -> float:
        """The relative L2 error that the integration over pixels may add; 0 without one."""
        return self._pixel_integration.error if self._pixel_integration else 0.0

    def _intensity_with_fallback(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: torch.Tensor | None,
        added: AddedLight | None,
    ) -> torch.Tensor:
        """Compute the light on the samples, by a fallback method if the first one fails.

        A fallback is needed if the pattern sends so little light to the window that the first
        engine can't keep the tolerance.
        """
        is_plain = phase is None and amplitude is None
        self._last_engine = engine = self.engine if is_plain else self._pattern_engine
        try:
            if spectrum is not None and isinstance(engine, GridEngine):
                light = engine.intensity_from_spectrum(spectrum, phase, amplitude, added)
            elif isinstance(engine, BehindPanelEngine):
                light = engine.intensity(phase, amplitude, added)
            else:
                light = engine.intensity(phase, amplitude)
        except ToleranceError:
            for other in self._fallback_engines():
                try:
                    assert isinstance(other, BehindPanelEngine)
                    light = other.intensity(phase, amplitude, added)
                except ToleranceError:
                    continue
                self._fallback_engine, self._last_engine = other, other.used_engine
                return light
            raise
        self._last_engine = engine.used_engine
        return light

    def _fallback_engines(self) -> Iterator[PSFEngine]:
        """Yield the engines that may stand in for the first one.

        The fallback that was used last comes first. There are none if the caller named a method, or
        if the panel doesn't stand apart from the lens.
        """
        if self._method is not None or self.camera is None or not self.camera.separation:
            return
        tried = [self.engine]
        if self._fallback_engine is not None:
            tried.append(self._fallback_engine)
            yield self._fallback_engine
        yield from fallback_engines(self._request, self.camera, tried)

    @accepts_numpy
    @in_full_precision
    def light_budget(
        self, phase: torch.Tensor | None = None, amplitude: torch.Tensor | None = None
    ) -> LightBudget:
        """Compute where a pattern's light goes: through the stop, to the window, or blocked.

        Unmodulated light counts.

        Parameters
        ----------
        phase : torch.Tensor or numpy.ndarray, optional
            Radians, (rows, columns) of the panel, as in a call.
        amplitude : torch.Tensor or numpy.ndarray, optional
            Of the same shape.

        Returns
        -------
        LightBudget
            Shares of the light, in the units of the PSF.

        Raises
        ------
        ValueError
            For a lens alone.
        """
        if self.camera is None:
            raise ValueError("a lens alone has no panel whose light could be told apart")
        if self._symmetry != "none":
            whole = (self._expand(phase), self._expand(amplitude))
            return self._whole_pattern_operator.light_budget(*whole)
        window = float(self.evaluate(phase, amplitude).sum())
        amplitude, peak = normalise_amplitude(amplitude, 2)
        strongest = 1.0 if peak is None else float(peak)
        parts = [(1.0, phase)]
        if self.unmodulated and phase is not None:
            parts = [(1 - self.unmodulated, phase), (self.unmodulated, None)]
        fields = [(strongest**2 * share, self._panel_field(one, amplitude)) for share, one in parts]
        return compute_light_budget(self._request, self.camera, fields, window)

    def _panel_field(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> torch.Tensor:
        """Compute the field behind the panel of one pattern, complex64, (rows, columns)."""
        assert self.camera is not None
        shape = self.camera.panel.shape
        factor = self.engine.modulation_factor(phase, amplitude, shape, torch.complex64)
        if factor is None:
            factor = torch.ones(shape, dtype=torch.complex64)
        if factor.ndim != 2:
            raise ValueError(f"phase is {tuple(factor.shape)}; give one pattern, {shape}")
        sphere = self._request.sphere
        if sphere is not None:
            factor = factor * sphere.wave_factor(*self.engine.points()).to(factor)
        return factor.detach()


@dataclass(frozen=True)
class _UnmodulatedLight:
    """Holds the light that gets no phase from the panel, for an amplitude.

    light: on the pixels.
    norm: its L2 norm over the window on the samples, where it is known.
    error: relative L2 error.
    keeps_tol: whether that is within the tolerance, as far as it can be.
    """

    amplitude: torch.Tensor | None
    light: torch.Tensor
    norm: torch.Tensor | None
    error: float
    keeps_tol: bool

    def added_light(self, share: float) -> AddedLight | None:
        """Tell of a share of this light in the units of the rest, which is a PSF of its own."""
        if self.norm is None or share == 1:
            return None
        norm = self.norm * (share / (1 - share))
        return AddedLight(norm, self.error * norm)


def _plan_engine(
    request: PSFRequest,
    camera: Camera | None,
    method: str | None,
    reserved_tol: float,
    *,
    expects_patterns: bool,
    for_patterns: bool = False,
) -> tuple[PSFRequest, PSFEngine]:
    """Prepare the cheapest engine, to a smaller tolerance if that is possible and needed.

    It is needed with derivatives, and for patterns on the points of a lens, of whose light the
    window may get less than without one. Returns the request that is kept, and its engine.

    expects_patterns: whether to leave room for such patterns.
    for_patterns: whether the engine takes any of them.
    """
    prepare = partial(prepare_cheapest_engine, for_patterns=for_patterns)
    shares = []
    if request.differentiable and method is None:
        shares.append(_SETTINGS.derivative_tol_share)
    if expects_patterns:
        shares.append(_SETTINGS.pattern_tol_share)
    if shares:
        tight = replace(
            request,
            tol=min(shares) * request.tol,
            pattern_tol=request.tol if expects_patterns else None,
        )
        with suppress(ToleranceError):
            return tight, prepare(tight, camera, method, reserved_tol)
    return request, prepare(request, camera, method, reserved_tol)


def _plan_symmetric_engine(
    request: PSFRequest, camera: Camera | None, method: str | None, symmetry: str
) -> tuple[PSFRequest, PSFEngine] | None:
    """Prepare the engine for symmetric patterns; None if there is none that suits.

    A named method is one for all patterns.
    """
    if camera is None or method is not None:
        return None
    make = symmetric_engine(symmetry, request, camera)
    if make is None:
        return None
    try:
        engine = make()
        engine.prepare()
    except ToleranceError:
        return None
    return request, engine
