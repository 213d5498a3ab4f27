"""From layers to the light on the sensor's samples: added up, or the near before the far."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch

from simulator.formation.gathering import Gathering
from simulator.formation.objects import Objects
from simulator.formation.spreading import Spreading
from simulator.formation.time import Cell

_ONE = np.ones((1, 1))


class Way(Protocol):
    """A way on which a layer's light comes to the sensor: straight, or by the panel's grid.

    number: of the layer. node: of wavelength. count: of the cell. Spectra are of light on samples,
    electrons per second and pixel.
    """

    def all(self, number: int, cell: Cell, count: int) -> list[torch.Tensor]:
        """Of all wavelengths, one spectrum for each channel."""
        ...

    def front(self, number: int, node: int, cell: Cell, count: int) -> list[torch.Tensor]:
        """Of one wavelength, one spectrum for each channel."""
        ...

    def hidden(self, number: int, node: int, cell: Cell, count: int) -> torch.Tensor:
        """Of the blurred share that a layer hides, at one wavelength."""
        ...


class Straight:
    """The light that the panel's grid doesn't send aside."""

    def __init__(self, gathering: Gathering, objects: Objects, spreading: Spreading) -> None:
        self._gathering, self._objects, self._spreading = gathering, objects, spreading

    def all(self, number: int, cell: Cell, count: int) -> list[torch.Tensor]:
        """PSFs of all wavelengths are added before anything is convolved."""
        layer, weights = self._spreading.layers[number], self._spreading.weights(number)
        total = self._gathering.dark(self._spreading.channels)
        where = self._objects.where(layer, cell)
        if not layer.parts or where is None:
            return total
        for index, one in enumerate(layer.parts):
            evenly = self._objects.evenly(one.picture)
            for spectrum, seen in zip(total, weights[:, index].sum(1), strict=True):
                spectrum[0, 0] += float(seen) * evenly
        shining = [self._objects.shining(part.picture, layer, where) for part in layer.parts]
        uneven = [index for index, spectra in enumerate(shining) if spectra]
        if not uneven:
            return total
        flat = weights[:, uneven].reshape(-1, weights.shape[2])
        for at, place in enumerate(self._objects.places):
            psfs = [
                self._spreading.psf(number, node, place, cell, count)
                for node in range(weights.shape[2])
            ]
            transfers = iter(self._gathering.transfers(psfs, flat, "picture"))
            for spectrum in total:
                for index in uneven:
                    spectrum += next(transfers) * shining[index][at]
        return total

    def front(self, number: int, node: int, cell: Cell, count: int) -> list[torch.Tensor]:
        layer, weights = self._spreading.layers[number], self._spreading.weights(number)
        total = self._gathering.dark(self._spreading.channels)
        where = self._objects.where(layer, cell)
        assert where is not None
        transfers = self._transfers(number, node, cell, count)
        for part, one in enumerate(layer.parts):
            shining = self._objects.shining(one.picture, layer, where)
            light = _through(transfers, shining)
            for channel in range(self._spreading.channels):
                total[channel] += float(weights[channel, part, node]) * light
        return total

    def hidden(self, number: int, node: int, cell: Cell, count: int) -> torch.Tensor:
        layer = self._spreading.layers[number]
        where = self._objects.where(layer, cell)
        assert where is not None
        assert layer.cover is not None
        covers = self._objects.hiding(layer.cover, where)
        return _through(self._transfers(number, node, cell, count), covers)

    def _transfers(self, number: int, node: int, cell: Cell, count: int) -> list[torch.Tensor]:
        """One for each place."""
        return [
            self._gathering.transfers(
                [self._spreading.psf(number, node, place, cell, count)], _ONE, "occlusion"
            )[0]
            for place in self._objects.places
        ]


def _through(transfers: Sequence[torch.Tensor], spectra: Sequence[torch.Tensor]) -> torch.Tensor:
    total = transfers[0] * spectra[0]
    for transfer, spectrum in zip(transfers[1:], spectra[1:], strict=True):
        total += transfer * spectrum
    return total


@dataclass(frozen=True)
class Layered(ABC):
    """All layers of a target, by all ways on which their light comes."""

    gathering: Gathering
    spreading: Spreading
    ways: Sequence[Way]

    @abstractmethod
    def spectra(self, cell: Cell, count: int) -> list[torch.Tensor]:
        """Of the light on samples, one for each channel."""


class Adding(Layered):
    """Every layer's light, as if all were transparent."""

    def spectra(self, cell: Cell, count: int) -> list[torch.Tensor]:
        total = self.gathering.dark(self.spreading.channels)
        for number in range(len(self.spreading.layers)):
            for way in self.ways:
                for channel, light in enumerate(way.all(number, cell, count)):
                    total[channel] += light
        return total


class Hiding(Layered):
    """From the farthest layer to the nearest, each before what lies behind.

    That is a product of blurred pictures, and so is formed wavelength by wavelength.
    """

    def spectra(self, cell: Cell, count: int) -> list[torch.Tensor]:
        total: list[torch.Tensor] = []
        for node in range(len(self.spreading.nodes)):
            light = self._of(node, cell, count)
            total = light if not total else [a + b for a, b in zip(total, light, strict=True)]
        return [self.gathering.transformed(light, "occlusion") for light in total]

    def _of(self, node: int, cell: Cell, count: int) -> list[torch.Tensor]:
        """Light on samples of one wavelength, for each channel."""
        samples, layers = self.gathering.samples, self.spreading.layers
        behind: list[torch.Tensor] = []
        for number in reversed(range(len(layers))):
            fronts = [way.front(number, node, cell, count) for way in self.ways]
            front = [
                samples(sum(one[1:], one[0]), "occlusion") for one in zip(*fronts, strict=True)
            ]
            if not behind:
                behind = front
            elif layers[number].cover is None:
                behind = [a + b for a, b in zip(behind, front, strict=True)]
            else:
                hidden = [way.hidden(number, node, cell, count) for way in self.ways]
                share = samples(sum(hidden[1:], hidden[0]), "occlusion")
                behind = [over(a, b, share) for a, b in zip(behind, front, strict=True)]
        return behind


def over(behind: torch.Tensor, front: torch.Tensor, hidden: torch.Tensor) -> torch.Tensor:
    """Light on samples, of what lies behind with a nearer layer before it.

    behind, front: blurred light of each. hidden: the nearer layer's blurred cover, 0 to 1: of the
    rays to a sample, the share that it stops. That those are as bright as the others of the same
    sample is exact where either layer is in focus, and right to about a percent elsewhere
    (Hasinoff and Kutulakos, A layer-based restoration framework for variable-aperture
    photography, ICCV 2007).
    """
    return behind * (1 - hidden.clamp(0, 1)) + front
