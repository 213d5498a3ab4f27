"""Search for a blur kernel by strong edges, and fit a kernel to known gradients."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.ndimage
import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.blur import transfer_function
from optics.inverse.gradient_statistics import gradients
from optics.inverse.observation import extend_periodically
from optics.inverse.operator import squared_modulus
from optics.inverse.priors import laplacian_spectrum
from optics.plane import centred_crop, centred_pad
from optics.progress import Progress

_SCALE_STEP = math.sqrt(2)  # ratio between one scale of the kernel search and the next


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
    """Enlarge a kernel to (size, size), with a sum of 1 and its origin at n // 2."""
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

    It may extend beyond the kernel. Of the windows that hold the most light, it's the one whose
    centre n // 2 is nearest to the kernel's centroid.
    """
    first = []
    for dim in (0, 1):
        profile = torch.nn.functional.pad(kernel.sum(1 - dim), (size, size))
        inside = torch.nn.functional.pad(profile.to(torch.float64).cumsum(0), (1, 0))
        held, whole = inside[size:] - inside[:-size], float(inside[-1])
        centroid = float((profile * torch.arange(profile.numel())).sum()) / whole
        # A window may lose up to 0.2 % more of the light than the best one to be centred better.
        good = (held >= float(held.max()) - 2e-3 * whole).nonzero().ravel().tolist()
        off = [abs(start + size // 2 - centroid) for start in good]
        first.append(int(good[off.index(min(off))]) - size)
    return first[0], first[1]


def cut_window(kernel: torch.Tensor, first: tuple[int, int], size: int) -> torch.Tensor:
    """Cut a (size, size) window out of a kernel, padded with zeros.

    It may start up to `size` pixels outside the kernel.
    """
    padded = torch.nn.functional.pad(kernel, (size, size, size, size))
    y, x = first[0] + size, first[1] + size
    return padded[y : y + size, x : x + size]


def align_kernel(kernel: torch.Tensor, reference: torch.Tensor) -> torch.Tensor:
    """Shift a kernel to the best match with a reference of the same size, by quarter pixels.

    The photograph doesn't show where the scene was before the blur.
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
    turn = []
    for at, whole, n in zip((y, x), likeness.shape, period, strict=True):
        shift = (at if at < whole // 2 else at - whole) / steps
        turn.append(torch.exp(-2j * math.pi * torch.fft.fftfreq(n) * shift))
    moved = torch.fft.ifft2(spectrum * turn[0][:, None] * turn[1]).real
    return moved[:rows, :columns].to(kernel)


def without_specks(kernel: torch.Tensor, faint: float, small: float) -> torch.Tensor:
    """Remove faint pixels and small isolated parts from a kernel; the result sums to 1.

    Pixels below the share `faint` of the peak are set to 0, and so are connected parts with less
    than the share `small` of the light.
    """
    kept = torch.where(kernel >= faint * kernel.max(), kernel, 0.0)
    if small > 0:
        parts, count = scipy.ndimage.label(kept.numpy() > 0, np.ones((3, 3)))
        light = scipy.ndimage.sum_labels(kept.numpy(), parts, np.arange(count + 1))
        weak = light < small * min(float(kept.sum()), float(light.max()))
        kept = torch.where(torch.from_numpy(weak[parts]), 0.0, kept)
    return kept / kept.sum()


@dataclass(frozen=True, eq=False)
class QuadraticProblem:
    """The quadratic objective k^T N k / 2 - r^T k of a blur kernel k, row by row.

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
        """Estimate the kernel k, of sum 1, that blurs a picture most nearly to the photograph.

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

# Divisor of the edges' weight in each iteration, and the largest one over all scales. Chosen.
_WEIGHT_DIVISOR, _MAX_WEIGHT_DIVISION = 1.1, 40.0

_ITERATIONS_PER_SCALE = 5  # iterations of the search by edges at each scale; chosen

_SPECK_SHARE = 0.1  # share of the kernel's light below which connected parts are removed; chosen


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
