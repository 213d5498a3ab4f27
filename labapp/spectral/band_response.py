"""What white gives in each band behind each of the sensor's filters, by a star or a white sheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.pictures.analysis.brackets import Bracket, find_bracket
from labapp.pictures.analysis.colour_filters import described_filters
from labapp.pictures.colour_matrix import white_balance
from labapp.runs.record.reader import Record
from optics.sensor import Mosaic

MONO = "Y"
"""Letter that stands for all pixels of a sensor without colour filters."""

# Light over the brightest band's from which a band can be restored. Chosen: 60 dB below, only noise
# is left.
_LEAST_SHARE = 1e-3

_CENTRAL_SHARE = 0.5  # of each side of a white sheet's picture, over which its light is averaged


@dataclass(frozen=True, eq=False)
class BandResponse:
    """What a white surface gives in each band behind each filter.

    pattern: rows of a letter for each pixel, which repeat over the sensor.
    channels: the letters, in the order of `shares`.
    shares: (channels, bands), light of a white surface, over the largest value.
    white: that largest value in electrons per second and pixel; None where only ratios are known.
    source: what counts as white, in words.
    """

    pattern: tuple[str, ...]
    channels: str
    shares: NDArray[np.float64]
    white: float | None
    source: str

    @property
    def band_levels(self) -> NDArray[np.float64]:
        """Return the light of white in each band behind the filter that sees most of it."""
        return self.shares.max(0)


def mosaic_of(record: Record) -> Mosaic | None:
    """Return the colour filters of a record's sensor; None without any."""
    return record.camera.sensor.colour


def band_gains(record: Record, picture: Bracket) -> NDArray[np.float64]:
    """Return each channel's sensitivity in a picture's band, (channels,); the largest is 1."""
    filters = described_filters(record, picture, is_grey=True)
    return np.ones(1) if filters is None else filters.gains


def broad_gains(mosaic: Mosaic | None, wavelengths: Sequence[float]) -> NDArray[np.float64]:
    """Compute each channel's sensitivity to each band of broad light, (channels, bands), 0 to 1.

    A band reaches from its centre (metres, rising) halfway to the next ones. The largest
    sensitivity in each band is 1.
    """
    if mosaic is None:
        return np.ones((1, len(wavelengths)))
    gains = [white_balance(mosaic, None, ends) for ends in pairwise(band_edges(wavelengths))]
    return np.stack(gains, axis=1)


def band_edges(wavelengths: Sequence[float]) -> list[float]:
    """Return the wavelengths in metres halfway between neighbouring bands, and beyond the ends."""
    centres = np.asarray(wavelengths, dtype=np.float64)
    half = np.diff(centres) / 2
    inner = (centres[:-1] + half).tolist()
    return [float(centres[0] - half[0]), *inner, float(centres[-1] + half[-1])]


def response_from_star(
    mosaic: Mosaic | None, gains: NDArray[np.float64], light: NDArray[np.float64] | None, star: str
) -> BandResponse:
    """Build the response of the bands from the light of the star, which counts as white.

    gains: (channels, bands), sensitivities, the largest of a band being 1.
    light: (bands,), the star's light behind the filter that sees most of it, on any scale. Where it
        isn't known, white is taken to give the same in the brightest channel of each band.
    """
    if light is None:
        words = "taken to give the same in each band's brightest channel"
        return BandResponse(*_layout(mosaic), gains, None, words)
    _require_light(light, f"the star {star!r}")
    shares = gains * (light / light.max())
    return BandResponse(*_layout(mosaic), shares, None, f"the light of the star {star!r}")


def response_from_sheet(
    record: Record,
    brackets: list[Bracket],
    sheet: str,
    neutral: str,
    wavelengths: Sequence[float],
) -> BandResponse:
    """Build the response of the bands (metres) from merged pictures of a white sheet.

    The sheet fills the middle of the frame. Raises UserError if a picture is missing, dark or
    clipped.
    """
    mosaic = mosaic_of(record)
    pictures = [find_bracket(brackets, sheet, neutral, one, record.path) for one in wavelengths]
    rates = np.stack([_channel_means(one, mosaic) for one in pictures], axis=1)
    _require_light(rates.max(0), f"the white sheet {sheet!r}")
    white = float(rates.max())
    shares = np.clip(rates / white, 0, None)
    return BandResponse(*_layout(mosaic), shares, white, f"the white sheet {sheet!r}")


def _layout(mosaic: Mosaic | None) -> tuple[tuple[str, ...], str]:
    """Return the rows of the sensor's filters and the letters of its channels."""
    if mosaic is None:
        return (MONO,), MONO
    return mosaic.pattern, "".join(mosaic.channels)


def _channel_means(picture: Bracket, mosaic: Mosaic | None) -> NDArray[np.float64]:
    """Return each channel's mean light in the middle of a white sheet's picture, (channels,)."""
    borders = (round(n * (1 - _CENTRAL_SHARE) / 2) for n in picture.rate.shape)
    rows, columns = (slice(at, n - at) for at, n in zip(borders, picture.rate.shape, strict=True))
    if not np.isfinite(picture.variance[rows, columns]).all():
        raise UserError(
            f"{picture.name}: the white sheet is clipped in every exposure. Expose it shorter."
        )
    rate = picture.rate[rows, columns]
    if mosaic is None:
        return np.array([rate.mean()])
    which = mosaic.channel_map(picture.rate.shape).numpy()[rows, columns]
    return np.array([rate[which == k].mean() for k in range(len(mosaic.channels))])


def _require_light(light: NDArray[np.float64], what: str) -> None:
    """Raise UserError if something white gives next to no light in a band."""
    if not light.max() > 0 or light.min() < _LEAST_SHARE * light.max():
        shares = " / ".join(f"{one:.2g}" for one in light / max(light.max(), 1e-300))
        raise UserError(
            f"{what} is dark in a band: it gives {shares} of the brightest one's light. Expose it "
            "longer, or leave the band out of --bands."
        )
