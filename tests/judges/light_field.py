"""A judge of images of layered scenes: a light field, one sharp picture for every pupil point.

Each point of the pupil is a pinhole, through which every layer is seen displaced by its defocus.
What such a pinhole sees is composited without blur, and the image is the mean over the pupil. A
shift by parts of a pixel is a mean of four whole ones, so that mattes stay within 0 to 1, and PSFs
and transfer functions are known in closed form, as sums over the pupil's points.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from judges.basics import Array, natural_image

Complex = NDArray[np.complex128]


def pupil_points(rows: int, columns: int) -> Array:
    """Middles of the parts of a pupil of 1 x 16/9, (points, 2), centred on the axis."""
    y = (np.arange(rows) + 0.5) / rows - 0.5
    x = ((np.arange(columns) + 0.5) / columns - 0.5) * 16 / 9
    return np.stack(np.meshgrid(y, x, indexing="ij"), -1).reshape(-1, 2)


def lattice_shifts(points: Array, dioptre: float, foci: Array, blur: float) -> Array:
    """Displacements in pixels, (points, 2), where each part of the pupil is a lens of its own.

    foci: (rows, columns) of parts of equal size, dioptres. All lenses have the pupil's axis.
    """
    rows, columns = foci.shape
    row = np.clip(np.floor((points[:, 0] + 0.5) * rows).astype(int), 0, rows - 1)
    column = np.clip(np.floor((points[:, 1] * 9 / 16 + 0.5) * columns).astype(int), 0, columns - 1)
    return blur * (dioptre - foci[row, column])[:, None] * points


def light_field_image(pictures: Array, mattes: Array, shifts: Array, weights: Array) -> Array:
    """Mean of sharp views over the pupil.

    pictures, mattes: (layers, rows, columns), the nearest first, periodic. shifts: (layers, points,
    2), pixels along y and x. weights: (points,), shares of the pupil, which may sum to less than 1.
    """
    image = np.zeros(pictures.shape[1:])
    for point, weight in enumerate(weights):
        view = _shifted(pictures[-1], shifts[-1, point])
        for layer in range(len(pictures) - 2, -1, -1):
            covered = _shifted(mattes[layer], shifts[layer, point])
            light = _shifted(mattes[layer] * pictures[layer], shifts[layer, point])
            view = light + (1 - covered) * view
        image += weight * view
    return image


def _shifted(picture: Array, shift: Array) -> Array:
    """A periodic picture, displaced by parts of a pixel: a mean of four whole displacements."""
    (y, fy), (x, fx) = ((math.floor(s), s - math.floor(s)) for s in shift)
    by_rows = (1 - fy) * np.roll(picture, y, 0) + fy * np.roll(picture, y + 1, 0)
    return (1 - fx) * np.roll(by_rows, x, 1) + fx * np.roll(by_rows, x + 1, 1)


def shift_transfer(shifts: Array, weights: Array, shape: tuple[int, int]) -> Complex:
    """Transfer function (rows, columns // 2 + 1) of one layer: a sum of phasors over the pupil."""
    rows, columns = shape
    along_y = _phasors(shifts[:, 0], np.fft.fftfreq(rows))
    along_x = _phasors(shifts[:, 1], np.fft.rfftfreq(columns))
    return (along_y * weights[:, None]).T @ along_x


def _phasors(shift: Array, frequency: Array) -> Complex:
    """Transfer functions of displacements along one axis, (points, frequencies)."""
    whole = np.floor(shift)[:, None]
    part = shift[:, None] - whole
    return np.exp(-2j * np.pi * frequency * whole) * (
        1 - part + part * np.exp(-2j * np.pi * frequency)
    )


def sum_of_masked_layers(pictures: Array, mattes: Array, transfers: Complex) -> Array:
    """What is often done instead: each layer's visible part is blurred, and all are added."""
    image, seen = np.zeros(pictures.shape[1:]), np.ones(pictures.shape[1:])
    for picture, matte, transfer in zip(pictures, mattes, transfers, strict=True):
        spectrum = np.fft.rfft2(seen * matte * picture) * transfer
        image += np.fft.irfft2(spectrum, pictures.shape[1:])
        seen = seen * (1 - matte)
    return image


def textured_layers(side: int, layers: int, seed: int) -> tuple[Array, Array]:
    """Pictures and mattes (layers, side, side), whose near layers cover discs and bars."""
    rng = np.random.default_rng(seed)
    pictures = np.stack([natural_image(side, side, seed + 100 * k) for k in range(layers)])
    y, x = np.mgrid[:side, :side]
    mattes = np.ones((layers, side, side))
    for k in range(layers - 1):
        (cy, cx), radius = side * rng.uniform(0.3, 0.7, 2), side * rng.uniform(0.15, 0.3)
        disc = np.clip(radius - np.hypot(y - cy, x - cx) + 0.5, 0, 1)
        bar = np.clip(side / 24 - np.abs(x - side * rng.uniform(0.1, 0.9) - 0.3 * y) + 0.5, 0, 1)
        mattes[k] = np.maximum(disc, bar)
    return pictures, mattes


def peak_ratio(image: Array, truth: Array) -> float:
    """Peak signal-to-noise ratio in dB, with a peak of 1."""
    error = float(np.mean((np.asarray(image) - truth) ** 2))
    return math.inf if error == 0 else -10 * math.log10(error)


@dataclass(frozen=True)
class LayeredCase:
    """Optics, and the depths of the layers of a scene, nearest first.

    foci: dioptres of the lens, (1, 1), or of each part of a lattice.
    """

    name: str
    foci: Array
    dioptres: tuple[float, ...]

    def shifts(self, points: Array, blur: float) -> Array:
        """Displacements of all layers, (layers, points, 2)."""
        return np.stack([lattice_shifts(points, d, self.foci, blur) for d in self.dioptres])


_LATTICE = np.linspace(0.125, 1.875, 8).reshape(2, 4)

CASES = (
    LayeredCase("lens at 0.5, 1.33 and 0.5 (far in focus)", np.array([[0.5]]), (1.33, 0.5)),
    LayeredCase("lens at 0.5, 2 and 0.02 (both sides)", np.array([[0.5]]), (2.0, 0.02)),
    LayeredCase("lens at 1.3, 1.33 and 0.5 (near in focus)", np.array([[1.3]]), (1.33, 0.5)),
    LayeredCase("lens at 0, 2 and 0.7 (same side)", np.array([[0.0]]), (2.0, 0.7)),
    LayeredCase("lens at 0.5, 2, 1 and 0.02", np.array([[0.5]]), (2.0, 1.0, 0.02)),
    LayeredCase("lattice of 2 x 4, 1.33 and 0.5", _LATTICE, (1.33, 0.5)),
    LayeredCase("lattice of 2 x 4, 2 and 0.02", _LATTICE, (2.0, 0.02)),
)
"""The depths of the study that found the over-composite good, and some more."""

Compositor = Callable[[Array, Array, Complex], Array]


def compare_compositors(
    case: LayeredCase, compositors: dict[str, Compositor], side: int, blur: float, seed: int
) -> dict[str, float]:
    """Agreement in dB of ways to composite a scene with the light field, peak 1.

    compositors: each takes pictures, mattes (layers, side, side) and transfer functions (layers,
    side, side // 2 + 1). blur: pixels for each dioptre along the pupil's short side.
    """
    points = pupil_points(18, 32)
    weights = np.full(len(points), 1 / len(points))
    pictures, mattes = textured_layers(side, len(case.dioptres), seed)
    shifts = case.shifts(points, blur)
    transfers = np.stack([shift_transfer(one, weights, (side, side)) for one in shifts])
    truth = light_field_image(pictures, mattes, shifts, weights)
    return {
        name: peak_ratio(composite(pictures, mattes, transfers), truth)
        for name, composite in compositors.items()
    }
