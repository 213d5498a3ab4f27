"""Interpolate a spectrum on an FFT's grid to samples of any pitch, by weights that are fitted.

The weights are applied as a matrix that is zero but for a band.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from optics.gauss_legendre import gauss_legendre

# Rows that are multiplied at a time; of 8, 16 and 32 the fastest for 901 rows of 8 entries.
_BLOCK = 16

_SPARE_NODES = 24  # quadrature nodes beyond two for each weight. Chosen: a smooth factor needs few.

# Eigenvalues of the weights' normal equations below this share of the largest one are rounding.
_LEAST_EIGENVALUE = 1e-15

# Largest ratio of the errors with one more weight and without it; above it, rounding rules.
_LEAST_GAIN = 0.9

SmoothFactor = Callable[[NDArray[np.float64]], NDArray[np.complex128]]
"""Returns a smooth factor at places -1 to 1 across the input, (samples, places)."""


class FittedInterpolation:
    """Interpolates a spectrum along one axis, from an FFT's grid to samples at any frequency.

    The input has `count` samples at the places t = -(count - 1) / 2 to (count - 1) / 2. For a
    sample at the frequency q / length, the result is

        sum over t of f(t) g(t) exp(-2 pi i q t / length),

    with a smooth factor g that may differ from sample to sample. If the input is first multiplied
    by `scaling`, the inverse of a Kaiser-Bessel kernel's spectrum, a few grid points around q
    suffice. Their weights are fitted by least squares, so that their scaled exponentials make up
    that of the sample times g over all t (J. A. Fessler and B. P. Sutton, IEEE Trans. Signal
    Process. 51, 560, 2003, doi 10.1109/TSP.2002.807005, sections II and III).

    count: number of input samples.
    length: of the FFT, more than `count`; it gives the spectrum at v / length for whole v.
    frequencies: of the samples, (samples,), cycles per input sample, ascending.
    tol: relative L2 error that is allowed, in the mean over t.
    factor: returns g at places t / (count / 2), complex, (samples, places). One by default.

    What it finds:

    grid: the grid points v that are used; they may be negative.
    scaling: factors on the input, (count,).
    rounding_growth: factor by which rounding errors of the spectrum grow, relative to even input.
    error: what the weights miss of a sample's exponential, whose modulus is 1: the root mean square
        over t, of the worst sample.
    """

    def __init__(
        self,
        count: int,
        length: int,
        frequencies: NDArray[np.float64],
        tol: float,
        factor: SmoothFactor | None = None,
    ) -> None:
        self._count, self._length = count, length
        self._places, self._factor = frequencies * length, factor
        width = max(2, interpolation_width(count / length, tol) - 2)
        self._fit(width)
        while self.error > tol and width < count:
            before, width = self.error, width + 1
            self._fit(width)
            if self.error > _LEAST_GAIN * before:
                break
        self.grid = range(int(self._bases.min()), int(self._bases.max()) + width)
        places = (np.arange(count, dtype=np.float64) - (count - 1) / 2) / (count / 2)
        self.scaling = self._scaling_at(places, width)
        gain = np.sqrt((np.abs(self._weights) ** 2).sum(1).max(initial=0.0))
        self.rounding_growth = float(gain * np.sqrt((self.scaling**2).mean()))

    def _scaling_at(self, places: NDArray[np.float64], width: int) -> NDArray[np.float64]:
        """Return the factors on the input at places t / (count / 2)."""
        beta = math.pi * width * (1 - 0.5 * self._count / self._length)
        turn = math.pi * width / 2 * places * (self._count / self._length)
        root = np.sqrt(beta**2 - turn**2)
        # The largest one, at the ends, is 1.
        spectrum = np.sinh(root) / root
        end = math.sqrt(beta**2 - (math.pi * width / 2 * self._count / self._length) ** 2)
        scaling: NDArray[np.float64] = math.sinh(end) / end / spectrum
        return scaling

    def _fit(self, width: int) -> None:
        """Fit `width` weights for every sample, and measure what they miss."""
        # The grid points lie evenly around each sample.
        self._bases = np.ceil(self._places - width / 2).astype(np.int64)
        wanted, waves, mean = self._exponentials(width, 2 * width + _SPARE_NODES)
        weighted = waves.conj() * mean[:, None]
        inverse = np.linalg.pinv(weighted.T @ waves, rcond=_LEAST_EIGENVALUE, hermitian=True)
        self._weights = wanted @ weighted @ inverse.T
        # Other nodes than those of the fit judge it.
        wanted, waves, mean = self._exponentials(width, 2 * width + _SPARE_NODES + 7)
        missed = wanted - self._weights @ waves.T
        squares = (missed.real**2 + missed.imag**2) @ mean
        self.error = math.sqrt(float(squares.max(initial=0.0)))

    def _exponentials(
        self, width: int, count: int
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]:
        """Return what the weights shall make up, of what, and the weights of a mean over t.

        The first is (samples, places), the second holds the scaled exponentials of a sample's grid
        points, (places, width); both are relative to that of the first grid point.
        """
        places, weights = gauss_legendre(count)
        turns = places * (self._count / self._length / 2)
        wanted = np.exp(-2j * math.pi * np.outer(self._places - self._bases, turns))
        if self._factor is not None:
            wanted = wanted * self._factor(places)
        waves = np.exp(-2j * math.pi * np.outer(turns, np.arange(width)))
        return wanted, waves * self._scaling_at(places, width)[:, None], weights / 2

    def matrix(
        self, dtype: torch.dtype, phases: NDArray[np.complex128] | None = None
    ) -> BandedMatrix:
        """Return the matrix from the spectrum on `grid` to the samples, (samples, grid points).

        The spectrum's phases count from the first sample of the input, as an FFT's do.
        phases: by which the samples are multiplied afterwards, (samples,).
        """
        grid = self._bases[:, None] + np.arange(self._weights.shape[1])
        turns = np.mod(grid * ((self._count - 1) / (2 * self._length)), 1)
        weights = self._weights * np.exp(2j * math.pi * turns)
        entries = weights if phases is None else weights * phases[:, None]
        first = torch.from_numpy(self._bases - self.grid.start)
        return BandedMatrix(torch.from_numpy(entries).to(dtype), first, len(self.grid))

    def matrix_of_mirrored_input(
        self, dtype: torch.dtype, phases: NDArray[np.complex128] | None = None
    ) -> BandedMatrix:
        """Return the matrix from the spectrum of mirrored input to the samples, as `matrix` does.

        The spectrum is even, and known at the grid points from zero on. Its phases count from the
        middle of the input.
        """
        weights = self._weights if phases is None else self._weights * phases[:, None]
        entries = torch.from_numpy(weights).to(dtype)
        kept = max(-self.grid.start, self.grid.stop - 1, 0) + 1
        return BandedMatrix(entries, torch.from_numpy(self._bases), kept, mirrored=True)


def interpolation_width(share: float, tol: float) -> int:
    """Return how many grid points a Kaiser-Bessel kernel needs for a relative error.

    The error of a kernel of width w is about exp(-pi w sqrt(1 - share)) (Barnett, Magland and af
    Klinteberg 2019, 10.1137/18M120885X); one more point is a margin. Fitted weights need a few
    less.
    share: input samples over the FFT's length, below 1.
    """
    return math.ceil(-math.log(tol) / (math.pi * math.sqrt(1 - share))) + 1


class BandedMatrix:
    """Multiplies lines of samples by a matrix with a few entries in each row, side by side.

    Some rows at a time are multiplied by a small dense matrix.

    entries: those that may differ from zero, (rows, width).
    first: column of the first entry of each row, (rows,), int64, ascending. Entries outside the
        matrix must be zero, or belong to a mirrored one.
    columns: of the matrix.
    mirrored: whether an entry of a negative column stands in the column of the opposite number, as
        the lines that are multiplied are even.
    """

    STEPS_PER_ROW = 2.0
    """Time to make the dense blocks, for each row, over that of a step of Python; measured."""

    def __init__(
        self, entries: torch.Tensor, first: torch.Tensor, columns: int, *, mirrored: bool = False
    ) -> None:
        self.shape = (entries.shape[0], columns)
        self._entries, self._first, self._mirrored = entries, first, mirrored
        self._blocks: list[tuple[slice, slice, torch.Tensor]] | None = None

    @property
    def bytes(self) -> int:
        """Bytes of the entries and of the dense blocks, about."""
        rows, width = self._entries.shape
        span = width + _BLOCK * self.shape[1] / max(rows, 1)
        return int(self._entries.element_size() * rows * (width + span))

    def blocks(self, device: torch.device) -> list[tuple[slice, slice, torch.Tensor]]:
        """Return the dense blocks on a device: rows, columns and entries."""
        blocks = self._blocks
        if blocks is None or blocks[0][2].device != device:
            entries, first = self._entries.cpu().numpy(), self._first.cpu().numpy()
            starts = range(0, self.shape[0], _BLOCK)
            # Another thread may make those of another device at the same time.
            blocks = self._blocks = [
                self._block(start, entries[start:][:_BLOCK], first[start:][:_BLOCK], device)
                for start in starts
            ]
        return blocks

    def _block(
        self, start: int, entries: NDArray[Any], first: NDArray[np.int64], device: torch.device
    ) -> tuple[slice, slice, torch.Tensor]:
        """Return the dense block of the rows from `start` on, whose entries are given."""
        columns = first[:, None] + np.arange(entries.shape[1])
        if self._mirrored:
            columns = np.abs(columns)
        inside = (columns >= 0) & (columns < self.shape[1])
        found = columns[inside]
        begin, end = (int(found.min()), int(found.max()) + 1) if found.size else (0, 0)
        dense = np.zeros((len(entries), end - begin), entries.dtype)
        row = np.broadcast_to(np.arange(len(entries))[:, None], columns.shape)[inside]
        if self._mirrored:
            np.add.at(dense, (row, found - begin), entries[inside])
        else:
            dense[row, found - begin] = entries[inside]
        rows = slice(start, start + len(entries))
        return rows, slice(begin, end), torch.from_numpy(dense).to(device)

    def forward(self, lines: torch.Tensor) -> torch.Tensor:
        """Multiply by the matrix, from (columns, lines) to (rows, lines)."""
        product = lines.new_empty(self.shape[0], lines.shape[1])
        for rows, columns, block in self.blocks(lines.device):
            torch.mm(block, lines[columns], out=product[rows])
        return product

    def adjoint(self, lines: torch.Tensor) -> torch.Tensor:
        """Multiply by the conjugate transpose, from (rows, lines) to (columns, lines)."""
        product = lines.new_zeros(self.shape[1], lines.shape[1])
        for rows, columns, block in self.blocks(lines.device):
            product[columns].addmm_(block.mH, lines[rows])
        return product
