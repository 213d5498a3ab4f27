"""What is known of a camera before its photograph refines it, from the star of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.spectral.band_psfs import BandPSFs
from labapp.spectral.band_response import BandResponse
from optics.multispectral import ModelUncertainty, SnapshotCalibration, SnapshotModel
from optics.sensor import Mosaic

Stack = NDArray[np.float64]

# Pixels around the middle that show the zeroth order: rings of three and more leave them dark.
_CORE = 2

_MOST_ORDER = 0.9  # largest zeroth order that is found; of more, there is no coded PSF to calibrate
_LEAST_SHARE = 1e-3  # of a band's strongest channel: least response, as a model's must be positive


def prior_of_run(psfs: BandPSFs, response: BandResponse) -> SnapshotCalibration:
    """Return the camera's nominal model with the usual uncertainty, from a run's star and white.

    Its response includes the share of the light that each PSF passes, which is the PSF's sum.
    """
    neutral = _neutral_psfs(psfs)
    shapes = psfs.psfs / psfs.psfs.sum((1, 2), keepdims=True)
    model = SnapshotModel.create(
        shapes,
        positive_response(response.shares),
        zeroth_order=zeroth_orders(shapes, neutral),
        neutral=neutral,
        pattern=response.pattern,
        channels=response.channels,
    )
    source = f"star and white of the run; for their errors, {usual_uncertainty_in_words()}"
    known = replace(SnapshotCalibration.nominal(model), source=source)
    return scale_bands(known, psfs.psfs.sum((1, 2)))


def require_filters(option: str, mosaic: Mosaic | None) -> Mosaic:
    """Return the colour filters of the sensor; raise UserError for `option` without any."""
    if mosaic is None:
        raise UserError(
            f"{option}: the sensor has no colour filters, behind which the bands' response could "
            "be calibrated. Use a sensor with colour filters, or leave it out."
        )
    return mosaic


def scale_bands(known: SnapshotCalibration, factors: Stack) -> SnapshotCalibration:
    """Multiply each band's response in a calibration by a factor, (bands,)."""
    response = known.model.response * torch.from_numpy(factors)
    return replace(known, model=replace(known.model, response=response))


def zeroth_orders(psfs: Stack, neutral: Stack) -> torch.Tensor:
    """Find the zeroth order's share of the light in each PSF, (bands,).

    The neutral PSFs are fitted to the middle of the others by least squares. Both are (bands, rows,
    columns), with sums of 1.
    """
    rows, columns = (slice(max(n // 2 - _CORE, 0), n // 2 + _CORE + 1) for n in psfs.shape[1:])
    a, b = neutral[:, rows, columns], psfs[:, rows, columns]
    shares = (a * b).sum((1, 2)) / np.square(a).sum((1, 2))
    return torch.from_numpy(np.clip(shares, 0, _MOST_ORDER))


def positive_response(response: Stack) -> Stack:
    """Return a response, (channels, bands), with small entries made positive."""
    return np.maximum(response, _LEAST_SHARE * response.max(0))


def usual_uncertainty_in_words() -> str:
    """Say in words how well a nominal model counts as known."""
    usual = ModelUncertainty()
    return (
        f"standard deviations of {usual.zeroth_order:g} in the zeroth order of all bands and "
        f"{usual.zeroth_order_of_band:g} of each, {usual.scale:.0%} in size, {usual.centre:g} px "
        f"in each band's place, {usual.response:.0%} in each channel"
    ).replace("%", " %")


def _neutral_psfs(psfs: BandPSFs) -> Stack:
    """Return the star's neutral PSFs, (bands, rows, columns); the middle pixel without a star."""
    count, rows, columns = psfs.psfs.shape
    neutral = np.zeros((count, rows, columns))
    neutral[:, rows // 2, columns // 2] = 1
    for band, spot in enumerate(psfs.spots):
        if spot is not None:
            shape = replace(spot, y=rows // 2, x=columns // 2).shape_on(rows, columns)
            neutral[band] = shape / shape.sum()
    return neutral
