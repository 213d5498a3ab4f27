"""Compute the PSF on the sensor, for a lens or camera, an object distance and a wavelength."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace

import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    Account,
    Budget,
    ErrorEstimate,
    MachineSpeed,
    Result,
    ToleranceError,
)
from optics.camera import Camera, Lens
from optics.chain import GridEngine, LightBudget, compute_light_budget
from optics.plane import Plane
from optics.psf.engine_choice import (
    fallback_engines,
    prepare_cheapest_engine,
    require_method,
    tolerance_error_with_advice,
)
from optics.psf_engines.engine import PSFEngine
from optics.psf_engines.request import PSFRequest
from optics.psf_engines.spherical_wave import SphericalWaveCorrection
from optics.pupil import (
    Scalar,
    cutoff_frequency,
    model_error,
    numeric_camera,
    open_pupil_radius,
    require_valid_source,
)
from optics.sensor import PIXEL_INTEGRATION_ERROR, PixelIntegration
from optics.threads import in_full_precision
from optics.validation import (
    accepts_numpy,
    as_number,
    require_tensor,
    require_tolerance,
    to_plain_numbers,
)


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
    tol : float, optional
        Largest relative L2 error from sampling and arithmetic; 1e-3 by default.
    method : str, optional
        One of METHODS for a lens, the name of a Fourier transform for a camera, or one of
        CHAIN_METHODS for a camera whose panel stands apart from its lens. By default the cheapest
        that keeps `tol`.
    phase_slope : float, optional
        Radians per stop radius by which a phase given to a lens may change. The quadrature nodes
        are chosen for it beforehand. 20 by default.
    budget : Budget, optional
        The memory allowed, and the machine's speed.

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
    account : Account
        What a call costs and how accurate it is.

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
        tol: float = 1e-3,
        method: str | None = None,
        phase_slope: float = 20.0,
        budget: Budget | None = None,
    ) -> None:
        self.camera = camera = optics if isinstance(optics, Camera) else None
        lens = optics.lens if isinstance(optics, Camera) else optics
        self.unmodulated = _resolve_unmodulated_share(camera, unmodulated)
        require_valid_source(distance, wavelength)
        require_tolerance(tol)
        require_method(method, camera)
        self.pixels = pixels
        cutoff = cutoff_frequency(_numeric_optics(optics), as_number(wavelength))
        self._pixel_integration = PixelIntegration(pixels, cutoff, budget) if integrate else None
        samples = self._pixel_integration.plane if self._pixel_integration else pixels
        rest = PIXEL_INTEGRATION_ERROR if integrate else 0.0
        floor = rest + 20 * FLOAT64_ARITHMETIC
        margin = self._pixel_integration.margin if self._pixel_integration else 0
        request = PSFRequest(
            lens,
            distance,
            wavelength,
            samples,
            tol - rest,
            budget or Budget(),
            margin,
            phase_slope,
            camera.separation if camera else 0.0,
            _validate_field_position(field),
            _build_spherical_wave(camera, distance, wavelength, field) if sphere else None,
            pixels.pitch if integrate else (0.0, 0.0),
        )
        if not floor <= tol:
            raise tolerance_error_with_advice(request, camera, method, rest, floor)
        self._request = request
        self._cached_unmodulated_psfs: list[tuple[torch.Tensor | None, torch.Tensor]] = []
        self.engine = prepare_cheapest_engine(request, camera, method, rest)
        self._method = method
        self._fallback_engine: PSFEngine | None = None
        self.account = self._build_account(request, tol, rest)

    def _build_account(self, request: PSFRequest, tol: float, rest: float) -> Account:
        """Build the PSF's account: its method, errors, predicted time and memory."""
        engine, speed = self.engine, request.budget.speed
        rows, columns = request.samples.shape
        sampling = ErrorEstimate(engine.error.value + rest, engine.error.how)
        return Account(
            method=engine.name,
            sampling=f"{engine.sampling} to {columns}x{rows} samples of "
            f"{request.samples.pitch[1] * 1e6:.3g} µm",
            precision=engine.precision,
            tol=tol,
            model=self._model_error(request),
            sampling_error=sampling,
            arithmetic=ErrorEstimate(engine.arithmetic, "bound, from tests"),
            cpu_predicted=self.cpu_seconds(speed),
            bytes=engine.bytes + (self._pixel_integration.bytes if self._pixel_integration else 0),
        )

    def _model_error(self, request: PSFRequest) -> ErrorEstimate:
        """Estimate the error of the PSF's optical model."""
        n = request.numeric
        radius = n.radius
        if self.camera is not None and not n.separation:
            radius = open_pupil_radius(replace(self.camera, lens=n.lens))
        return model_error(n.lens, n.wavelength, radius)

    @property
    def wavelength(self) -> Scalar:
        """The wavelength of the PSF's light, in metres."""
        return self._request.wavelength

    @property
    def scale(self) -> Scalar:
        """The ratio of a pupil or panel position to its frequency in the PSF's field, in m².

        It is the wavelength times the image distance, or times the ray-matrix element B
        (`Camera.ray_matrix_b`) where the panel stands apart from the lens.
        """
        if self.camera is None:
            return self._request.scale
        return self._request.wavelength * self.camera.ray_matrix_b

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of one PSF, in seconds, on a machine of the given speed."""
        integral = self._pixel_integration.cpu_seconds(speed) if self._pixel_integration else 0.0
        return self.engine.cpu_seconds(speed) + integral

    @property
    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Positions (y, x) in the pupil, in metres, where the PSF takes phase and amplitude.

        The two tensors broadcast against each other.
        """
        return self.engine.points()

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
            Zero by default.
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
        """Compute the PSF as a call does, but from tensors only, and with known spectra if given.

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
        light = self._light_on_pixels(phase, amplitude, spectrum)
        if not self.unmodulated or phase is None:
            return light
        other = self._unmodulated_light(amplitude, spectrum=unmodulated_spectrum).to(light.device)
        return (1 - self.unmodulated) * light + self.unmodulated * other

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
        return self._unmodulated_light(
            amplitude, cache_result=cache_result, spectrum=spectrum
        ).clone()

    def _unmodulated_light(
        self,
        amplitude: torch.Tensor | None,
        *,
        cache_result: bool = False,
        spectrum: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Compute the PSF of unmodulated light, or take it from the cache without a copy."""
        if self._request.differentiable or (amplitude is not None and not cache_result):
            return self._light_on_pixels(None, amplitude, spectrum)
        for known, light in self._cached_unmodulated_psfs:
            if known is amplitude:
                return light
        light = self._light_on_pixels(None, amplitude, spectrum)
        if not light.requires_grad:
            self._cached_unmodulated_psfs = [
                *self._cached_unmodulated_psfs[-1:],
                (amplitude, light),
            ]
        return light

    def needs_unmodulated_psf(self, amplitude: torch.Tensor | None) -> bool:
        """Tell whether the PSF of a phase needs `unmodulated_psf`, which isn't computed yet."""
        return self.unmodulated > 0 and not any(
            known is amplitude for known, _ in self._cached_unmodulated_psfs
        )

    def _light_on_pixels(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Compute the PSF on the sensor's pixels."""
        amplitude, peak = normalise_amplitude(amplitude, 1 if self.camera is None else 2)
        light = self._intensity_with_fallback(phase, amplitude, spectrum)
        light = self._pixel_integration(light) if self._pixel_integration else light
        if peak is None:
            return light
        # Outside this range of amplitudes, their squares may exceed the range of single precision,
        # also in a dim window.
        least = 1e-12
        extreme = bool((peak < least).any() or (peak > 1 / least).any())
        wide = light.to(torch.float64) if extreme else light
        return wide * (peak**2).to(wide)[..., None, None]

    def _intensity_with_fallback(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: torch.Tensor | None,
    ) -> torch.Tensor:
        """Compute the PSF's light on the samples, by a fallback method if the first one fails.

        A fallback is needed if the pattern sends so little light to the window that the first
        engine can't keep the tolerance.
        """
        try:
            if spectrum is not None and isinstance(self.engine, GridEngine):
                return self.engine.intensity_from_spectrum(spectrum, phase, amplitude)
            return self.engine.intensity(phase, amplitude)
        except ToleranceError:
            for other in self._fallback_engines():
                try:
                    light = other.intensity(phase, amplitude)
                except ToleranceError:
                    continue
                self._fallback_engine = other
                return light
            raise

    def _fallback_engines(self) -> Iterator[PSFEngine]:
        """Yield the engines that may compute the PSF in place of the first one.

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
        """Compute where a pattern's light goes: through the stop, to the PSF's window, or blocked.

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
        """Compute the field behind the panel for the PSF's light budget of one pattern.

        The field is complex64, (rows, columns).
        """
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


def normalise_amplitude(
    amplitude: torch.Tensor | None, sample_axes: int
) -> tuple[torch.Tensor | None, torch.Tensor | None]:
    """Scale the amplitude of every pattern in a batch to a peak of 1 for its PSF.

    Returns the amplitude and the old peaks, one for each pattern, float64. The peaks are None if
    they are all 1. A pattern whose amplitude is zero or not finite keeps it, with a peak of 1.
    sample_axes: number of axes at the end that hold one pattern.
    """
    if amplitude is None or not amplitude.numel():
        return amplitude, None
    axes = tuple(range(-min(sample_axes, amplitude.ndim), 0))
    peak = amplitude.detach().abs().amax(axes, keepdim=True)
    peak = torch.where((peak > 0) & peak.isfinite(), peak, 1.0)
    if bool((peak == 1).all()):
        return amplitude, None
    return amplitude / peak, peak.squeeze(axes).to(torch.float64)


def _resolve_unmodulated_share(camera: Camera | None, share: float | None) -> float:
    if camera is None:
        if share:
            raise ValueError(f"unmodulated is {share:g}; a lens without a panel modulates nothing")
        return 0.0
    share = camera.panel.unmodulated if share is None else share
    if not 0 <= share <= 1:
        raise ValueError(f"unmodulated is {share:g}; it is a share and must lie between 0 and 1")
    return share


def _validate_field_position(field: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
    if len(field) != 2 or not all(math.isfinite(as_number(place)) for place in field):
        raise ValueError(f"field is {field}; give two finite lengths (y, x) in metres")
    return field[0], field[1]


def _build_spherical_wave(
    camera: Camera | None, distance: Scalar, wavelength: Scalar, field: tuple[Scalar, Scalar]
) -> SphericalWaveCorrection:
    """Build the spherical-wave correction over the panel for a PSF's point imaged at `field`.

    `field` is (y, x) in metres on the sensor.
    """
    if camera is None:
        raise ValueError("sphere is True; it is a wave over a panel, and a lens has none")
    image, z1 = camera.lens.image_distance, camera.separation
    sines = (field[0] / image, field[1] / image)
    return SphericalWaveCorrection(distance, wavelength, sines, (-z1 * sines[0], -z1 * sines[1]))


def _numeric_optics(optics: Camera | Lens) -> Camera | Lens:
    """Return the PSF's camera or lens in plain numbers, without derivatives."""
    return numeric_camera(optics) if isinstance(optics, Camera) else to_plain_numbers(optics)


def psf(
    optics: Camera | Lens,
    phase: torch.Tensor | None = None,
    *,
    distance: Scalar,
    wavelength: Scalar,
    pixels: Plane,
    field: tuple[Scalar, Scalar] = (0.0, 0.0),
    sphere: bool = False,
    tol: float = 1e-3,
) -> Result[torch.Tensor]:
    """Compute the PSF on sensor pixels, with its account.

    It plans a PSFOperator and calls it once. See PSFOperator for the model.

    Parameters
    ----------
    optics : Camera or Lens
        What forms the image.
    phase : torch.Tensor or numpy.ndarray, optional
        Radians, (..., rows, columns) of the panel, or (..., points) for a lens. Zero by default.
    distance : float or 0-d torch.Tensor
        Metres from the object to the panel, or to a lens that stands alone; ``math.inf`` is
        allowed.
    wavelength : float or 0-d torch.Tensor
        Metres.
    pixels : Plane
        The sensor pixels whose light is computed.
    field : tuple of float or 0-d torch.Tensor, optional
        Metres (y, x) on the sensor from the axis to the point's geometric image.
    sphere : bool, optional
        Whether the wave over the panel is the exact spherical wave instead of its parabola.
    tol : float, optional
        Largest relative L2 error from sampling and arithmetic; 1e-3 by default.

    Returns
    -------
    Result of torch.Tensor
        The PSF, ``(..., *pixels.shape)``, as shares of the light leaving the pupil, and its
        account, with the processor time spent.

    Raises
    ------
    ToleranceError
        If `tol` can't be kept.
    """
    started = time.process_time()
    operator = PSFOperator(
        optics, distance, wavelength, pixels, field=field, sphere=sphere, tol=tol
    )
    value = operator(phase)
    return Result(value, operator.account.with_cpu_spent(time.process_time() - started))


def nyquist_samples_per_pixel(camera: Camera, wavelength: float) -> float:
    """Compute the samples per sensor pixel that just resolve a PSF's finest fringe along an axis.

    Parameters
    ----------
    camera : Camera
        Its stop and image distance set the cutoff frequency, its sensor the pixel pitch.
    wavelength : float
        Metres.

    Returns
    -------
    float
        Twice the cutoff frequency times the pixel pitch.
    """
    return 2 * camera.sensor.pitch * cutoff_frequency(camera, wavelength)
