"""Linear restoration axis by axis, where the PSF is a column times a row, as a cubic plate's is.

The photograph is Y = A X B^T, with a matrix for the blur down the columns and one for that along
the rows, and with any border: where the scene goes on beyond the frame, A and B have more columns
than rows. What separates, with their singular values s and t:

- a weight on |X|²: the solution has s t / (s² t² + weight) between the two bases. Its denominator
  is no product, so that no two filters give it; but the bases are each an axis' own (Hansen, Nagy
  and O'Leary, Deblurring Images, 2006, chapter 4, doi 10.1137/1.9780898718874);
- a Gaussian prior whose covariance is itself a column's times a row's: the same, after each axis
  was whitened;
- a filter for each axis, s / (s² + weight) times t / (t² + weight) (thesis section 2.5): two
  products of matrices, but it pays for noise on each axis as if the other weren't blurred.

What doesn't: a weight on the gradient's square, |D X|² + |X D^T|². It would need A^T A, D^T D and 1
to have the same eigenvectors, and they do on a period alone, where they are Fourier's; nor weights
of single pixels. See optics.deconvolution.wiener for those.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from scipy.optimize import minimize_scalar

from optics.deconvolution.blurred import Blurred, require_psf
from optics.deconvolution.noise import squared
from optics.deconvolution.restored import Restored
from optics.deconvolution.wiener import Frequencies, least_error
from optics.edge import require_finite, require_positive, tensors_inside
from optics.operators.blur import Border, require_border
from optics.threads import single_threaded

Likeness = Literal["flat", "neighbours"]

LIKENESSES: tuple[Likeness, ...] = ("neighbours", "flat")

_CORRELATION = 0.95
"""Of neighbouring pixels, as that of photographs (Jain 1989, chapter 2)."""

_DECADES = range(-8, 4)
"""Powers of ten that are tried as weights."""


@tensors_inside
def separable_parts(psf: torch.Tensor, tol: float = 1e-3) -> tuple[torch.Tensor, torch.Tensor]:
    """The column and the row whose product is the PSF, (rows, columns): psf = down x along.

    The nearest ones (Eckart and Young 1936), in the PSF's precision; down sums to 1. tol: the
    largest part of the PSF, relative L2, that they may leave out. Raises ValueError that says how
    large it is where it is larger.
    """
    require_finite("psf", psf)
    if psf.ndim != 2:
        raise ValueError(f"psf is {tuple(psf.shape)}; give (rows, columns)")
    require_psf(psf)
    exact = psf.to(torch.float64)
    u, s, vh = torch.linalg.svd(exact, full_matrices=False)
    left_out = float(torch.linalg.vector_norm(s[1:]) / torch.linalg.vector_norm(s))
    if not left_out <= tol:
        raise ValueError(
            f"psf isn't separable: the nearest product of a column and a row leaves out "
            f"{left_out:.2g} of it, more than tol {tol:g}; allow it, or use another method"
        )
    down, along = u[:, 0] * s[0], vh[0]
    share = down.sum()
    return (down / share).to(psf), (along * share).to(psf)


@tensors_inside
def blur_matrix(kernel: torch.Tensor, length: int, border: Border) -> torch.Tensor:
    """The blur of one axis, (length, scene): what each of `length` pixels gets of the scene.

    kernel: (n,), origin at n // 2. The scene is as long as the frame, but for an "unknown" border:
    n - 1 longer, all that light comes from; n - 1 - n // 2 of it before the frame.
    """
    require_border(border)
    n = len(kernel)
    pixel = torch.arange(length)[:, None]
    source = pixel + n // 2 - torch.arange(n)
    scene = length
    if border == "unknown":
        source, scene = source + (n - 1 - n // 2), length + n - 1
    share = kernel.expand(length, n)
    if border == "periodic":
        source = source % length
    else:
        inside = (source >= 0) & (source < scene)
        source, share = source.clamp(0, scene - 1), share * inside
    return kernel.new_zeros(length, scene).scatter_add(1, source, share)


@dataclass(frozen=True, eq=False)
class _Axis:
    """One axis' blur U diag(s) V^T of a whitened scene, and what makes a scene of that.

    left: U, (frame, rank). values: s. right: the prior's root times V, of what the frame sees,
    (frame, rank).
    """

    left: torch.Tensor
    values: torch.Tensor
    right: torch.Tensor

    @classmethod
    def of(cls, kernel: torch.Tensor, length: int, border: Border, prior: Likeness) -> _Axis:
        blur = blur_matrix(kernel.to(torch.float64), length, border)
        root = _root(blur.shape[1], border, prior)
        u, s, vh = torch.linalg.svd(blur if root is None else blur @ root, full_matrices=False)
        right = vh.mT if root is None else root @ vh.mT
        n = len(kernel)
        first = n - 1 - n // 2 if border == "unknown" else 0
        return cls(u, s, right[first : first + length])


def _root(length: int, border: Border, prior: Likeness) -> torch.Tensor | None:
    """R of a scene's covariance R R^T along an axis, relative to its variance; None for 1."""
    if prior == "flat":
        return None
    if border == "periodic":
        f = torch.fft.fftfreq(length, dtype=torch.float64)
        r = _CORRELATION
        # Of a correlation that falls geometrically, around the period.
        spectrum = ((1 - r**2) / (1 - 2 * r * torch.cos(2 * torch.pi * f) + r**2)).sqrt()
        wave = torch.fft.ifft(spectrum.to(torch.complex128)).real
        index = torch.arange(length)
        return wave[(index[:, None] - index) % length]
    index = torch.arange(length, dtype=torch.float64)
    return torch.linalg.cholesky(_CORRELATION ** (index[:, None] - index).abs())


