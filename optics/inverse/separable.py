"""Linear restoration axis by axis, for a separable PSF such as that of a cubic phase mask.

A separable PSF is a column times a row. The photograph is then Y = A X B^T, where the matrix A
blurs down the columns and B along the rows, with any border. With the singular values s of A and t
of B, these restorations are separable:

- A penalty on |X|². The coefficients of the photograph in the two bases of singular vectors are
  multiplied by s t / (s² t² + weight) (Hansen, Nagy and O'Leary, Deblurring Images, 2006, chapter
  4, doi 10.1137/1.9780898718874).
- A Gaussian prior whose covariance is a product of one for the columns and one for the rows. After
  each axis is whitened, it is the first case.
- One filter for each axis, s / (s² + weight) times t / (t² + weight) (thesis section 2.5). It takes
  only two matrix products, but it weighs the noise on each axis as if the other had no blur.

Neither a penalty on the squared gradient, |D X|² + |X D^T|², nor weights of single pixels are
separable: see optics.inverse.wiener.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import torch
from scipy.optimize import minimize_scalar

from optics.inverse.blur import Border, require_border
from optics.inverse.observation import Observation, require_psf
from optics.inverse.operator import squared_modulus
from optics.inverse.own_terms import in_own_unit
from optics.inverse.restored_image import RestoredImage
from optics.inverse.wiener import Frequencies, least_error_weight
from optics.threads import single_threaded
from optics.validation import accepts_numpy, require_finite, require_positive

ScenePrior = Literal["flat", "neighbours"]

SCENE_PRIORS: tuple[ScenePrior, ...] = ("neighbours", "flat")


@accepts_numpy
def separable_parts(psf: torch.Tensor, tol: float = 1e-3) -> tuple[torch.Tensor, torch.Tensor]:
    """Split a PSF, (rows, columns), into a column and a row: psf = down x along.

    Of all products of a column and a row, the result is nearest to it (Eckart and Young 1936).
    `down` sums to 1. Raises a ValueError that states the difference if it is above `tol`.

    tol: largest relative L2 difference between PSF and product that is allowed.
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
    """Build the matrix that blurs along one axis by a kernel with its origin at n // 2.

    It is (length, scene). The scene is as long as the frame, but with an "unknown" border n - 1
    pixels longer, of which n - 1 - n // 2 lie before the frame.
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


class _Axis(NamedTuple):
    """The singular value decomposition U diag(s) V^T of one axis' blur of a whitened scene.

    The right vectors are the root of the prior's covariance times V, for the pixels in the frame,
    (frame, rank), as U.
    """

    left_vectors: torch.Tensor
    singular_values: torch.Tensor
    right_vectors: torch.Tensor


def _decompose(kernel: torch.Tensor, length: int, border: Border, prior: ScenePrior) -> _Axis:
    blur = blur_matrix(kernel.to(torch.float64), length, border)
    scene, n = blur.shape[1], len(kernel)
    # The root R of the scene's correlation R R^T, which of neighbouring pixels in photographs is
    # 0.95 (Jain 1989, chapter 2).
    root, r = None, 0.95
    if prior != "flat" and border == "periodic":
        f = torch.fft.fftfreq(scene, dtype=torch.float64)
        # This is the power spectrum of a correlation that falls geometrically, on a period.
        spectrum = ((1 - r**2) / (1 - 2 * r * torch.cos(2 * torch.pi * f) + r**2)).sqrt()
        wave = torch.fft.ifft(spectrum.to(torch.complex128)).real
        index = torch.arange(scene)
        root = wave[(index[:, None] - index) % scene]
    elif prior != "flat":
        place = torch.arange(scene, dtype=torch.float64)
        root = torch.linalg.cholesky(r ** (place[:, None] - place).abs())
    u, s, vh = torch.linalg.svd(blur if root is None else blur @ root, full_matrices=False)
    right = vh.mT if root is None else root @ vh.mT
    first = n - 1 - n // 2 if border == "unknown" else 0
    return _Axis(u, s, right[first : first + length])


class SeparableFilter:
    """A linear filter for any number of photographs of one shape with a separable PSF.

    It is differentiable. Raises ValueError for another prior or border, or kernels that aren't
    finite.

    down, along: column and row of the PSF: see separable_parts().
    shape: the photograph's (rows, columns).
    border: what the scene does beyond the frame.
    prior: "flat" takes the scene's pixels as uncorrelated. "neighbours" takes them as correlated by
        0.95 per pixel along each axis.
    joint: whether the weight is compared with the product of both axes' singular values, as in a
        Wiener filter. Otherwise each axis has its own filter.
    dtype: precision of the computation.
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
        self._rows, self._columns = (
            _Axis(*(part.to(dtype) for part in _decompose(kernel, length, border, prior)))
            for kernel, length in zip((down, along), self.shape, strict=True)
        )

    @property
    def multiplications(self) -> int:
        """The number of multiplications for one photograph, in four or two matrix products."""
        m, n = self.shape
        p, q = len(self._rows.singular_values), len(self._columns.singular_values)
        if not self.joint:
            return m * m * n + m * n * n
        return p * m * n + p * n * q + p * q + m * p * q + m * q * n

    @accepts_numpy
    def coefficients(self, image: torch.Tensor) -> torch.Tensor:
        """Return the coefficients of photographs, (..., rows, columns), in the two SVD bases."""
        if tuple(image.shape[-2:]) != self.shape:
            raise ValueError(f"image is {tuple(image.shape)}; its last axes must be {self.shape}")
        return self._rows.left_vectors.mT @ image @ self._columns.left_vectors

    def coefficient_gain(self, weight: float) -> torch.Tensor:
        """Return the gain of each SVD coefficient, from photograph to scene.

        The gain times the singular values is 1 where nothing is lost.
        """
        require_positive("weight", weight, "")
        s, t = self._rows.singular_values[:, None], self._columns.singular_values
        if self.joint:
            return s * t / ((s * t).square() + weight)
        return s / (s.square() + weight) * (t / (t.square() + weight))

    @accepts_numpy
    def restore(self, coefficients: torch.Tensor, weight: float) -> torch.Tensor:
        """Compute the scene in the frame from the photograph's coefficients()."""
        return (
            self._rows.right_vectors
            @ (coefficients * self.coefficient_gain(weight))
            @ self._columns.right_vectors.mT
        )

    @accepts_numpy
    def __call__(self, image: torch.Tensor, weight: float) -> torch.Tensor:
        """Compute the scene X in the frame from a photograph less its mean.

        X minimises |A X B^T - image|² + weight * (X in the norm of the inverse prior covariance).
        """
        if self.joint:
            return self.restore(self.coefficients(image), weight)
        require_positive("weight", weight, "")
        down, along = (
            (axis.right_vectors * (axis.singular_values / (axis.singular_values.square() + weight)))
            @ axis.left_vectors.mT
            for axis in (self._rows, self._columns)
        )
        return down @ image @ along.mT

    def residual_coefficients(self, coefficients: torch.Tensor, weight: float) -> torch.Tensor:
        """Return the residual as coefficients of the photograph."""
        through = (
            self._rows.singular_values[:, None]
            * self._columns.singular_values
            * self.coefficient_gain(weight)
        )
        return coefficients * (1 - through)


