"""Compute the PSF of a lens with a panel of pixels in its plane."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch

from optics.accuracy import (
    FLOAT32_ARITHMETIC,
    FLOAT64_ARITHMETIC,
    CandidateMethod,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    cheapest_candidate,
    select_methods,
    unreachable_tolerance_error,
)
from optics.camera import Camera
from optics.camera.pupil import (
    defocus_curvature,
    panel_half_diagonal,
    phase_step_per_pixel,
    pupil_amplitude,
    require_open_pupil,
)
from optics.fourier import (
    ChirpTransform,
    CommensurateTransform,
    FourierGeometry,
    GriddedTransform,
    MatrixTransform,
    unit_phasor,
    valid_transforms,
)
from optics.fourier.gridded import FINEST_GRIDDING
from optics.fourier.transform import PlaneTransform
from optics.psf.behind_panel import BehindPanelEngine
from optics.psf.dim_windows import (
    AddedLight,
    EvenNoise,
    largest_ratio,
    normalise_amplitude,
    row_error,
    scale_light,
    window_norm,
)
from optics.psf.engine import require_sample_shape, squared_modulus
from optics.psf.interpolated_pixels import FINEST_INTERPOLATION, InterpolatedPixelTransform
from optics.psf.pixel_waves import (
    CurvedPixelTransform,
    EnvelopeShares,
    PixelGrid,
    PixelIntegralTransform,
    PixelWaveExpansion,
    WaveTerm,
    largest_coefficient,
    pixel_envelopes,
)
from optics.psf.request import PSFRequest
from optics.quarter_symmetry import quarter_shape
from optics.validation import as_number, needs_gradient, to_plain_numbers

PANEL_METHODS = (
    MatrixTransform.name,
    ChirpTransform.name,
    CommensurateTransform.name,
    GriddedTransform.name,
    CurvedPixelTransform.name,
    InterpolatedPixelTransform.name,
)
"""Names of the Fourier transforms behind a panel; not all of them serve every request."""


@dataclass(frozen=True)
class PanelEngineSettings:
    """Tune the engine for a panel in a lens.

    max_pixel_phase_step: largest change of phase across a panel pixel, in radians. Beyond, the blur
    is far larger than any sensor.
    transform_tol_share: share of the tolerance that the Fourier transform may use. Chosen.
    reached_transform_error: L2 error that a transform reaches, over the one it states. It is an
    eighteenth where it was measured, for gridding to 1e-2 to 1e-8; this is three times as much.
    Weights that are fitted reach what they state.
    interpolation_tol_share: share of the tolerance that fitted weights may use. Chosen: a further
    weight costs little.
    largest_interpolation_error: largest error of fitted weights that is planned for. Chosen.
    expansion_tol_share: share of the tolerance that the terms of the wave's expansion may use that
    are left out, by their prediction before a pattern is known. Chosen.
    refinement: share of the tolerance that is aimed at by an engine that stands in where the first
    one can't keep it. Chosen.
    finest_tol: smallest tolerance that is planned for. Chosen near the rounding of double
    precision.
    max_degrees: most degrees of the wave's expansion inside a pixel. Chosen.
    dark_margin: light that counts as none, over that of double precision's rounding. Chosen.
    straight_degrees: further degrees for the light without a pattern, where they cost nothing.
    Chosen.
    max_orders: most diffraction orders of the panel's pixels from the axis to a sample. Chosen:
    rules for the envelope then take a second.
    """

    max_pixel_phase_step: float = 600.0
    transform_tol_share: float = 0.05
    reached_transform_error: float = 0.17
    interpolation_tol_share: float = 0.005
    largest_interpolation_error: float = 1e-3
    expansion_tol_share: float = 0.5
    refinement: float = 0.5
    finest_tol: float = 1e-13
    max_degrees: int = 80
    dark_margin: float = 100.0
    straight_degrees: int = 6
    max_orders: float = 500.0


_SETTINGS = PanelEngineSettings()


@dataclass(frozen=True)
class PanelCostSettings:
    """Tune the predicted time of light behind a panel.

    Passes are those of MachineSpeed.touch, calls those of MachineSpeed.call. All values were fitted
    to 150 random problems on one machine, whose times they predict within a factor of two.

    pixel_passes: passes over the panel's pixels in a call: the pattern's phasor, and the measured
    error.
    term_passes: passes over the panel's pixels for each term of the wave; transforms that hold the
    wave have none.
    sample_passes: passes over the samples at the sensor in a call.
    node_passes: passes over the nodes inside pixels at which the wave is computed beforehand, in
    double precision.
    open_share_passes: passes over the panel's pixels for the share that the stop leaves open.
    line_passes: passes for each row and column of the panel and of the samples, for envelopes and
    rules.
    planning_calls: calls that planning costs at least.
    degree_calls: calls for each degree of the wave inside a pixel.
    """

    pixel_passes: float = 58.0
    term_passes: float = 26.0
    sample_passes: float = 28.0
    node_passes: float = 120.0
    open_share_passes: float = 50.0
    line_passes: float = 10_000.0
    planning_calls: float = 18.0
    degree_calls: float = 3.0


_COST = PanelCostSettings()


class PanelEngine(BehindPanelEngine):
    """Computes the PSF of a lens and a panel in its plane, whose pixels are uniform squares.

    The lens' wave adds to each pixel's modulation. Inside the pixels it is expanded in Legendre
    polynomials (PixelWaveExpansion): a single term if its phase hardly changes across a pixel, more
    for smaller tolerances. Each term is a Fourier transform of the pixels under an envelope. For a
    thin lens' defocus, two matrices can integrate the wave exactly instead (CurvedPixelTransform).
    A pixel that the stop covers in part passes light in proportion to its open area.

    The share of the light that a pattern sends into the window is known after a call only, so the
    error of every call is measured on its own light (see `optics.psf.dim_windows`). If it is beyond
    the tolerance, a finer engine computes the light again.

    transform: name of the Fourier transform; the cheapest if None.
    light_tol: relative L2 error that is planned for, as if the window were as bright as its
    surroundings; the request's tolerance if None.
    mirrored: whether patterns are mirrored in the middle of the panel's pixels, and only their
    quarter right of and below it is given (see `InterpolatedPixelTransform`); only where the light
    is mirrored, too (see `symmetric_engine`).
    light_norm: L2 norm over the window of the last call's light, (...).
    """

    def __init__(
        self,
        request: PSFRequest,
        camera: Camera,
        *,
        transform: str | None = None,
        light_tol: float | None = None,
        mirrored: bool = False,
    ) -> None:
        self._request, self._transform_name, self._mirrored = request, transform, mirrored
        n = request.numeric
        self._camera = replace(camera, lens=to_plain_numbers(camera.lens))
        self._light_tol = light_tol or max(n.tol, _SETTINGS.finest_tol)
        self._set_precision(self._light_tol < 2 * FLOAT32_ARITHMETIC)
        self._pixel_phase_step = self._largest_pixel_phase_step()
        self._require_countable_orders()
        what = f"a PSF of {n.samples.shape[1]}x{n.samples.shape[0]} samples behind a panel"
        offered = self._offered_methods()
        if not offered:
            raise unreachable_tolerance_error(n.tol, math.inf)
        names = select_methods(list(dict.fromkeys(one.name for one in offered)), transform, what)
        chosen = [one for one in offered if one.name in names]
        self._method = cheapest_candidate(chosen, n.budget, what)
        self._transform, self._degrees = self._method.transform, self._method.degrees
        self.name = self._transform.name
        self.error = ErrorEstimate(
            self._method.expansion_error + 2 * self._reached_transform_error,
            "estimate for a window as bright as its surroundings",
        )
        rows, columns = camera.panel.shape
        self.sampling = f"{columns}x{rows} panel pixels{self._method.description}"
        self.light_norm = torch.zeros(())
        self._cached_terms: tuple[list[WaveTerm], list[WaveTerm]] | None = None
        self._finer_engine: PanelEngine | None = None

    @property
    def _reached_transform_error(self) -> float:
        """The relative L2 error of the field that the transform is taken to reach."""
        stated = self._transform.error
        if isinstance(self._transform, PixelIntegralTransform):
            return stated
        return _SETTINGS.reached_transform_error * stated

    def _require_countable_orders(self) -> None:
        """Raise ToleranceError if the samples lie too many panel orders from the axis."""
        n = self._request.numeric
        orders = n.farthest_sample_radius * self._camera.panel.active_side / n.scale
        if orders > _SETTINGS.max_orders:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept: the farthest pixel lies {orders:.3g} diffraction "
                f"orders of the panel from the axis, and {_SETTINGS.max_orders:g} are summed at "
                "most; ask for pixels nearer to the axis, or check the panel's pitch (in metres)"
            )

    def _largest_pixel_phase_step(self) -> float:
        """Return the largest phase change of the wave across a panel pixel, in radians.

        Raises ToleranceError if it is too large.
        """
        n, panel = self._request.numeric, self._camera.panel
        step = phase_step_per_pixel(self._camera, n.distance, n.wavelength)
        if n.sphere is not None:
            step += n.sphere.largest_phase_slope(panel_half_diagonal(self._camera)) * panel.pitch
        if step > _SETTINGS.max_pixel_phase_step:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept: the wave turns by {step:.2g} rad "
                "across a panel pixel",
                "bring the object closer to the plane in focus",
            )
        return step

    def _offered_methods(self) -> list[_PanelMethod]:
        """List the ways to sum over the panel's pixels to the tolerance in force."""
        n, panel = self._request.numeric, self._camera.panel
        if self._mirrored:
            return self._interpolated_methods()
        half_turn = self._pixel_phase_step / 2
        methods = [
            method
            for divisions in sorted({1, *(max(1, math.ceil(half_turn / h)) for h in (0.5, 1, 2))})
            for method in self._methods_by_expansion(divisions)
        ]
        # The matrices for curved pixels contain the lens' wave and give no derivatives in it.
        if self._is_wave_separable and not self._request.differentiable:
            geometry = FourierGeometry(panel.plane, n.samples, n.scale)
            curvature = defocus_curvature(n.lens, n.distance, n.wavelength)
            curved = CurvedPixelTransform(geometry, self._dtype, curvature, panel.active_side)
            methods.append(_PanelMethod(curved, PixelGrid(panel), 0, 0.0, 1, separable=True))
            methods += self._interpolated_methods()
        return methods

    def _interpolated_methods(self) -> list[_PanelMethod]:
        """List the ways to sum over the panel's pixels by FFTs and fitted weights."""
        n, panel = self._request.numeric, self._camera.panel
        error = _SETTINGS.interpolation_tol_share * self._light_tol
        if error < FINEST_INTERPOLATION:
            return []
        geometry = FourierGeometry(panel.plane, n.samples, n.scale)
        curvature = defocus_curvature(n.lens, n.distance, n.wavelength)
        one = InterpolatedPixelTransform(
            geometry,
            self._dtype,
            curvature,
            panel.active_side,
            min(error, _SETTINGS.largest_interpolation_error),
            mirrored=self._mirrored,
        )
        if not one.fits:
            return []
        return [_PanelMethod(one, PixelGrid(panel), 0, 0.0, 1, separable=True)]

    def _methods_by_expansion(self, divisions: int) -> list[_PanelMethod]:
        """List the ways to sum by an expansion of the wave in parts of the pixels."""
        n, grid = self._request.numeric, PixelGrid(self._camera.panel, divisions)
        degrees, error = self._needed_degrees(grid)
        if degrees > _SETTINGS.max_degrees:
            return []
        separable = self._is_wave_separable
        nodes = 1 if separable or (degrees == 1 and divisions == 1) else degrees + 1
        allowed = max(_SETTINGS.transform_tol_share * self._light_tol, FINEST_GRIDDING)
        geometry = FourierGeometry(grid.points, n.samples, n.scale)
        return [
            _PanelMethod(one, grid, degrees, error, nodes, separable)
            for one in valid_transforms(geometry, self._dtype, allowed)
        ]

    @property
    def _is_wave_separable(self) -> bool:
        """Whether the wave is a product of a function of y and one of x."""
        n = self._request.numeric
        return n.lens.has_quadratic_phase and n.sphere is None

    def _needed_degrees(self, grid: PixelGrid) -> tuple[int, float]:
        """Return how many degrees of the wave in a pixel are needed, and the error left."""
        n, error = self._request.numeric, math.inf
        half_turn = self._pixel_phase_step / 2 / grid.divisions
        shares: EnvelopeShares | None = None
        for degrees in range(1, _SETTINGS.max_degrees + 1):
            sizes = [largest_coefficient(half_turn, k) for k in range(degrees + 1)]
            # Without this test, the envelopes would be evaluated for degrees far too low.
            if degrees > 1 and sizes[degrees] > 1:
                continue
            if shares is None or shares.degrees < degrees:
                shares = EnvelopeShares(n.samples, degrees + 8, grid.side, n.scale)
            pairs = [(degrees - k, k) for k in range(degrees + 1)]
            error = 2 * math.hypot(*(sizes[p[0]] * sizes[p[1]] * shares.share(p) for p in pairs))
            if error <= _SETTINGS.expansion_tol_share * self._light_tol:
                return degrees, error
        return _SETTINGS.max_degrees + 1, error

    @property
    def bytes(self) -> int:
        return self._method.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._method.cpu_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return self._method.planning_seconds(speed)

    def straight_seconds(self, speed: MachineSpeed) -> float:
        """Predict the seconds of the light without a pattern, which is computed once."""
        return self._method.straight_seconds(speed, self._is_open)

    def prepare(self) -> None:
        n = self._request.numeric
        if not self.error.value + self.arithmetic <= n.tol:
            raise unreachable_tolerance_error(n.tol, self.error.value + self.arithmetic)
        require_open_pupil(self._camera)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        y, x = self._camera.panel.plane.mesh()
        rows, columns = self._pattern_shape
        return y[-rows:], x[:, -columns:]

    @property
    def _pattern_shape(self) -> tuple[int, int]:
        """The shape in which patterns are given, (rows, columns)."""
        shape = self._camera.panel.shape
        return quarter_shape(shape) if self._mirrored else shape

    def _terms(self) -> tuple[list[WaveTerm], list[WaveTerm]]:
        """Return the terms of the wave in the pixels, and the first that are left out.

        They are cached unless derivatives are wanted: a cached tensor would belong to the graph of
        an earlier call.
        """
        if self._request.differentiable:
            return self._compute_terms()
        if self._cached_terms is None:
            self._cached_terms = self._compute_terms()
        return self._cached_terms

    def _compute_terms(self) -> tuple[list[WaveTerm], list[WaveTerm]]:
        if not self._degrees:
            # The transforms for curved pixels hold the wave.
            one = torch.ones(1, 1, dtype=self._dtype)
            return [WaveTerm((0, 0), one)], []
        grid = self._method.grid
        expansion = PixelWaveExpansion(self._request, grid, self._degrees, self._dtype)
        return expansion.terms(self._method.node_count)

    @property
    def _camera_with_tensors(self) -> Camera:
        """The camera with the request's lens, which may hold tensors that need gradients."""
        return replace(self._camera, lens=self._request.lens)

    def _pixel_amplitude(self, device: torch.device) -> torch.Tensor | None:
        """Return the open share of the panel's pixels; None if all of them are open."""
        if self._is_open and not self._request.differentiable:
            return None
        return pupil_amplitude(self._camera_with_tensors).to(device)

    @cached_property
    def _is_open(self) -> bool:
        """Whether the stop leaves all of the panel open."""
        return float(pupil_amplitude(self._camera).min()) == 1

    @property
    def _is_straight_field_separable(self) -> bool:
        """Whether the field without a pattern is a product of one along y and one along x."""
        return self._method.separable and self._is_open and not self._request.differentiable

    def _straight_light(self) -> torch.Tensor:
        """Compute the light without a pattern, where its field is a product over both axes."""
        y, x = (squared_modulus(self._straight_axis(axis), 1.0) for axis in (0, 1))
        return (y * self._plain_intensity_scale)[:, None] * x

    def _straight_axis(self, axis: int) -> torch.Tensor:
        """Return one axis of the field without a pattern, complex, for every sample."""
        n = self._request.numeric
        if not self._degrees:
            values = [torch.ones(self._pattern_shape[axis], dtype=self._dtype)]
            envelopes = [torch.ones((), dtype=self._dtype)]
        else:
            # A few more degrees along one axis cost nothing, and nothing needs to be measured then.
            degrees = self._degrees + _SETTINGS.straight_degrees
            grid = self._method.grid
            expansion = PixelWaveExpansion(self._request, grid, degrees, self._dtype)
            values = expansion.axis_coefficients(axis)
            places = n.samples.coordinates(axis)
            envelopes = list(pixel_envelopes(places, degrees, grid.side, n.scale).to(self._dtype))
        lines = torch.stack(values, dim=1 - axis)
        fields = self._transform.forward_axis(lines, axis).unbind(1 - axis)
        return sum(
            (field * envelope for field, envelope in zip(fields, envelopes, strict=True)),
            torch.zeros((), dtype=self._dtype),
        )

    @cached_property
    def _straight_power(self) -> torch.Tensor:
        """The sum over the pixel grid of the squared amplitude without a pattern."""
        return (pupil_amplitude(self._camera) ** 2).sum() * self._method.grid.divisions**2

    def _pattern_power(self, pattern: torch.Tensor, amplitude: torch.Tensor | None) -> torch.Tensor:
        """Return the sum over the panel of every pattern's squared amplitude, (...)."""
        if amplitude is None:
            return self._straight_power.expand(pattern.shape[:-2])
        parts = torch.view_as_real(pattern.detach().resolve_conj())
        return torch.linalg.vector_norm(parts, dim=(-3, -2, -1)) ** 2

    @property
    def _intensity_scale(self) -> torch.Tensor | float:
        """The factor from ``|sum over pixels|²`` to shares of the light per sample."""
        if self._request.differentiable:
            return self._compute_intensity_scale()
        return self._plain_intensity_scale

    @cached_property
    def _plain_intensity_scale(self) -> float:
        return float(self._compute_intensity_scale())

    def _compute_intensity_scale(self) -> torch.Tensor | float:
        q, panel = self._request, self._camera.panel
        # A pixel that the stop covers in part passes light by its open area.
        power = pupil_amplitude(self._camera_with_tensors).sum() * panel.active_side**2
        area = q.samples.pitch[0] * q.samples.pitch[1]
        return self._method.grid.side**4 * area / (q.scale**2 * power)

    def _envelopes(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the envelopes of the terms along y and x, each (degrees + 1, samples).

        They are cached unless derivatives are wanted.
        """
        if self._request.differentiable:
            return self._compute_envelopes(self._request)
        return self._plain_envelopes

    @cached_property
    def _plain_envelopes(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._compute_envelopes(self._request.numeric)

    def _compute_envelopes(self, q: PSFRequest) -> tuple[torch.Tensor, torch.Tensor]:
        side, degrees = self._method.grid.side, self._degrees
        y, x = (
            pixel_envelopes(q.samples.coordinates(axis), degrees, side, q.scale) for axis in (0, 1)
        )
        return y, x

    def _under_envelope(self, field: torch.Tensor, degrees: tuple[int, int]) -> torch.Tensor:
        """Multiply a term's field on the samples by its envelope."""
        if not self._degrees:
            return field
        y, x = self._envelopes()
        column, row = y[degrees[0]].to(field), x[degrees[1]].to(field)
        return field * column[:, None] * row

    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        """Compute the light on the samples, and measure its error there.

        added: other light that is added afterwards. The error that is told is that of both
        together.
        """
        scale, transform = self._intensity_scale, self._transform
        field, missing, peak = None, None, None
        if phase is None and amplitude is None and self._is_straight_field_separable:
            light, power = self._straight_light(), self._straight_power
        else:
            pattern, peak = self._pattern(phase, amplitude)
            power = self._pattern_power(pattern, amplitude)
            if isinstance(transform, InterpolatedPixelTransform):
                light = transform.intensity(pattern, self._plain_intensity_scale)
            else:
                terms, omitted = self._terms()
                field = self._field(pattern, terms)
                light = squared_modulus(field, scale)
                if omitted:
                    missing = partial(self._missing_light, pattern.detach(), omitted)
        with torch.no_grad():
            relative = None if added is None else added.relative_to(peak)
            self._measure_error(field, light.detach(), power, missing, relative)
        self._stand_in = None
        if self.error.value + self.arithmetic > self._request.tol and not self._is_dark(
            light, power
        ):
            return self._refined_intensity(phase, amplitude, added)
        self.light_norm = self.light_norm if peak is None else self.light_norm * peak**2
        return scale_light(light.to(torch.float64 if self._double else torch.float32), peak)

    @property
    def _double(self) -> bool:
        return self._dtype == torch.complex128

    def _pattern(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Return a pattern behind the stop on the pixel grid, and what it was divided by.

        The pattern is complex, (..., rows, columns), with amplitudes up to 1: all of the bright
        pixels of the one that is given may lie behind a closed part of the stop.
        """
        shape = self._pattern_shape
        given = next((one for one in (phase, amplitude) if one is not None), None)
        opened = self._pixel_amplitude(torch.device("cpu") if given is None else given.device)
        if amplitude is not None:
            require_sample_shape("amplitude", amplitude, shape)
            seen = amplitude if opened is None else amplitude * opened
            amplitude, peak = normalise_amplitude(seen, 2)
            factor = self.modulation_factor(phase, amplitude, shape, self._dtype)
        else:
            peak = None
            factor = self.modulation_factor(phase, None, shape, self._dtype)
            if factor is None:
                factor = torch.ones(shape, dtype=self._dtype)
            if opened is not None:
                factor = factor * opened.to(factor.dtype)
        assert factor is not None
        return self._method.grid.repeat(factor), peak

    def _field(self, pattern: torch.Tensor, terms: list[WaveTerm]) -> torch.Tensor:
        """Sum the field over the terms of the wave, (..., rows, columns) of the samples."""
        q = self._request
        moved = q.transform_variables
        # The panel keeps its size if the stop's radius changes, so only the scale stretches.
        stretch = q.numeric.scale / q.scale if needs_gradient(q.scale) else None
        field: torch.Tensor | None = None
        if not self._degrees:
            return self._transform(pattern, stretch, moved.shift)
        for term in terms:
            part = self._transform(term.times(pattern), stretch, moved.shift)
            part = self._under_envelope(part, term.degrees)
            field = part if field is None else field + part
        assert field is not None
        return field

    def _measure_error(
        self,
        field: torch.Tensor | None,
        light: torch.Tensor,
        power: torch.Tensor,
        missing: Callable[[torch.Tensor], torch.Tensor] | None,
        added: AddedLight | None,
    ) -> None:
        """Measure the error relative to the light in the window; the largest of a batch.

        power: sum of the squared amplitude over the panel, (...).
        missing: returns the field that was left out on rows of the window.
        """
        window, scale = self._request.window_slices, as_number(self._intensity_scale)
        own = window_norm(light, window)
        # Light isn't negative, so the norm of a sum is at least the root of the squares' sum.
        norm = own if added is None else torch.hypot(own, added.norm.to(own))
        noise = EvenNoise(light, self._noise_envelope, window, norm)
        level = (power * scale).to(light.device)
        # Half of the rounding's error follows the light. The other half spreads evenly, and a
        # relative error e of the field makes one of 2 e in the intensity.
        rounding = 0.5 * (FLOAT64_ARITHMETIC if self._double else FLOAT32_ARITHMETIC)
        if isinstance(self._transform, PixelIntegralTransform):
            rounding *= self._transform.rounding_growth
        self.arithmetic = rounding + noise.error(level * (rounding / 2) ** 2)
        transform = self._reached_transform_error
        error = 2 * transform + noise.error(level * transform**2)
        how = "estimate from the light in the window"
        if missing is not None and field is not None:
            found, rows = row_error(field.detach(), light, missing, scale, window, norm)
            error, how = error + found, f"measured on {rows} rows of the window"
        if added is not None:
            error += largest_ratio(added.error.to(norm), norm)
        self.error = ErrorEstimate(error, how)
        self.light_norm = own

    def _missing_light(
        self, pattern: torch.Tensor, omitted: list[WaveTerm], rows: torch.Tensor
    ) -> torch.Tensor:
        """Compute the field of the omitted terms on some rows of the samples."""
        geometry = self._transform.geometry
        y, u = geometry.pupil.coordinates(0), geometry.image.coordinates(0)[rows]
        kernel = unit_phasor(-torch.outer(u, y) / geometry.scale, self._dtype).to(pattern.device)
        axes = self._plain_envelopes
        total: torch.Tensor | None = None
        for term in omitted:
            part = self._transform.forward_axis(term.project(kernel, pattern), 1)
            down, along = (
                envelopes[k].to(part) for envelopes, k in zip(axes, term.degrees, strict=True)
            )
            part = part * down[rows.to(part.device), None] * along
            total = part if total is None else total + part
        assert total is not None
        return total

    @cached_property
    def _noise_envelope(self) -> tuple[torch.Tensor, torch.Tensor]:
        """How the envelopes of the terms weaken errors that transforms spread evenly.

        It is relative intensity, as `EvenNoise` takes it.
        """
        if isinstance(self._transform, PixelIntegralTransform):
            down, along = (self._transform.mean_squared_kernel(axis) for axis in (0, 1))
            return down[None], along[None]
        half_turn = self._pixel_phase_step / 2 / self._method.grid.divisions
        sizes = [largest_coefficient(half_turn, k) ** 2 for k in range(self._degrees)]
        size = torch.tensor(sizes, dtype=torch.float64)[:, None]
        y, x = (size * one[: self._degrees].abs() ** 2 for one in self._plain_envelopes)
        # Terms of degree k along y go with all degrees below the total along x.
        return y, x.cumsum(0).flip(0)

    def _is_dark(self, light: torch.Tensor, power: torch.Tensor) -> bool:
        """Tell whether the window is dark: double precision can't tell its light from none.

        Only then the light may be taken as it is, whatever its relative error.
        """
        if self._light_tol > _SETTINGS.finest_tol:
            return False
        rows, columns = self._request.window_slices
        level = (power * as_number(self._intensity_scale)).to(light.device)[..., None, None]
        rounding = level * torch.finfo(torch.float64).eps ** 2 * _SETTINGS.dark_margin
        return bool((light.detach()[..., rows, columns] <= rounding).all())

    def _refined_intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None,
    ) -> torch.Tensor:
        """Compute the light by a finer engine, whose error on it is within the tolerance."""
        tol, error = self._request.tol, self.error.value + self.arithmetic
        if self._light_tol <= _SETTINGS.finest_tol:
            raise unreachable_tolerance_error(tol, error)
        finer = max(self._light_tol * _SETTINGS.refinement * tol / error, _SETTINGS.finest_tol)
        if self._finer_engine is None or self._finer_engine._light_tol > finer:
            self._finer_engine = PanelEngine(
                self._request,
                self._camera,
                transform=self._transform_name,
                light_tol=finer,
                mirrored=self._mirrored,
            )
        self._stand_in = self._finer_engine
        return self._finer_engine.intensity(phase, amplitude, added)


@dataclass(frozen=True)
class _PanelMethod(CandidateMethod):
    """Predicts memory and time of light behind a panel, by one transform and one expansion.

    grid: parts of the panel's pixels that are summed.
    degrees: degrees of the wave inside a part that are summed; 0 if the transform holds the wave.
    expansion_error: predicted relative L2 error of the light without the other degrees.
    node_count: nodes along a side of a part from which the expansion is computed.
    separable: whether the wave is a product over both axes.
    """

    transform: PlaneTransform
    grid: PixelGrid
    degrees: int
    expansion_error: float
    node_count: int
    separable: bool

    @property
    def name(self) -> str:  # type: ignore[override]
        return self.transform.name

    @property
    def terms(self) -> int:
        """The number of terms of the wave in a pixel, each of which takes a transform."""
        return max(self.degrees * (self.degrees + 1) // 2, 1)

    @property
    def description(self) -> str:
        """What is summed over in each panel pixel, in words; empty for its centre."""
        parts, terms = self.grid.divisions, self.terms
        words = [f"{parts}² parts in each"] if parts > 1 else []
        words += [f"{terms} terms of the wave"] if terms > 1 else []
        return "".join(f", {one}" for one in words)

    @property
    def _panel_pixels(self) -> int:
        if isinstance(self.transform, InterpolatedPixelTransform):
            rows, columns = self.transform.field_shape
        else:
            rows, columns = self.transform.geometry.pupil.shape
        return rows * columns

    @property
    def bytes(self) -> int:
        kept = 2 if self.separable else 3 + self.terms + self.degrees
        return self.transform.bytes + kept * self.transform.dtype.itemsize * self._panel_pixels

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        pixels, (rows, columns) = self._panel_pixels, self.transform.geometry.image.shape
        terms = self.terms if self.degrees else 0
        passes = pixels * (_COST.pixel_passes + terms * _COST.term_passes)
        passes += rows * columns * _COST.sample_passes
        sums = self.terms * self.transform.cpu_seconds(speed)
        return passes * speed.touch * self._slowdown(speed) + sums

    def planning_seconds(self, speed: MachineSpeed) -> float:
        geometry = self.transform.geometry
        passes = sum(geometry.pupil.shape + geometry.image.shape) * _COST.line_passes
        passes += self._panel_pixels / self.grid.divisions**2 * _COST.open_share_passes
        if not self.separable:
            nodes = self._panel_pixels * self.node_count**2
            passes += nodes * _COST.node_passes
        calls = _COST.planning_calls + _COST.degree_calls * self.degrees
        return calls * speed.call + passes * speed.touch + self.transform.planning_seconds(speed)

    def straight_seconds(self, speed: MachineSpeed, is_open: bool) -> float:
        """Predict the seconds of the light without a pattern."""
        if self.separable and is_open:
            rows, columns = self.transform.geometry.image.shape
            return 2 * speed.call + rows * columns * _COST.sample_passes * speed.touch
        return self.cpu_seconds(speed)

    def _slowdown(self, speed: MachineSpeed) -> float:
        return speed.slowdown(self.transform.dtype)
