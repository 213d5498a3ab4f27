"""Measure the PSF on the star of a record, and compare it with target and prediction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from labapp.common.errors import UserError
from labapp.files.pattern_table import Pattern, PSFPattern, VideoPattern
from labapp.files.phase_table import RingPattern
from labapp.files.plan_file import Reconstruction
from labapp.files.scene_file import StarTable
from labapp.files.target_table import LogoTarget
from labapp.pictures.analysis.brackets import Bracket, Picture, find_bracket
from labapp.pictures.analysis.colour_filters import ColourFilters, star_filters
from labapp.prediction.pattern_psf import mean_psf
from labapp.runs.record.reader import Record
from optics import metrics
from optics.camera import Camera
from optics.formation import form_image, rfft2_frequencies, spectrum_of_disc
from optics.plane import Plane
from optics.psf import PSFOperator, nyquist_samples_per_pixel
from optics.slm import Modulator


@dataclass(frozen=True, eq=False)
class StarImage:
    """A star in a window around its peak with the neutral pattern.

    measured, neutral: (rows, columns), share of the neutral star's light on each pixel, with the
        coded and with the neutral pattern, unmodulated light included.
    share_in_window: share of the coded star's light inside the window; the light outside is missing
        from reconstructions.
    wavelength: metres.
    bands: (bands, rows, columns), `measured` of each band that is restored; the mean of the bands
        is `measured`. Of a sensor with colour filters, each band sums to 1: its neutral star is too
        small for all filters to see it alike.
    filters: colour filters of the sensor, with the star's light as white.
    variance, neutral_variance: variance of `measured` and of `neutral` by the camera's noise. 0
        where it isn't known: on pixels that are clipped in every exposure, and behind colour
        filters.
    """

    measured: Picture
    neutral: Picture
    share_in_window: float
    wavelength: float
    bands: Picture
    filters: ColourFilters | None
    variance: Picture
    neutral_variance: Picture

    def variance_without(self, share: float) -> Picture:
        """Return the noise variance of `measured` without a share of `neutral`."""
        return self.variance + share**2 * self.neutral_variance


@dataclass(frozen=True, eq=False)
class PSFReport(StarImage):
    """A measured PSF with its target, its prediction and their differences, on sensor pixels.

    modulated_psf: `measured` without the unmodulated light, to be compared with the target.
    target: requested shape of the PSF; None where the pattern has none.
    predicted: PSF of the star, computed from the camera's description; None where the scene doesn't
        describe the star.
    unmodulated: share of unmodulated light, measured at the centre.
    efficiency: light of `modulated_psf` where the target exceeds 2 % of its peak, over all light of
        `measured`.
    contrast: speckle contrast of `modulated_psf`, without the camera's noise; None where it has no
        light.
    prediction_error: relative L2 difference of measurement and prediction, without a fitted scale.
    """

    modulated_psf: Picture
    target: Picture | None
    predicted: Picture | None
    unmodulated: float
    efficiency: float | None
    contrast: float | None
    prediction_error: float | None


def measure_psf(record: Record, brackets: list[Bracket], roles: Reconstruction) -> PSFReport:
    """Measure the PSF on a star, and compare it with target and prediction.

    Raises UserError if the frames of the star are missing or dark.
    """
    star = crop_star(record, brackets, roles)
    measured, straight, window = star.measured, star.neutral, star.measured.shape[0]
    share = _unmodulated_share(straight, measured)
    shape = measured - share * straight
    camera = record.camera
    target = _target_on_sensor(record.plan.patterns[roles.coded], camera, window)
    predicted = _predict_recorded_star(record, camera, roles, star.wavelength, window)
    total = float(measured.sum())
    efficiency = contrast = None
    if target is not None:
        efficiency = metrics.efficiency(shape, target, total)
        bright = target > 0.5 * target.max()
        if float((shape[bright] / target[bright]).mean()) > 0:
            contrast = metrics.speckle_contrast(shape, target, star.variance_without(share))
    return PSFReport(
        **vars(star),
        modulated_psf=shape,
        target=target,
        predicted=predicted,
        unmodulated=share,
        efficiency=efficiency,
        contrast=contrast,
        prediction_error=None if predicted is None else metrics.relative_error(measured, predicted),
    )


def crop_star(record: Record, brackets: list[Bracket], roles: Reconstruction) -> StarImage:
    """Cut the star out of what was recorded with the neutral and with the coded pattern.

    Raises UserError if the frames of the star are missing or dark.
    """
    neutral, coded = (
        find_bracket(brackets, roles.star, pattern, roles.wavelength, record.path)
        for pattern in (roles.neutral, roles.coded)
    )
    filters = star_filters(record, coded, roles.grey)
    straight, seen = (_separate_bands(one, filters) for one in (neutral, coded))
    centre = bright_centroid(straight.mean(0))
    window = min(roles.psf_window_px, *neutral.rate.shape)
    straight = crop_centred(straight.mean(0), centre, window)
    if not straight.sum() > 0:
        raise UserError(f"{record.path}: the neutral star frames are dark. Expose them longer.")
    cut = np.stack([crop_centred(band, centre, window) for band in seen])
    total = float(straight.sum())
    inside = float(cut.mean(0).sum()) / max(float(seen.mean(0).sum()), total)
    sums = total if filters is None else cut.sum((1, 2), keepdims=True)
    bands = cut / sums
    noise, neutral_noise = (
        _known_variance(one, centre, window, filters) / total**2 for one in (coded, neutral)
    )
    return StarImage(
        bands.mean(0), straight / total, inside, coded.wavelength, bands, filters, noise,
        neutral_noise,
    )  # fmt: skip


def _known_variance(
    bracket: Bracket, centre: tuple[int, int], window: int, filters: ColourFilters | None
) -> Picture:
    """Cut the variance of a star's light out; 0 where it isn't known."""
    known = np.isfinite(bracket.variance) & (filters is None)
    return crop_centred(np.where(known, bracket.variance, 0.0), centre, window)


def _separate_bands(bracket: Bracket, filters: ColourFilters | None) -> Picture:
    """Return a star's light by band, (bands, rows, columns)."""
    if filters is None:
        return bracket.rate[None]
    clipped = ~np.isfinite(bracket.variance)
    noise = float(np.sqrt(bracket.variance[~clipped].mean())) if not clipped.all() else 0.0
    return filters.separate(bracket.rate, noise, clipped).astype(np.float64)


