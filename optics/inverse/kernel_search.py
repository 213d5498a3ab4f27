"""Search for a blur kernel, first by strong edges, then by statistics of natural pictures.

Parts of the photograph and a second search tell its uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.ndimage
import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.blur import transfer_function
from optics.inverse.gradient_statistics import NATURAL_GRADIENTS, gradients
from optics.inverse.latent_image import (
    LatentImageSampler,
    QuadraticProblem,
    fast_period,
    least_squares_problem,
    minimise_nonnegative,
    padded_spectrum,
)
from optics.inverse.observation import extend_periodically
from optics.inverse.operator import squared_modulus
from optics.inverse.priors import laplacian_spectrum
from optics.plane import centred_crop, centred_pad
from optics.progress import Progress

_SCALE_STEP = math.sqrt(2)
"""Ratio between one scale of the kernel search and the next."""


def next_odd(size: float) -> int:
    """Round a kernel's size up to an odd number, 3 or more."""
    whole = math.ceil(size - 1e-9)
    return max(3, whole + 1 - whole % 2)


def downsample(image: torch.Tensor, factor: float) -> torch.Tensor:
    """Shrink a photograph, (rows, columns), without aliasing."""
    if factor == 1:
        return image
    rows, columns = (round(n / factor) for n in image.shape)
    return torch.nn.functional.interpolate(
        image[None, None], (rows, columns), mode="bilinear", antialias=True, align_corners=False
    )[0, 0]


