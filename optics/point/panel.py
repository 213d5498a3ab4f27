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
    cheapest,
    named,
    unkeepable,
)
from optics.camera import Camera
from optics.edge import numeric, recorded
from optics.fourier import (
    ChirpTransform,
    CommensurateTransform,
    Geometry,
    GriddedTransform,
    MatrixTransform,
    Transform,
    transforms,
)
from optics.fourier.gridded import FINEST_GRIDDING
from optics.gauss_legendre import gauss_legendre
from optics.plane import Lattice
from optics.point.curved_pixels import CurvedPixelTransform
from optics.point.engine import Engine, Lit, within_a_turn
from optics.point.question import Question
from optics.pupil import (
    defocus_curvature,
    panel_phase,
    panel_reach,
    phase_step,
    pupil_amplitude,
    require_open,
    wave_phase,
)

TRANSFORMS = (
    MatrixTransform.name,
    ChirpTransform.name,
    CommensurateTransform.name,
    GriddedTransform.name,
    CurvedPixelTransform.name,
)
"""The methods behind a panel; not all of them serve every question."""

_STEEPEST_WAVE = 600.0
"""Radians across a panel pixel beyond which the blur is far larger than any sensor."""

_TRANSFORM_SHARE = 0.02
"""Of the tolerance that a transform may use, for all the light there is."""

_DIMMEST = 0.02
"""Share of the light in the window from which that of the transform's error is a small one."""

_MOST_NODES = 400


