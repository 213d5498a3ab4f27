"""Sharp pictures that natural statistics and a kernel allow, drawn as often as they are likely."""

from __future__ import annotations

from types import EllipsisType

import torch

from optics.deconvolution.blind.quadratic import (
    Quadratic,
    fast_period,
    padded_spectrum,
    quadratic_of,
)
from optics.deconvolution.blind.statistics import Mixture, gradients
from optics.deconvolution.conjugate import conjugate_gradients
from optics.fourier import irfft2, rfft2

_SOLVING = 25
"""Steps of conjugate gradients for a picture, from the one before on."""

_SETTLED = 1e-5
"""Of the squared residual, by which conjugate gradients end."""


class Latent:
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
        known: torch.Tensor,
        prior: Mixture,
        size: tuple[int, int],
        seed: int,
    ) -> None:
        """image, known: (rows, columns), known 1 or 0; size: of kernels."""
        self._image, self._known_pixels = image - image.mean(), known
        self._prior, self._size = prior, size
        self._deviations = image.new_tensor(prior.deviations)
        self._drawing = torch.Generator().manual_seed(seed)
        rows, columns = image.shape
        self._field = rows + size[0] - 1, columns + size[1] - 1
        self._period = fast_period(self._field[0] + size[0] - 1, self._field[1] + size[1] - 1)
        self._first = size[0] - 1, size[1] - 1
        self._frame = self._from_first(rows, columns)
        whole = image.new_zeros(self._period)
        whole[self._frame] = known
        self._known = rfft2(whole)
        y, x = size[0] // 2, size[1] // 2
        around = (x, size[1] - 1 - x, y, size[0] - 1 - y)
        middle = self._image[None, None]
        self.picture = torch.nn.functional.pad(middle, around, mode="replicate")[0, 0]

    def sample(self, kernel: torch.Tensor, deviation: float) -> None:
        """Draw the next picture for a kernel and the standard deviation of a pixel's noise."""
        along, down = (self._precisions(one) for one in _differences(self.picture))
        self.picture = self.drawn(kernel, deviation, along, down)

    def drawn(
        self, kernel: torch.Tensor, deviation: float, along: torch.Tensor, down: torch.Tensor
    ) -> torch.Tensor:
        """A picture for gradients of known precisions, (rows, columns - 1) and (rows - 1, columns)
        of the field."""
        spectrum, precision = padded_spectrum(kernel, self._period), deviation**-2
        reached = irfft2(
            self._known * padded_spectrum(kernel.square(), self._period).conj(), self._period
        )
        told = self._cut(reached).clamp(min=0) * precision
        inverse = (told + _onto_pixels(along, down)).reciprocal()
        noisy = (self._image + deviation * self._noise(self._image)) * self._known_pixels
        wanted = self._back(noisy, spectrum) * precision
        _add_adjoint(wanted, along.sqrt() * self._noise(along), down.sqrt() * self._noise(down))

        def normal(x: torch.Tensor) -> torch.Tensor:
            light = self._light(x, spectrum)[self._frame] * self._known_pixels
            answer = self._back(light, spectrum).mul_(precision)
            steps = _differences(x)
            _add_adjoint(answer, along * steps[0], down * steps[1])
            return answer

        left = wanted - normal(self.picture)
        enough = _SETTLED * _inner(left, left * inverse)
        picture, _ = conjugate_gradients(
            normal, left, self.picture, inverse, _inner, enough, _SOLVING
        )
        return picture

    def problem(self, kernel: torch.Tensor) -> Quadratic:
        """What the picture says of the kernel, by gradients. Those that weren't measured are taken
        for what a kernel makes of the picture: each step is one of expectation and maximisation."""
        spectrum = padded_spectrum(gradients(self.picture), self._period)
        light = irfft2(spectrum * padded_spectrum(kernel, self._period), self._period)
        known, seen = self._known_pixels, gradients(self._image)
        trusted = known[:-1, :-1] * known[:-1, 1:] * known[1:, :-1] > 0
        frame = self._from_first(seen.shape[1], seen.shape[2])
        light[frame] = torch.where(trusted, seen, light[frame])
        return quadratic_of(spectrum, rfft2(light), self._size)

    def _precisions(self, steps: torch.Tensor) -> torch.Tensor:
        """Of the components that gradients are drawn to be of."""
        below = self._prior.joint(steps.square()).softmax(0).cumsum(0)
        drawn = torch.rand(steps.shape, generator=self._drawing, dtype=steps.dtype)
        return self._deviations[(drawn > below[:-1]).sum(0)] ** -2

    def _noise(self, like: torch.Tensor) -> torch.Tensor:
        return torch.randn(like.shape, generator=self._drawing, dtype=like.dtype)

    def _from_first(self, rows: int, columns: int) -> tuple[EllipsisType, slice, slice]:
        y, x = self._first
        return (..., slice(y, y + rows), slice(x, x + columns))

    def _cut(self, whole: torch.Tensor) -> torch.Tensor:
        return whole[: self._field[0], : self._field[1]]

    def _light(self, x: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        return irfft2(padded_spectrum(x, self._period) * spectrum, self._period)

    def _back(self, light: torch.Tensor, spectrum: torch.Tensor) -> torch.Tensor:
        whole = light.new_zeros(self._period)
        whole[self._frame] = light
        return self._cut(irfft2(rfft2(whole) * spectrum.conj(), self._period))


def _differences(x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    return x[:, 1:] - x[:, :-1], x[1:] - x[:-1]


def _add_adjoint(x: torch.Tensor, along: torch.Tensor, down: torch.Tensor) -> None:
    x[:, 1:] += along
    x[:, :-1] -= along
    x[1:] += down
    x[:-1] -= down


def _onto_pixels(along: torch.Tensor, down: torch.Tensor) -> torch.Tensor:
    """Sums of what lies on either side of a pixel."""
    pad = torch.nn.functional.pad
    return (
        pad(along, (1, 0)) + pad(along, (0, 1)) + pad(down, (0, 0, 1, 0)) + pad(down, (0, 0, 0, 1))
    )


def _inner(a: torch.Tensor, b: torch.Tensor) -> float:
    return float((a * b).sum())
