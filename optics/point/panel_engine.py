"""The light of a point behind a panel of pixels and a lens."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import torch

from optics.accuracy import (
    FLOAT32_ARITHMETIC,
    FLOAT64_ARITHMETIC,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    cheapest_candidate,
    select_methods,
    unreachable_tolerance_error,
)
from optics.camera import Camera
from optics.fourier import (
    ChirpTransform,
    CommensurateTransform,
    FourierGeometry,
    GriddedTransform,
    MatrixTransform,
    Transform,
    valid_transforms,
)
from optics.fourier.gridded import FINEST_GRIDDING
from optics.gauss_legendre import gauss_legendre
from optics.plane import RectilinearGrid
from optics.point.curved_pixels import CurvedPixelTransform
from optics.point.engine import CachedPupilWave, PSFEngine, wrap_phase
from optics.point.request import PSFRequest
from optics.pupil import (
    defocus_curvature,
    panel_half_diagonal,
    phase_step_per_pixel,
    pupil_amplitude,
    pupil_phase,
    pupil_phase_on_panel,
    require_open_pupil,
)
from optics.validation import needs_gradient, to_plain_numbers

PANEL_METHODS = (
    MatrixTransform.name,
    ChirpTransform.name,
    CommensurateTransform.name,
    GriddedTransform.name,
    CurvedPixelTransform.name,
)
"""The methods behind a panel; not all of them serve every request."""

_MAX_PIXEL_PHASE_STEP = 600.0
"""Radians across a panel pixel beyond which the blur is far larger than any sensor."""

_TRANSFORM_SHARE = 0.02
"""Of the tolerance that a transform may use, for all the light there is."""

_LOW_LIGHT_SHARE = 0.02
"""Share of the light in the window from which that of the transform's error is a small one."""

_MAX_NODES = 400


