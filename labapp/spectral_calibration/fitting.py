"""Fits of a record's frames: PSFs, zeroth orders and response of each band."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.pictures.analysis.brackets import Bracket, find_bracket, merge_all
from labapp.pictures.analysis.colour_filters import passband_at
from labapp.pictures.analysis.star_psf import predict_star
from labapp.pictures.colour_matrix import white_balance
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.spectral.band_response import response_from_sheet
from labapp.spectral.neutral_stack import coded_light_share
from labapp.spectral.snapshot_prior import positive_response, require_filters, zeroth_orders
from labapp.spectral_calibration.request import SpectraRequest, request_of_record
from optics.camera.pupil import panel_to_focus_distance
from optics.multispectral import (
    SnapshotCalibration,
    SnapshotModel,
    calibrate_from_frames,
)
from optics.multispectral.frame_calibration import StarFrames
from optics.progress import Progress

Stack = NDArray[np.float64]

_POINT = 1e-9  # metres; diameter of a star whose size isn't known
_CENTRAL_SHARE = 0.5  # of each side of a white sheet's picture, where its light is most even

# Least brightest pixel of a star, over the noise of a dark one. Chosen: of less, a PSF's place is
# known no better than by the nominal model.
_LEAST_STAR = 10.0

_DARK_PERCENTILE = 10.0  # of the variances of a star's picture; counts as that of a dark pixel
_MAD_TO_DEVIATION = 1.4826  # standard deviation of a normal variable over its median absolute one

# Pixels around the PSFs' middle from which the star's place is found first. Chosen: the zeroth
# order shows it best.
_PLACE_REACH = 12

_BRIGHT = 5.0  # noises of a dark pixel from which a pixel's photon noise can be told


@dataclass(frozen=True, eq=False)
class SpectraFit:
    """The fitted model of a camera, and the pictures that it was fitted to.

    path: of the record.
    request: what was asked for.
    prior, found: the nominal model with its uncertainty, and the calibrated one. Their response is
        the white sheet's light in electrons per second.
    stars: (bands, rows, columns), the star's pictures around its place, each over its light.
    predicted: (bands, rows, columns), what the calibrated model predicts of them.
    star_residuals: (bands,), rms of what the model leaves of each star's picture beyond the noise,
        relative to it.
    light_share: (bands,), share of the light that the coded pattern sends into the window of the
        PSF: that of the sheet's light which it passes, times the computed share within the window.
    coded_sha256: digest of the coded pattern's grey levels.
    """

    path: Path
    request: SpectraRequest
    prior: SnapshotCalibration
    found: SnapshotCalibration
    stars: Stack
    predicted: Stack
    star_residuals: NDArray[np.float64]
    light_share: NDArray[np.float64]
    coded_sha256: str


def fit_spectra(path: Path, progress: Progress) -> SpectraFit:
    """Fit all parameters together to a record's frames of white sheet and coded star.

    The fit starts at the nominal model, computed from the bench's description and the patterns.
    Raises UserError if the record is of another kind or incomplete, its sensor has no colour
    filters, or its frames are clipped or dark.
    """
    with Record(path) as record:
        request = request_of_record(record)
        if record.state is not State.COMPLETE:
            raise UserError(
                f"{path}: the run is {record.state}, and a calibration needs all of its frames. "
                f"Take them with: labapp resume {shell_word(path)}"
            )
        require_filters("--spectra", record.camera.sensor.colour)
        names = {request.star, request.flat}
        brackets = merge_all(record, progress.part(0, 0.4), names)
        white = response_from_sheet(
            record, brackets, request.flat, request.neutral, request.wavelengths
        )
        assert white.white is not None
        flats, coded_flats, stars = (
            [find_bracket(brackets, target, shown, one, path) for one in request.wavelengths]
            for target, shown in (
                (request.flat, request.neutral),
                (request.flat, request.coded),
                (request.star, request.coded),
            )
        )
        progress.report(0.4, "nominal PSFs")
        rates = white.shares * white.white
        # What is kept is of a point; what is fitted has the size and the place of the star.
        nominal, window_share = _compute_nominal_model(record, request, rates)
        model, _ = _compute_nominal_model(record, request, rates, (0.0, 0.0))
        seen, photons = _star_pictures(stars)
        sheet = _flat_pictures(flats, model, photons)

        def fit(start: SnapshotModel) -> SnapshotCalibration:
            try:
                return calibrate_from_frames(
                    SnapshotCalibration.nominal(start),
                    flats=sheet,
                    stars=seen,
                    noise=1.0,
                    photon_variance=photons,
                )
            except ValueError as error:
                raise UserError(f"{path}: {error}.") from error

        progress.report(0.6, "place of the star")
        place = _common_shift(fit(_middle_of(model)))
        progress.report(0.8, "fit")
        # Interpolation would cost more than a model that is computed at the star's place.
        at_star = fit(_compute_nominal_model(record, request, rates, place)[0])
        pattern = record.pattern(request.coded).tobytes()
    found = _as_point(at_star, nominal)
    shown, predicted, residuals = _compare_stars(at_star, seen, photons)
    return SpectraFit(
        path,
        request,
        SnapshotCalibration.nominal(nominal),
        found,
        shown,
        predicted,
        residuals,
        window_share * coded_light_share(coded_flats, flats),
        hashlib.sha256(pattern).hexdigest(),
    )


def _compute_nominal_model(
    record: Record,
    request: SpectraRequest,
    rates: NDArray[np.float64],
    offset: tuple[float, float] | None = None,
) -> tuple[SnapshotModel, NDArray[np.float64]]:
    """Compute the model of a camera as described, whose deviations the frames then show.

    Its PSFs follow from the description of panel, lens and sensor, and from the recorded patterns;
    they have no noise. Its response has the light of the white sheet: of each band, the sum over
    the channels is the measured one, divided among them as the sensor's curves say.

    Returns as well the light in the window of the coded PSF over that in the window of the neutral
    one, (bands,); the pattern sends the rest beyond the window.

    rates: (channels, bands), electrons per second that the white sheet gives behind each filter.
    offset: place (y, x) of the star relative to the middle pixel, in pixels; its PSFs are those of
        the star. Of a point in the middle if None.
    """
    camera, bands = record.camera, request.wavelengths
    greys = [torch.from_numpy(record.pattern(one)) for one in (request.neutral, request.coded)]
    side = min(request.window_px, *camera.sensor.shape)
    # Odd, so that the window reaches as far on both sides of the middle.
    side -= 1 - side % 2
    distance = request.star_distance_m or panel_to_focus_distance(camera)
    diameter = _POINT if offset is None else request.star_diameter_um * 1e-6 or _POINT
    place = offset or (0.0, 0.0)
    stars = [
        [one.numpy() for one in predict_star(camera, greys, at, diameter, distance, side, place)]
        for at in bands
    ]
    # (neutral and coded, bands, rows, columns)
    psfs = np.clip(np.array(stars, dtype=np.float64).transpose(1, 0, 2, 3), 0, None)
    sums = psfs.sum((2, 3))
    neutral, coded = psfs / sums[..., None, None]
    mosaic = require_filters("--spectra", camera.sensor.colour)
    curves = [white_balance(mosaic, None, passband_at(record, one)) for one in bands]
    gains = positive_response(np.stack(curves, axis=1))
    model = SnapshotModel.create(
        coded,
        gains / gains.sum(0) * rates.sum(0),
        zeroth_order=zeroth_orders(coded, neutral),
        neutral=neutral,
        pattern=mosaic.pattern,
        channels="".join(mosaic.channels),
    )
    return model, sums[1] / sums[0]


def _middle_of(model: SnapshotModel) -> SnapshotModel:
    """Return the model with only the middle of its PSFs, which shows the star's place."""
    parts = [
        slice(max(n // 2 - _PLACE_REACH, 0), n // 2 + _PLACE_REACH + 1)
        for n in model.coded.shape[1:]
    ]
    window = (slice(None), *parts)
    return replace(model, coded=model.coded[window], neutral=model.neutral[window])


def _common_shift(found: SnapshotCalibration) -> tuple[float, float]:
    """Return the star's place (y, x) relative to its pixel, in pixels."""
    places = found.model.layout.centres
    shift = (found.deviation - found.relative_deviation)[places].reshape(2, -1)[:, 0]
    return float(shift[0]), float(shift[1])


def _as_point(found: SnapshotCalibration, model: SnapshotModel) -> SnapshotCalibration:
    """Turn the fit of a star at its place into that of a point's model."""
    deviation = found.relative_deviation.clone()
    orders = model.layout.zeroth_orders
    deviation[orders] += found.model.zeroth_order - model.zeroth_order
    return replace(found, model=model, deviation=deviation)


def _star_pictures(stars: Sequence[Bracket]) -> tuple[Stack, float]:
    """Return the stars over a dark pixel's noise, (bands, rows, columns), and their photon noise.

    Photon noise is its variance over light: of the bright pixels, the upper tenth of each band
    counts, and the largest of all bands, as bright pixels are from shorter exposures, which are
    noisier. Raises UserError if a star is clipped or dark.
    """
    rates, photons = [], 0.0
    for one in stars:
        if not np.isfinite(one.variance).all():
            raise UserError(
                f"{one.name}: the star is clipped in every exposure. Expose it shorter: "
                "--exposure-ms."
            )
        # Most of the frame is dark; its scatter includes the rounding to digital numbers.
        scatter = _MAD_TO_DEVIATION * float(np.median(np.abs(one.rate - np.median(one.rate))))
        noise = max(scatter, np.sqrt(float(np.percentile(one.variance, _DARK_PERCENTILE))))
        rate, variance = one.rate / noise, one.variance / noise**2
        bright = rate > _BRIGHT
        if rate.max() < _LEAST_STAR:
            raise UserError(
                f"{one.name}: the star is hardly brighter than the noise. Expose it longer: "
                "--exposure-ms, or leave the band out."
            )
        if bright.any():
            ratios = np.clip(variance[bright] - 1, 0, None) / rate[bright]
            photons = max(photons, float(np.percentile(ratios, 90)))
        rates.append(rate)
    return np.stack(rates), photons


def _flat_pictures(flats: Sequence[Bracket], model: SnapshotModel, photons: float) -> Stack:
    """Return the middle of the white sheet's pictures, (bands, rows, columns).

    Their unit is chosen so that their noise is that of the stars: a variance of 1 in the dark, and
    `photons` for each unit of light.
    """
    period, found = (len(model.pattern), len(model.pattern[0])), []
    for one in flats:
        parts = []
        for n, step in zip(one.rate.shape, period, strict=True):
            first = round(n * (1 - _CENTRAL_SHARE) / 2) // step * step
            parts.append(slice(first, max(n - first, first + step)))
        rate, variance = one.rate[parts[0], parts[1]], one.variance[parts[0], parts[1]]
        light, spread = float(rate.mean()), float(variance.mean())
        part = photons * light
        found.append(2 * rate / (np.sqrt(part**2 + 4 * spread) - part))
    return np.stack(found)


def _compare_stars(
    found: SnapshotCalibration, seen: Stack, photons: float
) -> tuple[Stack, Stack, NDArray[np.float64]]:
    """Cut out the stars as they were fitted, and predict them.

    Returns both, (bands, rows, columns), relative to each band's light, and the relative rms of
    their difference beyond the noise, (bands,).
    """
    frames = StarFrames.create(found.model, seen)
    predicted = frames.predict(found.deviation)
    light = (frames.measured * predicted).sum(1) / predicted.square().sum(1)
    model = light[:, None] * predicted
    noise = (1 + photons * model.clamp(min=0)).sum(1)
    left = ((frames.measured - model).square().sum(1) - noise).clamp(min=0)
    shape, scale = (-1, *frames.channel_masks.shape[1:]), model.sum(1)[:, None]
    return (
        (frames.measured / scale).reshape(shape).numpy(),
        (model / scale).reshape(shape).numpy(),
        (left / model.square().sum(1)).sqrt().numpy(),
    )
