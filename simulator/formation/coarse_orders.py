"""Side orders of the panel's pixel grid, rendered on cells of several sensor pixels."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from optics.plane import Plane
from simulator.convolution import convolve_valid
from simulator.formation.exposure_cells import ExposureCell
from simulator.formation.kernels import Kernels
from simulator.formation.layer_psfs import LayerPSFs
from simulator.formation.nodes import angle_share, rendered_angles
from simulator.formation.objects import ObjectSpectra, vignetting
from simulator.formation.windows import max_blur_distance
from simulator.probing.far_field import FarField, LensProbe, cut_kernel, side_order_kernel
from simulator.scene.target import Layer
from simulator.situation import Situation

Array = NDArray[np.float64]

_CELLS = 192  # cells along the frame's longer side. Chosen.

_SMALLEST_PANEL = 1 << 13  # panel pixels from which on orders are rendered on cells. Chosen.

# Samples of the far field in a diffraction spot, which is much smaller than a cell.
_SAMPLES_PER_SPOT = 1.5


def order_cell_pixels(s: Situation) -> int:
    """Return the sensor pixels along a cell."""
    return max(1, math.ceil(max(s.camera.sensor.shape) / _CELLS))


def can_be_coarse(s: Situation) -> bool:
    """Whether side orders can be computed on cells: all light takes the same way through the stop.

    Moving or hidden light, a turned panel, a lens that distorts, scales colours or has ghosts,
    interference, and jitter, which scatters light evenly, need PSFs. So does a small panel, whose
    diffraction spots are as large as a cell.
    """
    return (
        not s.camera.separation
        and math.prod(s.camera.panel.shape) >= _SMALLEST_PANEL
        and not s.interference
        and s.mount.is_aligned
        and s.mount.is_centred
        and not s.target.is_moving
        and not s.camera.panel.jitter
        and not any(s.camera.lens.distortion)
        and not s.camera.ghosts
        and not s.camera.lens.lateral_colour
        and all(layer.cover is None for layer in s.target.layers)
    )


class CoarseOrders:
    """Compute the light of all side orders together, from the panel's far field.

    Copies of a picture far aside are dim, so that their detail doesn't count. One period of the far
    field lands in each order, weighted by the envelope of one pixel.
    """

    def __init__(self, kernels: Kernels, spreading: LayerPSFs, objects: ObjectSpectra) -> None:
        self._kernels, self._spreading, self._objects = kernels, spreading, objects
        self._s, self._recipe, self._cache = kernels.s, kernels.recipe, kernels.cache
        s, recipe = kernels.s, kernels.recipe
        self._pixels = order_cell_pixels(s)
        self._cell = self._pixels * s.camera.sensor.pitch
        # The outermost pixels lie between cells, too.
        rows, columns = (math.ceil(n / self._pixels) + 2 for n in s.camera.sensor.shape)
        self._frame = rows, columns
        self._squared_sines = tuple(rendered_angles(s, recipe))

    def light(self, cell: ExposureCell) -> torch.Tensor:
        """Return an exposure cell's light in side orders, electrons per second and pixel.

        The result is (channels, rows, columns), float32.
        """
        spreading = self._spreading
        total = np.zeros((spreading.channels, *self._frame))
        for number, layer in enumerate(spreading.layers):
            weights = spreading.weights[number]
            for node in range(len(spreading.nodes)):
                kernel = self._kernel(number, node, cell)
                for part, angle in enumerate(spreading.angles[number]):
                    drawn = self._draw_on_cells(layer, part, kernel.shape, angle)
                    if drawn is None:
                        continue  # It stays uniform, and all of it is in the zeroth order's path.
                    ghosts = convolve_valid(drawn, kernel)
                    total += weights[:, part, node, None, None] * ghosts
        down, along = (
            _interpolation_matrix(n, cells, self._pixels)
            for n, cells in zip(self._s.camera.sensor.shape, self._frame, strict=True)
        )
        return down @ torch.from_numpy(total).to(torch.float32) @ along.T

    def _draw_on_cells(
        self, layer: Layer, part: int, kernel: tuple[int, ...], angle: int
    ) -> Array | None:
        """Draw a layer's part on the cells from which light reaches the frame.

        angle: as in light_spectra(). None stands for light that is uniform on the sensor.
        """
        even = self._objects.is_uniform(layer.parts[part].picture) and not angle
        if even and not self._recipe.vignetting:
            return None
        rows, columns = (n + side - 1 for n, side in zip(self._frame, kernel, strict=True))
        plane = Plane((rows, columns), (self._cell, self._cell))
        picture, camera = layer.parts[part].picture, self._kernels.camera
        causes = (
            "cells", picture, layer.distance, plane, camera, self._s.mount, self._recipe.vignetting,
            angle and (angle, self._squared_sines),
        )  # fmt: skip

        def draw() -> torch.Tensor:
            light = picture.light(plane, self._s.camera.magnification(layer.distance))
            if angle:
                light = light * angle_share(self._squared_sines, angle, self._s.camera, plane)
            if not self._recipe.vignetting:
                return light
            seen = vignetting(camera, self._s.mount, plane, layer.distance)
            return light * (seen - 1 if even else seen)

        return self._cache.get(causes, draw).numpy().astype(np.float64)

    def _kernel(self, layer: int, node: int, cell: ExposureCell) -> Array:
        """Return how a layer's light of one wavelength spreads over the side orders, by cells."""
        wavelength, distances = self._spreading.nodes[node].metres, self._spreading.distances(layer)

        def compute() -> Array:
            modulator, parts = self._kernels.fields(cell.panel_state, wavelength)
            lit, total = list(parts), np.zeros((1, 1))
            time = sum(share for share, _ in lit)
            turned = 1 - modulator.unmodulated_share
            for distance, weight in distances:
                pattern = sum(share * self._orders(one, wavelength, distance) for share, one in lit)
                total = total + weight * turned * pattern
                for number, (share, field) in enumerate(modulator.unmodulated_fields):
                    straight = self._keep(
                        ("straight", number, wavelength, distance),
                        functools.partial(self._orders, field, wavelength, distance),
                    )
                    total = total + weight * time * share * straight
            return total

        return self._keep((cell.panel_state, wavelength, distances), compute)

    def _keep(self, light: tuple[object, ...], compute: Callable[[], Array]) -> Array:
        """Return the kernel of some light from the cache, or compute it."""
        causes = ("coarse orders", light, self._kernels.key, self._cell,
                  self._s.camera.sensor.shape, self._s.picture_probe.extent)  # fmt: skip
        return self._cache.get(causes, compute)

    def _orders(self, field: torch.Tensor | None, wavelength: float, distance: float) -> Array:
        """Return a field's light in its side orders, by cells; None stands for an even field."""
        camera = self._kernels.camera_at(wavelength)
        lit = torch.ones(camera.panel.shape) if field is None else field
        lens = LensProbe(camera, wavelength, distance, self._cache).field(distance)
        side = math.sqrt(camera.panel.fill_factor)
        far = FarField((lens * lit).to(torch.complex64), side, _SAMPLES_PER_SPOT)
        kernel = side_order_kernel(far, self._kernels.period(wavelength), self._cell, 1, 2)
        # As far as light reaches the frame.
        y, x = (
            math.ceil(min(reach / self._cell, len(kernel))) + 2
            for reach in max_blur_distance(self._s)
        )
        power = (lit.abs() ** 2 * lens.abs() ** 2).sum() / (lens.abs() ** 2).sum()
        return float(power) * cut_kernel(kernel, (y, x))


def _interpolation_matrix(count: int, cells: int, pixels: int) -> torch.Tensor:
    """Return the matrix that interpolates linearly from cells to pixels, (count, cells).

    The middle pixel has the middle cell's value. pixels: along a cell.
    """
    place = (torch.arange(count) - count // 2) / pixels + cells // 2
    return (1 - (place[:, None] - torch.arange(cells)).abs()).clamp(min=0)
