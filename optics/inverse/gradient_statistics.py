"""Statistics of natural pictures' gradients, most of which are nearly 0 and a few are large."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.validation import accepts_numpy, as_floating_point, require_finite

LIGHT_DEVIATION = 0.2
"""Typical standard deviation of a photograph's light whose full scale is 1. NATURAL_GRADIENTS is
for photographs that are scaled to it."""


def gradients(image: torch.Tensor) -> torch.Tensor:
    """Compute the differences along x and y, (2, rows - 1, columns - 1)."""
    corner = image[:-1, :-1]
    return torch.stack([image[:-1, 1:] - corner, image[1:, :-1] - corner])


@accepts_numpy
def log_histogram(
    image: torch.Tensor, bins: int = 101, reach: float | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute the natural logarithm of the gradients' probability density (thesis Fig. 2.10).

    Returns the centres of the bins, and the logarithms, -inf where a bin is empty; both are
    float64. Raises ValueError for pictures, (rows, columns), that are constant, too small or not
    finite, or for fewer than 3 bins.

    reach: gradients from -reach to reach are counted, all of them if None.
    """
    values = _gradient_values(image)
    if bins < 3:
        raise ValueError(f"bins is {bins}; give at least 3")
    reach = float(values.abs().max()) * (1 + 1e-9) if reach is None else float(reach)
    if not (reach > 0 and math.isfinite(reach)):
        raise ValueError(f"reach is {reach:g}; it must be positive and finite")
    width = 2 * reach / bins
    place = ((values + reach) / width).floor().long()
    place = place[(place >= 0) & (place < bins)]
    counts = torch.bincount(place, minlength=bins).to(torch.float64)
    middles = (torch.arange(bins, dtype=torch.float64) + 0.5) * width - reach
    return middles, (counts / (values.numel() * width)).log()


@dataclass(frozen=True)
class GaussianMixture:
    """A mixture of Gaussians with mean 0 (Fergus et al. 2006, doi 10.1145/1141911.1141956).

    The shares are the Gaussians' weights, which sum to 1.
    """

    shares: tuple[float, ...]
    deviations: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.shares) != len(self.deviations) or not self.shares:
            raise ValueError(
                f"{len(self.shares)} shares and {len(self.deviations)} deviations; give as many "
                "of one as of the other"
            )
        if min(self.shares) <= 0 or abs(sum(self.shares) - 1) > 1e-6:
            raise ValueError(f"shares are {self.shares}; they must be positive and sum to 1")
        if min(self.deviations) <= 0:
            raise ValueError(f"deviations are {self.deviations}; they must be positive")

    def log_density(self, values: torch.Tensor) -> torch.Tensor:
        """Return the natural log density of gradients."""
        return self.log_joint(values.square()).logsumexp(0) - 0.5 * math.log(2 * math.pi)

    def log_joint(self, squares: torch.Tensor) -> torch.Tensor:
        """Return the log of each Gaussian's part in the density, but for -log(2 pi) / 2.

        squares: squared gradients. The result is (components, ...).
        """
        parts = [
            math.log(share / deviation) - squares / (2 * deviation**2)
            for share, deviation in zip(self.shares, self.deviations, strict=True)
        ]
        return torch.stack(parts)


@dataclass(frozen=True)
class GeneralisedGaussian:
    """A distribution of gradients with a density proportional to exp(-|gradient / scale|^power).

    The power is 0.5 to 0.8 for natural pictures (Mallat 1989, doi 10.1109/34.192463).
    """

    scale: float
    power: float

    def log_density(self, values: torch.Tensor) -> torch.Tensor:
        """Return the natural log density of gradients."""
        top = math.log(self.power / (2 * self.scale)) - math.lgamma(1 / self.power)
        return top - (values.abs() / self.scale) ** self.power

    def moment(self, power: float) -> float:
        """Return the mean of ``|gradient|`` to a power above -1."""
        ratio = math.lgamma((power + 1) / self.power) - math.lgamma(1 / self.power)
        return self.scale**power * math.exp(ratio)


NATURAL_GRADIENTS = GaussianMixture((0.17, 0.43, 0.32, 0.08), (0.003, 0.0195, 0.068, 0.212))
"""Distribution of the gradients of sharp photographs whose light has a standard deviation of
LIGHT_DEVIATION. It is the likeliest mixture for parts, 255 pixels wide, of 28 photographs (Kodak's
and scikit-image's). Its smallest deviation isn't below the quantisation by 8 bits."""


@accepts_numpy
def fit_mixture(image: torch.Tensor, components: int = 3) -> GaussianMixture:
    """Fit a mixture of Gaussians to the gradients of a picture, (rows, columns).

    The likelihood is maximised by expectation maximisation on a histogram. Deviations are at least
    half a bin of the histogram, since the zero gradients of even surfaces would otherwise make one
    of them 0. Raises ValueError for constant pictures, or a number of components outside 1 to 8.
    """
    if not 1 <= components <= 8:
        raise ValueError(f"components is {components}; give 1 to 8")
    values = _gradient_values(image).abs()
    bins = 2001
    width = float(values.max()) / bins
    counts = torch.bincount((values / width).long().clamp(max=bins - 1), minlength=bins)
    squares = ((torch.arange(bins, dtype=torch.float64) + 0.5) * width).square()
    weights, spread = counts / counts.sum(), float(values.square().mean().sqrt())
    ladder = torch.logspace(-1.3, 0.5, components, dtype=torch.float64)
    deviations = spread * (ladder if components > 1 else torch.ones(1, dtype=torch.float64))
    shares = torch.full((components,), 1 / components, dtype=torch.float64)
    for _ in range(200):
        joint = (shares / deviations).log()[:, None] - squares / (2 * deviations.square()[:, None])
        part = joint.softmax(0) * weights
        shares = part.sum(1).clamp(min=1e-9)
        deviations = ((part * squares).sum(1) / shares).sqrt().clamp(min=width / 2)
        shares = shares / shares.sum()
    return GaussianMixture(tuple(shares.tolist()), tuple(deviations.tolist()))


@accepts_numpy
def fit_generalised_gaussian(image: torch.Tensor) -> GeneralisedGaussian:
    """Fit a generalised Gaussian to the gradients of a picture, (rows, columns).

    The power follows from the ratio of the gradients' mean square to the square of their mean
    length (Sharifi and Leon-Garcia 1995, doi 10.1109/76.350779). It is limited to 0.1 to 8. Raises
    ValueError for constant pictures.
    """
    values = _gradient_values(image).abs()
    mean, square = float(values.mean()), float(values.square().mean())
    low, high = 0.1, 8.0
    for _ in range(60):
        middle = (low * high) ** 0.5
        unit = GeneralisedGaussian(1.0, middle)
        # The ratio falls as the power grows.
        heavier = unit.moment(2) / unit.moment(1) ** 2 > square / mean**2
        low, high = (middle, high) if heavier else (low, middle)
    power = (low * high) ** 0.5
    return GeneralisedGaussian(mean / GeneralisedGaussian(1.0, power).moment(1), power)


def _gradient_values(image: torch.Tensor) -> torch.Tensor:
    """Return all gradients of a picture as a vector.

    Raises ValueError for pictures that are too small, constant or not finite.
    """
    image = as_floating_point(image)
    if image.ndim != 2 or min(image.shape) < 2:
        raise ValueError(f"image is {tuple(image.shape)}; give (rows, columns) of 2 at least")
    require_finite("image", image)
    values = gradients(image.to(torch.float64)).ravel()
    if not bool(values.any()):
        raise ValueError("image is the same everywhere; it has no gradients to tell anything by")
    return values
