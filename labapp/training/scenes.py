"""Draw random scenes to train on: planes, and layers that hide parts of those behind them.

Every layer is a patch of its own, which goes on where nearer layers hide it, as blurred edges let
it be seen there. Mattes are drawn: blobs, polygons, bars with branches, and writing. Nothing is cut
out of a photograph, whose hidden parts aren't known.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.training.manifest import Split
from labapp.training.procedural_scenes import add_writing

Layers = NDArray[np.float32]
_Mask = NDArray[np.float32]

_OVERSAMPLING = 4
"""Drawn pixels along each side of a pixel; their mean makes edges about a pixel wide, with mattes
in steps of a sixteenth. Chosen."""

_COVERAGES = (0.03, 0.7)
"""Range of the share of a scene that a layer's matte may cover, so that both the layer and what is
behind it are seen. Chosen."""

_ATTEMPTS = 8
"""Shapes that are drawn until one covers a share within `_COVERAGES`. Chosen: one in six
doesn't, so that one matte in a million ends as a half plane."""

_BLOB_CELLS = (2, 7)
"""Range of a blob's random numbers along each side of a scene: the fewer, the larger. Chosen."""


@dataclass(frozen=True)
class SceneSettings:
    """What random scenes are made of; UserError if a value is out of range.

    layered_share: probability of a scene of several layers, 0 to 1; the others are planes. The
    default is that of a study in which it restored planes no worse, and layers better, than 0 did.
    most_layers: largest number of layers, 2 or more; 2 to this number are equally likely.
    """

    layered_share: float = 0.5
    most_layers: int = 4

    def __post_init__(self) -> None:
        if not 0 <= self.layered_share <= 1:
            raise UserError(
                f"The share of layered scenes is {self.layered_share:g}: give 0 to 1, such as 0.5."
            )
        if self.most_layers < 2:
            raise UserError(
                f"Layered scenes of at most {self.most_layers} layers: give 2 or more, or a share "
                "of layered scenes of 0."
            )


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene of layers, the nearest first; a plane has one.

    pictures: sRGB values, (layers, side, side), 0 to 1.
    mattes: share of each pixel that a layer covers, (layers, side, side), 0 to 1. The farthest
    layer's is 1.
    """

    pictures: Layers
    mattes: Layers


class PatchSource(Protocol):
    """What patches are cut from: `TrainingPictures` or `ProceduralPictures`."""

    def patch(
        self, generator: np.random.Generator, side: int, split: Split = "training"
    ) -> NDArray[np.float32]:
        """Return a random grey patch, (side, side), sRGB values from 0 to 1."""


def draw_scene(
    pictures: PatchSource,
    generator: np.random.Generator,
    side: int,
    settings: SceneSettings,
    split: Split = "training",
) -> Scene:
    """Draw a plane, or layers that hide parts of each other; depths aren't part of the scene.

    Raises UserError if the side is below 8 pixels, or no picture is as large.
    pictures: where each layer's picture comes from.
    generator: the only source of random numbers.
    side: pixels along each side, 8 or more.
    split: which pictures to draw from.
    """
    if side < 8:
        raise UserError(f"A scene of {side} x {side} pixels: give 8 or more along a side.")
    layers = 1
    if generator.random() < settings.layered_share:
        layers = int(generator.integers(2, settings.most_layers + 1))
    mattes = np.ones((layers, side, side), np.float32)
    for matte in mattes[:-1]:
        matte[:] = draw_matte(generator, side)
    patches = [pictures.patch(generator, side, split) for _ in range(layers)]
    return Scene(np.stack(patches), mattes)


def draw_matte(generator: np.random.Generator, side: int) -> _Mask:
    """Draw the matte of a layer of random shape, (side, side), with edges about a pixel wide."""
    low, high = _COVERAGES
    for _ in range(_ATTEMPTS):
        draw = _SHAPES[int(generator.integers(len(_SHAPES)))]
        matte = _average(draw(generator, side * _OVERSAMPLING), side)
        if low <= float(matte.mean()) <= high:
            return matte
    return _average(_draw_half_plane(generator, side * _OVERSAMPLING), side)


def _average(mask: _Mask, side: int) -> _Mask:
    """Average an oversampled drawing of zeros and ones over pixels."""
    return np.asarray(cv2.resize(mask, (side, side), interpolation=cv2.INTER_AREA), np.float32)


def _draw_half_plane(generator: np.random.Generator, side: int) -> _Mask:
    """Cover one side of a line through the scene's middle."""
    angle = generator.uniform(0, 2 * math.pi)
    along = np.arange(side, dtype=np.float32) - side / 2
    above = along * math.cos(angle) + along[:, None] * math.sin(angle) > 0
    return above.astype(np.float32)


