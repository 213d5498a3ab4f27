"""Random samples of the sharp picture behind a photograph, given a blur kernel."""

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
    """

    def __init__(
        self,
        image: torch.Tensor,
        valid: torch.Tensor,
        prior: GaussianMixture,
        size: tuple[int, int],
        seed: int,
    ) -> None:
        """Prepare a sampler for a photograph and kernels of one size.

        `image` and `valid` are (rows, columns); `valid` is 1 where a pixel may be used, else 0.
        `size` is the (rows, columns) of the kernels.
        """
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
        """Draw blind deconvolution's next sharp picture, for a blur kernel and noise deviation."""
        along, down = (self._sample_precisions(one) for one in _differences(self.picture))
        self.picture = self.sample_picture(kernel, deviation, along, down)

    def sample_picture(
        self, kernel: torch.Tensor, deviation: float, along: torch.Tensor, down: torch.Tensor
    ) -> torch.Tensor:
        """Draw blind deconvolution's sharp picture for gradients of known precision.

        The precision is the inverse variance. `along` is (rows, columns - 1) and `down` is (rows -
        1, columns) of the picture.
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
        """Return the least-squares problem for the blur kernel, from sharp and blurred gradients.

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
        """Draw each gradient's Gaussian from the deconvolution prior; return the precisions."""
        below = self._prior.log_joint(steps.square()).softmax(0).cumsum(0)
        drawn = torch.rand(steps.shape, generator=self._generator, dtype=steps.dtype)
        return self._deviations[(drawn > below[:-1]).sum(0)] ** -2

    def _normal_noise(self, like: torch.Tensor) -> torch.Tensor:
        """Draw the standard normal noise with which blind deconvolution samples sharp pictures.

        The noise has the shape and floating-point type of `like`.
        """
        return torch.randn(like.shape, generator=self._generator, dtype=like.dtype)

    def _slices_from_first(self, rows: int, columns: int) -> tuple[EllipsisType, slice, slice]:
        y, x = self._first_pixel
        return (..., slice(y, y + rows), slice(x, x + columns))

    def _crop_to_field(self, whole: torch.Tensor) -> torch.Tensor:
        """Crop a period to blind deconvolution's sharp picture, which extends beyond the frame."""
        return whole[: self._field_shape[0], : self._field_shape[1]]

    def _blur(self, x: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        """Blur a sharp picture by blind deconvolution's trial kernel, given by its spectrum.

        The result covers the whole period.
        """
        return irfft2(padded_spectrum(x, self._period) * spectrum, self._period)

    def _blur_adjoint(self, light: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of blind deconvolution's trial blur to light in the frame."""
        whole = light.new_zeros(self._period)
        whole[self._frame_slices] = light
        return self._crop_to_field(irfft2(rfft2(whole) * spectrum.conj(), self._period))


def _differences(x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute a sharp picture's differences along rows and columns, for blind deconvolution."""
    return x[:, 1:] - x[:, :-1], x[1:] - x[:-1]


def _add_adjoint(x: torch.Tensor, along: torch.Tensor, down: torch.Tensor) -> None:
    """Add the adjoint of a sharp picture's differences to x in place, for blind deconvolution."""
    x[:, 1:] += along
    x[:, :-1] -= along
    x[1:] += down
    x[:-1] -= down


def _sum_at_pixels(along: torch.Tensor, down: torch.Tensor) -> torch.Tensor:
    """Add up the precisions of the four gradients around each pixel of the deconvolved picture."""
    pad = torch.nn.functional.pad
    return (
        pad(along, (1, 0)) + pad(along, (0, 1)) + pad(down, (0, 0, 1, 0)) + pad(down, (0, 0, 0, 1))
    )


def _inner_product(a: torch.Tensor, b: torch.Tensor) -> float:
    """Compute the inner product of two sharp pictures for blind deconvolution."""
    return float((a * b).sum())