class SeparableFilter:
    """A linear restoration of frames of one shape, blurred by down x along: planned once, by the
    singular values of two matrices, and called many times. Differentiable.

    down, along: see separable_parts(). shape: of a frame, (rows, columns). prior: "flat", for a
    scene whose pixels know nothing of each other; "neighbours", where they correlate by 0.95 a
    pixel along each axis. joint: whether the weight is set against both axes' blur together, as
    Wiener's filter does; each axis has a filter of its own if False.
    Raises ValueError for another prior or border, or kernels that aren't finite.
    """

    @tensors_inside
    def __init__(
        self,
        down: torch.Tensor,
        along: torch.Tensor,
        shape: tuple[int, int],
        border: Border = "unknown",
        prior: Likeness = "flat",
        *,
        joint: bool = True,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        if prior not in LIKENESSES:
            raise ValueError(f"prior is {prior!r}; take one of {', '.join(LIKENESSES)}")
        for name, kernel in (("down", down), ("along", along)):
            require_finite(name, kernel)
            if kernel.ndim != 1:
                raise ValueError(f"{name} is {tuple(kernel.shape)}; a kernel has one axis")
        self.shape = (int(shape[0]), int(shape[1]))
        self.prior, self.joint = prior, joint
        axes = (
            _Axis.of(kernel, length, border, prior)
            for kernel, length in zip((down, along), self.shape, strict=True)
        )
        self._rows, self._columns = (
            _Axis(*(m.to(dtype) for m in (axis.left, axis.values, axis.right))) for axis in axes
        )

    @property
    def multiplications(self) -> int:
        """Of one call: four products of a picture and a matrix, and the gain; two without it."""
        m, n = self.shape
        p, q = len(self._rows.values), len(self._columns.values)
        if not self.joint:
            return m * m * n + m * n * n
        return p * m * n + p * n * q + p * q + m * p * q + m * q * n

    @tensors_inside
    def coefficients(self, image: torch.Tensor) -> torch.Tensor:
        """Of frames (..., rows, columns) in the two bases."""
        if tuple(image.shape[-2:]) != self.shape:
            raise ValueError(f"image is {tuple(image.shape)}; its last axes must be {self.shape}")
        return self._rows.left.mT @ image @ self._columns.left

    def gain(self, weight: float) -> torch.Tensor:
        """Of each coefficient of the photograph, that of the scene; times the blur's own it is 1
        where nothing is lost."""
        require_positive("weight", weight, "")
        s, t = self._rows.values[:, None], self._columns.values
        if self.joint:
            return s * t / ((s * t).square() + weight)
        return s / (s.square() + weight) * (t / (t.square() + weight))

    @tensors_inside
    def restored(self, coefficients: torch.Tensor, weight: float) -> torch.Tensor:
        """The scene in the frame, from coefficients()."""
        return self._rows.right @ (coefficients * self.gain(weight)) @ self._columns.right.mT

    @tensors_inside
    def __call__(self, image: torch.Tensor, weight: float) -> torch.Tensor:
        """The X with the least |A X B^T - image|² + weight * (X by its prior's covariance), in the
        frame; of `image` less its brightness, for the prior wants darkness."""
        if self.joint:
            return self.restored(self.coefficients(image), weight)
        down, along = self.filters(weight)
        return down @ image @ along.mT

    def filters(self, weight: float) -> tuple[torch.Tensor, torch.Tensor]:
        """Of each axis by itself, (rows, rows) and (columns, columns)."""
        require_positive("weight", weight, "")
        down, along = (
            (axis.right * (axis.values / (axis.values.square() + weight))) @ axis.left.mT
            for axis in (self._rows, self._columns)
        )
        return down, along

    def left(self, coefficients: torch.Tensor, weight: float) -> torch.Tensor:
        """What a restoration leaves of the photograph, in its coefficients."""
        through = self._rows.values[:, None] * self._columns.values * self.gain(weight)
        return coefficients * (1 - through)


@single_threaded
def separable(
    seen: Blurred,
    weight: float | None = None,
    prior: Likeness = "neighbours",
    *,
    joint: bool = True,
    tol: float = 1e-3,
) -> Restored:
    """The picture of least |H X - O|² + weight * (X by its prior), exactly and without iterations,
    (rows, columns): linear, so that it may be negative where the light is dim. Differentiable.

    prior, joint: see SeparableFilter; "flat" is wiener()'s "flat" with as many steps as it likes.
    weight: if None, by cross-validation, or for a flat prior the one with the least error that the
    photograph's spectrum predicts. The mean brightness is set apart. tol: as in separable_parts().
    Raises ValueError for a PSF that doesn't separate, a weight that isn't positive, or pixels that
    have weights or were clipped, which don't separate.
    """
    if seen.trust is not None:
        raise ValueError("weights or clipped pixels don't separate into rows and columns; use "
                         "wiener or total_variation")  # fmt: skip
    down, along = separable_parts(seen.psf / seen.gain, tol)
    planned = SeparableFilter(
        down, along, (seen.image.shape[0], seen.image.shape[1]), seen.border, prior,
        joint=joint, dtype=seen.image.dtype,
    )  # fmt: skip
    mean = seen.data.mean()
    coefficients = planned.coefficients(seen.data - mean)
    if weight is None:
        weight = _chosen(seen, planned, coefficients.detach(), (down, along))
    picture = planned.restored(coefficients, weight) + mean
    squares = float(planned.left(coefficients.detach(), weight).square().mean())
    name = f"separable, {prior}" + ("" if joint else ", each axis by itself")
    return Restored(picture, name, seen.noise, squares**0.5 / seen.deviation, weight)


def _chosen(
    seen: Blurred,
    planned: SeparableFilter,
    coefficients: torch.Tensor,
    kernels: tuple[torch.Tensor, torch.Tensor],
) -> float:
    """Weight. A flat prior is so far from photographs that no comparison of data and prior finds
    it: there the spectrum says what is lost."""
    if planned.prior == "neighbours":
        return _validated_weight(planned, coefficients)
    if not planned.joint:
        return _predicted_weight(seen, *kernels)
    power = seen.power.to(torch.float64)
    return least_error(seen, lambda k, at: power[at] / (power[at] + k))


def _predicted_weight(seen: Blurred, down: torch.Tensor, along: torch.Tensor) -> float:
    """Of a flat prior and a filter for each axis, as if the period were seen whole."""
    rows, columns = seen.whole
    y = squared(torch.fft.fft(down.to(torch.float64), rows))[:, None]
    x = squared(torch.fft.rfft(along.to(torch.float64), columns))

    def through(k: float, at: Frequencies) -> torch.Tensor:
        rows, columns = y[at[0]], x[at[1]]
        return rows / (rows + k) * (columns / (columns + k))

    return least_error(seen, through)


def _validated_weight(planned: SeparableFilter, coefficients: torch.Tensor) -> float:
    """By generalised cross-validation (Golub, Heath and Wahba 1979, doi
    10.1080/00401706.1979.10489751): the one with which each pixel is best told from the others. It
    takes the border into account, and needs no noise."""
    data = coefficients.to(torch.float64)
    ones = torch.ones_like(data)

    def unlikeliness(power: float) -> float:
        left, free = planned.left(data, 10**power), planned.left(ones, 10**power)
        return float(left.square().mean() / free.mean().square())

    coarse = min(_DECADES, key=unlikeliness)
    fine = minimize_scalar(
        unlikeliness, bounds=(coarse - 1, coarse + 1), method="bounded", options={"xatol": 0.02}
    )
    return float(10 ** (fine.x if fine.fun < unlikeliness(coarse) else coarse))
