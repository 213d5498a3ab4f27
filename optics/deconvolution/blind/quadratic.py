"""The kernel that takes known gradients to measured ones: a quadratic problem with bounds."""

from __future__ import annotations

from dataclasses import dataclass

import scipy.fft
import torch

from optics.fourier import irfft2, rfft2

_ENOUGH = 1e-6
"""Of a kernel's sum: a change below which it is found."""


@dataclass(frozen=True, eq=False)
class Quadratic:
    """k^T normal k / 2 - pull^T k, of a kernel's pixels in rows; over the noise's variance it is
    the logarithm of their likelihood.

    normal: (pixels, pixels), symmetric and never negative. pull: (rows, columns).
    """

    normal: torch.Tensor
    pull: torch.Tensor

    def value(self, kernel: torch.Tensor) -> float:
        flat = kernel.ravel()
        return float(0.5 * flat @ (self.normal @ flat) - self.pull.ravel() @ flat)

    def ridged(self, weight: float) -> Quadratic:
        """With weight * |k|² / 2 added."""
        eye = torch.eye(self.normal.shape[0], dtype=self.normal.dtype)
        return Quadratic(self.normal + weight * eye, self.pull)


def fast_period(rows: int, columns: int) -> tuple[int, int]:
    """No smaller, fast for an FFT, with an even number of columns."""
    half = scipy.fft.next_fast_len((columns + 1) // 2, real=True)
    return scipy.fft.next_fast_len(rows, real=True), 2 * half


def padded_spectrum(picture: torch.Tensor, period: tuple[int, int]) -> torch.Tensor:
    """Of a picture, (..., rows, columns), in the corner of a larger period."""
    rows, columns = picture.shape[-2:]
    margins = (0, period[1] - columns, 0, period[0] - rows)
    return rfft2(torch.nn.functional.pad(picture, margins))


def quadratic_of(known: torch.Tensor, measured: torch.Tensor, shape: tuple[int, int]) -> Quadratic:
    """Of |known * k - measured|² / 2, on a period that light doesn't pass the end of.

    known, measured: (channels, ...) spectra as of rfft2, of one period. shape: (rows, columns) of
    the kernel, whose first pixel belongs to a lag of 0.
    """
    period = (int(known.shape[-2]), 2 * (int(known.shape[-1]) - 1))
    power = (known.real.square() + known.imag.square()).sum(0)
    own = irfft2(power.to(known.dtype), period)
    pull = irfft2((known.conj() * measured).sum(0), period)[: shape[0], : shape[1]]
    return Quadratic(_toeplitz(own, shape), pull)


def _toeplitz(own: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Autocorrelation at the lag from each pixel to each other."""
    y = torch.arange(shape[0]).repeat_interleave(shape[1])
    x = torch.arange(shape[1]).repeat(shape[0])
    rows, columns = own.shape
    return own[(y[:, None] - y) % rows, (x[:, None] - x) % columns]


def least(
    problem: Quadratic, start: torch.Tensor, *, sum_is_one: bool, steps: int = 200
) -> torch.Tensor:
    """The kernel, nowhere negative, that makes the problem least; from a start on.

    By accelerated projected gradients with restarts (Beck and Teboulle 2009, doi 10.1137/080716542;
    O'Donoghue and Candès 2015, doi 10.1007/s10208-013-9150-3).
    """
    size = _largest_eigenvalue(problem.normal)
    if size <= 0:
        return start
    normal, pull = problem.normal / size, problem.pull.ravel() / size
    now = ahead = start.ravel()
    pace = 1.0
    for _ in range(steps):
        stepped = ahead - (normal @ ahead - pull)
        following = on_simplex(stepped) if sum_is_one else stepped.clamp(min=0)
        if float((ahead - following) @ (following - now)) > 0:
            pace, ahead = 1.0, following
        next_pace = (1 + (1 + 4 * pace * pace) ** 0.5) / 2
        change = following - now
        ahead = following + (pace - 1) / next_pace * change
        now, pace = following, next_pace
        if float(change.abs().max()) < _ENOUGH:
            break
    return now.reshape(start.shape)


def on_simplex(values: torch.Tensor) -> torch.Tensor:
    """The nearest point that is nowhere negative and sums to 1 (Duchi et al. 2008, doi
    10.1145/1390156.1390191)."""
    sorted_down = values.sort(descending=True).values
    excess = sorted_down.cumsum(0) - 1
    count = torch.arange(1, values.numel() + 1, dtype=values.dtype)
    last = int((sorted_down - excess / count > 0).sum()) - 1
    return (values - excess[last] / (last + 1)).clamp(min=0)


def _largest_eigenvalue(normal: torch.Tensor, steps: int = 20) -> float:
    """No less than it, nearly: of a Toeplitz matrix with mostly positive entries."""
    vector = torch.ones(normal.shape[0], dtype=normal.dtype)
    size = 0.0
    for _ in range(steps):
        vector = normal @ vector
        size = float(torch.linalg.vector_norm(vector))
        if size == 0:
            return 0.0
        vector = vector / size
    return 1.1 * size
