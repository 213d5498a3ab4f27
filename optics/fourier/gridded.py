"""The gridded FFT, between planes of any pitch and to a stated error."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy.fft
import scipy.sparse
import torch
from numpy.typing import NDArray

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft, fft_operations
from optics.fourier.fitted_interpolation import interpolation_width
from optics.fourier.separable import AxisRule, SeparableTransform
from optics.fourier.transform import FourierGeometry

_FINER = 2.0  # oversampling: points of the grid onto which the input is spread, per image sample

FINEST_GRIDDING = 1e-13
"""The smallest relative error that gridding reaches in double precision."""


# Time to make a rule along one axis, in calls and in Bessel functions for each grid point that a
# sample is spread to; measured.
_RULE_CALLS, _KERNELS_PER_TAP = 1.5, 2.0


class _GriddedRule(AxisRule):
    """Spreads samples onto a finer grid and divides its FFT by the kernel's spectrum, on one axis.

    The kernel is a Kaiser-Bessel function (Jackson et al. 1991). `position` is the phase in turns
    that each sample adds from one image sample to the next.
    """

    def __init__(
        self, position: NDArray[np.float64], m: int, error: float, dtype: torch.dtype
    ) -> None:
        n = position.size
        self._length = grid_length(m)
        width = interpolation_width(1 / _FINER, error)
        half, beta = width / 2, math.pi * width * (1 - 0.5 / _FINER)
        place = (position - np.round(position)) * self._length
        taps = np.ceil(place - half)[:, None] + np.arange(width)
        away = (taps - place[:, None]) / half
        weights = np.i0(beta * np.sqrt(np.clip(1 - away**2, 0, None)))
        real = np.float32 if dtype == torch.complex64 else np.float64
        index = (taps.ravel() % self._length).astype(np.int64)
        source = np.repeat(np.arange(n), width)
        values: Any = weights.ravel().astype(real)
        self._spread: Any = scipy.sparse.csr_array(
            (values, (index, source)), shape=(self._length, n)
        )
        self._gather: Any = scipy.sparse.csr_array(self._spread.T)
        k = np.arange(m) - m // 2
        root = np.sqrt(beta**2 - (2 * math.pi * half * k / self._length) ** 2)
        spectrum = 2 * half * np.sinh(root) / root
        self._output_index = torch.from_numpy(k % self._length)
        self._deapodisation = torch.from_numpy((1 / spectrum).astype(real))[:, None]
        self._on_device: dict[bool, torch.Tensor] = {}

    def to(self, device: torch.device) -> None:
        if self._deapodisation.device != device:
            self._deapodisation = self._deapodisation.to(device)
            self._output_index, self._on_device = self._output_index.to(device), {}

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        spectrum = fft(self._apply_matrix(field, spread=True), self._length, -2)
        return spectrum.index_select(-2, self._output_index) * self._deapodisation

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        grid = field.new_zeros((*field.shape[:-2], self._length, field.shape[-1]))
        grid.index_copy_(-2, self._output_index, field * (self._deapodisation * self._length))
        return self._apply_matrix(fft(grid, self._length, -2, inverse=True), spread=False)

    def _apply_matrix(self, field: torch.Tensor, *, spread: bool) -> torch.Tensor:
        """Spread along the second last axis of each picture, or gather from the grid."""
        lines = torch.view_as_real(field.resolve_conj().contiguous()).flatten(-2)
        pictures = lines.reshape(-1, *lines.shape[-2:])
        parts = [self._product(picture, spread) for picture in pictures]
        # Stacking copies, and a copy of a large picture takes as long as its transform.
        done = parts[0] if len(parts) == 1 else torch.stack(parts)
        return torch.view_as_complex(done.reshape(*field.shape[:-2], -1, field.shape[-1], 2))

    def _product(self, lines: torch.Tensor, spread: bool) -> torch.Tensor:
        matrix = self._spread if spread else self._gather
        if lines.device.type == "cpu":
            product: NDArray[Any] = matrix @ lines.numpy()
            return torch.from_numpy(product)
        if spread not in self._on_device:
            coo = matrix.tocoo()
            index = torch.from_numpy(np.stack(coo.coords).astype(np.int64))
            values = torch.from_numpy(coo.data)
            sparse = torch.sparse_coo_tensor(index, values, coo.shape, check_invariants=False)
            self._on_device[spread] = sparse.coalesce().to(lines.device)
        return torch.sparse.mm(self._on_device[spread], lines)


def grid_length(m: int) -> int:
    """Return the FFT's length for `m` image samples."""
    return scipy.fft.next_fast_len(math.ceil(_FINER * m) + 2)


class GriddedTransform(SeparableTransform):
    """Spreads samples onto a finer grid, for any pitch and window, to a stated error.

    The FFTs are about twice as long as the image. Each axis is a non-uniform FFT. The samples
    stand in rows and columns, so that one sparse matrix per axis spreads them.

    Parameters
    ----------
    geometry : FourierGeometry
        The two planes; the pupil's rows and columns may be unevenly spaced.
    dtype : torch.dtype
        complex64 or complex128.
    error : float, optional
        L2 error relative to the light that the whole image plane receives, 1e-13 to 1.

    Raises
    ------
    ValueError
        For an error outside that range.

    References
    ----------
    A. Dutt and V. Rokhlin, 1993; A. H. Barnett, J. Magland and L. af Klinteberg, 2019, doi
    10.1137/18M120885X.
    """

    name = "gridded FFT"
    bytes = 0

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype, error: float = 1e-7) -> None:
        super().__init__(geometry, dtype)
        if not FINEST_GRIDDING <= error < 1:
            raise ValueError(f"error is {error:g}; gridding reaches {FINEST_GRIDDING:g} to 1")
        self.error = error
        self._width = interpolation_width(1 / _FINER, error)
        (ny, nx), (my, mx), (columns, rows) = (
            geometry.pupil.shape,
            geometry.image.shape,
            self._lines,
        )
        self._grids = grid_length(my), grid_length(mx)
        largest = max(self._grids[0] * columns, self._grids[1] * rows)
        self.bytes = dtype.itemsize * (2 * largest + 2 * self._width * (ny + nx))

    def build_axis_rule(self, axis: int) -> AxisRule:
        """Build the rule of spreading and dividing along axis 0 (y) or 1 (x)."""
        g = self.geometry
        turns = g.pupil_offsets(axis).numpy() * (g.image.pitch[axis] / g.scale)
        return _GriddedRule(turns, g.image.shape[axis], self.error, self.dtype)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the seconds of making the kernels, at the first call."""
        taps = self._width * sum(self.geometry.pupil.shape)
        return 2 * _RULE_CALLS * speed.call + _KERNELS_PER_TAP * taps * speed.bessel

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of one call at a machine's speed."""
        (ny, nx), (down, along), (columns, rows) = (
            self.geometry.pupil.shape,
            self._grids,
            self._lines,
        )
        spread = self._width * (ny * columns + nx * rows)
        operations = columns * fft_operations(down) + rows * fft_operations(along)
        touched = down * columns + along * rows
        seconds = spread * speed.gridding + operations * speed.fft + 2 * touched * speed.touch
        return speed.call + seconds * speed.slowdown(self.dtype) + self.allocation_seconds(speed)
