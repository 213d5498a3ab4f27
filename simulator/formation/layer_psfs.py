"""The PSFs that blur each layer: for each wavelength, those of the depths that represent it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from optics.caching import ByteCache
from simulator.formation.exposure_cells import ExposureCell
from simulator.formation.kernels import Kernels, Order, PointSource
from simulator.formation.nodes import Wavelength, depth_nodes, electrons_per_radiance, wavelengths
from simulator.formation.objects import ObjectSpectra, Place, field_effect
from simulator.recipe import Recipe
from simulator.scene.drawable import Drawable
from simulator.scene.pixel_picture import PixelPicture
from simulator.scene.target import Layer, Part
from simulator.situation import Situation


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
            alike = (tuple(one.image.shape), one.side, one.offset, one.on_sensor)
        groups.setdefault(alike, []).append(index)
    return list(groups.values())


def merge_parts(
    layer: Layer, weights: NDArray[np.float64], cache: ByteCache
) -> tuple[Layer, NDArray[np.float64]]:
    """Return a layer with fewer parts that looks as the given one, and the parts' weights.

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
    """Add up pictures of the same pixels, each times its share."""

    def sum_pictures() -> PixelPicture:
        known = [one for one in pictures if isinstance(one, PixelPicture)]
        images = torch.stack([one.image for one in known])
        return replace(known[0], image=torch.tensordot(torch.tensor(shares).to(images), images, 1))

    return cache.get(("mixed", pictures, shares), sum_pictures)


class LayerPSFs:
    """Wavelength nodes, weights and PSFs of a target's layers.

    layers: the nearest first, with like parts merged. nodes: the wavelengths.
    """

    def __init__(
        self,
        s: Situation,
        recipe: Recipe,
        kernels: Kernels,
        objects: ObjectSpectra,
        cache: ByteCache,
    ) -> None:
        self._recipe, self._kernels, self.places = recipe, kernels, objects.places
        layers = s.target.for_camera(s.camera).layers
        found = wavelengths(s, recipe, [part for layer in layers for part in layer.parts])
        self.nodes = found.nodes
        self.channels = len(found.weights)
        self._weights: list[NDArray[np.float64]] = []
        self._angles: list[list[int]] = []
        self.layers: list[Layer] = []
        first = 0
        for layer in layers:
            own = slice(first, first + len(layer.parts))
            # On the axis, and what the light of each further angle has more or less.
            every = [found.weights[:, own], *found.aslant[:, :, own]]
            merged, weights = zip(*(merge_parts(layer, one, cache) for one in every), strict=True)
            parts = tuple(part for one in merged for part in one.parts)
            self.layers.append(replace(layer, parts=parts))
            self._angles.append([k for k, one in enumerate(merged) for _ in one.parts])
            # The irradiance depends on the layer's own distance, even if the PSFs of other
            # distances represent its blur.
            scale = electrons_per_radiance(kernels.camera, layer.distance)
            self._weights.append(scale * np.concatenate(weights, axis=1))
            first += len(layer.parts)
        distances = [layer.distance for layer in self.layers]
        self._depths = depth_nodes(distances, recipe.depths)
        self._first = self._depths[distances[0]][0][0]

    def weights(self, layer: int) -> NDArray[np.float64]:
        """Return electrons per second and pixel at picture value 1, (channels, parts, nodes)."""
        return self._weights[layer]

    def angles(self, layer: int) -> list[int]:
        """Return for each part of a layer the number of the filter's angle, 0 on the axis.

        The light of a further angle is what it has more or less than the axis; see Wavelengths.
        """
        return self._angles[layer]

    def distances(self, layer: int) -> tuple[tuple[float, float], ...]:
        """Return the distances whose PSFs stand for a layer, in metres, with their weights."""
        return tuple(self._depths[self.layers[layer].distance])

    def psf(
        self, layer: int, node: int, place: Place, cell: ExposureCell, number: int
    ) -> torch.Tensor:
        """Return a layer's PSF at one wavelength and place."""
        wavelength = self.nodes[node]
        order = self._kernels.central(wavelength.metres)
        total: torch.Tensor | None = None
        for distance, share in self._depths[self.layers[layer].distance]:
            effect = self._effect(distance, node, place, number)
            point = PointSource(wavelength.metres, distance, place)
            part = share * self._kernels.psf(cell.panel_state, point, effect, order)
            total = part if total is None else total + part
        assert total is not None
        return total

    def order_psf(
        self, layer: int, node: int, place: Place, cell: ExposureCell, order: Order
    ) -> torch.Tensor:
        """Return a layer's PSF in one diffraction order, on samples around the order's centre."""
        total: torch.Tensor | None = None
        for distance, share in self._depths[self.layers[layer].distance]:
            point = PointSource(self.nodes[node].metres, distance, place)
            part = share * self._kernels.psf(cell.panel_state, point, "panel orders", order)
            total = part if total is None else total + part
        assert total is not None
        return total

    def order_centre(self, node: Wavelength, order: Order) -> Place:
        """Return (y, x) metres on the sensor from a point's image to one of its orders."""
        return self._kernels.order_centre(node.metres, order)

    def _effect(self, distance: float, node: int, place: Place, number: int) -> str:
        """Return the effect to which the ledger ascribes the work on a PSF."""
        if self.nodes[node].leak:
            return "out-of-band leak"
        if place != self.places[0]:
            return field_effect(self._recipe)
        if distance != self._first:
            return "depth layers"
        if node:
            return "filter bandwidth"
        if number:
            return "rolling shutter" if self._recipe.rolling else "motion"
        return "diffraction" if self._recipe.diffraction else "picture"
