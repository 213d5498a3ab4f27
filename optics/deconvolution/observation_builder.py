"""Construction of a restoration's observation from arrays of any kind."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from optics.deconvolution.observation import Observation
from optics.deconvolution.variance_map import with_variance
from optics.operators.blur import Border
from optics.validation import (
    accepts_numpy,
    as_floating_point,
    require_number,
    require_tensor,
    split_mask,
)


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
    """Gather what a deconvolution needs: the blurred photograph, PSF, noise and weights.

    The arrays may be of any kind. The photograph is restored in double precision if `image` is
    double, otherwise in single precision. See `Observation` for what the quantities mean.

    Parameters
    ----------
    image : torch.Tensor or numpy.ndarray, (rows, columns)
        The photograph, light per pixel. Whole numbers and half precision become float32. `restore`
        returns an array of the same kind. Masked pixels of a numpy.ma array count as dead.
    psf : torch.Tensor or numpy.ndarray, (rows, columns)
        Point spread function, origin at n // 2. Its sum is the share of the scene's light that
        reaches the sensor, at most 1.
    noise : float, optional
        Standard deviation of a pixel, in the unit of `image`. Estimated from the photograph if
        None.
    border : {"unknown", "dark", "periodic"}, default "unknown"
        What the scene does beyond the frame.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Weight of each pixel in the data term; 0 where a pixel is dead.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full.
    variance : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Variance of each pixel, as of a merged exposure bracket; infinite where nothing was
        measured. It takes the place of `noise`: see with_variance(). `weights` then only say which
        pixels are used.

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
    """Build a deconvolution's observation from tensors or arrays of any real numbers."""
    given = {"image": image, "psf": psf, "weights": weights, "clipped": clipped}
    given["variance"] = variance
    for name, value in given.items():
        require_tensor(name, value)
        if value is not None and value.is_complex():
            raise TypeError(f"{name} is of {value.dtype}; give real numbers")
    image = as_floating_point(image)
    weights = weights if weights is None else weights.to(image)
    clipped = clipped if clipped is None else clipped.to(torch.bool)
    told = noise if noise is None else float(noise)
    built = Observation(image, psf.to(image), told, border, weights, clipped)
    return built if variance is None else with_variance(built, variance)
