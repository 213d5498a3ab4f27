"""Estimate the error of each pixel and band of a restoration.

It's told from bands that the sensor's filters see alike, and from the picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch

from optics.inverse.mosaics import MosaicObservation
from optics.inverse.restored_image import RestoredImage
from optics.multispectral.predicted_error import predict_errors
from optics.threads import single_threaded
from optics.validation import require_finite, require_unmasked

# Least cosine between what the filters transmit of bands that count as alike: a third of a band's
# light, or less, then differs through the filters in more than brightness. Chosen.
_ALIKE = 0.95

_SAME_PSFS = 0.99  # least cosine between the PSFs of bands that count as the same; chosen


def find_alike_bands(filters: torch.Tensor) -> list[tuple[int, ...]]:
    """Find the groups of bands that the filters see alike, but for a factor.

    Returns ascending indices of two bands or more in each group. A band is in a group if it is like
    another of them, and in one group at most. `filters` is one period of the mosaic's pattern,
    (bands, rows, columns).
    """
    alike = _cosines(filters) >= _ALIKE
    groups: list[set[int]] = []
    for band, row in enumerate(alike):
        joined = {band, *(int(other) for other in row.nonzero())}
        apart = [group for group in groups if not group & joined]
        for group in groups:
            joined |= group if group & joined else set()
        groups = [*apart, joined]
    return sorted(tuple(sorted(group)) for group in groups if len(group) > 1)


def _cosines(pictures: torch.Tensor) -> torch.Tensor:
    """Compute how alike the pictures of each two bands are, filters or PSFs: (bands, bands).

    These are the cosines of the angles between them, 1 for bands that differ by a factor only.
    """
    flat = pictures.flatten(1).to(torch.float64)
    directions = flat / flat.norm(dim=1, keepdim=True)
    return directions @ directions.mT


def _filter_period(observation: MosaicObservation) -> torch.Tensor:
    """Return one period of a mosaic's filters, (bands, rows, columns), float64."""
    rows, columns = observation.filter_period
    return observation.filters[:, :rows, :columns].to(torch.float64)


def _describe_alike_bands(names: Sequence[str], psfs: torch.Tensor) -> str:
    """Describe whether PSFs, (bands, rows, columns), separate bands that the filters see alike."""
    apart = _cosines(psfs) - torch.eye(len(psfs), dtype=torch.float64)
    separated = (
        "only the PSFs could separate these bands, and those of some don't differ either; how "
        "the light is divided among them is a guess from typical spectra."
        if float(apart.max()) >= _SAME_PSFS
        else "only the PSFs separate these bands, so that light may be restored in the wrong one "
        "of them."
    )
    return f"The filters see {', '.join(names[:-1])} and {names[-1]} alike: {separated}"


# Standard deviation in pixels of the Gaussian that smooths restored light; chosen.
_LIGHT_WIDTH = 1.0
_GRADIENT_WIDTH = 2.0  # the same for the length of the gradient; chosen

# What is added to light and gradient over the scene's light, so that logarithms end in the dark.
_LEAST_LIGHT, _LEAST_GRADIENT = 3e-3, 1e-3

# Least noise of the Gaussian scene over its light: without any all would be known; chosen.
_LEAST_PREDICTED_NOISE = 3e-4
_PERIOD = 64  # least pixels of the Gaussian scene beside the PSFs: enough frequencies


class ErrorFeatures(NamedTuple):
    """What the error of a restoration is estimated from.

    logarithms: by name, the natural logarithm of each feature relative to `scale`; shapes broadcast
        to (bands, rows, columns).
    scale: root mean square length of the restored spectra, in the picture's unit.
    """

    logarithms: dict[str, torch.Tensor]
    scale: float


def error_features(
    observation: MosaicObservation, image: torch.Tensor, spectra: Any
) -> ErrorFeatures:
    """Compute what the error of a restored picture, (bands, rows, columns), is estimated from.

    The features are the restored light of the band, that of the bands which the filters see alike,
    and the length of the band's gradient, all smoothed; and the error of the band that is predicted
    for Gaussian scenes of typical spectra. Tried without gain: the noise, the length of the whole
    spectrum, light of wider surroundings, and a prediction for the scene's own spectra.

    Raises ValueError if the picture or the typical spectra, (samples, bands), don't fit the
    observation, or aren't finite, or if the picture has no light.
    """
    require_unmasked(spectra)
    samples = torch.as_tensor(spectra, dtype=torch.float64)
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
    scale = float(image.square().sum(0).mean().sqrt())
    if not scale > 0:
        raise ValueError("the restored picture has no light; there is nothing to estimate")
    light = _smooth(image, _LIGHT_WIDTH)
    likeness = _cosines(_filter_period(observation)).square().to(light)
    alike = torch.einsum("nm,mrc->nrc", likeness, light)
    gradient = _smooth(torch.hypot(*torch.gradient(image, dim=(-2, -1))), _GRADIENT_WIDTH)
    noise = observation.noise / float(observation.psfs.sum((-2, -1)).mean()) / scale
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