class PanelEngine(Lit, Engine):
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
        question: Question,
        camera: Camera,
        *,
        transform: str | None = None,
        precise: bool = False,
    ) -> None:
        self._question, self._precise = question, precise
        n = question.numeric
        self._camera = replace(camera, lens=numeric(camera.lens))
        self._steps = phase_step(self._camera, n.distance, n.wavelength)
        if n.sphere is not None:
            self._steps += n.sphere.slope(panel_reach(camera)) * camera.panel.pitch
        flat = self._flat_error()
        self._double = precise or n.tol - (flat if flat < n.tol else 0) < 2 * FLOAT32_ARITHMETIC
        self._set_precision(self._double)
        allowed = 0.0 if precise else max(_TRANSFORM_SHARE * n.tol, FINEST_GRIDDING)
        self._allowed = allowed
        if flat + self.arithmetic + 2 * allowed <= n.tol:
            self._pixels, self._nodes, sampling = "flat", 1, flat
            offered: list[Transform] = list(transforms(self._geometry(1), self._dtype, allowed))
        else:
            sampling, offered = self._bent()
        what = f"a PSF of {n.samples.shape[1]}x{n.samples.shape[0]} samples behind a panel"
        valid = {one.name: one for one in offered}
        chosen = [valid[name] for name in named(valid, transform, what)]
        self._transform = cheapest(chosen, n.budget, what)
        if isinstance(self._transform, CurvedPixelTransform):
            self._pixels, self._nodes = "curved", 1
        self.name = self._transform.name
        self.error = ErrorEstimate(sampling + 2 * self._transform.error, "bound")
        rows, columns = camera.panel.shape
        divided = f", {self._nodes}² nodes in each" if self._nodes > 1 else ""
        self.sampling = f"{columns}x{rows} panel pixels{divided}"

    def _geometry(self, nodes: int) -> Geometry:
        n, panel = self._question.numeric, self._camera.panel
        if nodes == 1:
            return Geometry(panel.plane, n.samples, n.scale)
        inside = gauss_legendre(nodes)[0] * panel.active_side / 2
        y, x = (
            (panel.plane.coordinates(axis)[:, None] + torch.from_numpy(inside)).ravel()
            for axis in (0, 1)
        )
        return Geometry(Lattice(y, x), n.samples, n.scale)

    def _tilt(self) -> float:
        """Radians by which the kernel turns across a panel pixel, to the farthest sample."""
        n = self._question.numeric
        return 2 * math.pi * self._camera.panel.pitch * self._question.farthest / n.scale

    def _flat_error(self) -> float:
        """What it costs to take the lens' wave as constant over a panel pixel.

        With a step of s rad across a pixel, its light on the axis is overrated by s²/24 in
        amplitude; where the image lies t rad per pixel off the axis, by s t / 12 on one side
        of the pupil and underrated on the other. Light goes to t = pi at most, where a panel
        can steer it.
        """
        return self._steps * (self._steps / 12 + min(self._tilt(), math.pi) / 10)

    def _bent(self) -> tuple[float, list[Transform]]:
        """The error and the transforms where the wave bends inside a pixel."""
        n, panel = self._question.numeric, self._camera.panel
        if self._steps > _STEEPEST_WAVE:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept: the wave turns by {self._steps:.2g} rad across a "
                "panel pixel; bring the object closer to the plane in focus"
            )
        allowed = max(0.2 * n.tol, FLOAT64_ARITHMETIC)
        self._nodes = _nodes_for(0.5 * (self._steps + self._tilt()), allowed) + self._bend()
        self._pixels = "divided"
        divided = transforms(self._geometry(self._nodes), self._dtype, self._allowed)
        offered: list[Transform] = list(divided)
        # Its matrices hold the wave, and give no derivatives of it.
        if n.lens.quadratic and n.sphere is None and not self._question.differentiable:
            curvature = defocus_curvature(n.lens, n.distance, n.wavelength)
            offered.append(
                CurvedPixelTransform(self._geometry(1), self._dtype, curvature, panel.active_side)
            )
        return allowed, offered

    def _bend(self) -> int:
        """Nodes for polynomials that aren't straight lines over a coarse pixel."""
        n = self._question.numeric
        degree = max((degree for degree, _, _ in n.lens.aberrations), default=0)
        return math.ceil(degree * min(1.0, 10 * self._camera.panel.pitch / n.radius))

    @property
    def bytes(self) -> int:
        rows, columns = self._camera.panel.shape
        return self._transform.bytes + 2 * self._dtype.itemsize * rows * columns * self._nodes**2

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._transform.cpu_seconds(speed)

    def prepare(self) -> None:
        n = self._question.numeric
        if not self.error.value + self.arithmetic <= n.tol:
            raise unkeepable(n.tol, self.error.value + self.arithmetic)
        require_open(self._camera)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._camera.panel.plane.mesh()

    def _made_wave(self) -> torch.Tensor:
        """The stop and the lens' wave on pixels or nodes."""
        q = self._question
        amplitude = pupil_amplitude(self._camera)
        if self._pixels == "curved":
            wave = amplitude.to(torch.complex128)
        elif self._pixels == "flat":
            phase = panel_phase(replace(self._camera, lens=q.lens), q.distance, q.wavelength)
            wave = torch.polar(amplitude, within_a_turn(phase))
        else:
            wave = self._divided_wave(amplitude)
        if q.sphere is not None:
            wave = wave * q.sphere.factor(*self._transform.positions())
        return wave.to(self._dtype)

    def _divided_wave(self, amplitude: torch.Tensor) -> torch.Tensor:
        q, k = self._question, self._nodes
        radius = q.radius
        y, x = self._transform.positions()
        phase = wave_phase(q.lens, q.distance, q.wavelength, y / radius, x / radius)
        weight = torch.from_numpy(gauss_legendre(k)[1] / 2)
        rows, columns = self._camera.panel.shape
        shares = weight.tile(rows)[:, None] * weight.tile(columns)
        return torch.polar(_divided(amplitude, k) * shares, within_a_turn(phase))

    def _strength(self) -> torch.Tensor | float:
        """What turns |sum over the pixels|² into shares of the light a sample."""
        q, panel = self._question, self._camera.panel
        # A pixel that the stop covers in part passes light by its open area.
        power = float(pupil_amplitude(self._camera).sum()) * panel.active_side**2
        area = q.samples.pitch[0] * q.samples.pitch[1]
        return panel.active_side**4 * area / (q.scale**2 * power)

    def _envelope(self) -> torch.Tensor | float:
        """The intensity that one square panel pixel sends to a sample, 1 on the axis."""
        if self._pixels != "flat":
            return 1.0
        q, side = self._question, self._camera.panel.active_side
        y, x = q.samples.mesh()
        return (torch.sinc(y * side / q.scale) * torch.sinc(x * side / q.scale)) ** 2

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        q = self._question
        wave = self._wave()
        factor = self.modulation(phase, amplitude, self._camera.panel.shape, self._dtype)
        if factor is not None:
            wave = wave.to(factor.device) * _divided(factor, self._nodes)
        moved = q.derivatives
        # A panel doesn't grow with the stop.
        stretch = q.numeric.scale / q.scale if recorded(q.scale) else None
        field = self._transform(wave, stretch, moved.shift)
        light = (field.real**2 + field.imag**2) * self._strength()
        light = light * self._on(self._envelope(), light)
        if not self._precise and self._too_dim(light, amplitude):
            return self._precisely.intensity(phase, amplitude)
        return light.to(torch.float64 if self._double else torch.float32)

    @staticmethod
    def _on(value: torch.Tensor | float, like: torch.Tensor) -> torch.Tensor | float:
        if not isinstance(value, torch.Tensor):
            return value
        return value.to(like) if not value.requires_grad else value.to(like.device)

    def _too_dim(self, light: torch.Tensor, amplitude: torch.Tensor | None) -> bool:
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
        rows, columns = self._question.inner
        least = float(light.detach()[..., rows, columns].sum(dim=(-2, -1)).min())
        return 0 < least < _DIMMEST * total * self._window_share()

    def _window_share(self) -> float:
        """Of a period of the panel's sum that the window covers, 1 at most: noise spreads over
        all of it evenly."""
        n, pitch = self._question.numeric, self._camera.panel.pitch
        period = n.scale / pitch
        (rows, columns), (py, px) = (k - 2 * n.margin for k in n.samples.shape), n.samples.pitch
        return min(rows * py / period, 1.0) * min(columns * px / period, 1.0)

    @cached_property
    def _precisely(self) -> PanelEngine:
        return PanelEngine(self._question, self._camera, precise=True)


def _divided(values: torch.Tensor, nodes: int) -> torch.Tensor:
    """Every value for all nodes of its pixel."""
    if nodes == 1:
        return values
    return values.repeat_interleave(nodes, -2).repeat_interleave(nodes, -1)


def _nodes_for(half_turn: float, error: float) -> int:
    """Gauss-Legendre nodes that integrate exp(i h x) over -1 to 1 to a relative error."""
    for k in range(2, _MOST_NODES):
        log = 2 * k * math.log(2 * half_turn + 1e-300) + 4 * math.lgamma(k + 1)
        log -= math.log(2 * k + 1) + 3 * math.lgamma(2 * k + 1)
        if log < math.log(error):
            return k
    raise ToleranceError(
        f"the wave turns by {2 * half_turn:.2g} rad across a panel pixel, more than can be "
        "integrated there; bring the object closer to the plane in focus"
    )