def _draw_blobs(generator: np.random.Generator, side: int) -> _Mask:
    """Cover where smooth noise exceeds a level."""
    cells = int(generator.integers(*_BLOB_CELLS))
    noise = generator.standard_normal((cells + 3, cells + 3), dtype=np.float32)
    # The outer cells are cut off, where the interpolation repeats them.
    fine = round(side * (cells + 3) / cells) + 1
    smooth = cv2.resize(noise, (fine, fine), interpolation=cv2.INTER_CUBIC)
    start = (fine - side) // 2
    smooth = smooth[start : start + side, start : start + side]
    return (smooth > generator.uniform(-0.3, 0.8)).astype(np.float32)


def _draw_polygons(generator: np.random.Generator, side: int) -> _Mask:
    """Cover one to four polygons with corners around random centres."""
    mask = np.zeros((side, side), np.float32)
    for _ in range(int(generator.integers(1, 5))):
        count = int(generator.integers(3, 9))
        turns = np.sort(generator.random(count)) * 2 * math.pi
        radii = side * generator.uniform(0.05, 0.4) * generator.uniform(0.5, 1, count)
        centre = generator.uniform(0, side, 2)
        corners = centre + radii[:, None] * np.stack([np.cos(turns), np.sin(turns)], 1)
        cv2.fillPoly(mask, [np.rint(corners).astype(np.int32)], 1.0)
    return mask


def _draw_branches(generator: np.random.Generator, side: int) -> _Mask:
    """Cover bars through the scene, some with thinner branches."""
    mask = np.zeros((side, side), np.float32)
    for _ in range(int(generator.integers(1, 7))):
        angle = generator.uniform(0, math.pi)
        middle = generator.uniform(0, side, 2)
        width = _OVERSAMPLING * math.exp(generator.uniform(math.log(1.0), math.log(10.0)))
        _draw_bar(mask, middle, angle, width, 2.0 * side)
        for _ in range(int(generator.integers(0, 5))):
            place = middle + generator.uniform(-0.5, 0.5) * side * _direction(angle)
            turn = angle + generator.choice([-1, 1]) * generator.uniform(0.3, 1.2)
            length = side * generator.uniform(0.1, 0.5)
            _draw_bar(mask, place + 0.5 * length * _direction(turn), turn, 0.6 * width, length)
    return mask


def _draw_bar(
    mask: _Mask, middle: NDArray[np.float64], angle: float, width: float, length: float
) -> None:
    """Draw a bar around its middle, in place; lengths are in drawn pixels."""
    half = 0.5 * length * _direction(angle)
    ends = np.rint(np.stack([middle - half, middle + half])).astype(int).tolist()
    cv2.line(mask, ends[0], ends[1], 1.0, max(1, round(width)))


def _direction(angle: float) -> NDArray[np.float64]:
    """Return the unit vector (x, y) at an angle in radians."""
    return np.array([math.cos(angle), math.sin(angle)])


def _draw_writing(generator: np.random.Generator, side: int) -> _Mask:
    """Cover a few blocks of strokes, like writing."""
    mask = np.zeros((side, side), np.float32)
    for _ in range(int(generator.integers(1, 4))):
        add_writing(mask, generator, _OVERSAMPLING, ink=1.0)
    return mask


_SHAPES: tuple[Callable[[np.random.Generator, int], _Mask], ...] = (
    _draw_blobs,
    _draw_polygons,
    _draw_branches,
    _draw_writing,
)
"""Kinds of mattes, equally likely."""
