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

from optics.deconvolution.noise import squared_modulus
from optics.deconvolution.observation import Observation, require_psf
from optics.deconvolution.restored_image import RestoredImage
from optics.deconvolution.wiener import Frequencies, least_error_weight
from optics.operators.blur import Border, require_border
from optics.threads import single_threaded
from optics.validation import accepts_numpy, require_finite, require_positive

ScenePrior = Literal["flat", "neighbours"]

SCENE_PRIORS: tuple[ScenePrior, ...] = ("neighbours", "flat")

_CORRELATION = 0.95
"""Of neighbouring pixels, as that of photographs (Jain 1989, chapter 2)."""

_DECADES = range(-8, 4)
"""Powers of ten that are tried as weights."""


@accepts_numpy
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


@accepts_numpy
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

    left_vectors: U, (frame, rank). singular_values: s. right_vectors: the prior's root times V, of
    what the frame sees, (frame, rank).
    """

    left_vectors: torch.Tensor
    singular_values: torch.Tensor
    right_vectors: torch.Tensor

    @classmethod
    def of(cls, kernel: torch.Tensor, length: int, border: Border, prior: ScenePrior) -> _Axis:
        blur = blur_matrix(kernel.to(torch.float64), length, border)
        root = _prior_root(blur.shape[1], border, prior)
        u, s, vh = torch.linalg.svd(blur if root is None else blur @ root, full_matrices=False)
        right = vh.mT if root is None else root @ vh.mT
        n = len(kernel)
        first = n - 1 - n // 2 if border == "unknown" else 0
        return cls(u, s, right[first : first + length])


def _prior_root(length: int, border: Border, prior: ScenePrior) -> torch.Tensor | None:
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

    @accepts_numpy
    def __init__(
        self,
        down: torch.Tensor,
        along: torch.Tensor,
        shape: tuple[int, int],
        border: Border = "unknown",
        prior: ScenePrior = "flat",
        *,
        joint: bool = True,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        if prior not in SCENE_PRIORS:
            raise ValueError(f"prior is {prior!r}; take one of {', '.join(SCENE_PRIORS)}")
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
            _Axis(
                *(
                    m.to(dtype)
                    for m in (axis.left_vectors, axis.singular_values, axis.right_vectors)
                )
            )
            for axis in axes
        )

    @property
    def multiplications(self) -> int:
        """Of one call: four products of a picture and a matrix, and the gain; two without it."""
        m, n = self.shape
        p, q = len(self._rows.singular_values), len(self._columns.singular_values)
        if not self.joint:
            return m * m * n + m * n * n
        return p * m * n + p * n * q + p * q + m * p * q + m * q * n

    @accepts_numpy
    def coefficients(self, image: torch.Tensor) -> torch.Tensor:
        """Of frames (..., rows, columns) in the two bases."""
        if tuple(image.shape[-2:]) != self.shape:
            raise ValueError(f"image is {tuple(image.shape)}; its last axes must be {self.shape}")
        return self._rows.left_vectors.mT @ image @ self._columns.left_vectors

    def coefficient_gain(self, weight: float) -> torch.Tensor:
        """Of each coefficient of the photograph, that of the scene; times the blur's own it is 1
        where nothing is lost."""
        require_positive("weight", weight, "")
        s, t = self._rows.singular_values[:, None], self._columns.singular_values
        if self.joint:
            return s * t / ((s * t).square() + weight)
        return s / (s.square() + weight) * (t / (t.square() + weight))

    @accepts_numpy
    def restore(self, coefficients: torch.Tensor, weight: float) -> torch.Tensor:
        """The scene in the frame, from coefficients()."""
        return (
            self._rows.right_vectors
            @ (coefficients * self.coefficient_gain(weight))
            @ self._columns.right_vectors.mT
        )

    @accepts_numpy
    def __call__(self, image: torch.Tensor, weight: float) -> torch.Tensor:
        """The X with the least |A X B^T - image|² + weight * (X by its prior's covariance), in the
        frame; of `image` less its brightness, for the prior wants darkness."""
        if self.joint:
            return self.restore(self.coefficients(image), weight)
        down, along = self.axis_filters(weight)
        return down @ image @ along.mT

    def axis_filters(self, weight: float) -> tuple[torch.Tensor, torch.Tensor]:
        """Of each axis by itself, (rows, rows) and (columns, columns)."""
        require_positive("weight", weight, "")
        down, along = (
            (axis.right_vectors * (axis.singular_values / (axis.singular_values.square() + weight)))
            @ axis.left_vectors.mT
            for axis in (self._rows, self._columns)
        )
        return down, along

    def residual_coefficients(self, coefficients: torch.Tensor, weight: float) -> torch.Tensor:
        """What a restoration leaves of the photograph, in its coefficients."""
        through = (
            self._rows.singular_values[:, None]
            * self._columns.singular_values
            * self.coefficient_gain(weight)
        )
        return coefficients * (1 - through)


@single_threaded
def restore_separable(
    observation: Observation,
    weight: float | None = None,
    prior: ScenePrior = "neighbours",
    *,
    joint: bool = True,
    tol: float = 1e-3,
) -> RestoredImage:
    """The picture of least |H X - O|² + weight * (X by its prior), exactly and without iterations,
    (rows, columns): linear, so that it may be negative where the light is dim. Differentiable.

    prior, joint: see SeparableFilter; "flat" is wiener()'s "flat" with as many steps as it likes.
    weight: if None, by cross-validation, or for a flat prior the one with the least error that the
    photograph's spectrum predicts. The mean brightness is set apart. tol: as in separable_parts().
    Raises ValueError for a PSF that doesn't separate, a weight that isn't positive, or pixels that
    have weights or were clipped, which don't separate.
    """
    if observation.effective_weights is not None:
        raise ValueError("weights or clipped pixels don't separate into rows and columns; use "
                         "wiener or total_variation")  # fmt: skip
    down, along = separable_parts(observation.psf / observation.psf_sum, tol)
    planned = SeparableFilter(
        down, along, (observation.image.shape[0], observation.image.shape[1]),
        observation.border, prior, joint=joint, dtype=observation.image.dtype,
    )  # fmt: skip
    mean = observation.normalised_image.mean()
    coefficients = planned.coefficients(observation.normalised_image - mean)
    if weight is None:
        weight = _choose_weight(observation, planned, coefficients.detach(), (down, along))
    picture = planned.restore(coefficients, weight) + mean
    squares = float(planned.residual_coefficients(coefficients.detach(), weight).square().mean())
    name = f"separable, {prior}" + ("" if joint else ", each axis by itself")
    return RestoredImage(
        picture, name, observation.noise, squares**0.5 / observation.scene_noise, weight
    )


def _choose_weight(
    observation: Observation,
    separable_filter: SeparableFilter,
    coefficients: torch.Tensor,
    kernels: tuple[torch.Tensor, torch.Tensor],
) -> float:
    """Weight. A flat prior is so far from photographs that no comparison of data and prior finds
    it: there the spectrum says what is lost."""
    if separable_filter.prior == "neighbours":
        return _cross_validated_weight(separable_filter, coefficients)
    if not separable_filter.joint:
        return _predicted_weight(observation, *kernels)
    power = observation.squared_mtf.to(torch.float64)
    return least_error_weight(observation, lambda k, at: power[at] / (power[at] + k))


def _predicted_weight(observation: Observation, down: torch.Tensor, along: torch.Tensor) -> float:
    """Of a flat prior and a filter for each axis, as if the period were seen whole."""
    rows, columns = observation.period_shape
    y = squared_modulus(torch.fft.fft(down.to(torch.float64), rows))[:, None]
    x = squared_modulus(torch.fft.rfft(along.to(torch.float64), columns))

    def through(k: float, at: Frequencies) -> torch.Tensor:
        rows, columns = y[at[0]], x[at[1]]
        return rows / (rows + k) * (columns / (columns + k))

    return least_error_weight(observation, through)


def _cross_validated_weight(separable_filter: SeparableFilter, coefficients: torch.Tensor) -> float:
    """By generalised cross-validation (Golub, Heath and Wahba 1979, doi
    10.1080/00401706.1979.10489751): the one with which each pixel is best told from the others. It
    takes the border into account, and needs no noise."""
    data = coefficients.to(torch.float64)
    ones = torch.ones_like(data)

    def cross_validation_error(power: float) -> float:
        left, free = (
            separable_filter.residual_coefficients(data, 10**power),
            separable_filter.residual_coefficients(ones, 10**power),
        )
        return float(left.square().mean() / free.mean().square())

    coarse = min(_DECADES, key=cross_validation_error)
    fine = minimize_scalar(
        cross_validation_error,
        bounds=(coarse - 1, coarse + 1),
        method="bounded",
        options={"xatol": 0.02},
    )
    return float(10 ** (fine.x if fine.fun < cross_validation_error(coarse) else coarse))
