"""Make pictures out of random numbers alone, for trainings and tests without any file.

Most are dead leaves: opaque shapes on top of each other, whose sizes follow a power law. Their
power spectrum falls about as that of photographs, with 1 / f², and they have what photographs have:
edges that hide things, shading, fine texture and plain areas. Some have writing or gratings on top.

Source: A. B. Lee, D. Mumford, J. Huang, "Occlusion models for natural images", Int. J. Computer
Vision 41, 35, 2001, doi 10.1023/A:1011109015675.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.training.manifest import Split

Picture = NDArray[np.float32]

_OVERSAMPLING = 2
"""Drawn pixels along each side of a pixel, whose mean makes edges smooth."""

_SMALLEST_RADII = (1.0, 8.0)
"""Range of a picture's least radius of leaves, in pixels. Chosen: some pictures are crowded, others
plain."""

_LARGEST_RADIUS = 0.6
"""Largest radius of a leaf, in sides of the picture. Chosen."""

_COVERS = 3.0
"""Area of all leaves over that of the picture. Chosen: a twentieth of the plain ground is seen."""

_POLYGON_SHARE = 0.4
"""Share of leaves that are polygons; the others are ellipses. Chosen."""

_SUBPIXELS = 16
"""Steps of a drawn pixel in which shapes are placed; a power of two, as OpenCV wants it."""

_EXTRA_SHARE = 0.3
"""Share of pictures with writing or a grating on their leaves. Chosen."""

_TEXTURE_CONTRAST = 0.12
"""Largest standard deviation of a leaf's texture, in sRGB values. Chosen."""

_SHADING = 0.3
"""Largest change of a leaf's level across the picture, in sRGB values. Chosen."""


class ProceduralPictures:
    """Makes random grey patches, with the interface of `TrainingPictures`."""

    def patch(
        self, generator: np.random.Generator, side: int, split: Split = "training"
    ) -> Picture:
        """Make a random grey patch of leaves, writing and gratings, (side, side).

        Its values are sRGB, 0 to 1. Raises UserError if the side is below 8 pixels.
        generator: the only source of random numbers.
        side: pixels along each side, 8 or more.
        split: without influence, as no picture comes twice.
        """
        if side < 8:
            raise UserError(f"A patch of {side} x {side} pixels: give 8 or more along a side.")
        fine = side * _OVERSAMPLING
        canvas = _draw_leaves(generator, fine)
        # Level, slopes and texture together.
        along = np.arange(fine, dtype=np.float32)
        values = canvas[..., 0] + canvas[..., 1] * along + canvas[..., 2] * along[:, None]
        values = values + canvas[..., 3] * _draw_texture(generator, fine)
        extra = generator.random() / _EXTRA_SHARE
        if extra < 0.5:
            add_writing(values, generator, _OVERSAMPLING, ink=float(generator.random() < 0.3))
        elif extra < 1:
            _add_grating(values, generator)
        patch = cv2.resize(values, (side, side), interpolation=cv2.INTER_AREA)
        return np.clip(patch, 0, 1)


def _draw_leaves(generator: np.random.Generator, side: int) -> Picture:
    """Draw leaves on top of each other, (side, side, 4).

    Each leaf is drawn with its own level, its level's slopes along x and y, and its contrast of
    texture.
    """
    radii = _draw_radii(generator, side)
    places = generator.uniform(-0.1, 1.1, (len(radii), 2)) * side
    colours = _draw_colours(generator, len(radii) + 1, side, places)
    canvas = np.empty((side, side, 4), np.float32)
    canvas[:] = colours[-1]
    count = len(radii)
    turns = np.sort(generator.random((count, 4)), 1) * 2 * math.pi
    corners = radii[:, None, None] * np.stack([np.cos(turns), np.sin(turns)], -1)
    corners = np.rint((corners + places[:, None]) * _SUBPIXELS).astype(np.int32)
    axes = radii[:, None] * np.stack([np.ones(count), generator.uniform(0.35, 1.0, count)], 1)
    whole_axes = np.rint(axes * _SUBPIXELS).astype(int).tolist()
    centres = np.rint(places * _SUBPIXELS).astype(int).tolist()
    angles = generator.uniform(0, 180, count).tolist()
    is_polygon = generator.random(count) < _POLYGON_SHARE
    shift = _SUBPIXELS.bit_length() - 1
    for i, colour in enumerate(colours[:-1].tolist()):
        if is_polygon[i]:
            cv2.fillConvexPoly(canvas, corners[i], colour, cv2.LINE_8, shift)
        else:
            place, size, angle = centres[i], whole_axes[i], angles[i]
            cv2.ellipse(canvas, place, size, angle, 0, 360, colour, -1, cv2.LINE_8, shift)
    return canvas


