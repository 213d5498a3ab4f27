"""From the picture of a mosaic of colour filters to all colours of each pixel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import torch

from optics.demosaicing.joint_demosaicing import demosaic_with_prior
from optics.demosaicing.mosaic_observation import MosaicObservation
from optics.demosaicing.noise import estimate_mosaic_noise
from optics.demosaicing.opencv_interpolation import INTERPOLATIONS, interpolate_bayer
from optics.operators.spectral_mosaic import filter_weights
from optics.progress import Progress
from optics.validation import (
    accepts_numpy,
    as_floating_point,
    require_count,
    require_finite,
    require_positive,
    require_same_shape,
)

Method = Literal["prior", "bilinear", "edge-aware", "vng"]

METHODS: tuple[Method, ...] = ("prior", *INTERPOLATIONS)


@accepts_numpy
def demosaic(
    raw: torch.Tensor,
    pattern: Sequence[str],
    method: Method = "prior",
    *,
    channels: str = "RGB",
    response: torch.Tensor | None = None,
    noise: float | None = None,
    psf: torch.Tensor | None = None,
    weights: torch.Tensor | None = None,
    clipped: torch.Tensor | None = None,
    weight: float | None = None,
    iterations: int = 30,
    progress: Progress | None = None,
) -> torch.Tensor:
    """Estimate all colours of each pixel of a mosaic of colour filters.

    The method "prior" is the thesis' Eq. 4.7 with a prior worth having: few bends of brightness,
    and fewer of colours, see CurvaturePrior. The others are OpenCV's, for Bayer's pattern only; of
    the optional arguments they take `channels` alone. Colours bend least where white is even: give
    ``diag(gains)`` as `response` for channels that aren't balanced.

    Parameters
    ----------
    raw : torch.Tensor or numpy.ndarray, (rows, columns)
        Light of each pixel less the dark level; any size of frame.
    pattern : sequence of str
        Rows of one letter per pixel that repeat from the first pixel on, as ``("RG", "GB")``.
    method : {"prior", "bilinear", "edge-aware", "vng"}, default "prior"
        How colours are found, one of `METHODS`.
    channels : str, default "RGB"
        Letters of the channels. Without a response each channel is a band, in this order.
    response : torch.Tensor or numpy.ndarray, (channels, bands), optional
        What the filter of each letter transmits of each band; the identity if None.
    noise : float, optional
        Standard deviation of a pixel. Estimated if None.
    psf : torch.Tensor or numpy.ndarray, optional
        Blur of the lens, (rows, columns), or (bands, rows, columns) for one per band; sharp if
        None.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        How much each pixel is to be trusted; 0 where it is dead.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full: there the light is at least what was measured.
    weight : float, optional
        Regularisation weight of the prior. From the noise and the scale of the light if None.
    iterations : int, default 30
        Number of iterations, 1 or more.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    torch.Tensor or numpy.ndarray, (bands, rows, columns)
        Light of each band, which noise may leave below 0 where it is dark.

    Raises
    ------
    ValueError
        If an argument doesn't fit or isn't finite, the method doesn't take it, or no pixel sees a
        band.
    """
    rows = _validate_pattern(pattern, channels)
    raw = _validate_raw(raw)
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; take one of {', '.join(METHODS)}")
    if method != "prior":
        names = ("response", "psf", "weights", "clipped", "weight")
        told = (response, psf, weights, clipped, weight)
        given = [name for name, value in zip(names, told, strict=True) if value is not None]
        if given:
            raise ValueError(f"method {method!r} takes no {', '.join(given)}; take 'prior'")
        return interpolate_bayer(raw, rows, method)[["RGB".index(letter) for letter in channels]]
    if weight is not None:
        require_positive("weight", weight, "")
    require_count("iterations", iterations)
    period = len(rows), len(rows[0])
    seen = MosaicObservation(
        raw,
        filter_weights(rows, _validate_response(response, channels).to(raw), channels, raw.shape),
        estimate_mosaic_noise(raw, period) if noise is None else float(noise),
        None if psf is None else psf.to(raw),
        _effective_weights(raw, weights, clipped),
        None if clipped is None else clipped.to(torch.bool),
    )
    return demosaic_with_prior(seen, period, weight, iterations=iterations, progress=progress)


def _validate_pattern(pattern: Sequence[str], channels: str) -> tuple[str, ...]:
    rows = (pattern,) if isinstance(pattern, str) else tuple(pattern)
    if isinstance(pattern, str) or not rows or not rows[0] or len({len(row) for row in rows}) > 1:
        raise ValueError(
            f"pattern is {pattern!r}; give rows of one letter a pixel, all as long, as in "
            "('RG', 'GB')"
        )
    missing = sorted({letter for row in rows for letter in row} - set(channels))
    if missing:
        raise ValueError(f"pattern has {', '.join(missing)}; channels {channels!r} don't")
    return rows


def _validate_raw(raw: torch.Tensor) -> torch.Tensor:
    if raw.ndim != 2:
        raise ValueError(f"raw is {tuple(raw.shape)}; give (rows, columns)")
    require_finite("raw", raw)
    return as_floating_point(raw)


def _validate_response(response: torch.Tensor | None, channels: str) -> torch.Tensor:
    if response is None:
        return torch.eye(len(channels))
    require_finite("response", response)
    if response.ndim != 2 or len(response) != len(channels):
        raise ValueError(
            f"response is {tuple(response.shape)}; give (channels, bands), of {len(channels)} "
            f"channels {channels!r}"
        )
    return response


def _effective_weights(
    raw: torch.Tensor, weights: torch.Tensor | None, clipped: torch.Tensor | None
) -> torch.Tensor | None:
    """Weights, with 0 for what was clipped; None where all are 1."""
    require_same_shape("raw", raw, weights=weights, clipped=clipped)
    trust = weights if weights is None else weights.to(raw)
    if clipped is None:
        return trust
    sound = (~clipped.to(torch.bool)).to(raw)
    return sound if trust is None else trust * sound
