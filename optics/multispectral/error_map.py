"""An estimate of the error of each pixel and band of a spectral restoration.

Noise is the smaller part of the error: most of it is light in the wrong band, which the photograph
doesn't show, so that a second restoration of simulated data doesn't show it either. How large it
is was learnt from scenes whose spectra are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch

from optics.inverse.mosaics import MosaicObservation
from optics.inverse.restored_image import RestoredImage
from optics.multispectral.error_features import error_features
from optics.multispectral.filter_likeness import (
    describe_alike_bands,
    filter_period,
    find_alike_bands,
)
from optics.threads import single_threaded

_COEFFICIENTS = {
    "constant": 0.033,
    "light": 0.085,
    "alike": 0.370,
    "gradient": 0.275,
    "predicted": 0.865,
}
"""Coefficients of the logarithm of the half width, by feature: see `error_features`. Fitted by
`python -m figures.fit_error_map` to 48 restorations of 12 scenes with four designs and noise from 0
to 0.03. Where a scene's intervals came from the other scenes, they held 89 % of its lit pixels in
the mean; the standard deviation over scenes, designs and bands was 8 %. In the dark, below a length
of the spectrum of 0.1, it was 91 and 12 %."""


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """Hold the estimated error of a spectral restoration, with its doubtful bands.

    Parameters
    ----------
    half_width : torch.Tensor or numpy.ndarray, (bands, rows, columns)
        Half the width of an interval around each restored value that is estimated to hold the true
        one with a probability of 0.9; in the picture's unit, above 0.
    uncertain_bands : tuple of int
        Indices of the bands that only the PSFs separate, as the filters see them alike.
    message : str
        What these bands are, in words; empty if there are none.
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
    """Estimate the error of each pixel and band of a spectral restoration.

    The half width of the 90 % interval is a product of powers of what is known where the truth
    isn't: the restored light of this band and of those that the filters see alike, the gradient,
    and the error that is predicted for typical spectra from PSFs, filters and noise. It is an
    estimate: scenes differ in how far their spectra are from typical ones, which the photograph
    hardly shows. Of three unseen scenes, the intervals of single bands held 62 to 100 % of the lit
    pixels, and in the dark 31 to 100 %, the least at 700 nm.

    Parameters
    ----------
    observation : MosaicObservation
        The raw picture with its filters and PSFs, as it was restored.
    restored : RestoredImage
        The result of `restore_spectra`.
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
        If the picture, the spectra or the labels don't fit the observation, or aren't finite, or
        if the picture has no light.

    References
    ----------
    Koenker and Bassett 1978, doi 10.2307/1913643 (regression quantiles).
    """
    names = _band_labels(labels, observation.bands)
    features = error_features(observation, torch.as_tensor(restored.image), spectra)
    exponent = sum(_COEFFICIENTS[name] * value for name, value in features.logarithms.items())
    half_width = features.scale * torch.exp(torch.as_tensor(exponent))
    psfs = observation.psfs.expand(observation.bands, -1, -1)
    groups = find_alike_bands(filter_period(observation))
    return ErrorMap(
        half_width.numpy() if observation.is_numpy else half_width,
        tuple(sorted(band for group in groups for band in group)),
        describe_alike_bands(groups, psfs, names),
    )


def _band_labels(labels: Sequence[str] | None, bands: int) -> list[str]:
    """Return the names of a restoration's spectral bands, or ValueError for another number."""
    if labels is None:
        return [f"band {number}" for number in range(1, bands + 1)]
    if len(labels) != bands:
        raise ValueError(f"labels has {len(labels)} names; give one for each of {bands} bands")
    return list(labels)
