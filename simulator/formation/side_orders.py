"""Render the side diffraction orders of the panel's pixel grid: faint, distant copies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from simulator.formation.exposure_cells import ExposureCell
from simulator.formation.kernels import Order
from simulator.formation.layer_psfs import LayerPSFs
from simulator.formation.objects import ObjectSpectra
from simulator.formation.sample_grid import SampleGrid

_ONE = np.ones((1, 1))


def side_orders(most: int) -> list[Order]:
    """Return all orders up to `most` along each axis but the zeroth."""
    span = range(-most, most + 1)
    return [(y, x) for y in span for x in span if y or x]


class SideOrderPath:
    """The path of light that the panel's pixel grid diffracts into one side order.

    An order's offset is proportional to the wavelength. Its PSF is computed around the order's
    centre, and convolved with the object as if the object were there.
    """

    def __init__(
        self, gathering: SampleGrid, objects: ObjectSpectra, spreading: LayerPSFs, order: Order
    ) -> None:
        self._gathering, self._objects, self._spreading = gathering, objects, spreading
        self._order = order

    def layer_spectra(
        self, number: int, cell: ExposureCell, count: int, nodes: Sequence[int]
    ) -> list[torch.Tensor]:
        """Render a layer's light of some wavelengths; see LightPath."""
        total = self._gathering.zero_spectra(self._spreading.channels)
        for node in nodes:
            for channel, light in enumerate(self.wavelength_spectra(number, node, cell, count)):
                total[channel] += light
        return total

    def wavelength_spectra(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> list[torch.Tensor]:
        """Render a layer's light of one wavelength; see LightPath."""
        del count
        layer, weights = self._spreading.layers[number], self._spreading.weights(number)
        off = self._spreading.order_centre(self._spreading.nodes[node], self._order)
        where = self._objects.placement(layer, cell, off)
        total: list[torch.Tensor] = []
        for part, one in enumerate(layer.parts if where is not None else ()):
            assert where is not None
            if self._objects.is_off_plane(one.picture, layer, cell, off):
                continue
            angle = self._spreading.angles(number)[part]
            shining = self._objects.light_spectra(one.picture, layer, where, off, angle)
            light = self._spectrum(number, node, cell, shining)
            if light is None:
                continue
            total = total or self._gathering.zero_spectra(self._spreading.channels)
            for channel in range(self._spreading.channels):
                total[channel] += float(weights[channel, part, node]) * light
        return total

    def cover_spectrum(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> torch.Tensor | None:
        """Render the spectrum of a layer's cover, which may be beside the frame; see LightPath."""
        del count
        layer = self._spreading.layers[number]
        assert layer.cover is not None
        off = self._spreading.order_centre(self._spreading.nodes[node], self._order)
        where = self._objects.placement(layer, cell, off)
        if where is None:
            return None
        return self._spectrum(number, node, cell, self._objects.cover_spectra(layer.cover, where))

    def share(self, number: int, node: int, cell: ExposureCell, count: int) -> float:
        """Return the share of the light in the order's window."""
        del count
        first = self._spreading.places[0]
        return float(self._spreading.order_psf(number, node, first, cell, self._order).sum())

    def _spectrum(
        self, number: int, node: int, cell: ExposureCell, spectra: list[torch.Tensor]
    ) -> torch.Tensor | None:
        """Render a picture's spectrum in this order; None if none of its light is near."""
        if not any(bool(one.any()) for one in spectra):
            return None
        total = self._gathering.zero_spectra(1)[0]
        for place, spectrum in zip(self._objects.places, spectra, strict=True):
            psf = self._spreading.order_psf(number, node, place, cell, self._order)
            total += self._gathering.transfers([psf], _ONE, "panel orders")[0] * spectrum
        return total
