"""Combine a scene's layers into the light on the sensor: as a sum, or near before far."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from simulator.formation.exposure_cells import ExposureCell
from simulator.formation.kernels import Order
from simulator.formation.layer_psfs import LayerPSFs
from simulator.formation.objects import ObjectSpectra, Place
from simulator.formation.sample_grid import SampleGrid

Blur = Callable[[Sequence[torch.Tensor]], torch.Tensor | None]
"""Function from a picture's spectra, one for each place, to its light; None if none is near."""


class LightPath:
    """The way of light that the panel's pixel grid diffracts into one side order.

    An order's PSF is computed around its centre, and convolved with the object as if that were
    there. order: None for the zeroth, which has a class of its own. number: the layer. node: the
    wavelength. Spectra are of the light on samples, in electrons per second and pixel, one for each
    channel.
    """

    def __init__(
        self,
        gathering: SampleGrid,
        objects: ObjectSpectra,
        spreading: LayerPSFs,
        order: Order | None = None,
    ) -> None:
        self._gathering, self._objects, self._spreading = gathering, objects, spreading
        self._order = order

    def layer_spectra(
        self, number: int, cell: ExposureCell, nodes: Sequence[int]
    ) -> list[torch.Tensor]:
        """Return a layer's light of some wavelengths."""
        total = self._gathering.zero_spectra(self._spreading.channels)
        for node in nodes:
            for channel, light in enumerate(self.wavelength_spectra(number, node, cell)):
                total[channel] += light
        return total

    def wavelength_spectra(self, number: int, node: int, cell: ExposureCell) -> list[torch.Tensor]:
        """Return a layer's light of one wavelength; nothing if none of a side order is near."""
        layer, weights = self._spreading.layers[number], self._spreading.weights[number]
        off = self._offset(node)
        where = self._objects.placement(layer, cell, off)
        if where is None:
            return []
        dark = self._gathering.zero_spectra
        total = [] if self._order else dark(self._spreading.channels)
        blur = self._blur(number, node, cell)
        for part, one in enumerate(layer.parts):
            if self._order and self._objects.is_off_plane(one.picture, layer, cell, off):
                continue
            angle = self._spreading.angles[number][part]
            light = blur(self._objects.light_spectra(one.picture, where, angle))
            if light is not None:
                total = total or dark(self._spreading.channels)
                for spectrum, weight in zip(total, weights[:, part, node], strict=True):
                    spectrum += float(weight) * light
        return total

    def cover_spectrum(self, number: int, node: int, cell: ExposureCell) -> torch.Tensor | None:
        """Return the share of the light behind that a layer hides; None if it hides none nearby."""
        layer = self._spreading.layers[number]
        assert layer.cover is not None
        where = self._objects.placement(layer, cell, self._offset(node))
        if where is None:
            return None
        return self._blur(number, node, cell)(self._objects.cover_spectra(layer.cover, where))

    def share(self, number: int, node: int, cell: ExposureCell) -> float:
        """Return the share of the light in the PSF's window; the zeroth's may hold side orders."""
        first = self._objects.places[0]
        return float(self._spreading.psf(number, node, first, cell, self._order).sum())

    def _offset(self, node: int) -> Place:
        """Return where the order's centre lies, (y, x) metres from the image."""
        return self._spreading.order_centre(node, self._order) if self._order else (0.0, 0.0)

    def _blur(self, number: int, node: int, cell: ExposureCell) -> Blur:
        """Return the function that blurs a layer's pictures at one wavelength."""

        def blur(spectra: Sequence[torch.Tensor]) -> torch.Tensor | None:
            if not any(bool(one.any()) for one in spectra):
                return None
            total = self._gathering.zero_spectra(1)[0]
            for place, spectrum in zip(self._objects.places, spectra, strict=True):
                psf = self._spreading.psf(number, node, place, cell, self._order)
                total += self._gathering.transfer(psf, "panel orders") * spectrum
            return total

        return blur


