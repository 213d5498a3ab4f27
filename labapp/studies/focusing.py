"""Where a camera is in focus, by the blur of stars at several distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from labapp.common.errors import UserError
from labapp.pictures.analysis.brackets import Picture
from labapp.pictures.analysis.star_psf import bright_centroid, crop_centred
from optics.camera import Camera

_WINDOW = 192
"""Sensor pixels across a defocused star."""

_DIFFRACTION_ARM_PX = 6
"""Pixels around the axes that are left to the diffraction of a rectangle in focus."""


@dataclass(frozen=True)
class FocusCurve:
    """Blur of stars by their vergence, and the parabola through it.

    vergences: 1 / distance, dioptres. squares: mean square radius of each star, m². best: the
    vergence with the least blur. slope: m² a dioptre². least: m².
    """

    vergences: Sequence[float]
    squares: Sequence[float]
    best: float
    slope: float
    least: float


class DefocusedStar:
    """A star at a distance, without and with the lens: shares of its light, around its centre."""

    def __init__(self, distance: float, plain: Picture, coded: Picture) -> None:
        self.distance = distance
        centre = bright_centroid(plain)
        window = min(_WINDOW, *plain.shape)
        total = float(crop_centred(plain, centre, window).sum())
        if not total > 0:
            raise UserError(
                f"the star at {distance:g} m is dark. Expose it longer: the setting 'star_ms'."
            )
        self.plain = crop_centred(plain, centre, window) / total
        self.coded = crop_centred(coded, centre, window) / total

    @property
    def unmodulated_share(self) -> float:
        """How much of the picture without the lens is in the one with it, beside its focus."""
        y, x = np.abs(np.indices(self.plain.shape) - self.plain.shape[0] // 2)
        beside = (
            (y > _DIFFRACTION_ARM_PX)
            & (x > _DIFFRACTION_ARM_PX)
            & (self.plain > 0.2 * np.percentile(self.plain, 99))
        )
        if not beside.any():
            return 0.0
        plain, coded = self.plain[beside], self.coded[beside]
        return float(np.clip((plain * coded).sum() / (plain * plain).sum(), 0, 1))


def fit_focus_curve(
    stars: Sequence[DefocusedStar], pictures: Sequence[Picture], camera: Camera
) -> FocusCurve:
    vergences = [1 / star.distance for star in stars]
    squares = [_mean_square(picture) * camera.sensor.pitch**2 for picture in pictures]
    slope, linear, constant = np.polyfit(vergences, squares, 2)
    best = -linear / (2 * slope)
    return FocusCurve(
        vergences, squares, float(best), float(slope), float(constant - slope * best**2)
    )


def _mean_square(picture: Picture) -> float:
    """Of the radius about the centroid, pixels."""
    light = picture / picture.sum()
    y, x = np.indices(picture.shape)
    cy, cx = (y * light).sum(), (x * light).sum()
    return float((((y - cy) ** 2 + (x - cx) ** 2) * light).sum())


def mean_square_pupil_radius(camera: Camera) -> float:
    """Mean of x² + y² over the panel within the stop, m²: of a star's blur by a dioptre, over
    the square of the image distance."""
    panel = camera.panel
    y, x = (np.arange(n) - (n - 1) / 2 for n in panel.shape)
    square = (y[:, None] ** 2 + x**2) * panel.pitch**2
    inside = square <= (camera.lens.stop_diameter / 2) ** 2
    return float(square[inside].mean())
