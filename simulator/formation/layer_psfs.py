"""The PSFs that blur each layer: for each wavelength, those of the depths that represent it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from optics.caching import ByteCache
from simulator.formation.exposure_cells import ExposureCell
from simulator.formation.kernels import Kernels, Order, PointSource
from simulator.formation.nodes import depth_nodes, electrons_per_radiance, wavelengths
from simulator.formation.objects import ObjectSpectra, Place, field_effect
from simulator.scene.drawable import Drawable
from simulator.scene.pixel_picture import PixelPicture
from simulator.scene.target import Layer, Part

Array = NDArray[np.float64]


def groups_of_parts(layer: Layer, channels: int, nodes: int) -> list[list[int]]:
    """Return the indices of a layer's parts, in groups that can be drawn as one picture.

    At one wavelength and in one channel, each part's light is its picture times a number. Pictures
    on the same pixels can then be added before they are drawn, as the colours of a photograph.
    """
    groups: dict[object, list[int]] = {}
    for index, part in enumerate(layer.parts):
        one = part.picture
        alike: object = index
        if isinstance(one, PixelPicture) and channels * nodes == 1:
            alike = one.grid
        groups.setdefault(alike, []).append(index)
    return list(groups.values())


def _merge_parts(layer: Layer, weights: Array, cache: ByteCache) -> tuple[tuple[Part, ...], Array]:
    """Return fewer parts that look as a layer's, and their weights, (channels, parts, nodes)."""
    channels, _, nodes = weights.shape
    groups = groups_of_parts(layer, channels, nodes)
    if len(groups) == len(layer.parts):
        return layer.parts, weights
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
    return tuple(parts), np.concatenate(merged, axis=1)


def _mix(
    pictures: tuple[Drawable, ...], shares: tuple[float, ...], cache: ByteCache
) -> PixelPicture:
    """Add up pictures of the same pixels, each times its share."""

    def sum_pictures() -> PixelPicture:
        known = [one for one in pictures if isinstance(one, PixelPicture)]
        images = torch.stack([one.image for one in known])
        return replace(known[0], image=torch.tensordot(torch.tensor(shares).to(images), images, 1))

    return cache.get(("mixed", pictures, shares), sum_pictures)


class LayerPSFs:
    """Wavelength nodes, weights and PSFs of a target's layers.

    layers: the nearest first, with like parts merged. nodes: the wavelengths. weights: for each
    layer, electrons per second and pixel at picture value 1, (channels, parts, nodes). angles: for
    each part of each layer, the number of the filter's angle, 0 on the axis; the light of a further
    angle is what it has more or less than the axis (see Wavelengths).
    """

    def __init__(self, kernels: Kernels, objects: ObjectSpectra) -> None:
        self._kernels, self._places = kernels, objects.places
        s, self._recipe = kernels.s, kernels.recipe
        layers = s.target.for_camera(s.camera).layers
        found = wavelengths(s, self._recipe, [part for layer in layers for part in layer.parts])
        self.nodes = found.nodes
        self.channels = len(found.weights)
        self.weights: list[Array] = []
        self.angles: list[list[int]] = []
        self.layers: list[Layer] = []
        first = 0
        for layer in layers:
            own = slice(first, first + len(layer.parts))
            # On the axis, and what the light of each further angle has more or less.
            every = [found.weights[:, own], *found.aslant[:, :, own]]
            merged, weights = zip(
                *(_merge_parts(layer, one, kernels.cache) for one in every), strict=True
            )
            self.layers.append(replace(layer, parts=sum(merged, ())))
            self.angles.append([k for k, parts in enumerate(merged) for _ in parts])
            # The irradiance depends on the layer's own distance, even if the PSFs of other
            # distances represent its blur.
            scale = electrons_per_radiance(kernels.camera, layer.distance)
            self.weights.append(scale * np.concatenate(weights, axis=1))
            first += len(layer.parts)
        distances = [layer.distance for layer in self.layers]
        self._depths = depth_nodes(distances, self._recipe.depths)
        self._first = self._depths[distances[0]][0][0]

    def distances(self, layer: int) -> tuple[tuple[float, float], ...]:
        """Return the distances whose PSFs stand for a layer, in metres, with their weights."""
        return tuple(self._depths[self.layers[layer].distance])

    def psf(
        self, layer: int, node: int, place: Place, cell: ExposureCell, order: Order | None = None
    ) -> torch.Tensor:
        """Return a layer's PSF at one wavelength and place; of a side order, around its centre."""
        wavelength, parts = self.nodes[node].metres, []
        window = order or self._kernels.central(wavelength)
        for distance, share in self.distances(layer):
            point = PointSource(wavelength, distance, place)
            effect = "panel orders" if order else self._effect(distance, node, place, cell)
            parts.append(share * self._kernels.psf(cell.panel_state, point, effect, window))
        return sum(parts[1:], parts[0])

    def order_centre(self, node: int, order: Order) -> Place:
        """Return (y, x) metres on the sensor from a point's image to one of its orders."""
        return self._kernels.order_centre(self.nodes[node].metres, order)

    def _effect(self, distance: float, node: int, place: Place, cell: ExposureCell) -> str:
        """Return the effect to which the ledger ascribes the work on a PSF."""
        if self.nodes[node].leak:
            return "out-of-band leak"
        if place != self._places[0]:
            return field_effect(self._recipe)
        if distance != self._first:
            return "depth layers"
        if node:
            return "filter bandwidth"
        if cell.number:
            return "rolling shutter" if self._recipe.rolling else "motion"
        return "diffraction" if self._recipe.diffraction else "picture"