def _predicted_shares(
    observation: MosaicObservation, samples: torch.Tensor, noise: float
) -> torch.Tensor:
    """Predict each band's error relative to its light, for typical spectra.

    `noise` is relative to the length of the spectra. The result is (bands, 1, 1).
    """
    filters = _filter_period(observation)
    rows, columns = filters.shape[1:]
    letters = "".join(chr(ord("A") + n) for n in range(rows * columns))
    pattern = [letters[row * columns : (row + 1) * columns] for row in range(rows)]
    step = math.lcm(rows, columns)
    length = float(samples.square().sum(1).mean().sqrt())
    errors = predict_errors(
        observation.psfs.expand(observation.bands, -1, -1),
        filters.flatten(1).mT,
        pattern,
        samples,
        max(noise, _LEAST_PREDICTED_NOISE) * length,
        channels=letters,
        period=step * -(-max(_PERIOD, *observation.psfs.shape[1:]) // step),
    )
    return (errors.rms / errors.prior_rms)[:, None, None]


def _logarithm(relative: torch.Tensor, least: float) -> torch.Tensor:
    """Return the logarithm of a feature, which levels off at `least`."""
    return (relative.clamp(min=0) + least).log()


def _smooth(bands: torch.Tensor, sigma: float) -> torch.Tensor:
    """Smooth each band by a Gaussian of `sigma` pixels; the edge is repeated beyond it."""
    reach = math.ceil(3 * sigma)
    at = torch.arange(-reach, reach + 1, dtype=bands.dtype)
    weights = (-(at / sigma).square() / 2).exp()
    weights = weights / weights.sum()
    padded = torch.nn.functional.pad(bands[:, None], (reach,) * 4, mode="replicate")
    rows = torch.nn.functional.conv2d(padded, weights[None, None, :, None])
    return torch.nn.functional.conv2d(rows, weights[None, None, None, :])[:, 0]


# Coefficients of the logarithm of the half width, by feature: see `error_features`. Fitted by
# `python -m figures.fit_error_map` to 48 restorations of 12 scenes with four designs and noise from
# 0 to 0.03. Where a scene's intervals came from the other scenes, they held 89 % of its lit pixels
# in the mean; the standard deviation over scenes, designs and bands was 8 %. In the dark, below a
# length of the spectrum of 0.1, it was 91 and 12 %.
_COEFFICIENTS = {
    "constant": 0.033,
    "light": 0.085,
    "alike": 0.370,
    "gradient": 0.275,
    "predicted": 0.865,
}


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """Estimated error of a restoration, with its doubtful bands.

    Parameters
    ----------
    half_width : torch.Tensor or numpy.ndarray, (bands, rows, columns)
        Half the width of an interval around each restored value that is estimated to hold the true
        one with a probability of 0.9; in the picture's unit, above 0.
    uncertain_bands, message : tuple of int, str
        Indices of the bands that only the PSFs separate, as the filters see them alike; in words.
    """

    half_width: Any
    uncertain_bands: tuple[int, ...]
    message: str


@single_threaded
@torch.no_grad()
def estimate_error_map(
    observation: MosaicObservation,
    restored: RestoredImage,
    spectra: Any,
    *,
    labels: Sequence[str] | None = None,
) -> ErrorMap:
    """Estimate the error of each pixel and band of a restoration.

    The half width of the 90 % interval is a product of powers of what is known where the truth
    isn't: the restored light of this band and of those that the filters see alike, the gradient,
    and the error that is predicted for typical spectra from PSFs, filters and noise. It is an
    estimate: scenes differ in how far their spectra are from typical ones, which the photograph
    hardly shows. Of three unseen scenes, the intervals of single bands held 62 to 100 % of the lit
    pixels, and in the dark 31 to 100 %, the least at 700 nm.

    Parameters
    ----------
    observation, restored : MosaicObservation, RestoredImage
        The raw picture with its filters and PSFs, and the result of `restore_spectra`.
    spectra : torch.Tensor or numpy.ndarray, (samples, bands)
        The typical spectra with which it was restored.
    labels : sequence of str, optional
        Names of the bands in the message, such as their wavelengths; numbers from 1 if None.

    Returns
    -------
    ErrorMap
        The half width, an array of the restored picture's kind, and bands that are uncertain.

    Raises
    ------
    ValueError
        If something doesn't fit the observation, or isn't finite, or the picture has no light.

    References
    ----------
    Koenker and Bassett 1978, doi 10.2307/1913643 (regression quantiles).
    """
    bands = observation.bands
    names = [f"band {number + 1}" for number in range(bands)] if labels is None else labels
    if len(names) != bands:
        raise ValueError(f"labels has {len(names)} names; give one for each of {bands} bands")
    features = error_features(observation, torch.as_tensor(restored.image), spectra)
    exponent = sum(_COEFFICIENTS[name] * value for name, value in features.logarithms.items())
    half_width = features.scale * torch.exp(torch.as_tensor(exponent))
    psfs = observation.psfs.expand(bands, -1, -1)
    groups = find_alike_bands(_filter_period(observation))
    return ErrorMap(
        half_width.numpy() if observation.is_numpy else half_width,
        tuple(sorted(band for group in groups for band in group)),
        " ".join(
            _describe_alike_bands([names[band] for band in group], psfs[list(group)])
            for group in groups
        ),
    )
