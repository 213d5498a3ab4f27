"""Quadratic problems for a blur kernel that maps known gradients to measured ones."""

from __future__ import annotations

from dataclasses import dataclass

import scipy.fft
import torch

from optics.fourier import irfft2, rfft2


@dataclass(frozen=True, eq=False)
class QuadraticProblem:
    """The quadratic objective k^T N k / 2 - r^T k of a blur kernel k.

    k holds the kernel's pixels row by row. Divided by the noise variance, the objective is the
    negative log-likelihood of the kernel, up to a constant. `normal_matrix` is N, (pixels, pixels),
    symmetric and positive semidefinite. `right_hand_side` is r, (rows, columns).
    """

    normal_matrix: torch.Tensor
    right_hand_side: torch.Tensor

    def value(self, kernel: torch.Tensor) -> float:
        """Return the value of blind deconvolution's quadratic objective for a blur kernel."""
        flat = kernel.ravel()
        return float(0.5 * flat @ (self.normal_matrix @ flat) - self.right_hand_side.ravel() @ flat)

    def with_ridge(self, weight: float) -> QuadraticProblem:
        """Return blind deconvolution's kernel problem with a ridge ``weight * |k|² / 2`` added."""
        eye = torch.eye(self.normal_matrix.shape[0], dtype=self.normal_matrix.dtype)
        return QuadraticProblem(self.normal_matrix + weight * eye, self.right_hand_side)

    def blend_with(self, own_weight: float, new: QuadraticProblem) -> QuadraticProblem:
        """Return the weighted mean of two of blind deconvolution's blur-kernel problems.

        `own_weight`, from 0 to 1, is the weight of this problem.
        """
        return QuadraticProblem(
            torch.lerp(new.normal_matrix, self.normal_matrix, own_weight),
            torch.lerp(new.right_hand_side, self.right_hand_side, own_weight),
        )


def fast_period(rows: int, columns: int) -> tuple[int, int]:
    """Return a period of at least (rows, columns) with fast FFTs, for blind deconvolution.

    The number of columns is even.
    """
    half = scipy.fft.next_fast_len((columns + 1) // 2, real=True)
    return scipy.fft.next_fast_len(rows, real=True), 2 * half


def padded_spectrum(picture: torch.Tensor, period: tuple[int, int]) -> torch.Tensor:
    """Compute the rfft2 of a picture padded with zeros to a period, for blind deconvolution.

    The picture is (..., rows, columns).
    """
    rows, columns = picture.shape[-2:]
    margins = (0, period[1] - columns, 0, period[0] - rows)
    return rfft2(torch.nn.functional.pad(picture, margins))


def least_squares_problem(
    sharp: torch.Tensor, blurred: torch.Tensor, shape: tuple[int, int]
) -> QuadraticProblem:
    """Build blind deconvolution's problem of minimising ``|sharp * k - blurred|² / 2``.

    The sign * stands for convolution. `sharp` and `blurred` are rfft2 spectra, (channels, ...), on
    one period that is so large that the convolution doesn't wrap around. `shape` is the (rows,
    columns) of the kernel, whose first pixel belongs to a lag of 0.
    """
    period = (int(sharp.shape[-2]), 2 * (int(sharp.shape[-1]) - 1))
    power = (sharp.real.square() + sharp.imag.square()).sum(0)
    own = irfft2(power.to(sharp.dtype), period)
    pull = irfft2((sharp.conj() * blurred).sum(0), period)[: shape[0], : shape[1]]
    return QuadraticProblem(_toeplitz(own, shape), pull)


def _toeplitz(autocorrelation: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Build the Toeplitz normal matrix of blind deconvolution's blur kernel.

    Each entry is the autocorrelation at the lag between two pixels of the kernel.
    """
    y = torch.arange(shape[0]).repeat_interleave(shape[1])
    x = torch.arange(shape[1]).repeat(shape[0])
    rows, columns = autocorrelation.shape
    return autocorrelation[(y[:, None] - y) % rows, (x[:, None] - x) % columns]


def minimise_nonnegative(
    problem: QuadraticProblem, start: torch.Tensor, *, sum_is_one: bool, steps: int = 200
) -> torch.Tensor:
    """Find the non-negative blur kernel that minimises blind deconvolution's quadratic objective.

    The search starts from `start`. The method is the accelerated projected gradient with restarts
    (Beck and Teboulle 2009, doi 10.1137/080716542; O'Donoghue and Candès 2015, doi
    10.1007/s10208-013-9150-3). `sum_is_one` limits the kernels to those with a sum of 1.
    """
    size = _largest_eigenvalue(problem.normal_matrix)
    if size <= 0:
        return start
    normal, pull = problem.normal_matrix / size, problem.right_hand_side.ravel() / size
    now = ahead = start.ravel()
    pace = 1.0
    for _ in range(steps):
        stepped = ahead - (normal @ ahead - pull)
        following = project_onto_simplex(stepped) if sum_is_one else stepped.clamp(min=0)
        if float((ahead - following) @ (following - now)) > 0:
            pace, ahead = 1.0, following
        next_pace = (1 + (1 + 4 * pace * pace) ** 0.5) / 2
        change = following - now
        ahead = following + (pace - 1) / next_pace * change
        now, pace = following, next_pace
        # The tolerance is for kernels that sum to about 1.
        if float(change.abs().max()) < 1e-6:
            break
    return now.reshape(start.shape)


def project_onto_simplex(values: torch.Tensor) -> torch.Tensor:
    """Project a blindly estimated blur kernel onto the nearest non-negative one with a sum of 1.

    See Duchi et al. 2008, doi 10.1145/1390156.1390191.
    """
    sorted_down = values.sort(descending=True).values
    excess = sorted_down.cumsum(0) - 1
    count = torch.arange(1, values.numel() + 1, dtype=values.dtype)
    last = int((sorted_down - excess / count > 0).sum()) - 1
    return (values - excess[last] / (last + 1)).clamp(min=0)


def _largest_eigenvalue(normal: torch.Tensor, steps: int = 20) -> float:
    """Bound the largest eigenvalue of blind deconvolution's kernel matrix by power iteration.

    `normal` is the kernel's normal matrix. The result is 1.1 times the estimate of the power
    iteration, which makes it an upper bound for a Toeplitz matrix with mostly positive entries.
    """
    vector = torch.ones(normal.shape[0], dtype=normal.dtype)
    size = 0.0
    for _ in range(steps):
        vector = normal @ vector
        size = float(torch.linalg.vector_norm(vector))
        if size == 0:
            return 0.0
        vector = vector / size
    return 1.1 * size
