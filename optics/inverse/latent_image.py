"""Draw samples of the sharp picture behind a photograph, and find a kernel by its gradients."""

from __future__ import annotations

from dataclasses import dataclass
from types import EllipsisType

import scipy.fft
import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.gradient_statistics import GaussianMixture, gradients
from optics.inverse.normal_equations import conjugate_gradients


@dataclass(frozen=True, eq=False)
class QuadraticProblem:
    """The quadratic objective k^T N k / 2 - r^T k of a blur kernel k.

    k holds the kernel's pixels row by row. Divided by the noise variance, the objective is the
    negative log-likelihood of the kernel, up to a constant.

    normal_matrix: N, (pixels, pixels), symmetric and positive semidefinite.
    right_hand_side: r, (rows, columns).
    """

    normal_matrix: torch.Tensor
    right_hand_side: torch.Tensor

    def with_ridge(self, weight: float) -> QuadraticProblem:
        """Return the problem with ``weight * |k|² / 2`` added."""
        eye = torch.eye(self.normal_matrix.shape[0], dtype=self.normal_matrix.dtype)
        return QuadraticProblem(self.normal_matrix + weight * eye, self.right_hand_side)


def fast_period(rows: int, columns: int) -> tuple[int, int]:
    """Return a period of at least (rows, columns) with fast FFTs and an even number of columns."""
    half = scipy.fft.next_fast_len((columns + 1) // 2, real=True)
    return scipy.fft.next_fast_len(rows, real=True), 2 * half


def padded_spectrum(picture: torch.Tensor, period: tuple[int, int]) -> torch.Tensor:
    """Compute the rfft2 of a picture, (..., rows, columns), padded with zeros to a period."""
    rows, columns = picture.shape[-2:]
    margins = (0, period[1] - columns, 0, period[0] - rows)
    return rfft2(torch.nn.functional.pad(picture, margins))


def least_squares_problem(
    sharp: torch.Tensor, blurred: torch.Tensor, shape: tuple[int, int]
) -> QuadraticProblem:
    """Build the problem of minimising ``|sharp * k - blurred|² / 2``, where * is convolution.

    sharp, blurred: rfft2 spectra, (channels, ...), on one period that is so large that the
        convolution doesn't wrap around.
    shape: (rows, columns) of the kernel, whose first pixel belongs to a lag of 0.
    """
    period = (int(sharp.shape[-2]), 2 * (int(sharp.shape[-1]) - 1))
    power = (sharp.real.square() + sharp.imag.square()).sum(0)
    own = irfft2(power.to(sharp.dtype), period)
    pull = irfft2((sharp.conj() * blurred).sum(0), period)[: shape[0], : shape[1]]
    # The matrix has the autocorrelation at the lag between each two pixels of the kernel.
    y = torch.arange(shape[0]).repeat_interleave(shape[1])
    x = torch.arange(shape[1]).repeat(shape[0])
    matrix = own[(y[:, None] - y) % period[0], (x[:, None] - x) % period[1]]
    return QuadraticProblem(matrix, pull)


def minimise_nonnegative(
    problem: QuadraticProblem, start: torch.Tensor, *, sum_is_one: bool, steps: int = 200
) -> torch.Tensor:
    """Find the non-negative kernel that minimises a quadratic objective, from `start`.

    The method is the accelerated projected gradient with restarts (Beck and Teboulle 2009, doi
    10.1137/080716542; O'Donoghue and Candès 2015, doi 10.1007/s10208-013-9150-3). `sum_is_one`
    limits the kernels to those with a sum of 1.
    """
    # 1.1 times the estimate of the power iteration is an upper bound of the largest eigenvalue of
    # a Toeplitz matrix with mostly positive entries.
    vector, size = torch.ones(start.numel(), dtype=problem.normal_matrix.dtype), 0.0
    for _ in range(20):
        vector = problem.normal_matrix @ vector
        size = float(torch.linalg.vector_norm(vector))
        if size == 0:
            return start
        vector = vector / size
    size *= 1.1
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
    """Return the nearest non-negative kernel with a sum of 1.

    See Duchi et al. 2008, doi 10.1145/1390156.1390191.
    """
    sorted_down = values.sort(descending=True).values
    excess = sorted_down.cumsum(0) - 1
    count = torch.arange(1, values.numel() + 1, dtype=values.dtype)
    last = int((sorted_down - excess / count > 0).sum()) - 1
    return (values - excess[last] / (last + 1)).clamp(min=0)


class LatentImageSampler:
    """Samples the posterior distribution of the sharp picture for a given blur kernel.

    It is a Gibbs sampler (Schmidt, Gao and Roth 2010, doi 10.1109/CVPR.2010.5539844). In turn, it
    draws the component of the Gaussian mixture to which each gradient belongs, and the picture for
    these components. The picture is drawn exactly, by a linear solve with noise added to data and
    prior (Papandreou and Yuille 2010). Variational Bayes, with an independent normal posterior for
    each pixel, overestimates the uncertainty of wide kernels; with noise, it prefers a point to the
    true blur.

    The picture includes the surroundings of the frame from which light reaches it, so that nothing
    is assumed about the border.

    valid: 1 where a pixel may be used, else 0, (rows, columns).
    size: (rows, columns) of the kernels.
    """

    def __init__(
        self,
        image: torch.Tensor,
        valid: torch.Tensor,
        prior: GaussianMixture,
        size: tuple[int, int],
        seed: int,
    ) -> None:
        self._image, self._valid = image - image.mean(), valid
        self._prior, self._size = prior, size
        self._deviations = image.new_tensor(prior.deviations)
        self._generator = torch.Generator().manual_seed(seed)
        rows, columns = image.shape
        self._field_shape = rows + size[0] - 1, columns + size[1] - 1
        self._period = fast_period(
            self._field_shape[0] + size[0] - 1, self._field_shape[1] + size[1] - 1
        )
        self._first_pixel = size[0] - 1, size[1] - 1
        self._frame_slices = self._slices_from_first(rows, columns)
        whole = image.new_zeros(self._period)
        whole[self._frame_slices] = valid
        self._valid_spectrum = rfft2(whole)
        y, x = size[0] // 2, size[1] // 2
        around = (x, size[1] - 1 - x, y, size[0] - 1 - y)
        middle = self._image[None, None]
        self.picture = torch.nn.functional.pad(middle, around, mode="replicate")[0, 0]

    def sample(self, kernel: torch.Tensor, deviation: float) -> None:
        """Draw the next sharp picture, for a kernel and the noise's standard deviation."""
        along, down = (self._sample_precisions(one) for one in _differences(self.picture))
        self.picture = self.sample_picture(kernel, deviation, along, down)

    def sample_picture(
        self, kernel: torch.Tensor, deviation: float, along: torch.Tensor, down: torch.Tensor
    ) -> torch.Tensor:
        """Draw the sharp picture for gradients of known precision, the inverse variance.

        along: precisions, (rows, columns - 1) of the picture.
        down: precisions, (rows - 1, columns) of the picture.
        """
        spectrum, precision = padded_spectrum(kernel, self._period), deviation**-2
        reached = irfft2(
            self._valid_spectrum * padded_spectrum(kernel.square(), self._period).conj(),
            self._period,
        )
        told = self._crop_to_field(reached).clamp(min=0) * precision
        inverse = (told + _sum_at_pixels(along, down)).reciprocal()
        noisy = (self._image + deviation * self._normal_noise(self._image)) * self._valid
        wanted = self._blur_adjoint(noisy, spectrum) * precision
        _add_adjoint(
            wanted, along.sqrt() * self._normal_noise(along), down.sqrt() * self._normal_noise(down)
        )

        def normal(x: torch.Tensor) -> torch.Tensor:
            light = self._blur(x, spectrum)[self._frame_slices] * self._valid
            answer = self._blur_adjoint(light, spectrum).mul_(precision)
            steps = _differences(x)
            _add_adjoint(answer, along * steps[0], down * steps[1])
            return answer

        left = wanted - normal(self.picture)
        # Conjugate gradients start from the last picture, reduce the squared residual by 1e-5, and
        # do at most 25 steps.
        enough = 1e-5 * _inner_product(left, left * inverse)
        picture, *_ = conjugate_gradients(
            normal, left, self.picture, inverse, _inner_product, enough, 25
        )
        return picture

    def kernel_problem(self, kernel: torch.Tensor) -> QuadraticProblem:
        """Return the least-squares problem for the kernel, from sharp and blurred gradients.

        Gradients that weren't measured are replaced by those of the picture blurred by `kernel`, so
        that each step is one of expectation maximisation.
        """
        spectrum = padded_spectrum(gradients(self.picture), self._period)
        light = irfft2(spectrum * padded_spectrum(kernel, self._period), self._period)
        known, seen = self._valid, gradients(self._image)
        trusted = known[:-1, :-1] * known[:-1, 1:] * known[1:, :-1] > 0
        frame = self._slices_from_first(seen.shape[1], seen.shape[2])
        light[frame] = torch.where(trusted, seen, light[frame])
        return least_squares_problem(spectrum, rfft2(light), self._size)

    def _sample_precisions(self, steps: torch.Tensor) -> torch.Tensor:
        """Draw the Gaussian of each gradient, and return its precision."""
        below = self._prior.log_joint(steps.square()).softmax(0).cumsum(0)
        drawn = torch.rand(steps.shape, generator=self._generator, dtype=steps.dtype)
        return self._deviations[(drawn > below[:-1]).sum(0)] ** -2

    def _normal_noise(self, like: torch.Tensor) -> torch.Tensor:
        return torch.randn(like.shape, generator=self._generator, dtype=like.dtype)

    def _slices_from_first(self, rows: int, columns: int) -> tuple[EllipsisType, slice, slice]:
        y, x = self._first_pixel
        return (..., slice(y, y + rows), slice(x, x + columns))

    def _crop_to_field(self, whole: torch.Tensor) -> torch.Tensor:
        """Crop a period to the picture, which extends beyond the frame."""
        return whole[: self._field_shape[0], : self._field_shape[1]]

    def _blur(self, x: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        """Blur a picture by the kernel of a spectrum; the result covers the whole period."""
        return irfft2(padded_spectrum(x, self._period) * spectrum, self._period)

    def _blur_adjoint(self, light: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of the blur to light in the frame."""
        whole = light.new_zeros(self._period)
        whole[self._frame_slices] = light
        return self._crop_to_field(irfft2(rfft2(whole) * spectrum.conj(), self._period))


def _differences(x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute the differences along rows, and those down columns."""
    return x[:, 1:] - x[:, :-1], x[1:] - x[:-1]


def _add_adjoint(x: torch.Tensor, along: torch.Tensor, down: torch.Tensor) -> None:
    """Add the adjoint of the differences to x in place."""
    x[:, 1:] += along
    x[:, :-1] -= along
    x[1:] += down
    x[:-1] -= down


def _sum_at_pixels(along: torch.Tensor, down: torch.Tensor) -> torch.Tensor:
    """Add up the precisions of the four gradients around each pixel."""
    pad = torch.nn.functional.pad
    return (
        pad(along, (1, 0)) + pad(along, (0, 1)) + pad(down, (0, 0, 1, 0)) + pad(down, (0, 0, 0, 1))
    )


def _inner_product(a: torch.Tensor, b: torch.Tensor) -> float:
    return float((a * b).sum())
