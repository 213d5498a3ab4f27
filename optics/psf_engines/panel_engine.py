"""Compute the PSF of a lens with a panel of pixels in its plane."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
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
from optics.psf_engines.curved_pixels import CurvedPixelTransform
from optics.psf_engines.engine import CachedPupilWave, PSFEngine, wrap_phase
from optics.psf_engines.request import PSFRequest
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
"""Names of the Fourier transforms for a PSF behind a panel; not all of them serve every request."""


@dataclass(frozen=True)
class PanelEngineSettings:
    """Tune the PSF engine for a panel in a lens.

    Attributes
    ----------
    max_pixel_phase_step : float
        Largest change of phase across a panel pixel, in radians. Beyond, the blur is far larger
        than any sensor.
    transform_tol_share : float
        Share of the tolerance that the Fourier transform may use. Chosen.
    low_light_share : float
        Share of the light below which the window counts as dark, so that the transform's error,
        which scales with all light, may exceed its share of the tolerance. Chosen.
    max_nodes : int
        Most Gauss-Legendre nodes along a side of a pixel. Chosen.
    """

    max_pixel_phase_step: float = 600.0
    transform_tol_share: float = 0.02
    low_light_share: float = 0.02
    max_nodes: int = 400


_SETTINGS = PanelEngineSettings()


class PanelEngine(CachedPupilWave, PSFEngine):
    """Computes the PSF of a lens and a panel in its plane, whose pixels are uniform squares.

    The lens' wave adds to each pixel's modulation. Where the wave's phase hardly changes across a
    pixel, it is taken as constant there (flat pixels), and the field is one sum over the pixels
    times a pixel's envelope. Otherwise the wave is integrated inside each pixel: by a matrix along
    each axis for a thin lens' defocus (curved pixels), or by Gauss-Legendre nodes (divided pixels).
    A pixel that the stop covers in part passes light in proportion to its open area.

    transform: name of the Fourier transform; the cheapest if None. precise: whether to use double
    precision and exact transforms, whatever the tolerance.
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
        share = _SETTINGS.transform_tol_share
        allowed = 0.0 if precise else max(share * n.tol, FINEST_GRIDDING)
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
        """Return the panel PSF engine's Fourier geometry with `nodes`² points per panel pixel."""
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
        """Return the phase change of the PSF engine's kernel across a panel pixel, in radians.

        The kernel is that of the farthest sample, whose phase changes most.
        """
        n = self._request.numeric
        return (
            2 * math.pi * self._camera.panel.pitch * self._request.farthest_sample_radius / n.scale
        )

    def _flat_pixel_error(self) -> float:
        """Bound the PSF engine's error if it takes the wave as constant over each panel pixel.

        If the phase changes by s rad across a pixel, the pixel's amplitude on the axis is
        overestimated by s²/24. For a sample at t rad per pixel off the axis, it is overestimated by
        s t / 12 on one side of the pupil and underestimated on the other. A panel can steer light
        to t = pi at most.
        """
        return self._pixel_phase_step * (
            self._pixel_phase_step / 12 + min(self._kernel_phase_step(), math.pi) / 10
        )

    def _plan_curved_or_divided_pixels(self) -> tuple[float, list[Transform]]:
        """Return the PSF engine's error and transforms for a wave that bends in panel pixels."""
        n, panel = self._request.numeric, self._camera.panel
        if self._pixel_phase_step > _SETTINGS.max_pixel_phase_step:
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
        # The matrices for curved pixels contain the lens' wave and give no derivatives in it.
        if n.lens.has_quadratic_phase and n.sphere is None and not self._request.differentiable:
            curvature = defocus_curvature(n.lens, n.distance, n.wavelength)
            offered.append(
                CurvedPixelTransform(self._geometry(1), self._dtype, curvature, panel.active_side)
            )
        return allowed, offered

    def _extra_aberration_nodes(self) -> int:
        """Return how many nodes the PSF engine adds along a panel pixel for aberrations.

        Across a coarse pixel, aberrations aren't linear.
        """
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
        """Compute the lens' wave behind the stop on the PSF engine's pixels or their nodes."""
        q = self._request
        camera = self._camera_with_tensors
        amplitude = pupil_amplitude(camera)
        if self._pixel_model == "curved":
            wave = amplitude.to(torch.complex128)
        elif self._pixel_model == "flat":
            phase = pupil_phase_on_panel(camera, q.distance, q.wavelength)
            wave = torch.polar(amplitude, wrap_phase(phase))
        else:
            wave = self._wave_on_pixel_nodes(amplitude)
        if q.sphere is not None:
            wave = wave * q.sphere.wave_factor(*self._transform.positions())
        return wave.to(self._dtype)

    @property
    def _camera_with_tensors(self) -> Camera:
        """The camera with the PSF request's lens, which may hold tensors that need gradients."""
        return replace(self._camera, lens=self._request.lens)

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
        """Return the PSF engine's factor from ``|sum over pixels|²`` to light shares per sample."""
        q, panel = self._request, self._camera.panel
        # A pixel that the stop covers in part passes light by its open area.
        power = pupil_amplitude(self._camera_with_tensors).sum() * panel.active_side**2
        area = q.samples.pitch[0] * q.samples.pitch[1]
        return panel.active_side**4 * area / (q.scale**2 * power)

    def _pixel_envelope(self) -> torch.Tensor | float:
        """Return a panel pixel's relative intensity at the PSF engine's samples, 1 on the axis."""
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
        # The panel keeps its size if the stop's radius changes, so only the scale stretches.
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
        """Tell whether the PSF engine's window is so dim that errors of other light dominate it.

        The other light is all light in one period of the sum over the panel's pixels.
        """
        if not light.numel():
            return False
        total = torch.ones(())
        if amplitude is not None:
            total = (amplitude.detach().abs() ** 2).mean((-2, -1)).to(light.device)
        rows, columns = self._request.window_slices
        in_window = light.detach()[..., rows, columns].sum((-2, -1))
        least = _SETTINGS.low_light_share * self._window_period_share() * total
        return bool(((in_window > 0) & (in_window < least)).any())

    def _window_period_share(self) -> float:
        """Return the share of the PSF engine's period that the window covers, 1 at most.

        The sum over the panel's pixels is periodic on the sensor. The transform's error spreads
        evenly over a period.
        """
        n, pitch = self._request.numeric, self._camera.panel.pitch
        period = n.scale / pitch
        (rows, columns), (py, px) = (k - 2 * n.margin for k in n.samples.shape), n.samples.pitch
        return min(rows * py / period, 1.0) * min(columns * px / period, 1.0)

    @cached_property
    def _precise_engine(self) -> PanelEngine:
        """The panel PSF engine in higher precision, for a dim window."""
        return PanelEngine(self._request, self._camera, precise=True)


def _repeat_per_node(values: torch.Tensor, nodes: int) -> torch.Tensor:
    """Repeat each panel pixel's value for all nodes that the PSF engine has in the pixel."""
    if nodes == 1:
        return values
    return values.repeat_interleave(nodes, -2).repeat_interleave(nodes, -1)


def _pixel_node_count(half_turn: float, error: float) -> int:
    """Return how many Gauss-Legendre nodes the PSF engine needs in a pixel for a given error.

    The nodes integrate the wave exp(i half_turn x) over x from -1 to 1.
    """
    for k in range(2, _SETTINGS.max_nodes):
        log = 2 * k * math.log(2 * half_turn + 1e-300) + 4 * math.lgamma(k + 1)
        log -= math.log(2 * k + 1) + 3 * math.lgamma(2 * k + 1)
        if log < math.log(error):
            return k
    raise ToleranceError(
        f"the wave turns by {2 * half_turn:.2g} rad across a panel pixel, more than can be "
        "integrated there; bring the object closer to the plane in focus"
    )