class PanelEngine(CachedPupilWave, PSFEngine):
    """Every panel pixel is a square of one modulation, and the lens' wave lies over it.

    Where the wave hardly turns across a pixel it is taken as constant there (flat pixels):
    one sum over the pixels, times the envelope of one. Otherwise it is integrated inside
    each pixel: by a matrix along each axis if it is a thin lens' defocus (curved pixels),
    or by Gauss-Legendre nodes (divided pixels). A pixel that the stop covers in part passes
    light by its open area.

    transform: the name of one; the cheapest if None. precise: in double precision by exact
    transforms, whatever the tolerance.
    """

    def __init__(
        self,
        request: PSFRequest,
        camera: Camera,
        *,
        transform: str | None = None,
        precise: bool = False,
    ) -> None:
        self._request, self._precise = request, precise
        n = request.numeric
        self._camera = replace(camera, lens=to_plain_numbers(camera.lens))
        self._pixel_phase_step = phase_step_per_pixel(self._camera, n.distance, n.wavelength)
        if n.sphere is not None:
            self._pixel_phase_step += (
                n.sphere.largest_phase_slope(panel_half_diagonal(camera)) * camera.panel.pitch
            )
        flat = self._flat_pixel_error()
        self._double = precise or n.tol - (flat if flat < n.tol else 0) < 2 * FLOAT32_ARITHMETIC
        self._set_precision(self._double)
        allowed = 0.0 if precise else max(_TRANSFORM_SHARE * n.tol, FINEST_GRIDDING)
        self._transform_tol = allowed
        if flat + self.arithmetic + 2 * allowed <= n.tol:
            self._pixel_model, self._nodes_per_side, sampling = "flat", 1, flat
            offered: list[Transform] = list(
                valid_transforms(self._geometry(1), self._dtype, allowed)
            )
        else:
            sampling, offered = self._plan_curved_or_divided_pixels()
        what = f"a PSF of {n.samples.shape[1]}x{n.samples.shape[0]} samples behind a panel"
        valid = {one.name: one for one in offered}
        chosen = [valid[name] for name in select_methods(valid, transform, what)]
        self._transform = cheapest_candidate(chosen, n.budget, what)
        if isinstance(self._transform, CurvedPixelTransform):
            self._pixel_model, self._nodes_per_side = "curved", 1
        self.name = self._transform.name
        self.error = ErrorEstimate(sampling + 2 * self._transform.error, "bound")
        rows, columns = camera.panel.shape
        divided = f", {self._nodes_per_side}² nodes in each" if self._nodes_per_side > 1 else ""
        self.sampling = f"{columns}x{rows} panel pixels{divided}"

    def _geometry(self, nodes: int) -> FourierGeometry:
        n, panel = self._request.numeric, self._camera.panel
        if nodes == 1:
            return FourierGeometry(panel.plane, n.samples, n.scale)
        inside = gauss_legendre(nodes)[0] * panel.active_side / 2
        y, x = (
            (panel.plane.coordinates(axis)[:, None] + torch.from_numpy(inside)).ravel()
            for axis in (0, 1)
        )
        return FourierGeometry(RectilinearGrid(y, x), n.samples, n.scale)

    def _kernel_phase_step(self) -> float:
        """Radians by which the kernel turns across a panel pixel, to the farthest sample."""
        n = self._request.numeric
        return (
            2 * math.pi * self._camera.panel.pitch * self._request.farthest_sample_radius / n.scale
        )

    def _flat_pixel_error(self) -> float:
        """What it costs to take the lens' wave as constant over a panel pixel.

        With a step of s rad across a pixel, its light on the axis is overrated by s²/24 in
        amplitude; where the image lies t rad per pixel off the axis, by s t / 12 on one side
        of the pupil and underrated on the other. Light goes to t = pi at most, where a panel
        can steer it.
        """
        return self._pixel_phase_step * (
            self._pixel_phase_step / 12 + min(self._kernel_phase_step(), math.pi) / 10
        )

    def _plan_curved_or_divided_pixels(self) -> tuple[float, list[Transform]]:
        """The error and the transforms where the wave bends inside a pixel."""
        n, panel = self._request.numeric, self._camera.panel
        if self._pixel_phase_step > _MAX_PIXEL_PHASE_STEP:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept: the wave turns by {self._pixel_phase_step:.2g} rad "
                "across a panel pixel; bring the object closer to the plane in focus"
            )
        allowed = max(0.2 * n.tol, FLOAT64_ARITHMETIC)
        self._nodes_per_side = (
            _pixel_node_count(0.5 * (self._pixel_phase_step + self._kernel_phase_step()), allowed)
            + self._extra_aberration_nodes()
        )
        self._pixel_model = "divided"
        divided = valid_transforms(
            self._geometry(self._nodes_per_side), self._dtype, self._transform_tol
        )
        offered: list[Transform] = list(divided)
        # Its matrices hold the wave, and give no derivatives of it.
        if n.lens.has_quadratic_phase and n.sphere is None and not self._request.differentiable:
            curvature = defocus_curvature(n.lens, n.distance, n.wavelength)
            offered.append(
                CurvedPixelTransform(self._geometry(1), self._dtype, curvature, panel.active_side)
            )
        return allowed, offered

    def _extra_aberration_nodes(self) -> int:
        """Nodes for polynomials that aren't straight lines over a coarse pixel."""
        n = self._request.numeric
        degree = max((degree for degree, _, _ in n.lens.aberrations), default=0)
        return math.ceil(degree * min(1.0, 10 * self._camera.panel.pitch / n.radius))

    @property
    def bytes(self) -> int:
        rows, columns = self._camera.panel.shape
        return (
            self._transform.bytes
            + 2 * self._dtype.itemsize * rows * columns * self._nodes_per_side**2
        )

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._transform.cpu_seconds(speed)

    def prepare(self) -> None:
        n = self._request.numeric
        if not self.error.value + self.arithmetic <= n.tol:
            raise unreachable_tolerance_error(n.tol, self.error.value + self.arithmetic)
        require_open_pupil(self._camera)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._camera.panel.plane.mesh()

    def _compute_pupil_wave(self) -> torch.Tensor:
        """The stop and the lens' wave on pixels or nodes."""
        q = self._request
        amplitude = pupil_amplitude(self._camera)
        if self._pixel_model == "curved":
            wave = amplitude.to(torch.complex128)
        elif self._pixel_model == "flat":
            phase = pupil_phase_on_panel(
                replace(self._camera, lens=q.lens), q.distance, q.wavelength
            )
            wave = torch.polar(amplitude, wrap_phase(phase))
        else:
            wave = self._wave_on_pixel_nodes(amplitude)
        if q.sphere is not None:
            wave = wave * q.sphere.wave_factor(*self._transform.positions())
        return wave.to(self._dtype)

    def _wave_on_pixel_nodes(self, amplitude: torch.Tensor) -> torch.Tensor:
        q, k = self._request, self._nodes_per_side
        radius = q.radius
        y, x = self._transform.positions()
        phase = pupil_phase(q.lens, q.distance, q.wavelength, y / radius, x / radius)
        weight = torch.from_numpy(gauss_legendre(k)[1] / 2)
        rows, columns = self._camera.panel.shape
        shares = weight.tile(rows)[:, None] * weight.tile(columns)
        return torch.polar(_repeat_per_node(amplitude, k) * shares, wrap_phase(phase))

    def _intensity_scale(self) -> torch.Tensor | float:
        """What turns |sum over the pixels|² into shares of the light a sample."""
        q, panel = self._request, self._camera.panel
        # A pixel that the stop covers in part passes light by its open area.
        power = float(pupil_amplitude(self._camera).sum()) * panel.active_side**2
        area = q.samples.pitch[0] * q.samples.pitch[1]
        return panel.active_side**4 * area / (q.scale**2 * power)

    def _pixel_envelope(self) -> torch.Tensor | float:
        """The intensity that one square panel pixel sends to a sample, 1 on the axis."""
        if self._pixel_model != "flat":
            return 1.0
        q, side = self._request, self._camera.panel.active_side
        y, x = q.samples.mesh()
        return (torch.sinc(y * side / q.scale) * torch.sinc(x * side / q.scale)) ** 2

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        q = self._request
        wave = self._pupil_wave()
        factor = self.modulation_factor(phase, amplitude, self._camera.panel.shape, self._dtype)
        if factor is not None:
            wave = wave.to(factor.device) * _repeat_per_node(factor, self._nodes_per_side)
        moved = q.transform_variables
        # A panel doesn't grow with the stop.
        stretch = q.numeric.scale / q.scale if needs_gradient(q.scale) else None
        field = self._transform(wave, stretch, moved.shift)
        light = (field.real**2 + field.imag**2) * self._intensity_scale()
        light = light * self._to_device_of(self._pixel_envelope(), light)
        if not self._precise and self._has_too_little_light(light, amplitude):
            return self._precise_engine.intensity(phase, amplitude)
        return light.to(torch.float64 if self._double else torch.float32)

    @staticmethod
    def _to_device_of(value: torch.Tensor | float, like: torch.Tensor) -> torch.Tensor | float:
        if not isinstance(value, torch.Tensor):
            return value
        return value.to(like) if not value.requires_grad else value.to(like.device)

    def _has_too_little_light(self, light: torch.Tensor, amplitude: torch.Tensor | None) -> bool:
        """Whether the window gets so little of the light that its errors are those of the rest.

        The rest is what one period of the panel's sum holds.
        """
        if amplitude is not None:
            total = float((amplitude.detach().abs() ** 2).mean())
            if total == 0:
                return False
        else:
            total = 1.0
        if not light.numel():
            return False
        rows, columns = self._request.window_slices
        least = float(light.detach()[..., rows, columns].sum(dim=(-2, -1)).min())
        return 0 < least < _LOW_LIGHT_SHARE * total * self._window_period_share()

    def _window_period_share(self) -> float:
        """Of a period of the panel's sum that the window covers, 1 at most: noise spreads over
        all of it evenly."""
        n, pitch = self._request.numeric, self._camera.panel.pitch
        period = n.scale / pitch
        (rows, columns), (py, px) = (k - 2 * n.margin for k in n.samples.shape), n.samples.pitch
        return min(rows * py / period, 1.0) * min(columns * px / period, 1.0)

    @cached_property
    def _precise_engine(self) -> PanelEngine:
        return PanelEngine(self._request, self._camera, precise=True)


def _repeat_per_node(values: torch.Tensor, nodes: int) -> torch.Tensor:
    """Every value for all nodes of its pixel."""
    if nodes == 1:
        return values
    return values.repeat_interleave(nodes, -2).repeat_interleave(nodes, -1)


def _pixel_node_count(half_turn: float, error: float) -> int:
    """Gauss-Legendre nodes that integrate exp(i h x) over -1 to 1 to a relative error."""
    for k in range(2, _MAX_NODES):
        log = 2 * k * math.log(2 * half_turn + 1e-300) + 4 * math.lgamma(k + 1)
        log -= math.log(2 * k + 1) + 3 * math.lgamma(2 * k + 1)
        if log < math.log(error):
            return k
    raise ToleranceError(
        f"the wave turns by {2 * half_turn:.2g} rad across a panel pixel, more than can be "
        "integrated there; bring the object closer to the plane in focus"
    )
