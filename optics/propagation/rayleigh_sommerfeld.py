"""Direct quadrature of the diffraction integral, slow but accurate."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch.utils.checkpoint import checkpoint

from optics.accuracy import ErrorEstimate, MachineSpeed, ToleranceError
from optics.fourier import unit_phasor
from optics.gauss_legendre import gauss_legendre
from optics.propagation.paraxial import oversampling_factor, target_ray_frequencies
from optics.propagation.propagator import Propagator, Share, working_precision
from optics.propagation.span import FreeSpaceSpan

# Semi-axis sums of the Bernstein ellipses that are tried. Each of them gives a valid bound.
_RHO = 1 + np.geomspace(1e-3, 1e9, 300)


def gauss_nodes(turn: float, bend: float, depth: float, error: float, most: int) -> int:
    """Return how many nodes integrate a spherical wave over a cell; 0 for more than `most`.

    The wave is exp(i (h x + b x²)) over |x| < 1, with |h| <= turn and |b| <= bend in radians, times
    an amplitude. error: relative error of the integral. depth: distance of the wave's origin over
    half the cell's side; infinite if the amplitude is the same everywhere.

    The wave's amplitude has poles at ± i depth. The quadrature error of such a function with n
    nodes is about rho^(-2n), with rho = depth + sqrt(1 + depth²) (Trefethen 2008). The nodes for
    the amplitude are added to those for the phase. For these, the error of the mean with n nodes is
    at most 32 / 15 M rho^(-2n) / (1 - rho^(-2)), for a function that is no larger than M on the
    ellipse of foci ± 1 and semi-axis sum rho (Trefethen 2008, 10.1137/060659831). On the ellipse
    A cos t + i B sin t, the modulus of the wave is

        exp(-h B sin t - b A B sin 2t),

    which is largest where cos t = 4 b A / (h + sqrt(h² + 32 b² A²)), up to signs.
    """
    slow = math.log(1 / error) / (2 * math.asinh(depth))
    if slow > most:
        return 0
    # From a depth of 1000 on, the amplitude counts as constant over the cell: its second-order
    # part is 1e-6, and two nodes integrate that exactly.
    extra = math.ceil(slow) if depth < 1e3 else 0
    a, b = (_RHO + 1 / _RHO) / 2, (_RHO - 1 / _RHO) / 2
    root = np.hypot(turn, math.sqrt(32) * bend * a)
    cosine = 4 * bend * a / (turn + root + 1e-300)
    growth = b * np.sqrt(1 - cosine**2) * (turn + 2 * bend * a * cosine)
    wanted = growth + math.log(32 / 15 / error) - np.log1p(-(_RHO**-2.0))
    nodes = max(math.ceil(float((wanted / (2 * np.log(_RHO))).min())), 1) + extra
    return nodes if nodes <= most else 0


def upsample(field: torch.Tensor, factor: int, carrier: float) -> torch.Tensor:
    """Upsample a field by `factor` along its last axis, by padding its spectrum with zeros.

    The first of each group of `factor` samples coincides with one of the field's. carrier: turns
    from sample to sample, at the middle of the spectrum. The result is exact for a field that is
    dark at its ends; otherwise the field is continued periodically.
    """
    if factor == 1:
        return field
    n = field.shape[-1]
    spectrum = torch.fft.fft(field * _carrier_phasor(n, -carrier, field))
    order = torch.fft.fftshift(spectrum, dim=-1)
    # Where the field's lowest frequency stands in the padded spectrum.
    first = (n * factor) // 2 - n // 2
    padded = torch.nn.functional.pad(order, (first, n * factor - n - first))
    fine = torch.fft.ifft(torch.fft.ifftshift(padded, dim=-1)) * factor
    return fine * _carrier_phasor(n * factor, carrier / factor, field)


def upsample_adjoint(fine: torch.Tensor, factor: int, carrier: float) -> torch.Tensor:
    """Apply the conjugate transpose of `upsample` to a field on finer samples."""
    if factor == 1:
        return fine
    n = fine.shape[-1] // factor
    spectrum = torch.fft.fft(fine * _carrier_phasor(n * factor, -carrier / factor, fine))
    first = (n * factor) // 2 - n // 2
    order = torch.fft.fftshift(spectrum, dim=-1)[..., first : first + n]
    return torch.fft.ifft(torch.fft.ifftshift(order, dim=-1)) * _carrier_phasor(n, carrier, fine)


def _carrier_phasor(n: int, turns: float, like: torch.Tensor) -> torch.Tensor:
    index = torch.arange(n, dtype=torch.float64)
    return unit_phasor(turns * index, like.dtype).to(like.device)


# Most points along an axis in place of one sample: nodes of a cell, or finer samples of a smooth
# field. Chosen.
_MAX_POINTS = 1000

# Pairs of a source point and a target sample per tile, chosen so that they fit in the processor's
# caches, and source points per tile, unless a single row has more.
_TILE_PAIRS, _TILE_SOURCE_POINTS = 1 << 16, 1 << 11

# Memory in bytes per pair of a tile, and processor time of a pair, in passes over one complex
# number: one phase, computed in float64, and a square root. Single precision would hardly be
# faster.
_PAIR_BYTES, _PAIR_TOUCHES = 120, 140


def impulse_response(
    across: torch.Tensor,
    depth: torch.Tensor,
    distance: torch.Tensor,
    wavelength: torch.Tensor,
    *,
    paraxial: bool = False,
) -> torch.Tensor:
    """Return the impulse response of free space, without the factor exp(i k distance).

        h = depth / (2 pi r²) (1 / r - i k) exp(i k (r - distance)), r² = depth² + across²

    This is the kernel of the first Rayleigh-Sommerfeld integral (section 3.5 of Goodman). In the
    paraxial model it is exp(i k (across² / (2 depth) + depth - distance)) / (i wavelength depth)
    (thesis Eq. 2.12).

    across: square of the lateral distance between the points, m². depth: their distance along the
    axis, metres, positive. distance: distance of the target plane, whose phase is left out. All
    tensors are float64. Long distances are never subtracted from each other:
    r - distance = (across² + (depth - distance) (depth + distance)) / (r + distance).
    """
    beyond = depth - distance
    if paraxial:
        turns = across / (2 * wavelength * depth) + beyond / wavelength
        return unit_phasor(turns - 0.25, torch.complex128) / (wavelength * depth)
    square = across + depth**2
    r = torch.sqrt(square)
    way = (across + beyond * (depth + distance)) / (r + distance)
    strength = depth / square
    amplitude = torch.complex(strength / (2 * math.pi * r), -strength / wavelength)
    return amplitude * unit_phasor(way / wavelength, torch.complex128)


class DirectQuadrature(Propagator):
    """Sum the spherical waves of all source points at every target sample.

    The method is the reference for all others, of both models and onto tilted targets. A cell is
    summed over Gauss-Legendre nodes. A smooth field is summed over its samples. That is exact where
    no replica of its spectrum has a ray to the target, which requires carrier + band + the steepest
    ray's frequency to be below 1 / pitch by a margin (optics.propagation.paraxial). At shorter
    distances, the field is interpolated to finer samples by zero-padded FFTs. Memory is bounded:
    the kernel is computed in tiles, which aren't kept, and is computed again for derivatives.
    """

    name = "direct quadrature"

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        n = span.numeric
        self._near = span.nearest_target_distance()
        self._sign = math.copysign(1.0, n.distance)
        self._factors = self._factor(0), self._factor(1)
        self.dtype = torch.complex128
        share = 4 * Share.DIRECT
        # The kernel's phase between the two most distant points, in turns.
        y, x = (max(map(abs, n.lateral_range(axis))) for axis in (0, 1))
        deepest = max(abs(corner[2]) for corner in n.target_corners)
        turns = ((y**2 + x**2) / (2 * self._near) + deepest - abs(n.distance)) / n.wavelength
        self.arithmetic = working_precision(n.tol, turns, share, double=True)[1]
        self.error = ErrorEstimate(share * n.sampling_tol, "bound")
        rows, columns = self._points
        self.sampling = f"{columns}x{rows} source points"

    def _factor(self, axis: int) -> int:
        """Return how many points replace a source sample along an axis.

        They are nodes of a cell, or finer samples of a smooth field.
        """
        n, error = self.span.numeric, Share.DIRECT * self.span.sampling_tol
        most = _MAX_POINTS
        if n.cells is None:
            factor = oversampling_factor(n, axis, error, most)
        else:
            half = n.cells[axis] / 2
            turn = 2 * math.pi * half * max(map(abs, target_ray_frequencies(n, axis)))
            bend = math.pi * half**2 / (n.wavelength * self._near)
            depth = math.inf if n.paraxial else self._near / half
            factor = gauss_nodes(turn, bend, depth, error, most)
        if not factor:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept by {self.name}: {n.distance:g} m away more than "
                f"{most} points are needed for each sample in {'yx'[axis]}; sample finer, or "
                "give the field's band= if it is narrower"
            )
        return factor

    @property
    def _points(self) -> tuple[int, int]:
        (ny, nx), (fy, fx) = self.span.source.shape, self._factors
        return ny * fy, nx * fx

    @property
    def bytes(self) -> int:
        points, (my, mx) = math.prod(self._points), self.span.target.shape
        extra = 4 if self.span.cells is None else 2
        kept = self.dtype.itemsize * (extra * points + 2 * my * mx) + 16 * points
        return kept + _PAIR_BYTES * max(_TILE_PAIRS, self._points[1])

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        my, mx = self.span.target.shape
        pairs = math.prod(self._points) * my * mx
        return speed.call + pairs * _PAIR_TOUCHES * speed.touch

    def prepare(self) -> None:
        """Do nothing, because no kernel is kept between calls."""

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        points = field.to(self.dtype)
        for axis in (0, 1):
            lines = self._samples_to_points(axis, points.movedim(-2 + axis, -1))
            points = lines.movedim(-1, -2 + axis)
        sent = self._sum(points.reshape(-1, math.prod(self._points)).mT, adjoint=False)
        return sent.mT.reshape(*field.shape[:-2], *self.span.target.shape)

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        flat = field.to(self.dtype).reshape(-1, math.prod(self.span.target.shape)).mT
        points = self._sum(flat, adjoint=True).mT.reshape(*field.shape[:-2], *self._points)
        for axis in (0, 1):
            lines = self._points_to_samples(axis, points.movedim(-2 + axis, -1))
            points = lines.movedim(-1, -2 + axis)
        return points

    def _samples_to_points(self, axis: int, field: torch.Tensor) -> torch.Tensor:
        """Return the field on the quadrature points along an axis, times each point's length."""
        span, factor = self.span, self._factors[axis]
        pitch = span.source.pitch[axis]
        if span.cells is None:
            return upsample(field, factor, span.carrier[axis] * pitch) * (pitch / factor)
        return (field[..., None] * self._weights(axis, field.device)).flatten(-2)

    def _points_to_samples(self, axis: int, points: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of _samples_to_points()."""
        span, factor = self.span, self._factors[axis]
        pitch = span.source.pitch[axis]
        if span.cells is None:
            return upsample_adjoint(points, factor, span.carrier[axis] * pitch) * (pitch / factor)
        parts = points.reshape(*points.shape[:-1], -1, factor)
        return (parts * self._weights(axis, points.device)).sum(-1)

    def _weights(self, axis: int, device: torch.device) -> torch.Tensor:
        """Return the Gauss-Legendre weights of a cell along an axis, in metres."""
        assert self.span.cells is not None
        weights = gauss_legendre(self._factors[axis])[1] / 2
        return torch.from_numpy(weights * self.span.cells[axis]).to(device)

    def _point_coordinates(self, axis: int) -> torch.Tensor:
        """Return the quadrature points on the source along an axis, in metres."""
        source, factor = self.span.source, self._factors[axis]
        x = source.coordinates(axis)
        if self.span.cells is not None:
            nodes = torch.tensor(gauss_legendre(factor)[0])
            inside = nodes * self.span.cells[axis] / 2
        else:
            inside = torch.arange(factor, dtype=torch.float64) * (source.pitch[axis] / factor)
        return (x[:, None] + inside).flatten()

    def _target(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return y, x and depth of the target's samples as flat tensors, in metres."""
        target = self.span.target
        y = (target.coordinates(0) - target.centre[0])[:, None].expand(target.shape)
        x = (target.coordinates(1) - target.centre[1])[None, :].expand(target.shape)
        places = self.span.target_position(y, x)
        y, x, z = (torch.as_tensor(p, dtype=torch.float64).expand(target.shape) for p in places)
        return y.reshape(-1), x.reshape(-1), (z * self._sign).reshape(-1)

    def _sum(self, values: torch.Tensor, *, adjoint: bool) -> torch.Tensor:
        """Multiply fields by the matrix of the kernel h, or by its conjugate transpose.

        values: fields on a plane, (points, fields). Backward propagation is that of the conjugate.
        """
        values, device = values.conj() if self._sign < 0 else values, values.device
        target = [p.to(device) for p in self._target()]
        source_y, source_x = (self._point_coordinates(axis).to(device) for axis in (0, 1))
        lengths = [
            torch.as_tensor(length, dtype=torch.float64, device=device)
            for length in (self.span.distance, self.span.wavelength)
        ]
        lengths[0] = lengths[0] * self._sign
        lines = source_x.numel()
        (outer, inner), sums = _tiles(target[0].numel(), source_y.numel(), lines, adjoint), []
        for there in outer:
            total: torch.Tensor | None = None
            for here in inner:
                targets, rows = (here, there) if adjoint else (there, here)
                geometry = [*(p[targets] for p in target), source_y[rows], source_x, *lengths]
                used = targets if adjoint else slice(rows.start * lines, rows.stop * lines)
                tensors = (values[used], *geometry)
                if torch.is_grad_enabled() and any(t.requires_grad for t in tensors):
                    # Derivatives compute the tile again.
                    part = checkpoint(self._product, adjoint, *tensors, use_reentrant=False)
                else:
                    part = self._product(adjoint, *tensors)
                total = part if total is None else total + part
            assert total is not None
            sums.append(total)
        sent = torch.cat(sums)
        return sent.conj().resolve_conj() if self._sign < 0 else sent

    def _product(
        self, adjoint: bool, values: torch.Tensor, *geometry: torch.Tensor
    ) -> torch.Tensor:
        """Multiply a tile of the kernel by its values."""
        y, x, depth, source_y, source_x, distance, wavelength = geometry
        across = (y[:, None] - source_y)[:, :, None] ** 2 + (x[:, None] - source_x)[:, None, :] ** 2
        kernel = impulse_response(
            across.flatten(1), depth[:, None], distance, wavelength, paraxial=self.span.paraxial
        )
        return (kernel.mH if adjoint else kernel) @ values


def _tiles(targets: int, rows: int, lines: int, adjoint: bool) -> tuple[list[slice], list[slice]]:
    """Split the target's samples and the source's rows into tiles.

    The slices of the result's plane come first, then those of the plane that is summed over.
    """
    some = min(max(_TILE_SOURCE_POINTS // lines, 1), rows)
    many = max(_TILE_PAIRS // (some * lines), 1)
    parts = [
        [slice(first, min(first + step, count)) for first in range(0, count, step)]
        for count, step in ((targets, many), (rows, some))
    ]
    return (parts[1], parts[0]) if adjoint else (parts[0], parts[1])
