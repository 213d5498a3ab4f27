"""Compute the PSF of a lens with a panel of pixels in its plane."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial

import torch

from optics.accuracy import (
    FLOAT32_ARITHMETIC,
    FLOAT64_ARITHMETIC,
    ErrorEstimate,
    MachineSpeed,
    cheapest_candidate,
    select_methods,
    unreachable_tolerance_error,
)
from optics.camera import Camera
from optics.camera.pupil import pupil_amplitude, require_open_pupil
from optics.fourier import unit_phasor
from optics.psf.dim_windows import (
    AddedLight,
    EvenNoise,
    largest_ratio,
    normalise_amplitude,
    row_error,
    scale_light,
    window_norm,
)
from optics.psf.engine import BehindPanelEngine, require_sample_shape
from optics.psf.interpolated_pixels import InterpolatedPixelTransform
from optics.psf.panel_methods import PanelMethod, PanelSum
from optics.psf.phase_factor import squared_modulus
from optics.psf.pixel_waves import (
    PixelIntegralTransform,
    PixelWaveExpansion,
    WaveTerm,
    largest_coefficient,
)
from optics.psf.request import PSFRequest
from optics.quarter_symmetry import quarter_shape
from optics.validation import as_number, needs_gradient, to_plain_numbers

_FINEST_TOL = 1e-13  # smallest tolerance that is planned for, near double precision's rounding
_REFINEMENT = 0.5  # share of the tolerance that a finer engine aims at; chosen
_STRAIGHT_DEGREES = 6  # further ones for light without a pattern, where they cost nothing; chosen
_DARK_MARGIN = 100.0  # light that counts as none, over that of double precision's rounding; chosen


class _PanelField:
    """Computes the field of patterns on the samples by one method.

    half_turn: half of the largest phase change of the wave across a panel pixel, radians.
    """

    def __init__(self, request: PSFRequest, method: PanelMethod, half_turn: float) -> None:
        self._request, self._method = request, method
        self._transform, self._dtype = method.transform, method.transform.dtype
        self._half_turn = half_turn / method.grid.divisions
        self._known_terms: tuple[list[WaveTerm], list[WaveTerm]] | None = None

    def _terms(self) -> tuple[list[WaveTerm], list[WaveTerm]]:
        """Return the terms of the wave in the pixels, and the first that are left out.

        They are cached unless derivatives are wanted: a cached tensor would belong to the graph of
        an earlier call.
        """
        if self._known_terms is not None:
            return self._known_terms
        found = self._expansion().terms(self._method.node_count)
        if not self._request.differentiable:
            self._known_terms = found
        return found

    def _expansion(self, more: int = 0) -> PixelWaveExpansion:
        """Return the expansion of the wave in the pixels, with some more degrees."""
        degrees = self._method.degrees + more
        return PixelWaveExpansion(self._request, self._method.grid, degrees, self._dtype)

    def straight(self, axis: int, pixels: int) -> torch.Tensor:
        """Return one axis of the field without a pattern, complex, for every sample."""
        if not self._method.degrees:
            line = torch.ones(pixels, dtype=self._dtype).unsqueeze(1 - axis)
            return self._transform.forward_axis(line, axis).squeeze(1 - axis)
        # A few more degrees along one axis cost nothing, and nothing needs to be measured then.
        expansion = self._expansion(_STRAIGHT_DEGREES)
        lines = torch.stack(expansion.axis_coefficients(axis), dim=1 - axis)
        fields = self._transform.forward_axis(lines, axis).unbind(1 - axis)
        parts = zip(fields, expansion.envelopes(axis).to(self._dtype), strict=True)
        zero = torch.zeros((), dtype=self._dtype)
        return sum((field * envelope for field, envelope in parts), zero)

    def patterned(
        self, pattern: torch.Tensor
    ) -> tuple[torch.Tensor, Callable[[torch.Tensor], torch.Tensor] | None]:
        """Sum the field over the terms of the wave, (..., rows, columns) of the samples.

        Also returns a function that computes the field of the omitted terms on some rows of them.
        """
        q = self._request
        moved = q.transform_variables
        # The panel keeps its size if the stop's radius changes, so only the scale stretches.
        stretch = q.numeric.scale / q.scale if needs_gradient(q.scale) else None
        if not self._method.degrees:
            return self._transform(pattern, stretch, moved.shift), None
        terms, omitted = self._terms()
        parts = (
            term.under_envelope(self._transform(term.times(pattern), stretch, moved.shift))
            for term in terms
        )
        return sum(parts, next(parts)), partial(self._missing, pattern.detach(), omitted)

    def _missing(
        self, pattern: torch.Tensor, omitted: list[WaveTerm], rows: torch.Tensor
    ) -> torch.Tensor:
        """Compute the field of the omitted terms on some rows of the samples."""
        geometry = self._transform.geometry
        y, u = geometry.pupil.coordinates(0), geometry.image.coordinates(0)[rows]
        kernel = unit_phasor(-torch.outer(u, y) / geometry.scale, self._dtype).to(pattern.device)
        rows = rows.to(pattern.device)
        parts = (
            term.under_envelope(
                self._transform.forward_axis(term.project(kernel, pattern), 1), rows
            )
            for term in omitted
        )
        return sum(parts, next(parts))

    @cached_property
    def noise_envelope(self) -> tuple[torch.Tensor, torch.Tensor]:
        """How the terms' envelopes weaken errors that transforms spread (see `EvenNoise`)."""
        if isinstance(self._transform, PixelIntegralTransform):
            down, along = (self._transform.mean_squared_kernel(axis) for axis in (0, 1))
            return down[None], along[None]
        degrees = self._method.degrees
        sizes = [largest_coefficient(self._half_turn, k) ** 2 for k in range(degrees)]
        size = torch.tensor(sizes, dtype=torch.float64)[:, None]
        expansion = self._expansion()
        y, x = (size * expansion.envelopes(axis)[:degrees].abs() ** 2 for axis in (0, 1))
        # Terms of degree k along y go with all degrees below the total along x.
        return y, x.cumsum(0).flip(0)


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
    mirrored: whether a quarter of mirrored patterns is given (see `InterpolatedPixelTransform`);
    only where the light is mirrored, too (see `symmetric_engine`).
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
        self._light_tol = light_tol or max(n.tol, _FINEST_TOL)
        self._set_precision(self._light_tol < 2 * FLOAT32_ARITHMETIC)
        posed = PanelSum(request, self._camera, self._light_tol, self._dtype)
        offered = (
            posed.interpolated_methods(mirrored=True) if mirrored else posed.methods(transform)
        )
        if not offered:
            raise unreachable_tolerance_error(n.tol, math.inf)
        what = f"a PSF of {n.samples.shape[1]}x{n.samples.shape[0]} samples behind a panel"
        names = select_methods(list(dict.fromkeys(one.name for one in offered)), transform, what)
        chosen = [one for one in offered if one.name in names]
        self._method = cheapest_candidate(chosen, n.budget, what)
        self._transform, self.name = self._method.transform, self._method.name
        self._field = _PanelField(request, self._method, posed.half_turn)
        self.error = ErrorEstimate(
            self._method.expansion_error + 2 * self._method.reached_transform_error,
            "estimate for a window as bright as its surroundings",
        )
        rows, columns = camera.panel.shape
        self.sampling = f"{columns}x{rows} panel pixels{self._method.description}"
        self.light_norm = torch.zeros(())
        self._known_scale: float | None = None
        self._finer_engine: PanelEngine | None = None

    @property
    def bytes(self) -> int:
        return self._method.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._method.cpu_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return self._method.planning_seconds(speed)

    def straight_seconds(self, speed: MachineSpeed) -> float:
        """Predict the seconds of the light without a pattern, which is computed once."""
        if self._method.separable and self._is_open:
            return self._method.straight_seconds(speed)
        return self.cpu_seconds(speed)

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

    @cached_property
    def _is_open(self) -> bool:
        """Whether the stop leaves all of the panel open."""
        return float(pupil_amplitude(self._camera).min()) == 1

    def _intensity_scale(self) -> torch.Tensor | float:
        """Return the factor from ``|sum over pixels|²`` to shares of the light per sample."""
        if self._known_scale is not None:
            return self._known_scale
        q, panel = self._request, self._camera.panel
        # A pixel that the stop covers in part passes light by its open area.
        power = pupil_amplitude(self._lens_camera).sum() * panel.active_side**2
        area = q.samples.pitch[0] * q.samples.pitch[1]
        scale = self._method.grid.side**4 * area / (q.scale**2 * power)
        if q.differentiable:
            return scale
        self._known_scale = float(scale)
        return self._known_scale

    @property
    def _lens_camera(self) -> Camera:
        """The camera with the request's lens, which may hold tensors that need gradients."""
        return replace(self._camera, lens=self._request.lens)

    @cached_property
    def _straight_power(self) -> torch.Tensor:
        """The sum over the pixel grid of the squared amplitude without a pattern."""
        return (pupil_amplitude(self._camera) ** 2).sum() * self._method.grid.divisions**2

    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        """Compute the light on the samples, and measure its error beside what is `added`."""
        scale, transform = self._intensity_scale(), self._transform
        missing_error, peak = None, None
        is_product = self._method.separable and self._is_open and not self._request.differentiable
        if phase is None and amplitude is None and is_product:
            # The field is a product of one along y and one along x.
            y = squared_modulus(self._field.straight(0, self._pattern_shape[0]), 1.0)
            x = squared_modulus(self._field.straight(1, self._pattern_shape[1]), 1.0)
            light, power = (y * scale)[:, None] * x, self._straight_power
        else:
            pattern, peak = self._pattern(phase, amplitude)
            power = self._straight_power.expand(pattern.shape[:-2])
            if amplitude is not None:
                parts = torch.view_as_real(pattern.detach().resolve_conj())
                power = torch.linalg.vector_norm(parts, dim=(-3, -2, -1)) ** 2
            if isinstance(transform, InterpolatedPixelTransform):
                light = transform.intensity(pattern, as_number(scale))
            else:
                field, missing = self._field.patterned(pattern)
                light = squared_modulus(field, scale)
                if missing is not None:
                    missing_error = partial(
                        row_error, field.detach(), light.detach(), missing, as_number(scale)
                    )
        with torch.no_grad():
            relative = None if added is None else added.relative_to(peak)
            level = (power * as_number(scale)).to(light.device)
            self._measure_error(light.detach(), level, missing_error, relative)
        self._stand_in = None
        error = self.error.value + self.arithmetic
        if error > self._request.tol and not self._is_dark(light, level):
            self._stand_in = self._plan_finer_engine(error)
            return self._stand_in.intensity(phase, amplitude, added)
        self.light_norm = self.light_norm if peak is None else self.light_norm * peak**2
        return scale_light(light.to(self._dtype.to_real()), peak)

    def _pattern(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Return a pattern behind the stop on the pixel grid, and what it was divided by.

        The pattern is complex, (..., rows, columns), with amplitudes up to 1: all of the bright
        pixels of the one that is given may lie behind a closed part of the stop.
        """
        shape, opened, peak = self._pattern_shape, None, None
        given = phase if phase is not None else amplitude
        if self._request.differentiable or not self._is_open:
            opened = pupil_amplitude(self._lens_camera)
            opened = opened if given is None else opened.to(given.device)
        if amplitude is not None:
            require_sample_shape("amplitude", amplitude, shape)
            seen = amplitude if opened is None else amplitude * opened
            amplitude, peak = normalise_amplitude(seen, 2)
            # It holds the stop's share.
            opened = None
        factor = self.modulation_factor(phase, amplitude, shape, self._dtype)
        if factor is None:
            factor = torch.ones(shape, dtype=self._dtype)
        if opened is not None:
            factor = factor * opened.to(factor.dtype)
        return self._method.grid.repeat(factor), peak

    def _measure_error(
        self,
        light: torch.Tensor,
        level: torch.Tensor,
        missing_error: Callable[..., tuple[float, int]] | None,
        added: AddedLight | None,
    ) -> None:
        """Measure the error relative to the light in the window; the largest of a batch.

        level: sum of the squared amplitude over the panel, in units of the light, (...).
        missing_error: measures what the omitted terms matter, where there are any.
        """
        window = self._request.window_slices
        self.light_norm = own = window_norm(light, window)
        # Light isn't negative, so the norm of a sum is at least the root of the squares' sum.
        norm = own if added is None else torch.hypot(own, added.norm.to(own))
        noise = EvenNoise(light, self._field.noise_envelope, window, norm)
        # Half of the rounding's error follows the light. The other half spreads evenly, and a
        # relative error e of the field makes one of 2 e in the intensity.
        double = self._dtype == torch.complex128
        rounding = 0.5 * (FLOAT64_ARITHMETIC if double else FLOAT32_ARITHMETIC)
        if isinstance(self._transform, PixelIntegralTransform):
            rounding *= self._transform.rounding_growth
        self.arithmetic = rounding + noise.error(level * (rounding / 2) ** 2)
        transform = self._method.reached_transform_error
        error = 2 * transform + noise.error(level * transform**2)
        how = "estimate from the light in the window"
        if missing_error is not None:
            found, rows = missing_error(window, norm)
            error, how = error + found, f"measured on {rows} rows of the window"
        if added is not None:
            error += largest_ratio(added.error.to(norm), norm)
        self.error = ErrorEstimate(error, how)

    def _is_dark(self, light: torch.Tensor, level: torch.Tensor) -> bool:
        """Tell whether the window is dark: double precision can't tell its light from none.

        Only then the light may be taken as it is, whatever its relative error.
        """
        if self._light_tol > _FINEST_TOL:
            return False
        rows, columns = self._request.window_slices
        rounding = level[..., None, None] * torch.finfo(torch.float64).eps ** 2 * _DARK_MARGIN
        return bool((light.detach()[..., rows, columns] <= rounding).all())

    def _plan_finer_engine(self, error: float) -> PanelEngine:
        """Plan an engine whose error on light with the relative error given is within the tol."""
        tol = self._request.tol
        if self._light_tol <= _FINEST_TOL:
            raise unreachable_tolerance_error(tol, error)
        finer = max(self._light_tol * _REFINEMENT * tol / error, _FINEST_TOL)
        if self._finer_engine is None or self._finer_engine._light_tol > finer:
            self._finer_engine = PanelEngine(
                self._request,
                self._camera,
                transform=self._transform_name,
                light_tol=finer,
                mirrored=self._mirrored,
            )
        return self._finer_engine
