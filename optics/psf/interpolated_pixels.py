"""Compute the Fourier integral over panel pixels by FFTs, from whose grids weights lead on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy.fft
import torch
from numpy.typing import NDArray

from optics.accuracy import MachineSpeed
from optics.caching import ByteCache
from optics.fourier import FourierGeometry, unit_phasor
from optics.fourier.differentiation import apply_function, apply_linear_map
from optics.fourier.fitted_interpolation import (
    BandedMatrix,
    FittedInterpolation,
    interpolation_width,
)
from optics.fourier.spectrum_grid import FullSpectrum, MirroredSpectrum, SpectrumGrid
from optics.gauss_legendre import gauss_legendre
from optics.plane import Plane
from optics.psf.pixel_waves import PixelIntegralTransform, full_precision_nodes

# Errors, and the ratio of the FFT's length to the panel's pixels for that error and larger ones.
# For a panel of 1080 x 1920 pixels 1.35 was the fastest of 1.2 to 2 that adds no more rounding
# than a plain sum in single precision has.
_OVERSAMPLING = ((3e-6, 1.35), (2e-7, 1.5), (0.0, 2.0))

# Rounding error of an FFT over that of a plain sum. It was 0.09 where it was measured, for a
# panel of 1080 x 1920 pixels; twice as much is told.
_FFT_ROUNDING = 0.2

_FINEST_ERROR = 1e-8  # that the weights are asked for; below, rounding spoils their fit

# Time to fit the weights, for each sample and node, over that of a pass over a sample; measured
# for 16 to 1800 samples.
_FITTED_TERM_PASSES = 3000.0

# Radians by which the lens' wave may turn in half a panel pixel. Chosen: 0.75 are met by 2
# dioptres of defocus at the ends of 1920 pixels of 8 µm.
_MOST_BEND = 2.0

# Weights, for other PSFs of the same samples and wavelength. The bytes are chosen: for 40 PSFs of
# 1600 samples a side, as a panel's calibration needs over a band of wavelengths.
_KEPT = ByteCache(32 << 20)


class InterpolatedPixelTransform(PixelIntegralTransform):
    """Computes the Fourier integral over square panel pixels under a quadratic phase, by FFTs.

    The sum is that of CurvedPixelTransform. An FFT along each axis leads to a grid that is a little
    finer than the panel's Nyquist frequency, and a few weights from the grid to each sample. What a
    curved pixel adds to the transform of its centre is a smooth function of pixel and sample, which
    the weights take in, so that it costs nothing.

    If the field is mirrored, only a quarter of it is given, the pixels right of and below the
    middle of the panel's pixels (with those in the middle, for an odd number). The FFTs then are
    cosine transforms of half the length along either axis. Since the wave of the lens is symmetric
    about the axis and not about the middle of the pixels, half a pixel away, the mirrored field's
    image is shifted; the weights lead to the samples of the unshifted one.

    geometry: the panel's pixel centres, on a regular plane, and the samples.
    curvature: of the quadratic phase about the axis, radians per square metre.
    side: of a pixel's active square, metres.
    error: relative L2 error of the field that is allowed.
    mirrored: whether a quarter of a mirrored field is given.
    """

    name = "interpolated FFT with curved pixels"

    def __init__(
        self,
        geometry: FourierGeometry,
        dtype: torch.dtype,
        curvature: float,
        side: float,
        error: float,
        *,
        mirrored: bool = False,
    ) -> None:
        super().__init__(geometry, dtype)
        self.error, self.mirrored = error, mirrored
        if mirrored:
            self.name = "cosine transform with curved pixels"
        self._oversampling = next(ratio for least, ratio in _OVERSAMPLING if error >= least)
        about = curvature, side, self._oversampling, mirrored
        self._axes = _Axis(geometry, 0, *about), _Axis(geometry, 1, *about)

    @property
    def _width(self) -> int:
        """The number of weights for each sample, about."""
        return interpolation_width(1 / self._oversampling, self.error)

    @property
    def fits(self) -> bool:
        """Whether weights keep the error for all samples, and the wave bends little in a pixel."""
        if self.error < _FINEST_ERROR:
            return False
        return all(one.reaches(self._width) for one in self._axes)

    @property
    def field_shape(self) -> tuple[int, int]:
        """The shape of the field that is given, (rows, columns)."""
        y, x = self._axes
        return y.given_count, x.given_count

    def _require_samples(self, field: torch.Tensor) -> None:
        if field.shape[-2:] != self.field_shape:
            raise ValueError(f"field is {tuple(field.shape)}; it has {self.field_shape} samples")

    @cached_property
    def _parts(self) -> tuple[_AxisParts, _AxisParts]:
        each = self.error / math.sqrt(2)
        y, x = self._axes[0].parts(each, self.dtype), self._axes[1].parts(each, self.dtype)
        self.error = max(self.error, math.hypot(y.error, x.error))
        self.rounding_growth = max(1.0, _FFT_ROUNDING * y.rounding_growth * x.rounding_growth)
        return y, x

    def _forward(self, field: torch.Tensor) -> torch.Tensor:
        return _for_each(lambda one: self._field_from_grid(self._grid(one)), field)

    def _grid(self, field: torch.Tensor) -> torch.Tensor:
        """Transform one pattern to the points of the FFTs' grids that are needed."""
        y, x = self._parts
        field = (field * x.wave.to(field.device)).mul_(y.wave.to(field.device)[:, None])
        return x.spectrum.forward(y.spectrum.forward(field, 0), 1)

    def _columns_from_grid(self, grid: torch.Tensor) -> torch.Tensor:
        """Transform the FFTs' grid to samples along x, and to points along y."""
        y, x = self._parts
        columns = x.matrix.forward(x.spectrum.unfold(grid.mT.contiguous()))
        return y.spectrum.unfold(columns.mT.contiguous())

    def _adjoint(self, field: torch.Tensor) -> torch.Tensor:
        return _for_each(lambda one: self._grid_adjoint(self._adjoint_to_grid(one)), field)

    def _adjoint_of_columns(self, columns: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose of `_columns_from_grid`, back to the FFTs' grid."""
        y, x = self._parts
        folded = x.spectrum.fold(x.matrix.adjoint(y.spectrum.fold(columns).mT.contiguous()))
        return folded.mT.contiguous()

    def _grid_adjoint(self, grid: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose of `_grid`, back to the panel."""
        y, x = self._parts
        pixels = y.spectrum.adjoint(x.spectrum.adjoint(grid, 1), 0)
        waves = (one.wave.conj().to(pixels.device) for one in (y, x))
        return pixels.mul_(next(waves)[:, None]).mul_(next(waves))

    def intensity(self, field: torch.Tensor, scale: float) -> torch.Tensor:
        """Compute ``|F|²`` times a scale, without keeping the field F on the samples.

        The result is real, (..., rows, columns) of the image, differentiable in the field.
        Derivatives compute F again from the FFTs' grid, which takes less memory and little time.

        field: complex, (..., *field_shape).
        """
        self._require_samples(field)
        return _for_each(
            lambda one: apply_function(_Intensity, self, one.to(self.dtype), scale)[0], field
        )

    def _field_from_grid(self, grid: torch.Tensor) -> torch.Tensor:
        return self._parts[0].matrix.forward(self._columns_from_grid(grid))

    def _adjoint_to_grid(self, field: torch.Tensor) -> torch.Tensor:
        return self._adjoint_of_columns(self._parts[0].matrix.adjoint(field))

    def forward_axis(self, field: torch.Tensor, axis: int) -> torch.Tensor:
        """Apply the transform along axis 0 (y) or 1 (x) of a field only."""
        part, lines = self._parts[axis], field.to(self.dtype)
        lines = lines if axis == 0 else lines.mT
        lines = part.spectrum.forward(lines * part.wave[:, None], 0)
        found = part.matrix.forward(part.spectrum.unfold(lines.contiguous()))
        return found if axis == 0 else found.mT

    def mean_squared_kernel(self, axis: int) -> torch.Tensor:
        one = self._axes[axis]
        return _KEPT.get((one, "mean"), one.mean_squared_factor)

    def positions(self) -> tuple[torch.Tensor, torch.Tensor]:
        y, x = super().positions()
        rows, columns = self.field_shape
        return y[-rows:], x[:, -columns:]

    @property
    def bytes(self) -> int:
        y, x = self._axes
        field = y.given_count * x.given_count
        grids = y.kept_count * (x.given_count + x.length), x.kept_count * len(y.samples)
        image = len(y.samples) * len(x.samples)
        return self.dtype.itemsize * int(field + max(y.length * x.given_count, *grids) + 2 * image)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        y, x = self._axes
        width = self._width
        operations = (
            x.given_count * y.spectrum().operations + y.kept_count * x.spectrum().operations
        )
        rows, columns = len(y.samples), len(x.samples)
        products = 4 * columns * (y.kept_count * x.span(width) + rows * y.span(width))
        passes = 6 * y.given_count * x.given_count + 8 * (y.kept_count * columns + rows * columns)
        seconds = operations * speed.fft + products * speed.multiply_add + passes * speed.touch
        return speed.call + seconds * speed.slowdown(self.dtype) + self.allocation_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of fitting the weights."""
        terms = sum(len(one.samples) for one in self._axes) * (self._width + 12)
        return 5 * speed.call + terms * _FITTED_TERM_PASSES * speed.touch


def _for_each(
    function: Callable[[torch.Tensor], torch.Tensor], field: torch.Tensor
) -> torch.Tensor:
    """Apply a function to each field of a batch, (..., rows, columns)."""
    if field.ndim == 2:
        return function(field)
    found = [function(one) for one in field.flatten(0, -3)]
    if not found:
        # An empty batch keeps its derivatives.
        shape = function(field.new_zeros(field.shape[-2:])).shape
        return field.sum((-2, -1))[..., None, None].real.expand(*field.shape[:-2], *shape)
    return torch.stack(found).reshape(*field.shape[:-2], *found[0].shape)


class _Intensity(torch.autograd.Function):
    """The autograd function of the intensity, which keeps the FFTs' grid alone.

    The grid is a second result, so that derivatives of the first derivative reach the field.
    """

    @staticmethod
    def forward(
        ctx: Any, transform: InterpolatedPixelTransform, field: torch.Tensor, scale: float
    ) -> tuple[torch.Tensor, torch.Tensor]:
        grid = transform._grid(field)
        ctx.transform, ctx.scale = transform, scale
        ctx.save_for_backward(grid)
        ctx.set_materialize_grads(False)
        columns, matrix = transform._columns_from_grid(grid), transform._parts[0].matrix
        shape, kind = (matrix.shape[0], columns.shape[1]), transform.dtype.to_real()
        light = torch.empty(shape, dtype=kind, device=columns.device)
        for rows, points, block in matrix.blocks(columns.device):
            parts = torch.view_as_real(block @ columns[points])
            torch.mul(parts[..., 0], parts[..., 0], out=light[rows])
            light[rows].addcmul_(parts[..., 1], parts[..., 1]).mul_(scale)
        return light, grid

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor | None, by_grid: torch.Tensor | None) -> Any:
        (grid,) = ctx.saved_tensors
        transform: InterpolatedPixelTransform = ctx.transform
        if gradient is not None:
            # The loss' derivative in the FFTs' grid.
            if torch.is_grad_enabled():
                to_field, to_grid = transform._field_from_grid, transform._adjoint_to_grid
                field = apply_linear_map(to_field, to_grid, grid)
                found = apply_linear_map(to_grid, to_field, 2 * ctx.scale * gradient * field)
            else:
                columns = transform._columns_from_grid(grid)
                change = torch.zeros_like(columns)
                for rows, points, block in transform._parts[0].matrix.blocks(columns.device):
                    field = torch.view_as_real(block @ columns[points])
                    field.mul_((2 * ctx.scale * gradient[rows])[..., None])
                    change[points].addmm_(block.mH, torch.view_as_complex(field))
                found = transform._adjoint_of_columns(change)
            by_grid = found if by_grid is None else by_grid + found
        if by_grid is None:
            return None, None, None
        return None, apply_linear_map(transform._grid_adjoint, transform._grid, by_grid), None


@dataclass(frozen=True, eq=False)
class _AxisParts:
    """Holds what leads from the panel's pixels to the samples along one axis.

    wave: the lens' wave at the pixels, scaled for the weights, complex, (given pixels,).
    error, rounding_growth: of the weights (see `FittedInterpolation`).
    """

    wave: torch.Tensor
    spectrum: SpectrumGrid
    matrix: BandedMatrix
    error: float
    rounding_growth: float

    @property
    def bytes(self) -> int:
        """The memory in bytes, about."""
        return self.wave.nbytes + self.matrix.bytes


@dataclass(frozen=True)
class _Axis:
    """Plans the Fourier sum over panel pixels along one axis.

    In the frame of the pixels' middle, at x_m, the wave exp(i c (x_m + t)²) of a pixel at t has the
    tilt 2 c x_m, which shifts the image by x_m c scale / pi. Axis 0 is y, and 1 is x.
    """

    geometry: FourierGeometry
    axis: int
    curvature: float
    side: float
    oversampling: float
    mirrored: bool

    @property
    def _count(self) -> int:
        return self.geometry.pupil.shape[self.axis]

    @property
    def _pitch(self) -> float:
        pupil = self.geometry.pupil
        assert isinstance(pupil, Plane)
        return pupil.pitch[self.axis]

    @cached_property
    def _middle(self) -> float:
        return float(self.geometry.pupil.coordinates(self.axis).mean())

    @cached_property
    def samples(self) -> NDArray[np.float64]:
        """The positions of the samples in the frame of the pixels' middle, metres."""
        u: NDArray[np.float64] = self.geometry.image.coordinates(self.axis).numpy()
        return u - self._middle * self.curvature * self.geometry.scale / math.pi

    @property
    def given_count(self) -> int:
        """The number of the panel's pixels along the axis that are given."""
        return (self._count + 1) // 2 if self.mirrored else self._count

    @cached_property
    def length(self) -> int:
        """The length of the FFT along the axis."""
        least = math.ceil(self.oversampling * self._count) + 1
        if self.mirrored:
            return 2 * scipy.fft.next_fast_len(-(-least // 2))
        return int(scipy.fft.next_fast_len(least))

    @property
    def _frequencies(self) -> NDArray[np.float64]:
        """The samples' frequencies in cycles per panel pixel."""
        return self.samples * (self._pitch / self.geometry.scale)

    def span(self, width: int) -> float:
        """Return over how many grid points the weights of a block of samples reach."""
        step = float(self.samples[1] - self.samples[0]) if len(self.samples) > 1 else 0.0
        return width + 16 * self._pitch * abs(step) * self.length / self.geometry.scale

    def _farthest(self) -> float:
        return float(np.abs(self._frequencies).max()) * self.length

    def reaches(self, width: int) -> bool:
        """Tell whether few weights reach all samples, and the wave bends little in a pixel."""
        edge = self._count / 2 * self._pitch
        bend = abs(self.curvature) * edge * self.side
        in_grid = not self.mirrored or self._farthest() + width / 2 + 2 < self.length // 2
        return in_grid and bend < _MOST_BEND

    @property
    def kept_count(self) -> int:
        """The number of grid points of the spectrum along the axis that are kept, about."""
        if self.mirrored:
            return min(math.ceil(self._farthest()) + 8, self.length // 2)
        reach = float(np.ptp(self._frequencies)) * self.length
        return min(math.ceil(reach) + 16, self.length)

    def spectrum(self, grid: range = range(1)) -> SpectrumGrid:
        """Return the spectrum on points of the FFT's grid."""
        kind = MirroredSpectrum if self.mirrored else FullSpectrum
        return kind(self._count, self.length, grid)

    def parts(self, error: float, dtype: torch.dtype) -> _AxisParts:
        """Return the wave, the spectrum's grid and the weights along the axis, maybe kept ones."""
        return _KEPT.get((self, error, dtype), partial(self._fit_parts, error, dtype))

    def _fit_parts(self, error: float, dtype: torch.dtype) -> _AxisParts:
        frequencies, middle = self._frequencies, self._middle
        fit = FittedInterpolation(self._count, self.length, frequencies, error, self._pixel_factor)
        # The image of a panel whose pixels' middle is off the axis has another phase.
        u = self.geometry.image.coordinates(self.axis).numpy()
        turns = self.curvature * middle**2 / (2 * math.pi) - u * (middle / self.geometry.scale)
        phases = unit_phasor(torch.from_numpy(turns), torch.complex128).numpy()
        make = fit.matrix_of_mirrored_input if self.mirrored else fit.matrix
        t = (torch.arange(self._count, dtype=torch.float64) - (self._count - 1) / 2) * self._pitch
        bent = unit_phasor(self.curvature / (2 * math.pi) * t**2, torch.complex128)
        wave = (bent * torch.from_numpy(fit.scaling)).to(dtype)[-self.given_count :]
        matrix, spectrum = make(dtype, phases), self.spectrum(fit.grid)
        return _AxisParts(wave, spectrum, matrix, fit.error, fit.rounding_growth)

    def _pixel_factor(self, places: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return what the area of a panel pixel makes of the wave at its centre, (samples, places).

        It is the mean over |d| < side / 2 of exp(i c (2 t d + d²) - 2 pi i u d / scale) for a pixel
        at t.

        places: t in half widths of the panel.
        """
        t, half = places * (self._count / 2 * self._pitch), self.side / 2
        bend = abs(self.curvature) * (2 * float(np.abs(t).max()) * half + half**2)
        tilt = 2 * math.pi * float(np.abs(self.samples).max()) * half / self.geometry.scale
        nodes, weights = gauss_legendre(full_precision_nodes(bend + tilt))
        d = nodes * half
        bent = np.exp(1j * self.curvature * (2 * np.outer(d, t) + d[:, None] ** 2))
        tilted = np.exp(-2j * math.pi / self.geometry.scale * np.outer(self.samples, d))
        return np.asarray((tilted * (weights / 2)) @ bent)

    def mean_squared_factor(self) -> torch.Tensor:
        """Return the mean over the panel's pixels of what a sample gets of each, float64."""
        nodes, weights = gauss_legendre(16)
        factor = self._pixel_factor(nodes)
        return torch.from_numpy((factor.real**2 + factor.imag**2) @ (weights / 2))
