"""Render the side diffraction orders of the panel's pixel grid: faint, distant copies."""

from __future__ import annotations

import numpy as np
import torch

from simulator.formation.exposure_cells import ExposureCell
from simulator.formation.kernels import Order
from simulator.formation.layer_psfs import LayerPSFs
from simulator.formation.objects import ObjectSpectra
from simulator.formation.sample_grid import SampleGrid

_ONE = np.ones((1, 1))


class SideOrdersPath:
    """The path of light that the panel's pixel grid diffracts into side orders.

    An order's offset is proportional to the wavelength. Its PSF is computed around the order's
    centre, and convolved with the object as if the object were there.
    """

    def __init__(
        self, gathering: SampleGrid, objects: ObjectSpectra, spreading: LayerPSFs, most: int
    ) -> None:
        self._gathering, self._objects, self._spreading = gathering, objects, spreading
        span = range(-most, most + 1)
        # All orders but the zeroth.
        self._orders: list[Order] = [(y, x) for y in span for x in span if y or x]

    def layer_spectra(self, number: int, cell: ExposureCell, count: int) -> list[torch.Tensor]:
        """Render a layer's light in side orders of all wavelengths; see LightPath."""
        total = self._gathering.zero_spectra(self._spreading.channels)
        for node in range(len(self._spreading.nodes)):
            for channel, light in enumerate(self.wavelength_spectra(number, node, cell, count)):
                total[channel] += light
        return total

    def wavelength_spectra(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> list[torch.Tensor]:
        """Render a layer's light in side orders of one wavelength; see LightPath."""
        del count
        layer, weights = self._spreading.layers[number], self._spreading.weights(number)
        total = self._gathering.zero_spectra(self._spreading.channels)
        for order in self._orders:
            off = self._spreading.order_centre(self._spreading.nodes[node], order)
            where = self._objects.placement(layer, cell, off)
            if where is None:
                continue
            for part, one in enumerate(layer.parts):
                if self._objects.is_off_plane(one.picture, layer, cell, off):
                    continue
                angle = self._spreading.angles(number)[part]
                shining = self._objects.light_spectra(one.picture, layer, where, off, angle)
                light = self._order_spectrum(number, node, order, cell, shining)
                if light is None:
                    continue
                for channel in range(self._spreading.channels):
                    total[channel] += float(weights[channel, part, node]) * light
        return total

    def cover_spectrum(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> torch.Tensor:
        """Render the spectrum of a layer's cover in side orders; see LightPath."""
        del count
        layer = self._spreading.layers[number]
        assert layer.cover is not None
        total = self._gathering.zero_spectra(1)[0]
        for order in self._orders:
            off = self._spreading.order_centre(self._spreading.nodes[node], order)
            where = self._objects.placement(layer, cell, off)
            if where is None:
                continue
            covers = self._objects.cover_spectra(layer.cover, where)
            light = self._order_spectrum(number, node, order, cell, covers)
            if light is not None:
                total += light
        return total

    def _order_spectrum(
        self, number: int, node: int, order: Order, cell: ExposureCell, spectra: list[torch.Tensor]
    ) -> torch.Tensor | None:
        """Render a picture's spectrum in one side order; None if none of its light is near."""
        if not any(bool(one.any()) for one in spectra):
            return None
        total = self._gathering.zero_spectra(1)[0]
        for place, spectrum in zip(self._objects.places, spectra, strict=True):
            psf = self._spreading.order_psf(number, node, place, cell, order)
            total += self._gathering.transfers([psf], _ONE, "panel orders")[0] * spectrum
        return total