def bright_centroid(rate: Picture) -> tuple[int, int]:
    """Return the pixel (y, x) at the centroid of all pixels above a fifth of the peak."""
    y, x = np.nonzero(rate > 0.2 * rate.max())
    weight = rate[y, x]
    return round(float(np.average(y, weights=weight))), round(float(np.average(x, weights=weight)))


def crop_centred(image: Picture, centre: tuple[int, int], window: int) -> Picture:
    """Cut out a square window, with the pixel `centre` at its n // 2; 0 beyond the frame."""
    y, x = (c - window // 2 for c in centre)
    cut = np.zeros((window, window))
    rows = slice(max(y, 0), min(y + window, image.shape[0]))
    columns = slice(max(x, 0), min(x + window, image.shape[1]))
    inner = image[rows, columns]
    top, left = rows.start - y, columns.start - x
    cut[top : top + inner.shape[0], left : left + inner.shape[1]] = inner
    return cut


def _unmodulated_share(neutral: Picture, measured: Picture) -> float:
    """Return the share of unmodulated light, 0 to 1, in a measured PSF that is dark at its centre.

    The neutral PSF is fitted there by least squares.
    """
    middle, core = neutral.shape[0] // 2, 3
    part = (slice(middle - core, middle + core + 1),) * 2
    a, b = neutral[part], measured[part]
    return float(np.clip((a * b).sum() / (a * a).sum(), 0, 1))


def _target_on_sensor(spec: Pattern, camera: Camera, window: int) -> Picture | None:
    """Draw a pattern's target on sensor pixels, to compare it with the measured PSF.

    Of a video, the mean of its frames' targets is drawn. Returns None for a pattern without a
    target, and for a logo, whose picture a record doesn't contain.
    """
    frames = 1
    if isinstance(spec, VideoPattern) and spec.pattern is not None:
        frames = spec.length
        spec = spec.pattern
    if not isinstance(spec, RingPattern | PSFPattern) or isinstance(spec.target, LogoTarget):
        return None
    pitch = camera.sensor.pitch
    plane = Plane((window, window), (pitch, pitch))
    try:
        moments = [moment.render(plane) for moment in spec.target.video_drawings(frames, Path())]
    except ValueError as error:
        raise UserError(
            f"the PSF's window is {window} pixels: {error}, or a larger 'psf_window_px' in the "
            "plan's [reconstruct] table."
        ) from error
    return torch.stack(moments).mean(0).numpy()


def _predict_recorded_star(
    record: Record, camera: Camera, roles: Reconstruction, wavelength: float, window: int
) -> Picture | None:
    """Predict the light of a star, scaled like the PSF measured on it.

    The camera's description is evaluated at the filter's centre wavelength; the filter's bandwidth
    isn't modelled. Returns None if the record describes no scene with this star.
    """
    scene = record.scene
    star = scene.targets.get(roles.star) if scene else None
    if not isinstance(star, StarTable):
        return None
    greys = [torch.from_numpy(record.pattern(name)) for name in (roles.neutral, roles.coded)]
    neutral, coded = predict_star(
        camera, greys, wavelength, star.diameter_um * 1e-6, star.distance_m, window
    )
    return (coded / neutral.sum()).numpy()


def predict_star(
    camera: Camera,
    greys: Sequence[torch.Tensor],
    wavelength: float,
    diameter: float,
    distance: float,
    window: int,
    offset: tuple[float, float] = (0.0, 0.0),
) -> list[torch.Tensor]:
    """Predict a star's image with each pattern, as shares of its light per pixel.

    The pixels are a square window. The finite sizes of star and pixel are included.

    greys: levels on the panel, (rows, columns), or (frames, rows, columns) of a repeated video.
    wavelength, diameter, distance: of the light and of the star, metres.
    window: side of the window in sensor pixels.
    offset: place (y, x) of the star's image relative to the middle pixel, in pixels. Its PSF is
        that of the axis.
    """
    finer = math.ceil(nyquist_samples_per_pixel(camera, wavelength))
    # 32 pixels on each side keep the edges of the computed window from wrapping into the result.
    side = window + 2 * 32
    plane = camera.sensor.window_plane((side, side)).with_finer_pitch(finer)
    operator = PSFOperator(camera, distance, wavelength, plane, integrate=False, unmodulated=0.0)
    modulator = Modulator(camera.panel, wavelength)
    size = diameter * camera.magnification(distance)
    disc = spectrum_of_disc(plane, size, 1 / finer**2)
    fy, fx = rfft2_frequencies(plane)
    y, x = (one * camera.sensor.pitch for one in offset)
    disc = disc * torch.exp(-2j * math.pi * (fy * y + fx * x))

    def predict(grey: torch.Tensor) -> torch.Tensor:
        (psf,) = mean_psf(operator, modulator, grey if grey.ndim == 3 else grey[None])
        return form_image(disc, psf, plane, finer, (window, window))

    return [predict(grey) for grey in greys]
