"""A camera as its description means it to be: PSFs of each band, and response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.pictures.analysis.colour_filters import passband_at
from labapp.pictures.analysis.star_psf import predict_star
from labapp.pictures.colour_matrix import white_balance
from labapp.runs.record.reader import Record
from labapp.spectral.snapshot_prior import positive_response, zeroth_orders
from labapp.spectral_calibration.request import SpectraRequest
from optics.camera import Camera
from optics.camera.pupil import panel_to_focus_distance
from optics.multispectral import SnapshotModel

_POINT = 1e-9
"""Diameter in metres of a star whose size isn't known: a point."""


@dataclass(frozen=True, eq=False)
class NominalCamera:
    """A snapshot camera as it is meant to be.

    model: its PSFs, each of which sums to 1, and its response.
    window_share: (bands,), light in the window of the coded PSF over that in the window of the
        neutral one. A pattern sends the rest beyond the window.
    """

    model: SnapshotModel
    window_share: NDArray[np.float64]


def compute_nominal_model(
    record: Record,
    request: SpectraRequest,
    rates: NDArray[np.float64],
    offset: tuple[float, float] | None = None,
) -> NominalCamera:
    """Compute the model of a camera as described, whose deviations the frames then show.

    Its PSFs follow from the description of panel, lens and sensor, and from the recorded patterns;
    they have no noise. Its response has the light of the white sheet: of each band, the sum over
    the channels is the measured one, divided among them as the sensor's curves say.

    record: of the calibration.
    request: bands, patterns, and the star's size and distance.
    rates: (channels, bands), electrons per second that the white sheet gives behind each filter.
    offset: place (y, x) of the star relative to the middle pixel, in pixels; its PSFs are those of
        the star. Of a point in the middle if None.
    """
    camera = record.camera
    greys = [torch.from_numpy(record.pattern(one)) for one in (request.neutral, request.coded)]
    psfs = _predict_psfs(camera, greys, request, offset)
    sums = psfs.sum((2, 3))
    neutral, coded = psfs / sums[..., None, None]
    gains = positive_response(_curve_gains(record, camera, request))
    mosaic = camera.sensor.colour
    assert mosaic is not None
    model = SnapshotModel.create(
        coded,
        gains / gains.sum(0) * rates.sum(0),
        zeroth_order=zeroth_orders(coded, neutral),
        neutral=neutral,
        pattern=mosaic.pattern,
        channels="".join(mosaic.channels),
    )
    return NominalCamera(model, sums[1] / sums[0])


def _predict_psfs(
    camera: Camera,
    greys: list[torch.Tensor],
    request: SpectraRequest,
    offset: tuple[float, float] | None,
) -> NDArray[np.float64]:
    """Predict star or point in each band, (2, bands, rows, columns).

    The first half is through the neutral pattern. The sides are odd, so that the window reaches as
    far on both sides of the middle.
    """
    side = min(request.window_px, *camera.sensor.shape)
    side -= 1 - side % 2
    distance = request.star_distance_m or panel_to_focus_distance(camera)
    diameter = _POINT if offset is None else request.star_diameter_um * 1e-6 or _POINT
    place = offset or (0.0, 0.0)
    found = [
        [one.numpy() for one in predict_star(camera, greys, nm, diameter, distance, side, place)]
        for nm in request.wavelengths
    ]
    psfs = np.array(found, dtype=np.float64).transpose(1, 0, 2, 3)
    return np.clip(psfs, 0, None)


def _curve_gains(record: Record, camera: Camera, request: SpectraRequest) -> NDArray[np.float64]:
    """Compute each channel's share of each band by the sensor's curves, (channels, bands)."""
    mosaic = camera.sensor.colour
    assert mosaic is not None
    gains = [white_balance(mosaic, None, passband_at(record, one)) for one in request.wavelengths]
    return np.stack(gains, axis=1)
