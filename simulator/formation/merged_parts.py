"""Merge parts of a layer that are rendered alike into one picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from optics.caching import ByteCache
from simulator.scene.drawable import Drawable
from simulator.scene.pixel_picture import PixelPicture
from simulator.scene.target import Layer, Part


def groups_of_parts(layer: Layer, channels: int, nodes: int) -> list[list[int]]:
    """Return the indices of a layer's parts, in groups that are rendered as one picture.

    At one wavelength and in one channel, each part's light is its picture times a number.
    Pictures on the same pixels can then be added before they are drawn, as the colours of a
    photograph.
    """
    groups: dict[object, list[int]] = {}
    for index, part in enumerate(layer.parts):
        one = part.picture
        alike: object = index
        if isinstance(one, PixelPicture) and channels * nodes == 1:
            alike = (tuple(one.image.shape), one.side, one.offset, one.on_sensor)
        groups.setdefault(alike, []).append(index)
    return list(groups.values())


def merge_parts(
    layer: Layer, weights: NDArray[np.float64], cache: ByteCache
) -> tuple[Layer, NDArray[np.float64]]:
    """Return a layer with fewer parts that renders as the given one, and the parts' weights.

    weights: of the layer's parts, (channels, parts, nodes). cache: keeps merged pictures.
    """
    channels, _, nodes = weights.shape
    groups = groups_of_parts(layer, channels, nodes)
    if len(groups) == len(layer.parts):
        return layer, weights
    parts, merged = [], []
    for group in groups:
        each = weights[:, group]
        total = float(np.abs(each).sum())
        first = layer.parts[group[0]]
        if len(group) > 1 and total:
            pictures = tuple(layer.parts[index].picture for index in group)
            first = Part(first.spectrum, _mix(pictures, tuple(each[0, :, 0] / total), cache))
            each = np.full((1, 1, 1), total)
        parts.append(first)
        merged.append(each[:, :1])
    return replace(layer, parts=tuple(parts)), np.concatenate(merged, axis=1)


def _mix(
    pictures: tuple[Drawable, ...], shares: tuple[float, ...], cache: ByteCache
) -> PixelPicture:
    """Add up pictures of the same pixels for rendering, each times its share."""

    def sum_pictures() -> PixelPicture:
        known = [one for one in pictures if isinstance(one, PixelPicture)]
        images = torch.stack([one.image for one in known])
        return replace(known[0], image=torch.tensordot(torch.tensor(shares).to(images), images, 1))

    return cache.get(("mixed", pictures, shares), sum_pictures)
