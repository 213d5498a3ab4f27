"""What an estimate of a spectral restoration's error is computed from, pixel by pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch

from optics.inverse.mosaics import MosaicObservation
from optics.multispectral.filter_likeness import cosines, filter_period
from optics.multispectral.predicted_error import predict_errors
from optics.validation import require_finite, require_unmasked

_LIGHT_WIDTH = 1.0
"""Standard deviation in pixels of the Gaussian that smooths the restored light; chosen."""

_GRADIENT_WIDTH = 2.0
"""The same for the length of the gradient; chosen."""

_LEAST_LIGHT = 3e-3
_LEAST_GRADIENT = 1e-3
"""What is added to light and gradient relative to the scene's light, so that their logarithms end
in the dark; chosen."""

_LEAST_PREDICTED_NOISE = 3e-4
"""Least noise of the Gaussian scene relative to its light, as without any all would be known;
chosen."""

_PERIOD = 64
"""Least number of pixels of the Gaussian scene beside the PSFs: enough frequencies."""


@dataclass(frozen=True, eq=False)
class ErrorFeatures:
    """Hold the features from which a spectral restoration's error is estimated.

    Parameters
    ----------
    logarithms : dict of str to torch.Tensor
        By name, the natural logarithm of each feature relative to `scale`; shapes broadcast to
        (bands, rows, columns).
    scale : float
        Root mean square length of the restored spectra, in the picture's unit.
    """

    logarithms: dict[str, torch.Tensor]
    scale: float


def error_features(
    observation: MosaicObservation, image: torch.Tensor, spectra: Any
) -> ErrorFeatures:
    """Compute what a spectral restoration's error is estimated from.

    The features are the restored light of the band, that of the bands which the filters see alike,
    and the length of the band's gradient, all smoothed; and the error of the band that is predicted
    for Gaussian scenes of typical spectra. Tried without gain: the noise, the length of the whole
    spectrum, light of wider surroundings, and a prediction for the scene's own spectra.

    Parameters
    ----------
    observation : MosaicObservation
        The raw picture with its filters and PSFs.
    image : torch.Tensor, (bands, rows, columns)
        The restored picture.
    spectra : torch.Tensor or numpy.ndarray, (samples, bands)
        Typical spectra.

    Returns
    -------
    ErrorFeatures
        The features, without dependence on the unit of light.

    Raises
    ------
    ValueError
        If the picture or the spectra don't fit the observation, or aren't finite, or if the
        picture has no light.
    """
    require_unmasked(spectra)
    samples = torch.as_tensor(spectra, dtype=torch.float64)
    _require(observation, image, samples)
    scale = float(image.square().sum(0).mean().sqrt())
    if not scale > 0:
        raise ValueError("the restored picture has no light; there is nothing to estimate")
    light = _smooth(image, _LIGHT_WIDTH)
    alike = torch.einsum(
        "nm,mrc->nrc", cosines(filter_period(observation)).square().to(light), light
    )
    gradient = _smooth(torch.hypot(*torch.gradient(image, dim=(-2, -1))), _GRADIENT_WIDTH)
    noise = _scene_noise(observation) / scale
    return ErrorFeatures(
        {
            "constant": torch.ones(1, 1, 1).to(image),
            "light": _logarithm(light / scale, _LEAST_LIGHT),
            "alike": _logarithm(alike / scale, _LEAST_LIGHT),
            "gradient": _logarithm(gradient / scale, _LEAST_GRADIENT),
            "predicted": _predicted_shares(observation, samples, noise).log().to(image),
        },
        scale,
    )


def _require(observation: MosaicObservation, image: torch.Tensor, samples: torch.Tensor) -> None:
    """Raise ValueError for a restored picture or spectra that don't fit the observation."""
    wanted = (observation.bands, *observation.image.shape)
    if tuple(image.shape) != wanted:
        raise ValueError(
            f"restored is {tuple(image.shape)}; give the restoration of this observation, {wanted}"
        )
    if samples.ndim != 2 or samples.shape[1] != observation.bands:
        raise ValueError(
            f"spectra is {tuple(samples.shape)}; give (samples, {observation.bands} bands)"
        )
    if min(wanted[1:]) < 2:
        raise ValueError(f"the picture has {wanted[1]} x {wanted[2]} pixels; give 2 x 2 or more")
    require_finite("restored", image)
    require_finite("spectra", samples)


def _scene_noise(observation: MosaicObservation) -> float:
    """Return the noise of a raw picture on the scale of the scene's spectral light."""
    return observation.noise / float(observation.psfs.sum((-2, -1)).mean())


def _predicted_shares(
    observation: MosaicObservation, samples: torch.Tensor, noise: float
) -> torch.Tensor:
    """Predict the errors of spectral bands relative to their light, for typical spectra.

    `noise` is relative to the length of the spectra. The result is (bands, 1, 1).
    """
    filters = filter_period(observation)
    rows, columns = filters.shape[1:]
    letters = [chr(ord("A") + n) for n in range(rows * columns)]
    pattern = ["".join(letters[row * columns : (row + 1) * columns]) for row in range(rows)]
    step = math.lcm(rows, columns)
    length = float(samples.square().sum(1).mean().sqrt())
    errors = predict_errors(
        observation.psfs.expand(observation.bands, -1, -1),
        filters.flatten(1).mT,
        pattern,
        samples,
        max(noise, _LEAST_PREDICTED_NOISE) * length,
        channels="".join(letters),
        period=step * -(-max(_PERIOD, *observation.psfs.shape[1:]) // step),
    )
    return (errors.rms / errors.prior_rms)[:, None, None]


def _logarithm(relative: torch.Tensor, least: float) -> torch.Tensor:
    """Return the logarithm of a restoration's feature, which levels off at `least`."""
    return (relative.clamp(min=0) + least).log()


def _smooth(bands: torch.Tensor, sigma: float) -> torch.Tensor:
    """Smooth each band of a restored picture by a Gaussian of `sigma` pixels.

    The picture's edge is repeated beyond it.
    """
    reach = math.ceil(3 * sigma)
    at = torch.arange(-reach, reach + 1, dtype=bands.dtype)
    weights = (-(at / sigma).square() / 2).exp()
    weights = weights / weights.sum()
    padded = torch.nn.functional.pad(bands[:, None], (reach,) * 4, mode="replicate")
    rows = torch.nn.functional.conv2d(padded, weights[None, None, :, None])
    return torch.nn.functional.conv2d(rows, weights[None, None, None, :])[:, 0]