def _draw_radii(generator: np.random.Generator, side: int) -> NDArray[np.float64]:
    """Draw the radii of leaves in drawn pixels; their density falls with the cube of the radius."""
    least = _SMALLEST_RADII[0] * (_SMALLEST_RADII[1] / _SMALLEST_RADII[0]) ** generator.random()
    high = _LARGEST_RADIUS * side
    low = min(least * _OVERSAMPLING, high / 2)
    mean_square = 2 * math.log(high / low) / (low**-2 - high**-2)
    count = max(1, round(_COVERS * side**2 / (math.pi * mean_square)))
    return (low**-2 + generator.random(count) * (high**-2 - low**-2)) ** -0.5


def _draw_colours(
    generator: np.random.Generator, count: int, side: int, places: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Draw level, slopes and contrast of leaves, (count, 4); the level is that at the origin."""
    level = generator.beta(1.2, 1.6, count)
    slopes = generator.uniform(-_SHADING, _SHADING, (count, 2)) / side
    slopes *= generator.random((count, 1)) < 0.5
    centres = np.vstack([places, np.full((count - len(places), 2), side / 2)])
    contrast = _TEXTURE_CONTRAST * generator.random(count) ** 2
    at_origin = level - (slopes * centres).sum(1)
    return np.column_stack([at_origin, slopes, contrast])


def _draw_texture(generator: np.random.Generator, side: int) -> Picture:
    """Draw noise of three scales for leaves' texture, with a standard deviation of about 1."""
    texture = np.zeros((side, side), np.float32)
    for cells in (2, 4, 8):
        count = max(2, side // cells)
        noise = generator.standard_normal((count, count), dtype=np.float32)
        texture += cv2.resize(noise, (side, side), interpolation=cv2.INTER_LINEAR)
    return texture


def add_writing(
    values: Picture, generator: np.random.Generator, oversampling: int, ink: float
) -> None:
    """Write rows of strokes, like writing, over a part of a picture, in place.

    values: the picture as it is drawn, (side, side).
    oversampling: drawn pixels along each side of a pixel.
    ink: value of the strokes.
    """
    side = values.shape[0]
    height = int(generator.integers(7, 25)) * oversampling
    width = max(1, round(height * generator.uniform(0.06, 0.2)))
    left, top = generator.uniform(-0.2, 0.7, 2) * side
    rows, glyphs = int(generator.integers(1, 6)), int(generator.integers(3, 16))
    corners = generator.uniform(0, 1, (rows, glyphs, 5, 2)) * (0.6 * height, height)
    corners[..., 0] += left + 0.8 * height * np.arange(glyphs)[:, None]
    corners[..., 1] += top + 1.5 * height * np.arange(rows)[:, None, None]
    strokes = np.rint(corners.reshape(-1, 5, 2)).astype(np.int32)
    cv2.polylines(values, list(strokes), False, ink, width, cv2.LINE_8)


def _add_grating(values: Picture, generator: np.random.Generator) -> None:
    """Put a disc with a grating of any period on leaves, in place."""
    side = values.shape[0]
    period = _OVERSAMPLING * math.exp(generator.uniform(math.log(3), math.log(24)))
    angle, phase = generator.uniform(0, math.pi), generator.uniform(0, 2 * math.pi)
    along = np.arange(side, dtype=np.float32) * (2 * math.pi / period)
    waves = np.sin(along * math.cos(angle) + along[:, None] * math.sin(angle) + phase)
    if generator.random() < 0.5:
        waves = np.sign(waves)
    disc = np.zeros(values.shape, np.uint8)
    centre = [int(one) for one in generator.integers(0, side, 2)]
    cv2.circle(disc, centre, int(generator.integers(side // 8, side // 2)), 1, -1)
    level, contrast = generator.uniform(0.3, 0.7), generator.uniform(0.05, 0.3)
    np.copyto(values, level + contrast * waves, where=disc.astype(bool))
