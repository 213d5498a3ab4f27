"""The chain of panel, space, stop, space and sensor by exact quadrature over the stop."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    unkeepable,
)
from optics.camera import Camera
from optics.chain.engine import ChainEngine
from optics.chain.relay import Band, RelayAxis, fast_length
from optics.chain.relay_axes import bend_of, extent
from optics.edge import recorded
from optics.fourier.nonuniform import (
    FINEST_NUFFT,
    NonuniformTransform,
    nonuniform_bytes,
    nonuniform_seconds,
)
from optics.fourier.transform import applied
from optics.plane import Plane
from optics.point.engine import within_a_turn
from optics.point.question import Question
from optics.pupil import wave_phase
from optics.stop.quadrature import Nodes, Steepness, count_nodes, stop_blocks, stop_rule

_LEFT_OUT, _QUADRATURE, _TRANSFORM = 0.5, 0.05, 0.02
"""Of the tolerance: for light left out; and in the field for the nodes and each transform."""

_TAPERED = 1e-2
"""Of the tolerance: what a band's ends may change within the light's reach."""

_BYTES_A_NODE = 400
_MOST_NODES = 200_000_000
"""Some minutes of work."""


class NodesEngine(ChainEngine):
    """Gauss-Legendre nodes that follow the stop's boundary, and non-uniform FFTs to them from
    the panel's spectrum, and from them to the sensor.

    A frequency f goes from a place on the panel to one bend f beside it. Those that get from no
    place of the panel to any of the stop are left out, by a smooth end of the band. Against the
    chirp exp(-i pi bend (f - f0)²), a Gaussian step of standard deviation s at the distance D
    from the stationary frequency f0 leaves exp(-2 (pi bend s D)² / (1 + (2 pi bend s²)²)); the
    best s² = 1 / (2 pi bend) makes that exp(-pi bend D² / 2). So nothing else is left out than
    what the tolerance allows (see EdgeLight), and the error falls faster than any power.
    """

    name = "chain, quadrature"
    precision = "float64"
    _dtype = torch.complex128

    def _plan(self, n: Question) -> None:
        self.arithmetic = 10 * FLOAT64_ARITHMETIC
        rough = self._sphere_error()
        allowed = _LEFT_OUT * n.tol - rough
        if not allowed > 0:
            raise unkeepable(n.tol, 1.1 * (rough + 0.2 * n.tol) / _LEFT_OUT)
        low, high = self._search.band(allowed, np.zeros(2))
        ends = zip(low, high, strict=True)
        self._axes = [_axis(n, self._camera, k, *pair) for k, pair in enumerate(ends)]
        self._bright = min(1.0, self._edge.window_share) ** 0.5
        self._accuracy = max(_TRANSFORM * n.tol * self._bright, FINEST_NUFFT)
        used = 2 * (_QUADRATURE * n.tol + 2 * self._accuracy / self._bright)
        left = rough + allowed + 2 * _TAPERED * n.tol + used
        self.error = ErrorEstimate(left, "estimate, for an evenly lit panel")
        self._steep = self._steepness(n)
        self._count = count_nodes(n.lens.stop, self._steep, _QUADRATURE * n.tol)
        self.sampling = f"{self._count} nodes in the stop"
        self._whole: _Block | None = None
        self._held = self._count * _BYTES_A_NODE <= n.budget.memory / 2
        if self._count > _MOST_NODES or (self._question.differentiable and not self._held):
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept: the light at the lens turns so fast that it takes "
                f"{self._count:.1e} nodes in the stop; ask for a larger tol, or stop the lens down"
            )

    def _steepness(self, n: Question) -> Steepness:
        """The lens' own, and that of all the light that gets there."""
        turn = math.hypot(*(max(map(abs, axis.band.outer)) for axis in self._axes))
        tilt = 2 * math.pi * n.radius * turn / float(n.spread)
        at_lens = replace(n, distance=n.from_lens, separation=0.0, phase_slope=tilt)
        return at_lens.steepness

    @property
    def _frequencies(self) -> Plane:
        """The band as a plane, cycles per metre."""
        counts = [axis.frequencies for axis in self._axes]
        steps = [1 / axis.period for axis in self._axes]
        middles = [
            (axis.lowest + count // 2) * step
            for axis, count, step in zip(self._axes, counts, steps, strict=True)
        ]
        return Plane((counts[0], counts[1]), (steps[0], steps[1]), (middles[0], middles[1]))

    @property
    def bytes(self) -> int:
        nodes = min(self._count, self._most) if not self._held else self._count
        plane, samples = self._frequencies, self._question.samples
        each = nonuniform_bytes(0, plane) + nonuniform_bytes(0, samples)
        return each + 32 * plane.shape[0] * plane.shape[1] + _BYTES_A_NODE * nodes

    @property
    def _most(self) -> int:
        return max(1 << 18, self._question.budget.memory // 4 // _BYTES_A_NODE)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        there = nonuniform_seconds(self._count, self._frequencies, self._accuracy, speed)
        on = nonuniform_seconds(self._count, self._question.samples, self._accuracy, speed)
        return (there + on) * (1.0 if self._held else 3.0)

    def prepare(self) -> None:
        n = self._question.numeric
        if not self.error.value + self.arithmetic <= n.tol:
            raise unkeepable(n.tol, self.error.value + self.arithmetic)
        if self._held:
            rule = stop_rule(n.lens.stop, self._steep, _QUADRATURE * n.tol)
            self._whole = _Block(rule, self)
            self.sampling = f"{rule.count} nodes in the stop"

    def _blocks(self) -> Iterator[_Block]:
        if self._whole is not None:
            yield self._whole
            return
        n = self._question.numeric
        for nodes in stop_blocks(n.lens.stop, self._steep, _QUADRATURE * n.tol, self._most):
            yield _Block(nodes, self)

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        modulated = self.modulated(phase, amplitude)
        if not modulated.numel():
            return self.none(modulated)
        if self._whole is None and modulated.requires_grad and torch.is_grad_enabled():
            raise ValueError(
                f"a stop of {self._count} nodes gives no derivatives; allow more memory, or take "
                'method="chain"'
            )
        light = self._spectrum(modulated, self._axes)
        for axis, part in self.leaning(modulated):
            axes = [replace(one, leaning=k == axis) for k, one in enumerate(self._axes)]
            light = light + self._spectrum(part, axes)
        field = sum((block.field(light) for block in self._blocks()), torch.zeros(()))
        power = (field.real**2 + field.imag**2) * self.strength()
        return self._kept(power, phase, amplitude)

    def _spectrum(self, field: torch.Tensor, axes: list[RelayAxis]) -> torch.Tensor:
        """All frequencies of the band after the space, (..., y, x)."""
        y, x = axes
        for axis, dim in ((y, -2), (x, -1)):
            field = torch.fft.fft(field, axis.length, dim)
            number = (torch.arange(axis.frequencies) + axis.lowest) % axis.length
            field = field.index_select(dim, number.to(field.device))
        moved = self._moved()
        weights = [axis.transfer(self._dtype).to(field.device) for axis in axes]
        if moved is not None:
            # The bend's derivative comes by a factor that is 1.
            weights = [
                w * torch.polar(torch.ones_like(a), a)
                for w, a in (
                    (w, -math.pi * axis.frequency**2 * (moved.bend - moved.bend.detach()))
                    for w, axis in zip(weights, axes, strict=True)
                )
            ]
        return field * weights[0][:, None] * weights[1]


def _axis(n: Question, camera: Camera, axis: int, low: float, high: float) -> RelayAxis:
    """Frequencies from `low` to `high`, or as far as light gets from the panel to the stop."""
    panel, spread = camera.panel, float(n.spread)
    bend = bend_of(n)
    line = panel.plane.coordinates(axis)
    ends = float(line[0]) - panel.pitch / 2, float(line[-1]) + panel.pitch / 2
    shift = float(n.sines[axis]) * n.separation
    stop = [place * n.radius / spread - shift for place in extent(camera, axis)]
    steps = math.sqrt(2 * math.log(1 / (_TAPERED * n.tol)))
    room = steps / math.sqrt(math.pi * bend)
    soft = 1 / math.sqrt(2 * math.pi * bend)
    low = max(low - room, (stop[0] - ends[1]) / bend - room)
    high = min(high + room, (stop[1] - ends[0]) / bend + room)
    band = Band(low, high, soft, steps)
    margin = steps / (2 * math.pi * soft)
    reach = ends[0] + bend * band.outer[0], ends[1] + bend * band.outer[1]
    least = max(reach[1] - stop[0], stop[1] - reach[0], ends[1] - ends[0]) + margin
    length = fast_length(least / panel.pitch)
    return RelayAxis(
        panel.shape[axis], panel.pitch, panel.active_side, length, 1, length, bend, 0.0, band
    )


class _Block:
    """Some nodes, what the lens does there, and the transforms to them and onwards."""

    def __init__(self, nodes: Nodes, engine: NodesEngine) -> None:
        self._nodes, self._engine = nodes, engine
        q = engine._question
        n = q.numeric
        grow = n.radius / float(n.spread)
        shifts = [float(sine) * n.separation for sine in n.sines]
        self._places = (nodes.y * grow, nodes.x * grow)
        y, x = (p - s for p, s in zip(self._places, shifts, strict=True))
        self._there = NonuniformTransform(y, x, engine._frequencies, 1.0, engine._accuracy)
        self._on = NonuniformTransform(
            nodes.y * n.radius, nodes.x * n.radius, n.samples, n.scale, engine._accuracy
        )

    def field(self, light: torch.Tensor) -> torch.Tensor:
        """On the samples, in square stop radii."""
        q = self._engine._question
        moved, onward = self._engine._moved(), q.derivatives
        numbers = (moved.stretch, *moved.shift) if moved is not None else (None, None, None)
        arriving = _at_nodes(self._there, light, *numbers)
        phase = wave_phase(q.lens, q.from_lens, q.wavelength, self._nodes.y, self._nodes.x)
        phase = within_a_turn(phase)
        wave = torch.polar(torch.ones_like(phase), phase) * self._nodes.weight
        return self._on(arriving * wave.to(arriving.device), onward.stretch, onward.shift)


def _at_nodes(transform: NonuniformTransform, light: torch.Tensor, *numbers: Any) -> torch.Tensor:
    """The field at the transform's points, from the light's frequencies on its image plane."""
    wanted = light.requires_grad or any(map(recorded, numbers))
    if not (wanted and torch.is_grad_enabled()):
        return transform.adjoint(light.detach())
    return applied(_AtNodes, transform, light, *numbers)


class _AtNodes(torch.autograd.Function):
    """The sum of light exp(2 pi i f (stretch y + shift)) over all frequencies f, at nodes y."""

    @staticmethod
    def forward(
        ctx: Any, transform: NonuniformTransform, light: torch.Tensor, *numbers: Any
    ) -> torch.Tensor:
        ctx.transform, ctx.numbers = transform, numbers
        ctx.save_for_backward(light)
        return transform._adjoint(light)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        transform: NonuniformTransform = ctx.transform
        answers: list[Any] = [None] * 4
        if ctx.needs_input_grad[1]:
            answers[0] = transform._forward(gradient)
        if any(ctx.needs_input_grad[2:]):
            (light,) = ctx.saved_tensors
            f = (transform.image.coordinates(0)[:, None], transform.image.coordinates(1)[None, :])
            turned = [transform._adjoint(light * (2j * math.pi * one)) for one in f]
            # How much the answer changes for a metre along each axis, at every node.
            y, x = (
                (gradient.conj() * one).real.reshape(-1, one.shape[-1]).sum(0) for one in turned
            )
            at_y, at_x = transform.positions()
            found = ((y * at_y).sum() + (x * at_x).sum(), y.sum(), x.sum())
            for place, (number, value) in enumerate(zip(ctx.numbers, found, strict=True), start=1):
                answers[place] = value.to(number) if number is not None else None
        return (None, *answers)
