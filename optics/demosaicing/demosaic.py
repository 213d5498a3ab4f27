"""The entry point of demosaicing, which checks its arguments and calls the chosen method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import torch

from optics.demosaicing.joint_demosaicing import demosaic_with_prior
from optics.demosaicing.mosaic_observation import MosaicObservation
from optics.demosaicing.opencv_interpolation import INTERPOLATIONS, interpolate_bayer
from optics.operators.spectral_mosaic import filter_weights
from optics.progress import Progress
from optics.validation import (
    accepts_numpy,
    as_floating_point,
    require_count,
    require_finite,
    require_positive,
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
    """Demosaic a raw picture: estimate all colours of each pixel of a mosaic of colour filters.

    The method "prior" solves Eq. 4.7 of the thesis with a prior that penalises the curvature of
    the brightness, and that of colour differences more. The other methods are
    those of OpenCV, for the Bayer pattern only; of the optional arguments they accept only
    `channels`. The prior assumes that all bands of a white surface are equal: for channels that
    aren't balanced, give ``diag(gains)`` as `response`.

    Parameters
    ----------
    raw : torch.Tensor or numpy.ndarray, (rows, columns)
        Light of each pixel less the dark level, of a frame of any size.
    pattern : sequence of str
        Rows of one letter per pixel that repeat from the first pixel on, as ``("RG", "GB")``.
    method : {"prior", "bilinear", "edge-aware", "vng"}, default "prior"
        Method of demosaicing, one of `METHODS`.
    channels : str, default "RGB"
        Letters of the channels. Without a response each channel is a band, in this order.
    response : torch.Tensor or numpy.ndarray, (channels, bands), optional
        Share of each band that the filter of each letter transmits; the identity if None.
    noise : float, optional
        Standard deviation of a pixel, in the unit of `raw`. Estimated if None.
    psf : torch.Tensor or numpy.ndarray, optional
        PSF of the lens, (rows, columns), or (bands, rows, columns) for one per band; no blur if
        None.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Weight of each pixel in the data term; 0 where a pixel is dead.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full: there the light is at least what was measured.
    weight : float, optional
        Regularisation weight of the prior. Chosen from the noise and the scale of the light if
        None.
    iterations : int, default 30
        Number of iterations, 1 or more.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    torch.Tensor or numpy.ndarray, (bands, rows, columns)
        Light of each band. Noise may make it negative in dark places.

    Raises
    ------
    ValueError
        If an argument has the wrong shape or isn't finite, if the method doesn't accept it, or if
        no pixel sees one of the bands.
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
    seen = mosaic_observation(
        raw, rows, channels, response, noise=noise, psf=psf, weights=weights, clipped=clipped
    )
    found = demosaic_with_prior(seen, weight, iterations=iterations, progress=progress)
    # The restored image is cut at 0, which would brighten what is dark on the mean.
    return seen.crop_to_frame(found.period_image).clone()


def mosaic_observation(
    raw: torch.Tensor,
    rows: tuple[str, ...],
    channels: str,
    response: torch.Tensor | None,
    *,
    noise: float | None,
    psf: torch.Tensor | None,
    weights: torch.Tensor | None,
    clipped: torch.Tensor | None,
) -> MosaicObservation:
    """Build the observation of a raw mosaic for demosaicing: see demosaic()."""
    shares = _validate_response(response, channels).to(raw)
    psfs = torch.ones(1, 1, 1).to(raw) if psf is None else psf.to(raw)
    psfs = psfs[None] if psfs.ndim == 2 else psfs
    return MosaicObservation(
        raw,
        psfs.mean(0),
        noise if noise is None else float(noise),
        weights=weights if weights is None else weights.to(raw),
        clipped=clipped if clipped is None else clipped.to(torch.bool),
        psfs=psfs,
        filters=filter_weights(rows, shares, channels, raw.shape),
        filter_period=(len(rows), len(rows[0])),
    )


def _validate_pattern(pattern: Sequence[str], channels: str) -> tuple[str, ...]:
    """Return the rows of a mosaic's filter pattern; raise ValueError if they are malformed."""
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
    """Return a raw mosaic for demosaicing in floating point; raise ValueError if it's unusable."""
    if raw.ndim != 2:
        raise ValueError(f"raw is {tuple(raw.shape)}; give (rows, columns)")
    require_finite("raw", raw)
    return as_floating_point(raw)


def _validate_response(response: torch.Tensor | None, channels: str) -> torch.Tensor:
    """Return the response of a mosaic's colour filters, by default the identity.

    Raises ValueError for a response that isn't finite or has the wrong shape.
    """
    if response is None:
        return torch.eye(len(channels))
    require_finite("response", response)
    if response.ndim != 2 or len(response) != len(channels):
        raise ValueError(
            f"response is {tuple(response.shape)}; give (channels, bands), of {len(channels)} "
            f"channels {channels!r}"
        )
    return response
