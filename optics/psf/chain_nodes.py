"""Go through the chain from panel to sensor by quadrature over the stop."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    unreachable_tolerance_error,
)
from optics.camera import Camera
from optics.camera.pupil import pupil_phase
from optics.camera.stop_nodes import (
    QuadratureNodes,
    count_nodes,
    rule_seconds,
    stop_rule,
    stop_rule_blocks,
)
from optics.fourier.differentiation import Derivatives, ShapedMap, Term
from optics.fourier.nonuniform import (
    FINEST_NUFFT,
    NonuniformTransform,
    nonuniform_bytes,
    nonuniform_seconds,
)
from optics.plane import Plane
from optics.psf.chain_engine import ChainEngine, ChainLight
from optics.psf.dim_windows import AddedLight
from optics.psf.edge_scatter import fresnel_area
from optics.psf.lens_grid import TAPER_TOL_SHARE, panel_and_stop_ends, tapered_band
from optics.psf.phase_factor import wrap_phase
from optics.psf.request import PSFRequest
from optics.psf.to_lens import PropagatorAxis, fast_fft_length

# Shares of the tolerance, all chosen.
_BAND_TOL_SHARE = 0.5  # for light outside the band of frequencies
_QUADRATURE_TOL_SHARE = 0.05  # for the quadrature, in the field
_TRANSFORM_TOL_SHARE = 0.02  # for each non-uniform FFT, in the field

# Largest tolerance for which the quadrature, the transforms and the band's ends are planned.
# Chosen, so that the error that is told stays below 1e-4.
_COARSEST_INNER_TOL = 2e-4

# Predicted times, fitted to 60 random chains.
_FIXED_CALLS = 18.0  # of a PSF, whatever its size, in calls
_FREQUENCY_PASSES = 95.0  # for each frequency of the panel's spectrum
_PLANNING_CALLS = 20.0  # of planning, whatever its size, in calls
# Time to sort a node for the transforms and to compute the lens' wave there, over that of
# MachineSpeed.point.
_PLANNED_NODE_POINTS = 10.0

_PLANNING_RULES = 2.0  # time to find the nodes, over what `rule_seconds` predicts for a lens alone

_NODE_BYTES = 400  # for each node
_MOST_NODES = 200_000_000  # that are computed; they take some minutes


class QuadratureEngine(ChainEngine):
    """Computes the PSF by Gauss-Legendre nodes that follow the stop's boundary.

    Non-uniform FFTs lead from the panel's spectrum to the nodes, and from the nodes to the sensor.
    Light of the frequency f moves sideways by f times the Fresnel area. Frequencies that reach the
    stop from no point of the panel are left out by a band with smooth ends (see `tapered_band`). So
    only light that the tolerance allows is left out (see StopEdgeScatter), and the error falls
    faster than any power.
    """

    name = "chain, quadrature"
    precision = "float64"
    _dtype = torch.complex128

    def _plan(self, n: PSFRequest) -> None:
        self.arithmetic = 10 * FLOAT64_ARITHMETIC
        rough = self._sphere_error()
        allowed = _BAND_TOL_SHARE * n.tol - rough
        if not allowed > 0:
            raise unreachable_tolerance_error(n.tol, 1.1 * (rough + 0.2 * n.tol) / _BAND_TOL_SHARE)
        low, high = self._search.find_band(allowed, np.zeros(2))
        # Steps whose errors fall faster than any power are planned for more than is asked: they
        # cost little, and their errors are far below what is told.
        inner_tol = min(n.tol, _COARSEST_INNER_TOL)
        planned = [_plan_axis(n, self._camera, k, low[k], high[k], inner_tol) for k in (0, 1)]
        self._axes = [axis for axis, _ in planned]
        if all(is_complete for _, is_complete in planned):
            allowed = 0.0
        amplitude = min(1.0, self._edge_scatter.window_share) ** 0.5
        self._transform_tol = max(_TRANSFORM_TOL_SHARE * inner_tol * amplitude, FINEST_NUFFT)
        self._quadrature_tol = _QUADRATURE_TOL_SHARE * inner_tol
        used = 2 * (self._quadrature_tol + 2 * self._transform_tol / amplitude)
        left = rough + allowed + 2 * TAPER_TOL_SHARE * inner_tol + used
        self.error = ErrorEstimate(left, "estimate, for an evenly lit panel")
        # It bounds the phase slope in the stop for all light that reaches the lens.
        turn = math.hypot(*(max(map(abs, axis.band.outer_limits)) for axis in self._axes))
        tilt = 2 * math.pi * n.radius * turn / float(n.shadow_magnification)
        at_lens = replace(n, distance=n.object_to_lens_distance, separation=0.0, phase_slope=tilt)
        self._slope_bound = at_lens.phase_slope_bound
        self._node_count = count_nodes(n.lens.stop, self._slope_bound, self._quadrature_tol)
        self.sampling = f"{self._node_count} nodes in the stop"
        self._full_block: _StopNodeBlock | None = None
        self._nodes_in_memory = self._node_count * _NODE_BYTES <= n.budget.memory / 2
        if self._node_count > _MOST_NODES or (
            self._request.differentiable and not self._nodes_in_memory
        ):
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept: the light at the lens turns so fast that it takes "
                f"{self._node_count:.1e} nodes in the stop"
            )

    @property
    def _frequency_plane(self) -> Plane:
        """The panel frequencies that are followed, as a plane in cycles per metre."""
        counts = [axis.frequency_count for axis in self._axes]
        steps = [1 / axis.period for axis in self._axes]
        middles = [
            (axis.first_frequency_number + count // 2) * step
            for axis, count, step in zip(self._axes, counts, steps, strict=True)
        ]
        return Plane((counts[0], counts[1]), (steps[0], steps[1]), (middles[0], middles[1]))

    @property
    def bytes(self) -> int:
        within = self._nodes_in_memory or self._node_count < self._max_block_nodes
        nodes = self._node_count if within else self._max_block_nodes
        plane, samples = self._frequency_plane, self._request.samples
        each = nonuniform_bytes(0, plane) + nonuniform_bytes(0, samples)
        return each + 32 * plane.shape[0] * plane.shape[1] + _NODE_BYTES * nodes

    @property
    def _max_block_nodes(self) -> int:
        return max(1 << 18, self._request.budget.memory // 4 // _NODE_BYTES)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        there = nonuniform_seconds(
            self._node_count, self._frequency_plane, self._transform_tol, speed
        )
        on = nonuniform_seconds(self._node_count, self._request.samples, self._transform_tol, speed)
        rows, columns = self._frequency_plane.shape
        spectrum = _FREQUENCY_PASSES * rows * columns * speed.touch * speed.double
        nodes = (there + on) * (1.0 if self._nodes_in_memory else 3.0)
        return _FIXED_CALLS * speed.call + spectrum + nodes

    def planning_seconds(self, speed: MachineSpeed) -> float:
        seconds = super().planning_seconds(speed) + _PLANNING_CALLS * speed.call
        if not self._nodes_in_memory:
            return seconds
        seconds += _PLANNED_NODE_POINTS * self._node_count * speed.point
        stop, slope = self._request.numeric.lens.stop, self._slope_bound
        return seconds + _PLANNING_RULES * rule_seconds(stop, slope, self._quadrature_tol, speed)

    def prepare(self) -> None:
        super().prepare()
        if self._nodes_in_memory:
            stop = self._request.numeric.lens.stop
            rule = stop_rule(stop, self._slope_bound, self._quadrature_tol)
            self._full_block = _StopNodeBlock(rule, self)
            self.sampling = f"{rule.count} nodes in the stop"

    def _blocks(self) -> Iterator[_StopNodeBlock]:
        if self._full_block is not None:
            yield self._full_block
            return
        stop = self._request.numeric.lens.stop
        for nodes in stop_rule_blocks(
            stop, self._slope_bound, self._quadrature_tol, self._max_block_nodes
        ):
            yield _StopNodeBlock(nodes, self)

    def _light(
        self, field: torch.Tensor, amplitude: torch.Tensor | None, added: AddedLight | None
    ) -> ChainLight:
        if self._full_block is None and field.requires_grad and torch.is_grad_enabled():
            raise ValueError(
                f"a stop of {self._node_count} nodes gives no derivatives; allow more memory, or "
                'take method="chain"'
            )
        light = self._spectrum_at_lens(field, self._axes)
        for axes, part in self._sloped_parts(field, self._axes):
            light = light + self._spectrum_at_lens(part, axes)
        seen = sum((block.field(light) for block in self._blocks()), torch.zeros(()))
        return ChainLight((seen.real**2 + seen.imag**2) * self.intensity_scale())

    def _spectrum_at_lens(self, field: torch.Tensor, axes: list[PropagatorAxis]) -> torch.Tensor:
        """Compute the spectrum, (..., y, x), of the field that arrives at the lens."""
        y, x = axes
        for axis, dim in ((y, -2), (x, -1)):
            field = torch.fft.fft(field, axis.fft_length, dim)
            number = torch.arange(axis.frequency_count) + axis.first_frequency_number
            field = field.index_select(dim, (number % axis.fft_length).to(field.device))
        moved = self._propagator_variables()
        weights = [axis.transfer(self._dtype).to(field.device) for axis in axes]
        if moved is not None:
            # This factor has the value 1 and carries the derivative in the Fresnel area.
            change = moved.fresnel_area - moved.fresnel_area.detach()
            angles = [-math.pi * axis.band_frequencies**2 * change for axis in axes]
            weights = [
                weight * torch.polar(torch.ones_like(angle), angle)
                for weight, angle in zip(weights, angles, strict=True)
            ]
        return field * weights[0][:, None] * weights[1]


def _plan_axis(
    n: PSFRequest, camera: Camera, axis: int, low: float, high: float, tol: float
) -> tuple[PropagatorAxis, bool]:
    """Plan a frequency axis: the frequencies from `low` to `high` that reach the stop.

    Also returns whether the axis holds all frequencies that go from any point of the panel to any
    point of the stop.

    tol: relative error that the band's smooth ends may cause.
    """
    panel, bend = camera.panel, fresnel_area(n)
    ends, stop = panel_and_stop_ends(n, camera, axis)
    # Beyond these frequencies, no light goes from the panel to the stop.
    first, last = (stop[0] - ends[1]) / bend, (stop[1] - ends[0]) / bend
    is_complete = low <= first and last <= high
    band = tapered_band(max(low, first), min(high, last), bend, tol)
    margin = band.taper_sigmas / (2 * math.pi * band.taper_sigma)
    reach = ends[0] + bend * band.outer_limits[0], ends[1] + bend * band.outer_limits[1]
    least = max(reach[1] - stop[0], stop[1] - reach[0], ends[1] - ends[0]) + margin
    length = fast_fft_length(least / panel.pitch)
    planned = PropagatorAxis(
        panel.shape[axis], panel.pitch, panel.active_side, length, 1, length, bend, 0.0, band
    )
    return planned, is_complete


class _StopNodeBlock:
    """Holds a block of nodes in the stop, and the transforms to the nodes and to the sensor."""

    def __init__(self, nodes: QuadratureNodes, engine: QuadratureEngine) -> None:
        self._nodes, self._engine = nodes, engine
        self._kept_wave: torch.Tensor | None = None
        q = engine._request
        n = q.numeric
        grow = n.radius / float(n.shadow_magnification)
        shifts = [float(sine) * n.separation for sine in n.chief_ray_slopes]
        y, x = (p * grow - s for p, s in zip((nodes.y, nodes.x), shifts, strict=True))
        self._to_lens = NonuniformTransform(
            y, x, engine._frequency_plane, 1.0, engine._transform_tol
        )
        self._to_sensor = NonuniformTransform(
            nodes.y * n.radius, nodes.x * n.radius, n.samples, n.scale, engine._transform_tol
        )

    def field(self, light: torch.Tensor) -> torch.Tensor:
        """Compute the field at the sensor from these nodes, in square stop radii."""
        q = self._engine._request
        moved, onward = self._engine._propagator_variables(), q.transform_variables
        if moved is None:
            arriving = self._to_lens.adjoint(light)
        else:
            numbers = (moved.stretch, *moved.shift)
            arriving = _shaped_adjoint(self._to_lens)(light, numbers)
        wave, at = self._kept_wave, self._nodes
        if wave is None:
            distance = q.object_to_lens_distance
            phase = wrap_phase(pupil_phase(q.lens, distance, q.wavelength, at.y, at.x))
            wave = torch.polar(torch.ones_like(phase), phase) * at.weight
            self._kept_wave = None if q.differentiable else wave
        return self._to_sensor(arriving * wave.to(arriving.device), onward.stretch, onward.shift)


def _shaped_adjoint(transform: NonuniformTransform) -> ShapedMap:
    """Return the sum of light at the stop nodes as a map that their places shape.

    It sums light exp(2 pi i f (stretch y + shift)) over all frequencies f, at the nodes y.
    """

    def derive(same: ShapedMap) -> Derivatives:
        at_y, at_x = transform.positions()
        fy, fx = (2j * math.pi * transform.image.coordinates(axis) for axis in (0, 1))
        turn_y, turn_x = fy[:, None], fx[None, :]
        stretch: list[Term] = [(at_y, same, turn_y), (at_x, same, turn_x)]
        return [stretch, [(1.0, same, turn_y)], [(1.0, same, turn_x)]]

    return ShapedMap(transform._adjoint, transform._forward, derive)
