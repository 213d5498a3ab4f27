"""Sharp pictures that natural statistics and a kernel allow, drawn as often as they are likely."""

from __future__ import annotations

from types import EllipsisType

import torch

from optics.deconvolution.blind.gradient_statistics import GaussianMixture, gradients
from optics.deconvolution.blind.quadratic import (
    QuadraticProblem,
    fast_period,
    least_squares_problem,
    padded_spectrum,
)
from optics.deconvolution.conjugate_gradients import conjugate_gradients
from optics.fourier import irfft2, rfft2

_CG_STEPS = 25
"""Steps of conjugate gradients for a picture, from the one before on."""

_CG_TOLERANCE = 1e-5
"""Of the squared residual, by which conjugate gradients end."""


class LatentImageSampler:
    """The sharp picture's posterior for a kernel, by samples.

    By turns, which component each gradient is of is drawn for the picture, and the picture for
    these (Gibbs; Schmidt, Gao and Roth 2010, doi 10.1109/CVPR.2010.5539844), the latter exactly: a
    linear solve with noise put on data and prior (Papandreou and Yuille 2010). A normal posterior
    of each pixel apart, as variational Bayes has it, makes too much of wide kernels' uncertainty,
    so that in noise it prefers a point to the true blur. The picture is looked for as far around
    the frame as light comes from into it: nothing is assumed of the border.
    """

    def __init__(
        self,
        image: torch.Tensor,
        valid: torch.Tensor,
        prior: GaussianMixture,
        size: tuple[int, int],
        seed: int,
    ) -> None:
        """image, valid: (rows, columns), valid 1 or 0; size: of kernels."""
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
        """Draw the next picture for a kernel and the standard deviation of a pixel's noise."""
        along, down = (self._sample_precisions(one) for one in _differences(self.picture))
        self.picture = self.sample_picture(kernel, deviation, along, down)

    def sample_picture(
        self, kernel: torch.Tensor, deviation: float, along: torch.Tensor, down: torch.Tensor
    ) -> torch.Tensor:
        """A picture for gradients of known precisions, (rows, columns - 1) and (rows - 1, columns)
        of the field."""
        spectrum, precision = padded_spectrum(kernel, self._period), deviation**-2
        reached = irfft2(
            self._valid_spectrum * padded_spectrum(kernel.square(), self._period).conj(),
            self._period,
        )
        told = self._crop_to_field(reached).clamp(min=0) * precision
        inverse = (told + _sum_at_pixels(along, down)).reciprocal()
        noisy = (self._image + deviation * self._noise(self._image)) * self._valid
        wanted = self._blur_adjoint(noisy, spectrum) * precision
        _add_adjoint(wanted, along.sqrt() * self._noise(along), down.sqrt() * self._noise(down))

        def normal(x: torch.Tensor) -> torch.Tensor:
            light = self._blur(x, spectrum)[self._frame_slices] * self._valid
            answer = self._blur_adjoint(light, spectrum).mul_(precision)
            steps = _differences(x)
            _add_adjoint(answer, along * steps[0], down * steps[1])
            return answer

        left = wanted - normal(self.picture)
        enough = _CG_TOLERANCE * _inner(left, left * inverse)
        picture, _ = conjugate_gradients(
            normal, left, self.picture, inverse, _inner, enough, _CG_STEPS
        )
        return picture

    def kernel_problem(self, kernel: torch.Tensor) -> QuadraticProblem:
        """What the picture says of the kernel, by gradients. Those that weren't measured are taken
        for what a kernel makes of the picture: each step is one of expectation and maximisation."""
        spectrum = padded_spectrum(gradients(self.picture), self._period)
        light = irfft2(spectrum * padded_spectrum(kernel, self._period), self._period)
        known, seen = self._valid, gradients(self._image)
        trusted = known[:-1, :-1] * known[:-1, 1:] * known[1:, :-1] > 0
        frame = self._slices_from_first(seen.shape[1], seen.shape[2])
        light[frame] = torch.where(trusted, seen, light[frame])
        return least_squares_problem(spectrum, rfft2(light), self._size)

    def _sample_precisions(self, steps: torch.Tensor) -> torch.Tensor:
        """Of the components that gradients are drawn to be of."""
        below = self._prior.log_joint(steps.square()).softmax(0).cumsum(0)
        drawn = torch.rand(steps.shape, generator=self._generator, dtype=steps.dtype)
        return self._deviations[(drawn > below[:-1]).sum(0)] ** -2

    def _noise(self, like: torch.Tensor) -> torch.Tensor:
        return torch.randn(like.shape, generator=self._generator, dtype=like.dtype)

    def _slices_from_first(self, rows: int, columns: int) -> tuple[EllipsisType, slice, slice]:
        y, x = self._first_pixel
        return (..., slice(y, y + rows), slice(x, x + columns))

    def _crop_to_field(self, whole: torch.Tensor) -> torch.Tensor:
        return whole[: self._field_shape[0], : self._field_shape[1]]

    def _blur(self, x: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        return irfft2(padded_spectrum(x, self._period) * spectrum, self._period)

    def _blur_adjoint(self, light: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        whole = light.new_zeros(self._period)
        whole[self._frame_slices] = light
        return self._crop_to_field(irfft2(rfft2(whole) * spectrum.conj(), self._period))


def _differences(x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    return x[:, 1:] - x[:, :-1], x[1:] - x[:-1]


def _add_adjoint(x: torch.Tensor, along: torch.Tensor, down: torch.Tensor) -> None:
    x[:, 1:] += along
    x[:, :-1] -= along
    x[1:] += down
    x[:-1] -= down


def _sum_at_pixels(along: torch.Tensor, down: torch.Tensor) -> torch.Tensor:
    """Sums of what lies on either side of a pixel."""
    pad = torch.nn.functional.pad
    return (
        pad(along, (1, 0)) + pad(along, (0, 1)) + pad(down, (0, 0, 1, 0)) + pad(down, (0, 0, 0, 1))
    )


def _inner(a: torch.Tensor, b: torch.Tensor) -> float:
    return float((a * b).sum())
