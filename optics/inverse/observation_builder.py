"""Build an observation from arrays of any kind, and pixel weights from a variance map."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from optics.inverse.blur import Border
from optics.inverse.observation import Observation
from optics.validation import (
    accepts_numpy,
    as_floating_point,
    require_number,
    require_tensor,
    split_mask,
)

# Mean variance over the squared mean deviation up to which noise counts as even. Chosen: at 1.05,
# deviations differ by about a fifth.
_EVEN_SPREAD = 1.05

# Noise that the photograph shows over that of its map, from which the rest is added to the map.
# Chosen: verdicts doubt a told noise from the same ratio.
_DOUBTED = 1.6


def with_variance(observation: Observation, variance: torch.Tensor) -> Observation:
    """Weight each pixel by the inverse of its standard deviation σ.

    With one prior for the whole picture, this is what the likelihood asks for where noise grows
    with the light. There, the negative logarithm of the posterior is the sum of (H x - y)² / (2 σ²)
    and of ``|∇x| / s``. The scale s of the scene's gradients follows the light, as σ does.
    Multiplied by σ, which is about constant in a region, it is the sum of (H x - y)² / (2 σ) and of
    ``|∇x|`` times a constant. The inverse variance would suit a scene whose gradients are as large
    in the shade as in the sun; it restores bright parts worse than one noise for all. The weights'
    scale makes a residual relative to the noise about 1. See Almeida and Figueiredo 2013, doi
    10.1109/TIP.2013.2258354, for weighted data in a splitting, and Granados et al. 2010, doi
    10.1109/CVPR.2010.5540208, for the noise of a merged bracket.

    The noise of the result is the rms of the map. If the noise is even, `variance` is None in it,
    and all pixels have the same weight. Raises ValueError for a map of another shape, values that
    are NaN or not above 0, and a map without a finite value at a pixel that is used.

    observation: its own weights only say which pixels are used.
    variance: variance of each pixel, (rows, columns), above 0, in the photograph's unit squared;
        infinite where nothing was measured.
    """
    shape = tuple(observation.image.shape)
    if tuple(variance.shape) != shape:
        raise ValueError(f"variance is {tuple(variance.shape)} and image {shape}; give one a pixel")
    unknown = int(torch.isnan(variance).sum())
    if unknown:
        raise ValueError(f"variance is NaN at {unknown} pixels; it's infinite where unmeasured")
    wrong = int((variance <= 0).sum())
    if wrong:
        raise ValueError(
            f"variance is {float(variance.min()):g} at its least, and at {wrong} pixels not above "
            "0; give the squared standard deviation of each pixel, which read noise keeps above 0"
        )
    trust = observation.effective_weights
    measured = torch.isfinite(variance)
    used = measured if trust is None else measured & (trust > 0)
    if not bool(used.any()):
        raise ValueError(
            "variance is infinite at every pixel that is used; nothing was measured there"
        )
    known = variance[used].to(torch.float64)
    mean, deviation = float(known.mean()), float(known.sqrt().mean())
    # The weight of a clipped pixel doesn't matter, but it must not look like a dead one.
    given = torch.ones_like(measured) if observation.weights is None else observation.weights > 0
    kept = measured & given
    if observation.clipped is not None:
        kept |= observation.clipped & given
    if mean <= _EVEN_SPREAD * deviation**2:
        weights = None if bool(kept.all()) else kept.to(observation.image)
        return replace(observation, given_noise=mean**0.5, weights=weights, variance=None)
    inverse = torch.where(used, variance, mean).to(torch.float64).rsqrt()
    weights = (inverse * (mean / deviation) * kept).to(observation.image)
    variance = variance.to(torch.float64)
    return replace(observation, given_noise=mean**0.5, weights=weights, variance=variance)


def with_doubted_variance(observation: Observation, variance: torch.Tensor) -> Observation:
    """Weight pixels by a variance map that may leave something unexplained: see with_variance().

    If the photograph shows much more noise than its map has in the mean, PSF or model are wrong by
    more than the noise. What exceeds the map is then added to every pixel, which makes the noise
    more even.
    """
    mapped = with_variance(observation, variance)
    excess = observation.noise**2 - mapped.noise**2
    if observation.noise <= _DOUBTED * mapped.noise:
        return mapped
    return with_variance(observation, variance + excess)


def without_variance(observation: Observation) -> Observation:
    """Return the problem with one noise for all pixels, the rms of its variance map."""
    if observation.variance is None or observation.weights is None:
        return observation
    used = observation.weights > 0
    weights = None if bool(used.all()) else used.to(observation.image)
    return replace(observation, weights=weights, variance=None)


def build_observation(
    image: Any,
    psf: Any,
    noise: float | None = None,
    border: Border = "unknown",
    weights: Any = None,
    clipped: Any = None,
    *,
    variance: Any = None,
) -> Observation:
    """Gather a blurred photograph, its PSF, noise and weights.

    The photograph is restored in double precision if `image` is double, otherwise in single. See
    `Observation` for what the quantities mean.

    Parameters
    ----------
    image : torch.Tensor or numpy.ndarray, (rows, columns)
        The photograph, light per pixel. Whole numbers and half precision become float32. Masked
        pixels of a numpy.ma array count as dead.
    psf : torch.Tensor or numpy.ndarray, (rows, columns)
        Point spread function, origin at n // 2. Its sum is the share of the light that arrives.
    noise : float, optional
        Standard deviation of a pixel, in the unit of `image`; estimated if None.
    border : {"unknown", "dark", "periodic"}, default "unknown"
        What the scene does beyond the frame.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Weight of each pixel in the data term; 0 where a pixel is dead.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full.
    variance : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Variance of each pixel, in the place of `noise`; infinite where nothing was measured.
        `weights` then only say which pixels are used: see with_variance().

    Returns
    -------
    Observation
        The observation that `restore` takes.

    Raises
    ------
    TypeError
        If an argument is no array, or not of real numbers.
    ValueError
        If `Observation` or with_variance() raises it, or if noise and variance are both given.
    """
    if noise is not None and variance is not None:
        raise ValueError(f"noise is {noise:g} and variance is given too; give one of them")
    if noise is not None:
        require_number("noise", noise)
    image, weights = split_mask(image, weights)
    built: Observation = _build_observation(image, psf, noise, border, weights, clipped, variance)
    return replace(built, is_numpy=isinstance(image, np.ndarray))


@accepts_numpy
def _build_observation(
    image: torch.Tensor,
    psf: torch.Tensor,
    noise: float | None,
    border: Border,
    weights: torch.Tensor | None,
    clipped: torch.Tensor | None,
    variance: torch.Tensor | None,
) -> Observation:
    given = (image, psf, weights, clipped, variance)
    for name, value in zip(("image", "psf", "weights", "clipped", "variance"), given, strict=True):
        require_tensor(name, value)
        if value is not None and value.is_complex():
            raise TypeError(f"{name} is of {value.dtype}; give real numbers")
    image = as_floating_point(image)
    weights = weights if weights is None else weights.to(image)
    clipped = clipped if clipped is None else clipped.to(torch.bool)
    told = noise if noise is None else float(noise)
    built = Observation(image, psf.to(image), told, border, weights, clipped)
    return built if variance is None else with_variance(built, variance)