class ZerothOrderPath(LightPath):
    """The way of the light that stays in the zeroth order of the panel's pixel grid."""

    def layer_spectra(
        self, number: int, cell: ExposureCell, nodes: Sequence[int]
    ) -> list[torch.Tensor]:
        """Return a layer's light of some wavelengths.

        Their PSFs are added before the convolution.
        """
        layer, weights = self._spreading.layers[number], self._spreading.weights[number]
        weights = weights[:, :, list(nodes)]
        total = self._gathering.zero_spectra(self._spreading.channels)
        where = self._objects.placement(layer, cell)
        if not layer.parts or where is None:
            return total
        angles = self._spreading.angles[number]
        shining = []
        for index, (one, angle) in enumerate(zip(layer.parts, angles, strict=True)):
            evenly = self._objects.uniform_dc_term(one.picture, angle)
            for spectrum, seen in zip(total, weights[:, index].sum(1), strict=True):
                spectrum[0, 0] += float(seen) * evenly
            shining.append(self._objects.light_spectra(one.picture, where, angle))
        uneven = [index for index, spectra in enumerate(shining) if spectra]
        if not uneven:
            return total
        flat = weights[:, uneven].reshape(-1, weights.shape[2])
        for at, place in enumerate(self._objects.places):
            psfs = [self._spreading.psf(number, node, place, cell) for node in nodes]
            transfers = iter(self._gathering.transfers(psfs, flat, "picture"))
            for spectrum in total:
                for index in uneven:
                    spectrum += next(transfers) * shining[index][at]
        return total

    def _blur(self, number: int, node: int, cell: ExposureCell) -> Blur:
        psfs = (self._spreading.psf(number, node, place, cell) for place in self._objects.places)
        transfers = [self._gathering.transfer(psf, "occlusion") for psf in psfs]

        def blur(spectra: Sequence[torch.Tensor]) -> torch.Tensor:
            total = transfers[0] * spectra[0]
            for transfer, spectrum in zip(transfers[1:], spectra[1:], strict=True):
                total += transfer * spectrum
            return total

        return blur


@dataclass(frozen=True)
class Compositor:
    """Combine all layers of a target, along all paths of their light.

    occlusion: whether near layers hide far ones; else all light is added.
    """

    gathering: SampleGrid
    spreading: LayerPSFs
    paths: Sequence[LightPath]
    occlusion: bool

    def spectra(self, cell: ExposureCell, nodes: Sequence[int]) -> list[torch.Tensor]:
        """Return all layers' light of some wavelengths, as a spectrum for each channel."""
        if self.occlusion:
            return self._occluded_spectra(cell, nodes)
        total = self.gathering.zero_spectra(self.spreading.channels)
        for number in range(len(self.spreading.layers)):
            for way in self.paths:
                for channel, light in enumerate(way.layer_spectra(number, cell, nodes)):
                    total[channel] += light
        return total

    def _occluded_spectra(self, cell: ExposureCell, nodes: Sequence[int]) -> list[torch.Tensor]:
        """Combine layers from the farthest to the nearest.

        Blurred light is multiplied by blurred covers, and so has to be computed wavelength by
        wavelength, and path by path: what comes to a pixel from aside is hidden by what is aside.
        The rays that a cover stops are taken to be as bright as the other rays to a sample. This is
        exact where either layer is in focus, and right to about a percent elsewhere (Hasinoff and
        Kutulakos, A layer-based restoration framework for variable-aperture photography, ICCV
        2007). Where blurred edges of two layers lie along each other, it is wrong by several
        percent of the light along that line: a ray passes both or none.
        """
        total: list[torch.Tensor] = []
        for node in nodes:
            for way in self.paths:
                total = _sums(total, self._path_light(way, node, cell))
        if not total:
            return self.gathering.zero_spectra(self.spreading.channels)
        return [self.gathering.transform_samples(light, "occlusion") for light in total]

    def _path_light(self, way: LightPath, node: int, cell: ExposureCell) -> list[torch.Tensor]:
        """Return the light of one wavelength and path on samples, near layers before far ones.

        There is one picture for each channel, or none if no layer's light is near the frame.
        """
        behind: list[torch.Tensor] = []
        for number in reversed(range(len(self.spreading.layers))):
            if behind and self.spreading.layers[number].cover is not None:
                cover = way.cover_spectrum(number, node, cell)
                carried = way.share(number, node, cell)
                if cover is not None and carried:
                    # A path holds a share of a layer's light, and the layer hides all that is
                    # behind in it.
                    hidden = self.gathering.samples(cover, "occlusion") / carried
                    left = 1 - hidden.clamp(0, 1)
                    behind = [one * left for one in behind]
            spectra = way.wavelength_spectra(number, node, cell)
            behind = _sums(behind, [self.gathering.samples(one, "occlusion") for one in spectra])
        return behind


def _sums(one: list[torch.Tensor], other: list[torch.Tensor]) -> list[torch.Tensor]:
    """Add the channels of two lights; one without any is dark."""
    return [a + b for a, b in zip(one, other, strict=True)] if one and other else one or other
