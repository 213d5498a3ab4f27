"""Merging of pictures that share shape and place, before they are drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from simulator.scene.drawable import Drawable
from simulator.scene.pixel_picture import PixelPicture
from simulator.scene.polygons import Polygons

WeightedPicture = tuple[Drawable, float]
"""A picture and the weight of its values."""


def merge_pictures(pictures: Iterable[WeightedPicture]) -> list[WeightedPicture]:
    """Merge pictures into fewer with the same weighted sum, without those of weight 0."""
    kinds: dict[object, list[WeightedPicture]] = {}
    for number, (picture, weight) in enumerate(pictures):
        if weight:
            kinds.setdefault(_kind(picture, number), []).append((picture, weight))
    return [_one(alike) for alike in kinds.values()]


def _kind(picture: Drawable, number: int) -> object:
    """Return a key that is equal for two pictures if they can be merged."""
    if isinstance(picture, PixelPicture):
        return picture.image.shape, picture.side, picture.offset, picture.on_sensor
    return picture.corners if isinstance(picture, Polygons) else number


def _one(alike: Sequence[WeightedPicture]) -> WeightedPicture:
    """Merge pictures of one kind into one picture and its weight."""
    first, weight = alike[0]
    if len(alike) == 1:
        return first, weight
    if isinstance(first, PixelPicture):
        image = sum(p.image * w for p, w in alike if isinstance(p, PixelPicture))
        return PixelPicture(image, first.side, first.offset, first.on_sensor), 1.0  # type: ignore[arg-type]
    assert isinstance(first, Polygons)
    both = [(p, w) for p, w in alike if isinstance(p, Polygons)]
    values = tuple(sum(p.values[k] * w for p, w in both) for k in range(len(first.values)))
    return Polygons(first.corners, values, sum(p.ground * w for p, w in both)), 1.0
