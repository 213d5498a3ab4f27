"""Measure the distance in focus by the blur of stars at several distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from labapp.common.errors import UserError
from labapp.pictures.analysis.brackets import Picture
from labapp.pictures.analysis.star_psf import bright_centroid, crop_centred
from optics.camera import Camera


@dataclass(frozen=True)
class FocusCurve:
    """Hold the blur of stars by their vergence, and the parabola fitted to it.

    vergences: 1 / distance of each star, dioptres.
    squares: mean square radius of each star's picture, m².
    best: vergence of the parabola's minimum, dioptres.
    slope: coefficient of the parabola's square term, m² per dioptre².
    least: mean square radius at the minimum, m².
    """

    vergences: Sequence[float]
    squares: Sequence[float]
    best: float
    slope: float
    least: float


class DefocusedStar:
    """Hold the pictures of a star without and with the SLM's lens, as shares of the star's light.

    Both are centred on the star. Raises UserError if the star is dark.
    distance: metres.
    """

    def __init__(self, distance: float, plain: Picture, coded: Picture) -> None:
        self.distance = distance
        centre = bright_centroid(plain)
        window = min(192, *plain.shape)
        total = float(crop_centred(plain, centre, window).sum())
        if not total > 0:
            raise UserError(
                f"the star at {distance:g} m is dark. Expose it longer: the setting 'star_ms'."
            )
        self.plain = crop_centred(plain, centre, window) / total
        self.coded = crop_centred(coded, centre, window) / total

    @property
    def unmodulated_share(self) -> float:
        """Share of the picture without the lens that is left in the picture with it, 0 to 1.

        Only pixels beside the focus of the lens are compared.
        """
        y, x = np.abs(np.indices(self.plain.shape) - self.plain.shape[0] // 2)
        # Six pixels around the axes are left out, where a rectangle's diffraction puts light.
        beside = (y > 6) & (x > 6) & (self.plain > 0.2 * np.percentile(self.plain, 99))
        if not beside.any():
            return 0.0
        plain, coded = self.plain[beside], self.coded[beside]
        return float(np.clip((plain * coded).sum() / (plain * plain).sum(), 0, 1))


def fit_focus_curve(
    stars: Sequence[DefocusedStar], pictures: Sequence[Picture], camera: Camera
) -> FocusCurve:
    """Fit a parabola in vergence to the mean square radii of stars."""
    vergences = [1 / star.distance for star in stars]
    squares = [_mean_square(picture) * camera.sensor.pitch**2 for picture in pictures]
    slope, linear, constant = np.polyfit(vergences, squares, 2)
    best = -linear / (2 * slope)
    return FocusCurve(
        vergences, squares, float(best), float(slope), float(constant - slope * best**2)
    )


def _mean_square(picture: Picture) -> float:
    """Return the mean square distance of a picture's light from its centroid, pixels²."""
    light = picture / picture.sum()
    y, x = np.indices(picture.shape)
    cy, cx = (y * light).sum(), (x * light).sum()
    return float((((y - cy) ** 2 + (x - cx) ** 2) * light).sum())


def mean_square_pupil_radius(camera: Camera) -> float:
    """Return the mean of x² + y² in m² over the part of the panel within the stop.

    Multiplied by the square of the image distance, this gives the mean square radius of a star that
    is one dioptre out of focus.
    """
    panel = camera.panel
    y, x = (np.arange(n) - (n - 1) / 2 for n in panel.shape)
    square = (y[:, None] ** 2 + x**2) * panel.pitch**2
    inside = square <= (camera.lens.stop_diameter / 2) ** 2
    return float(square[inside].mean())
