"""The PSF: measured on the star, freed of unmodulated light to be judged, and predicted."""

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
from labapp.light.pattern_psf import mean_psf
from labapp.pictures.analysis.brackets import Bracket, Picture, find_bracket
from labapp.runs.record.reader import Record
from optics import metrics
from optics.camera import Camera
from optics.formation import form_image, spectrum_of_disc
from optics.plane import Plane
from optics.psf import PSFOperator, nyquist_samples_per_pixel
from optics.slm import Modulator

_CORE = 3
"""Pixels around the centre in which unmodulated light is looked for."""

_MARGIN = 32
"""Pixels around a predicted window, so that its edges don't wrap into it."""


@dataclass(frozen=True, eq=False)
class StarImage:
    """A star as it was seen, in a window around the neutral one's peak.

    measured, neutral: share of the neutral star's light on each pixel, with the coded pattern and
    without, unmodulated light included. share_in_window: share of the coded star's light that falls
    in the window; what falls outside is missing from reconstructions. wavelength: metres.
    """

    measured: Picture
    neutral: Picture
    share_in_window: float
    wavelength: float


@dataclass(frozen=True, eq=False)
class PSFReport(StarImage):
    """A measured PSF and what it is judged against, on sensor pixels.

    modulated_psf: `measured` without the unmodulated light, to be judged against target.
    predicted: of the star, as the camera's description has it; None where the star isn't
    described. unmodulated: share found in the centre.
    efficiency: light of `modulated_psf` where the target exceeds 2 % of its peak over all light of
    `measured`. contrast: speckle contrast of `modulated_psf`, None where it has no light.
    prediction_error: relative L2, without a fitted scale.
    """

    modulated_psf: Picture
    target: Picture | None
    predicted: Picture | None
    unmodulated: float
    efficiency: float | None
    contrast: float | None
    prediction_error: float | None


def measure_psf(record: Record, brackets: list[Bracket], roles: Reconstruction) -> PSFReport:
    """The full PSF in a window around the neutral star's peak, and what it is judged by.

    UserError if the star frames are missing or dark.
    """
    star = crop_star(record, brackets, roles)
    measured, straight, window = star.measured, star.neutral, star.measured.shape[0]
    share = _unmodulated_share(straight, measured)
    shape = measured - share * straight
    camera = record.bench.build_camera()
    target = _target_on_sensor(record.plan.patterns[roles.coded], camera, window)
    predicted = _predict_recorded_star(record, camera, roles, star.wavelength, window)
    total = float(measured.sum())
    efficiency = None if target is None else metrics.efficiency(shape, target, total)
    return PSFReport(
        **vars(star),
        modulated_psf=shape,
        target=target,
        predicted=predicted,
        unmodulated=share,
        efficiency=efficiency,
        contrast=None if target is None else _contrast(shape, target),
        prediction_error=None if predicted is None else metrics.relative_error(measured, predicted),
    )


def crop_star(record: Record, brackets: list[Bracket], roles: Reconstruction) -> StarImage:
    """The star with the coded pattern; UserError if its frames are missing or dark."""
    neutral, coded = (
        find_bracket(brackets, roles.star, pattern, roles.wavelength, record.path)
        for pattern in (roles.neutral, roles.coded)
    )
    centre = bright_centroid(neutral.rate)
    window = min(roles.psf_window_px, *neutral.rate.shape)
    total = float(crop_centred(neutral.rate, centre, window).sum())
    if not total > 0:
        raise UserError(f"{record.path}: the neutral star frames are dark. Expose them longer.")
    measured = crop_centred(coded.rate, centre, window) / total
    inside = float(measured.sum()) * total / max(float(coded.rate.sum()), total)
    straight = crop_centred(neutral.rate, centre, window) / total
    return StarImage(measured, straight, inside, coded.wavelength)


def _contrast(shape: Picture, target: Picture) -> float | None:
    """Speckle contrast, which is none where a shape far from its target leaves it dark."""
    bright = target > 0.5 * target.max()
    lit = float((shape[bright] / target[bright]).mean()) > 0
    return metrics.speckle_contrast(shape, target) if lit else None


def bright_centroid(rate: Picture) -> tuple[int, int]:
    """The pixel at the centroid of what is brighter than a fifth of the peak."""
    y, x = np.nonzero(rate > 0.2 * rate.max())
    weight = rate[y, x]
    return round(float(np.average(y, weights=weight))), round(float(np.average(x, weights=weight)))


def crop_centred(image: Picture, centre: tuple[int, int], window: int) -> Picture:
    """A square around a pixel, which becomes its origin; beyond the picture there is none."""
    y, x = (c - window // 2 for c in centre)
    cut = np.zeros((window, window))
    rows = slice(max(y, 0), min(y + window, image.shape[0]))
    columns = slice(max(x, 0), min(x + window, image.shape[1]))
    inner = image[rows, columns]
    top, left = rows.start - y, columns.start - x
    cut[top : top + inner.shape[0], left : left + inner.shape[1]] = inner
    return cut


def _unmodulated_share(neutral: Picture, measured: Picture) -> float:
    """How much of the neutral PSF is in the centre of another: least squares there.

    Holds for shapes that leave their centre dark.
    """
    middle = neutral.shape[0] // 2
    part = (slice(middle - _CORE, middle + _CORE + 1),) * 2
    a, b = neutral[part], measured[part]
    return float(np.clip((a * b).sum() / (a * a).sum(), 0, 1))


def _target_on_sensor(spec: Pattern, camera: Camera, window: int) -> Picture | None:
    """What the pattern's PSF was asked to be, of a video the mean of its moments; None for other
    patterns, and for a logo, whose picture a record hasn't got."""
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
    """The star through the camera's description, on the scale of the measured PSF.

    At the filter's centre wavelength; its band is not modelled here.
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
) -> list[torch.Tensor]:
    """Share of a star's light on each pixel of a square window, a picture for each pattern.

    greys: grey levels on the panel; (frames, rows, columns) of a video, which is repeated.
    diameter, distance: of the star, metres. Star and pixel are included.
    """
    finer = math.ceil(nyquist_samples_per_pixel(camera, wavelength))
    side = window + 2 * _MARGIN
    plane = camera.sensor.window_plane((side, side)).with_finer_pitch(finer)
    operator = PSFOperator(camera, distance, wavelength, plane, integrate=False, unmodulated=0.0)
    modulator = Modulator(camera.panel, wavelength)
    size = diameter * camera.magnification(distance)
    disc = spectrum_of_disc(plane, size, 1 / finer**2)

    def predict(grey: torch.Tensor) -> torch.Tensor:
        (psf,) = mean_psf(operator, modulator, grey if grey.ndim == 3 else grey[None])
        return form_image(disc, psf, plane, finer, (window, window))

    return [predict(grey) for grey in greys]