def enlarge_kernel(kernel: torch.Tensor, factor: float, size: int) -> torch.Tensor:
    """Enlarge a kernel from a coarser to a finer scale.

    The origin stays at n // 2. The result is (size, size) with a sum of 1.
    """
    old = kernel.shape[-1]
    at = (torch.arange(size, dtype=kernel.dtype) - size // 2) / factor + old // 2
    share = torch.clamp(1 - (at[:, None] - torch.arange(old, dtype=kernel.dtype)).abs(), min=0)
    larger = share @ kernel @ share.T
    total = float(larger.sum())
    return larger / total if total > 0 else point_kernel(size).to(kernel)


def point_kernel(size: int) -> torch.Tensor:
    """Return the kernel without blur: (size, size), all light at n // 2."""
    point = torch.zeros(size, size)
    point[size // 2, size // 2] = 1
    return point


def centre_kernel(kernel: torch.Tensor, size: int) -> torch.Tensor:
    """Move a kernel by whole pixels into the middle of (size, size), with a sum of 1."""
    cut = cut_window(kernel, centred_window_start(kernel, size), size)
    return cut / cut.sum()


def centred_window_start(kernel: torch.Tensor, size: int) -> tuple[int, int]:
    """Find the first row and column of the (size, size) window that centres a kernel.

    The window may extend beyond the kernel. Among the windows that hold the most light, up to a
    small share, the one is chosen whose centre n // 2 is nearest to the kernel's centroid.
    """
    rows, columns = (
        _best_window_start(torch.nn.functional.pad(kernel.sum(1 - dim), (size, size)), size) - size
        for dim in (0, 1)
    )
    return rows, columns


def cut_window(kernel: torch.Tensor, first: tuple[int, int], size: int) -> torch.Tensor:
    """Cut a (size, size) window out of a kernel, padded with zeros.

    first: the window's first row and column, up to `size` pixels outside the kernel.
    """
    padded = torch.nn.functional.pad(kernel, (size, size, size, size))
    y, x = first[0] + size, first[1] + size
    return padded[y : y + size, x : x + size]


def _best_window_start(profile: torch.Tensor, size: int) -> int:
    """Find where the window of `size` that centres a kernel starts on one axis.

    profile: the kernel's sum over the other axis.
    """
    inside = torch.nn.functional.pad(profile.to(torch.float64).cumsum(0), (1, 0))
    held = inside[size:] - inside[:-size]
    whole = float(inside[-1])
    centroid = float((profile * torch.arange(profile.numel())).sum()) / whole
    # A window may lose up to 0.2 % more of the light than the best one to be centred better.
    good = (held >= float(held.max()) - 2e-3 * whole).nonzero().ravel().tolist()
    return int(min(good, key=lambda first: abs(first + size // 2 - centroid)))


_TOUCHING = np.ones((3, 3))


def without_specks(kernel: torch.Tensor, faint: float, small: float) -> torch.Tensor:
    """Remove faint pixels and small isolated parts from a kernel; the result sums to 1.

    Pixels below the share `faint` of the peak are set to 0, and so are connected parts with less
    than the share `small` of the light.
    """
    kept = torch.where(kernel >= faint * kernel.max(), kernel, 0.0)
    if small > 0:
        parts, count = scipy.ndimage.label(kept.numpy() > 0, _TOUCHING)
        light = scipy.ndimage.sum_labels(kept.numpy(), parts, np.arange(count + 1))
        weak = light < small * min(float(kept.sum()), float(light.max()))
        kept = torch.where(torch.from_numpy(weak[parts]), 0.0, kept)
    return kept / kept.sum()


class StrongEdges:
    """Estimates the strong edges of a photograph's scene, and the blur kernel from them.

    The photograph is (rows, columns) with a standard deviation of about LIGHT_DEVIATION. Kernels
    are at most (rows, columns) `size`.
    """

    def __init__(self, image: torch.Tensor, valid: torch.Tensor, size: tuple[int, int]) -> None:
        self._image, self._size = image, size
        rows, columns = image.shape
        self._period_shape = fast_period(rows + 2 * size[0], columns + 2 * size[1])
        self._spectrum = rfft2(extend_periodically(image, self._period_shape))
        self._laplacian = laplacian_spectrum(self._period_shape).to(image)
        trusted = (valid[1:, 1:] * valid[:-1, :-1] * valid[1:, :-1] * valid[:-1, 1:])[None]
        self._valid_gradients = gradients(image) * trusted
        # These gradients lie so far inside the frame that all of their blurred light was measured.
        unseen = torch.nn.functional.max_pool2d(
            1 - trusted, (2 * size[0] + 1, 2 * size[1] + 1), 1, (size[0], size[1])
        )
        down, along = size[0] // 2, size[1] // 2
        self._interior = torch.zeros_like(trusted)
        frame = (..., slice(down, rows - 1 - down), slice(along, columns - 1 - along))
        self._interior[frame] = 1 - unseen[frame]

    def estimate_picture(self, kernel: torch.Tensor, weight: float) -> torch.Tensor:
        """Estimate the sharp picture with few edges that a trial kernel blurs to the photograph.

        The picture x minimises |k * x - image|² + weight * (number of pixels where x has a
        gradient), by half-quadratic splitting (Xu, Zheng and Jia 2013, doi 10.1109/CVPR.2013.147).
        Opposite borders of the photograph are blended.

        kernel: k, with its origin at n // 2.
        """
        transfer = transfer_function(kernel, self._period_shape)
        told, power = transfer.conj() * self._spectrum, squared_modulus(transfer)
        x, coupling = irfft2(self._spectrum, self._period_shape), 2 * weight
        # The coupling of the picture to its edges grows up to 1000.
        while coupling < 1e3:
            along, down = torch.roll(x, -1, 1) - x, torch.roll(x, -1, 0) - x
            weak = along.square() + down.square() < weight / coupling
            along.masked_fill_(weak, 0)
            down.masked_fill_(weak, 0)
            kept = torch.roll(along, 1, 1) - along + torch.roll(down, 1, 0) - down
            wanted = told + coupling * rfft2(kept)
            x = irfft2(wanted / (power + coupling * self._laplacian), self._period_shape)
            coupling *= 2
        return centred_crop(x, self._image.shape)

    def estimate_kernel(
        self, picture: torch.Tensor, start: torch.Tensor, ridge: float
    ) -> torch.Tensor:
        """Estimate the kernel k that blurs a picture with few edges most nearly to the photograph.

        The result sums to 1.

        start: the result if the picture has no edges.
        ridge: weight of |k|², which determines what the edges don't.
        """
        edges = gradients(picture) * self._interior
        rows, columns = self._size
        period = fast_period(edges.shape[-2] + rows, edges.shape[-1] + columns)
        # The padding shifts the lags, so that the lag of -(n // 2) becomes 0.
        shift = torch.nn.functional.pad(self._valid_gradients, (columns // 2, 0, rows // 2, 0))
        problem = least_squares_problem(
            padded_spectrum(edges, period), padded_spectrum(shift, period), self._size
        )
        found = minimise_nonnegative(problem.with_ridge(ridge), start, sum_is_one=False, steps=100)
        total = float(found.sum())
        return found / total if total > 0 else start


EDGE_PENALTIES = (4e-3, 2.0), (2e-2, 2.0), (2e-2, 20.0)
"""Penalties from which the search by strong edges starts: of each pixel with a gradient, and of the
kernel's squared norm, for photographs whose light has a standard deviation of LIGHT_DEVIATION.
Several are tried, since one doesn't suit all photographs."""

_WEIGHT_DIVISOR, _MAX_WEIGHT_DIVISION = 1.1, 40.0
"""Divisor of the edges' weight in each iteration, and the largest one over all scales. Chosen."""

_ITERATIONS_PER_SCALE = 5
"""Iterations of the search by edges at each scale. Chosen."""

_SPECK_SHARE = 0.1
"""Share of the kernel's light below which connected parts are removed. Chosen."""

_FIRST_NOISE, _MIN_NOISE = 2.0, 1e-3
"""First noise of the search by statistics, over the photograph's, and the smallest standard
deviation of the noise, which allows for errors of the model. Chosen."""

_BURN_IN_ROUNDS, _HISTORY_WEIGHT = 2, 0.75
"""First rounds of the search by statistics, in which the kernel doesn't change, and the weight of
the earlier samples in each round. Chosen."""


@dataclass(frozen=True, eq=False)
class NormalisedPhotograph:
    """A photograph, scaled to a standard deviation of LIGHT_DEVIATION.

    image: (rows, columns).
    valid: 1 where a pixel may be used, else 0.
    noise: standard deviation of a pixel.
    """

    image: torch.Tensor
    valid: torch.Tensor
    noise: float

    def downsample(self, factor: float) -> NormalisedPhotograph:
        """Shrink the photograph by a factor."""
        if factor == 1:
            return self
        known = (downsample(self.valid, factor) > 0.999).to(self.image)
        return NormalisedPhotograph(downsample(self.image, factor), known, self.noise / factor)


def search_kernel_by_edges(
    photo: NormalisedPhotograph, size: int, weight: float, ridge: float, progress: Progress
) -> torch.Tensor:
    """Search for a kernel by strong edges, from coarse to fine scales.

    size: odd side of the kernel, which is (size, size).
    weight, ridge: see EDGE_PENALTIES. The weight decreases from one iteration to the next.
    """
    kernel, first = point_kernel(3), weight
    kernel[1, 0] = kernel[1, 1] = 0.5
    # From coarse to 1; a kernel has at least 3 pixels at the coarsest scale.
    count = max(0, math.floor(math.log(size / 3) / math.log(_SCALE_STEP)))
    ladder = [_SCALE_STEP**number for number in range(count, -1, -1)]
    for number, factor in enumerate(ladder):
        progress.report(number / len(ladder), f"strong edges, 1/{factor:.3g} of the size")
        n = next_odd(size / factor)
        kernel = enlarge_kernel(kernel, ladder[number - 1] / factor if number else 1.0, n)
        smaller, used = photo.downsample(factor), weight
        strong = StrongEdges(smaller.image, smaller.valid, (n, n))
        for _ in range(_ITERATIONS_PER_SCALE):
            progress.raise_if_cancelled()
            picture = strong.estimate_picture(kernel, used)
            kernel = strong.estimate_kernel(picture, kernel, ridge)
            kernel = without_specks(kernel, 0.0, _SPECK_SHARE)
            used /= _WEIGHT_DIVISOR
        weight = max(weight / _WEIGHT_DIVISOR**_ITERATIONS_PER_SCALE, first / _MAX_WEIGHT_DIVISION)
        kernel = centre_kernel(kernel, n)
    return kernel


def refine_kernel_by_statistics(
    photo: NormalisedPhotograph, start: torch.Tensor, progress: Progress, rounds: int = 20
) -> torch.Tensor:
    """Find the likeliest kernel over all sharp pictures that natural statistics allow.

    It is that of the finest scale. The algorithm is stochastic expectation maximisation (Delyon,
    Lavielle and Moulines 1999, doi 10.1214/aos/1018031103), with samples from a fixed seed. The
    assumed noise decreases to the photograph's noise in the last of the `rounds`.
    """
    size = start.shape[0], start.shape[1]
    latent = LatentImageSampler(photo.image, photo.valid, NATURAL_GRADIENTS, size, seed=0)
    kernel, noise = start, max(photo.noise, _MIN_NOISE)
    told: QuadraticProblem | None = None
    for number in range(rounds):
        progress.report(number / rounds, f"natural statistics {number + 1}/{rounds}")
        factor = _FIRST_NOISE ** (1 - number / (rounds - 1))
        latent.sample(kernel, noise * factor)
        now = latent.kernel_problem(kernel)
        if told is not None:
            now = QuadraticProblem(
                torch.lerp(now.normal_matrix, told.normal_matrix, _HISTORY_WEIGHT),
                torch.lerp(now.right_hand_side, told.right_hand_side, _HISTORY_WEIGHT),
            )
        told = now
        if number >= _BURN_IN_ROUNDS:
            kernel = minimise_nonnegative(told, kernel, sum_is_one=True)
    return kernel


_PARTS = 2
"""Number of parts into which the photograph is divided along each axis."""


def kernel_deviation(
    photo: NormalisedPhotograph,
    kernel: torch.Tensor,
    rival: torch.Tensor,
    refine: Callable[[NormalisedPhotograph, torch.Tensor, Progress], torch.Tensor],
    progress: Progress,
) -> torch.Tensor:
    """Estimate the standard deviation of each pixel of a kernel.

    `refine` estimates the kernel again from parts of the photograph that share no pixel. The
    variance of the mean of these kernels is their variance over their number. `rival` is a kernel
    of the same size that was found from another start. Its difference from the kernel shows whether
    the search has converged, which the parts can't show, since they start from the same kernel
    (Gelman and Rubin 1992, doi 10.1214/ss/1177011136).
    """
    rows, columns = photo.image.shape
    square = torch.zeros_like(kernel)
    for number in range(_PARTS**2):
        y, x = divmod(number, _PARTS)
        inside = (
            slice(rows * y // _PARTS, rows * (y + 1) // _PARTS),
            slice(columns * x // _PARTS, columns * (x + 1) // _PARTS),
        )
        part = NormalisedPhotograph(photo.image[inside], photo.valid[inside], photo.noise)
        told = progress.part(number / _PARTS**2, (number + 1) / _PARTS**2)
        square += (align_kernel(refine(part, kernel, told), kernel) - kernel).square()
    # The factor of 2 in the deviation allows for the error that all parts share. It was measured on
    # photographs with known kernels.
    spread = 2.0**2 * square / _PARTS**2 / (_PARTS**2 - 1)
    spread = spread + (align_kernel(rival, kernel) - kernel).square()
    # Neighbouring pixels of the kernel are taken to have similar variances.
    pooled = torch.nn.functional.avg_pool2d(spread[None, None], 3, 1, 1)[0, 0]
    return pooled.sqrt()


def align_kernel(kernel: torch.Tensor, reference: torch.Tensor) -> torch.Tensor:
    """Shift a kernel to the best match with a reference of the same size, by quarter pixels.

    The position of a kernel is arbitrary, since the photograph doesn't show where the scene was
    before the blur.
    """
    steps = 4
    rows, columns = reference.shape
    period = (2 * rows, 2 * columns)
    spectrum = torch.fft.fft2(kernel, s=period)
    cross = spectrum.conj() * torch.fft.fft2(reference, s=period)
    fine = centred_pad(torch.fft.fftshift(cross), tuple(steps * n for n in period))
    likeness = torch.fft.ifft2(torch.fft.ifftshift(fine)).real
    place = int(likeness.argmax())
    y, x = divmod(place, likeness.shape[1])
    way = [
        (at if at < n // 2 else at - n) / steps
        for at, n in zip((y, x), likeness.shape, strict=True)
    ]
    turn = [
        torch.exp(-2j * math.pi * torch.fft.fftfreq(n) * shift)
        for n, shift in zip(period, way, strict=True)
    ]
    moved = torch.fft.ifft2(spectrum * turn[0][:, None] * turn[1]).real
    return moved[:rows, :columns].to(kernel)
