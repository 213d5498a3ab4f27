"""Combine a scene's layers into the light on the sensor: as a sum, or near before far."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch

from simulator.formation.exposure_cells import ExposureCell
from simulator.formation.layer_psfs import LayerPSFs
from simulator.formation.objects import ObjectSpectra
from simulator.formation.sample_grid import SampleGrid

_ONE = np.ones((1, 1))


class LightPath(Protocol):
    """A way of light to the sensor, by one diffraction order of the panel's pixel grid.

    number: the layer's index. node: the wavelength's index. count: the index of the exposure cell.
    Spectra are Fourier spectra of the light on samples, in electrons per second and pixel.
    """

    def layer_spectra(
        self, number: int, cell: ExposureCell, count: int, nodes: Sequence[int]
    ) -> list[torch.Tensor]:
        """Return a layer's light of some wavelengths, as one spectrum for each channel."""
        ...

    def wavelength_spectra(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> list[torch.Tensor]:
        """Return a layer's light of one wavelength, as one spectrum for each channel.

        The list is empty if none of the light is near the frame on this path.
        """
        ...

    def cover_spectrum(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> torch.Tensor | None:
        """Return a layer's blurred cover at one wavelength, as a spectrum; None if it isn't near.

        The cover is the share of the light behind that the layer hides.
        """
        ...

    def share(self, number: int, node: int, cell: ExposureCell, count: int) -> float:
        """Return the share of a layer's light of one wavelength that takes this path."""
        ...


class ZerothOrderPath:
    """The way of the light that stays in the zeroth order of the panel's pixel grid."""

    def __init__(self, gathering: SampleGrid, objects: ObjectSpectra, spreading: LayerPSFs) -> None:
        self._gathering, self._objects, self._spreading = gathering, objects, spreading

    def layer_spectra(
        self, number: int, cell: ExposureCell, count: int, nodes: Sequence[int]
    ) -> list[torch.Tensor]:
        """Return a layer's light of some wavelengths; see LightPath.

        The PSFs of these wavelengths are added before the convolution.
        """
        layer, weights = self._spreading.layers[number], self._spreading.weights(number)
        weights = weights[:, :, list(nodes)]
        total = self._gathering.zero_spectra(self._spreading.channels)
        where = self._objects.placement(layer, cell)
        if not layer.parts or where is None:
            return total
        angles = self._spreading.angles(number)
        for index, (one, angle) in enumerate(zip(layer.parts, angles, strict=True)):
            evenly = self._objects.uniform_dc_term(one.picture, angle)
            for spectrum, seen in zip(total, weights[:, index].sum(1), strict=True):
                spectrum[0, 0] += float(seen) * evenly
        shining = [
            self._objects.light_spectra(part.picture, layer, where, angle=angle)
            for part, angle in zip(layer.parts, angles, strict=True)
        ]
        uneven = [index for index, spectra in enumerate(shining) if spectra]
        if not uneven:
            return total
        flat = weights[:, uneven].reshape(-1, weights.shape[2])
        for at, place in enumerate(self._objects.places):
            psfs = [self._spreading.psf(number, node, place, cell, count) for node in nodes]
            transfers = iter(self._gathering.transfers(psfs, flat, "picture"))
            for spectrum in total:
                for index in uneven:
                    spectrum += next(transfers) * shining[index][at]
        return total

    def wavelength_spectra(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> list[torch.Tensor]:
        """Return a layer's light of one wavelength; see LightPath."""
        layer, weights = self._spreading.layers[number], self._spreading.weights(number)
        total = self._gathering.zero_spectra(self._spreading.channels)
        where = self._objects.placement(layer, cell)
        assert where is not None
        transfers = self._transfers(number, node, cell, count)
        angles = self._spreading.angles(number)
        for part, one in enumerate(layer.parts):
            shining = self._objects.light_spectra(one.picture, layer, where, angle=angles[part])
            light = _apply_transfers(transfers, shining)
            for channel in range(self._spreading.channels):
                total[channel] += float(weights[channel, part, node]) * light
        return total

    def cover_spectrum(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> torch.Tensor:
        """Return the spectrum of a layer's cover at one wavelength, blurred by its PSF."""
        layer = self._spreading.layers[number]
        where = self._objects.placement(layer, cell)
        assert where is not None
        assert layer.cover is not None
        covers = self._objects.cover_spectra(layer.cover, where)
        return _apply_transfers(self._transfers(number, node, cell, count), covers)

    def share(self, number: int, node: int, cell: ExposureCell, count: int) -> float:
        """Return the share of the light in the PSF's window, where side orders may lie, too."""
        first = self._spreading.places[0]
        return float(self._spreading.psf(number, node, first, cell, count).sum())

    def _transfers(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> list[torch.Tensor]:
        """Return a layer's transfer functions at one wavelength, one for each place."""
        return [
            self._gathering.transfers(
                [self._spreading.psf(number, node, place, cell, count)], _ONE, "occlusion"
            )[0]
            for place in self._objects.places
        ]


def _apply_transfers(
    transfers: Sequence[torch.Tensor], spectra: Sequence[torch.Tensor]
) -> torch.Tensor:
    """Blur: sum the places' spectra times their transfer functions."""
    total = transfers[0] * spectra[0]
    for transfer, spectrum in zip(transfers[1:], spectra[1:], strict=True):
        total += transfer * spectrum
    return total


@dataclass(frozen=True)
class Compositor(ABC):
    """Combine all layers of a target, along all paths of their light."""

    gathering: SampleGrid
    spreading: LayerPSFs
    paths: Sequence[LightPath]

    @abstractmethod
    def spectra(
        self, cell: ExposureCell, count: int, nodes: Sequence[int] | None = None
    ) -> list[torch.Tensor]:
        """Return the light of all layers on samples, as a spectrum for each channel.

        nodes: the wavelengths that count; all of them by default.
        """

    def _nodes(self, nodes: Sequence[int] | None) -> Sequence[int]:
        """Return the wavelengths that count, all of them for None."""
        return range(len(self.spreading.nodes)) if nodes is None else nodes


class AdditiveCompositor(Compositor):
    """Add the light of all layers, as if all were transparent."""

    def spectra(
        self, cell: ExposureCell, count: int, nodes: Sequence[int] | None = None
    ) -> list[torch.Tensor]:
        total = self.gathering.zero_spectra(self.spreading.channels)
        for number in range(len(self.spreading.layers)):
            for way in self.paths:
                found = way.layer_spectra(number, cell, count, self._nodes(nodes))
                for channel, light in enumerate(found):
                    total[channel] += light
        return total


class OccludingCompositor(Compositor):
    """Combine layers from the farthest to the nearest, where near ones hide far ones.

    Blurred light is multiplied by blurred covers, and so has to be computed wavelength by
    wavelength, and path by path: what comes to a pixel from aside is hidden by what is aside.
    """

    def spectra(
        self, cell: ExposureCell, count: int, nodes: Sequence[int] | None = None
    ) -> list[torch.Tensor]:
        total: list[torch.Tensor] = []
        for node in self._nodes(nodes):
            for way in self.paths:
                total = _sums(total, self._path_light(way, node, cell, count))
        if not total:
            return self.gathering.zero_spectra(self.spreading.channels)
        return [self.gathering.transform_samples(light, "occlusion") for light in total]

    def _path_light(
        self, way: LightPath, node: int, cell: ExposureCell, count: int
    ) -> list[torch.Tensor]:
        """Return the light of one wavelength and path on samples, near layers before far ones.

        There is one picture for each channel, or none if no layer's light is near the frame.
        """
        behind: list[torch.Tensor] = []
        for number in reversed(range(len(self.spreading.layers))):
            if behind and self.spreading.layers[number].cover is not None:
                left = self._light_left(way, number, node, cell, count)
                behind = [one * left for one in behind]
            spectra = way.wavelength_spectra(number, node, cell, count)
            behind = _sums(behind, [self.gathering.samples(one, "occlusion") for one in spectra])
        return behind

    def _light_left(
        self, way: LightPath, number: int, node: int, cell: ExposureCell, count: int
    ) -> torch.Tensor | float:
        """Return the share of a path's light from behind that a layer leaves, on samples."""
        cover = way.cover_spectrum(number, node, cell, count)
        carried = way.share(number, node, cell, count)
        if cover is None or not carried:
            return 1.0
        # A path holds a share of a layer's light, and the layer hides all that is behind in it.
        return uncovered_share(self.gathering.samples(cover, "occlusion") / carried)


def _sums(one: list[torch.Tensor], other: list[torch.Tensor]) -> list[torch.Tensor]:
    """Add the channels of two lights; one without any is dark."""
    return [a + b for a, b in zip(one, other, strict=True)] if one and other else one or other


def uncovered_share(cover_share: torch.Tensor) -> torch.Tensor:
    """Return the share of the light from behind that a nearer layer leaves, on samples.

    cover_share: blurred cover of the nearer layer, 0 to 1: the share of the rays to a sample that
    it stops. These rays are taken to be as bright as the other rays to the sample. This is exact
    where either layer is in focus, and right to about a percent elsewhere (Hasinoff and Kutulakos,
    A layer-based restoration framework for variable-aperture photography, ICCV 2007). Where blurred
    edges of two layers lie along each other, it is wrong by several percent of the light along that
    line: a ray passes both or none.
    """
    return 1 - cover_share.clamp(0, 1)
