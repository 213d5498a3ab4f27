"""Merging of pictures that share shape and place, before they are drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from simulator.scene.drawable import Drawable
from simulator.scene.pixel_picture import PixelPicture
from simulator.scene.polygons import Polygons

WeightedPicture = tuple[Drawable, float]
"""A picture and the weight of its values."""


def merge_pictures(pictures: Iterable[WeightedPicture]) -> list[WeightedPicture]:
    """Merge pictures into fewer with the same weighted sum, without those of weight 0."""
    kinds: dict[object, list[WeightedPicture]] = {}
    for number, (picture, weight) in enumerate(pictures):
        kind: object = number
        if isinstance(picture, PixelPicture):
            kind = picture.grid
        elif isinstance(picture, Polygons):
            kind = picture.corners
        if weight:
            kinds.setdefault(kind, []).append((picture, weight))
    return [_one(alike) for alike in kinds.values()]


def _one(alike: Sequence[WeightedPicture]) -> WeightedPicture:
    """Merge pictures of one kind into one picture and its weight."""
    first, weight = alike[0]
    if len(alike) == 1:
        return first, weight
    if isinstance(first, PixelPicture):
        image = sum(p.image * w for p, w in alike if isinstance(p, PixelPicture))
        return replace(first, image=image), 1.0  # type: ignore[arg-type]
    assert isinstance(first, Polygons)
    both = [(p, w) for p, w in alike if isinstance(p, Polygons)]
    values = tuple(sum(p.values[k] * w for p, w in both) for k in range(len(first.values)))
    return Polygons(first.corners, values, sum(p.ground * w for p, w in both)), 1.0
