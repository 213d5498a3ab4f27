"""Construction of a mosaic's observation from arrays of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from optics.demosaicing.mosaic_observation import MosaicObservation
from optics.operators.blur import Border
from optics.operators.spectral_mosaic import filter_weights
from optics.validation import accepts_numpy, as_floating_point, require_finite, split_mask


def build_mosaic_observation(
    raw: Any,
    pattern: Sequence[str],
    psf: Any = None,
    *,
    channels: str = "RGB",
    response: Any = None,
    noise: float | None = None,
    border: Border = "unknown",
    weights: Any = None,
    clipped: Any = None,
) -> MosaicObservation:
    """Gather what demosaicing with deconvolution needs: the raw picture, filters, PSFs and noise.

    Parameters
    ----------
    raw : torch.Tensor or numpy.ndarray, (rows, columns)
        Light of each pixel less the dark level. Masked pixels of a numpy.ma array count as dead.
    pattern : sequence of str
        Rows of one letter per pixel that repeat from the first pixel on, as ``("RG", "GB")``.
    psf : torch.Tensor or numpy.ndarray, optional
        PSF with its origin at n // 2, (rows, columns), or (bands, rows, columns) for one per band;
        no blur if None.
    channels : str, default "RGB"
        Letters of the channels. Without a response each channel is a band, in this order.
    response : torch.Tensor or numpy.ndarray, (channels, bands), optional
        Share of each band that the filter of each letter transmits; the identity if None.
    noise : float, optional
        Standard deviation of a pixel, in the unit of `raw`. Estimated if None.
    border : {"unknown", "dark", "periodic"}, default "unknown"
        What the scene does beyond the frame.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Weight of each pixel in the data term; 0 where a pixel is dead.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full: there the light is at least what was measured.

    Returns
    -------
    MosaicObservation
        The observation that `optics.deconvolution.restore` takes; it restores (bands, rows,
        columns).

    Raises
    ------
    ValueError
        If an argument has the wrong shape or isn't finite, or if no pixel sees one of the bands.
    """
    rows = _validate_pattern(pattern)
    raw, weights = split_mask(raw, weights)
    built: MosaicObservation = _build_mosaic_observation(
        raw, rows, psf, channels, response, noise, border, weights, clipped
    )
    return replace(built, is_numpy=isinstance(raw, np.ndarray))


@accepts_numpy
def _build_mosaic_observation(
    raw: torch.Tensor,
    rows: tuple[str, ...],
    psf: torch.Tensor | None,
    channels: str,
    response: torch.Tensor | None,
    noise: float | None,
    border: Border,
    weights: torch.Tensor | None,
    clipped: torch.Tensor | None,
) -> MosaicObservation:
    """Build a mosaic's observation from tensors or arrays of any real numbers."""
    raw = _validate_raw(raw)
    shares = _validate_response(response, channels).to(raw)
    psfs = torch.ones(1, 1, 1).to(raw) if psf is None else psf.to(raw)
    psfs = psfs[None] if psfs.ndim == 2 else psfs
    return MosaicObservation(
        raw,
        psfs.mean(0),
        noise if noise is None else float(noise),
        border,
        weights if weights is None else weights.to(raw),
        clipped if clipped is None else clipped.to(torch.bool),
        psfs=psfs,
        filters=filter_weights(rows, shares, channels, raw.shape),
        filter_period=(len(rows), len(rows[0])),
    )


def _validate_pattern(pattern: Sequence[str]) -> tuple[str, ...]:
    """Return the rows of a mosaic's filter pattern; raise ValueError if they are malformed."""
    rows = (pattern,) if isinstance(pattern, str) else tuple(pattern)
    if isinstance(pattern, str) or not rows or not rows[0] or len({len(row) for row in rows}) > 1:
        raise ValueError(
            f"pattern is {pattern!r}; give rows of one letter a pixel, all as long, as in "
            "('RG', 'GB')"
        )
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