@single_threaded
@in_own_unit()
def restore_separable(
    observation: Observation,
    weight: float | None = None,
    prior: ScenePrior = "neighbours",
    *,
    joint: bool = True,
    tol: float = 1e-3,
) -> RestoredImage:
    """Deblur a photograph with a separable PSF by a linear filter, without iterations.

    The result is linear, so that it may be negative where the light is dim, and differentiable: see
    SeparableFilter. The mean of the photograph is subtracted before and added afterwards.

    Raises ValueError for a PSF that isn't separable, a weight that isn't positive, or pixels that
    have weights or are clipped, which aren't separable.

    weight: regularisation weight. If None, it comes from cross-validation, or for a flat prior it
        is the one with the least error that the photograph's spectrum predicts.
    prior: see SeparableFilter. "flat" is the limit of wiener() with "flat" and many steps.
    joint: see SeparableFilter.
    tol: largest part of the PSF that isn't separable: see separable_parts().
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
        # A flat prior describes photographs too poorly for cross-validation.
        if prior == "neighbours":
            weight = _cross_validated_weight(planned, coefficients.detach())
        else:
            weight = _predicted_weight(observation, down, along, joint)
    picture = planned.restore(coefficients, weight) + mean
    squares = float(planned.residual_coefficients(coefficients.detach(), weight).square().mean())
    name = f"separable, {prior}" + ("" if joint else ", each axis by itself")
    return RestoredImage(
        picture, name, observation.noise, squares**0.5 / observation.scene_noise, weight
    )


def _predicted_weight(
    observation: Observation, down: torch.Tensor, along: torch.Tensor, joint: bool
) -> float:
    """Predict the best weight for a flat prior from the photograph's spectrum.

    The prediction assumes that the whole period was measured.
    """
    if joint:
        power = observation.squared_mtf.to(torch.float64)
        return least_error_weight(observation, lambda k, at: power[at] / (power[at] + k))
    rows, columns = observation.period_shape
    y = squared_modulus(torch.fft.fft(down.to(torch.float64), rows))[:, None]
    x = squared_modulus(torch.fft.rfft(along.to(torch.float64), columns))

    def through(k: float, at: Frequencies) -> torch.Tensor:
        rows, columns = y[at[0]], x[at[1]]
        return rows / (rows + k) * (columns / (columns + k))

    return least_error_weight(observation, through)


def _cross_validated_weight(separable_filter: SeparableFilter, coefficients: torch.Tensor) -> float:
    """Choose the weight by generalised cross-validation, which doesn't need the noise.

    With this weight, each pixel is predicted best from the others (Golub, Heath and Wahba 1979, doi
    10.1080/00401706.1979.10489751).
    """
    data = coefficients.to(torch.float64)
    ones = torch.ones_like(data)

    def cross_validation_error(power: float) -> float:
        left, free = (
            separable_filter.residual_coefficients(data, 10**power),
            separable_filter.residual_coefficients(ones, 10**power),
        )
        return float(left.square().mean() / free.mean().square())

    coarse = min(range(-8, 4), key=cross_validation_error)
    fine = minimize_scalar(
        cross_validation_error,
        bounds=(coarse - 1, coarse + 1),
        method="bounded",
        options={"xatol": 0.02},
    )
    return float(10 ** (fine.x if fine.fun < cross_validation_error(coarse) else coarse))
