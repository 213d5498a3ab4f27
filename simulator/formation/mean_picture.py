"""The mean picture of a situation by a recipe: electrons on each pixel, side orders included."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch

from optics.caching import ByteCache
from optics.camera.ghost import total_share
from optics.sensor.stages import mix_neighbours
from simulator.formation.coarse_orders import CoarseOrders
from simulator.formation.compositing import (
    AdditiveCompositor,
    LightPath,
    OccludingCompositor,
    ZerothOrderPath,
)
from simulator.formation.distorting import DISTORTION_OPERATIONS, distort
from simulator.formation.dust_shadows import cast_shadows
from simulator.formation.exposure_cells import ExposureCell, exposure_cells
from simulator.formation.ghosts import ghost_on_pixels, ghost_operations
from simulator.formation.kernels import Kernels, Order
from simulator.formation.layer_psfs import LayerPSFs
from simulator.formation.nodes import channel_efficiencies, wavelengths
from simulator.formation.objects import ObjectSpectra
from simulator.formation.sample_grid import SampleGrid
from simulator.formation.vibration import image_vibration, vibration_transfer
from simulator.formation.windows import rendering_windows
from simulator.ledger import Ledger
from simulator.recipe import Recipe
from simulator.situation import Situation

_ONE = np.ones((1, 1))


def side_orders(most: int) -> list[Order]:
    """Return all orders up to `most` along each axis but the zeroth."""
    span = range(-most, most + 1)
    return [(y, x) for y in span for x in span if y or x]


class SideOrderPath:
    """The way of light that the panel's pixel grid diffracts into one side order.

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
        """Return a layer's light of some wavelengths; see LightPath."""
        total = self._gathering.zero_spectra(self._spreading.channels)
        for node in nodes:
            for channel, light in enumerate(self.wavelength_spectra(number, node, cell, count)):
                total[channel] += light
        return total

    def wavelength_spectra(
        self, number: int, node: int, cell: ExposureCell, count: int
    ) -> list[torch.Tensor]:
        """Return a layer's light of one wavelength; see LightPath."""
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
        """Return the spectrum of a layer's cover, which may be beside the frame; see LightPath."""
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
        """Return a picture's spectrum in this order, or None if none of its light is near."""
        if not any(bool(one.any()) for one in spectra):
            return None
        total = self._gathering.zero_spectra(1)[0]
        for place, spectrum in zip(self._objects.places, spectra, strict=True):
            psf = self._spreading.order_psf(number, node, place, cell, self._order)
            total += self._gathering.transfers([psf], _ONE, "panel orders")[0] * spectrum
        return total


def expected_electrons(
    s: Situation,
    recipe: Recipe,
    cache: ByteCache,
    ledger: Ledger,
    check: Callable[[], None] = lambda: None,
) -> torch.Tensor:
    """Return the mean photo-electrons of a situation on each pixel.

    Colour filters, pixel aperture and crosstalk are included; the sensor's other stages come later.

    Parameters
    ----------
    s : Situation
        The situation whose picture is rendered.
    recipe : Recipe
        Nodes and stages of the rendering.
    cache : ByteCache
        Keeps light, spectra and PSFs for later pictures.
    ledger : Ledger
        Counts the operations by effect.
    check : Callable, optional
        Function without arguments that is called between the steps of a long computation. It may
        raise, to end the computation.

    Returns
    -------
    torch.Tensor
        Mean electrons over the exposure, (rows, columns) float32, 0 or more.

    Raises
    ------
    ValueError
        For an exposure that isn't positive, and for a recipe by which nothing can be rendered.
    """
    _require_counts(recipe)
    target = s.target.for_camera(s.camera)
    channels = len(channel_efficiencies(s, recipe))
    total = torch.zeros((channels, *s.camera.sensor.shape), dtype=torch.float32)
    found = wavelengths(s, recipe, [part for layer in target.layers for part in layer.parts])
    if found.nodes and found.weights.any():
        render = _Rendering(s, recipe, cache, ledger, check)
        for number, cell in enumerate(exposure_cells(s, recipe)):
            check()
            light = render.light(cell, number)
            total += light * torch.from_numpy(cell.weight).to(torch.float32)[:, None]
    if recipe.dust:
        ledger.add("dust", total.numel(), 4 * total.numel())
        cast_shadows(total, s.camera.sensor, s.camera.lens)
    colour = s.camera.sensor.colour
    if colour is not None and recipe.mosaic:
        ledger.add("colour filter array", total[0].numel(), 4 * total[0].numel())
        electrons = colour.sample_channels(total).clamp(min=0)
    else:
        electrons = total[0].clamp(min=0)
    if recipe.crosstalk:
        ledger.add("pixel crosstalk", 8.0 * electrons.numel(), 4 * electrons.numel())
        electrons = mix_neighbours(electrons, s.camera.sensor.crosstalk)
    return electrons


def _require_counts(recipe: Recipe) -> None:
    """Raise ValueError if one of a recipe's counts is too small."""
    for name in (
        "window",
        "samples_per_pixel",
        "wavelengths",
        "depths",
        "places",
        "aberrated_places",
        "motion",
    ):
        if getattr(recipe, name) < 1:
            raise ValueError(f"the recipe's {name} is {getattr(recipe, name)}; it is 1 at least")
    for name in ("leak", "orders"):
        if getattr(recipe, name) < 0:
            raise ValueError(f"the recipe's {name} is {getattr(recipe, name)}; it is 0 at least")


class _Rendering:
    """Compute the light of exposure cells, with what all cells of an exposure share."""

    def __init__(
        self,
        s: Situation,
        recipe: Recipe,
        cache: ByteCache,
        ledger: Ledger,
        check: Callable[[], None],
    ) -> None:
        self._s, self._recipe, self._cache, self._check = s, recipe, cache, check
        self._ledger = ledger
        self._vibration = image_vibration(s) if recipe.vibration else 0.0
        coarse = recipe.coarse_orders and recipe.diffraction
        orders = recipe.orders if recipe.diffraction and not coarse else 0
        windows = rendering_windows(
            s,
            recipe.window,
            orders=orders,
            wave=recipe.diffraction,
            samples=(recipe.samples_per_pixel, recipe.light_samples_per_pixel),
            ghosts=recipe.ghosts,
        )
        self._gathering = SampleGrid(s.camera.sensor, windows.picture, recipe, ledger, check)
        kernels = Kernels(s, recipe, windows, cache, ledger, check)
        objects = ObjectSpectra(s, recipe, self._gathering, kernels, cache)
        spreading = LayerPSFs(s, recipe, kernels, objects, cache)
        self._wavelengths = [one.metres for one in spreading.nodes]
        ways: list[LightPath] = [ZerothOrderPath(self._gathering, objects, spreading)]
        if orders and not windows.merged_orders:
            ways += [
                SideOrderPath(self._gathering, objects, spreading, one)
                for one in side_orders(orders)
            ]
        layered = OccludingCompositor if recipe.occlusion else AdditiveCompositor
        self._layered = layered(self._gathering, spreading, ways)
        self._coarse_orders = (
            CoarseOrders(s, recipe, kernels, spreading, objects, cache) if coarse else None
        )

    def light(self, cell: ExposureCell, number: int) -> torch.Tensor:
        """Return the light of an exposure cell, computed or from the cache.

        It is in electrons per second, (channels, rows, columns).
        """
        s, r = self._s, self._recipe
        # The light doesn't depend on the recipe's fields for time, which the cell contains, or for
        # the sensor's later stages: these are set to one value in the cache key.
        axes = r.with_changes(
            lamp=False, rolling=False, motion=1, crystal=False, dust=False, crosstalk=False,
            speckle=False, dark_current=False,
            fixed_pattern=False, shot="none", clipping=False, read_noise=False,
            quantisation=False,
        )  # fmt: skip
        causes = (
            "light", s.camera, s.mount, s.target, s.band, s.interference, s.numerics, axes,
            cell.panel_state, cell.shift, cell.path, self._vibration,
            s.focus_drift if r.focus_drift else 0.0,
        )  # fmt: skip
        return self._cache.get(causes, lambda: self._compute_light(cell, number))

    def _compute_light(self, cell: ExposureCell, number: int) -> torch.Tensor:
        aperture = self._recipe.pixel_aperture
        light = []
        for spectrum, straight in self._spectra(cell, number):
            self._check()
            light.append(self._gathering.light_on_pixels(spectrum, aperture))
            if self._recipe.ghosts:
                light[-1] = self._with_ghosts(light[-1], straight)
        total = torch.stack(light)
        if self._coarse_orders is not None:
            self._check()
            total += self._coarse_orders.light(cell)
        return self._with_glare(total) if self._recipe.glare else total

    def _spectra(self, cell: ExposureCell, number: int) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """Return all light where it lands, and straight, as two spectra for each channel."""
        groups: list[tuple[list[int] | None, float]] = [(None, 1.0)]
        if self._recipe.lateral_colour:
            scale = self._s.camera.lens.image_scale
            groups = [([node], scale(one)) for node, one in enumerate(self._wavelengths)]
        total: list[tuple[torch.Tensor, torch.Tensor]] = []
        for nodes, scaled in groups:
            straight = [self._blurred(one) for one in self._layered.spectra(cell, number, nodes)]
            found = [(self._moved(one, scaled), one) for one in straight]
            if total:
                found = [(a + c, b + d) for (a, b), (c, d) in zip(total, found, strict=True)]
            total = found
        return total

    def _blurred(self, spectrum: torch.Tensor) -> torch.Tensor:
        """Blur a picture, given as its spectrum, by its vibration."""
        self._check()
        if not self._vibration:
            return spectrum
        self._ledger.add("vibration", 20.0 * spectrum.numel(), 12 * spectrum.numel())
        return spectrum * vibration_transfer(self._gathering.plane, self._vibration)

    def _moved(self, spectrum: torch.Tensor, scale: float) -> torch.Tensor:
        """Distort and scale a picture, given as its spectrum."""
        bend, coloured = self._recipe.distortion, self._recipe.lateral_colour
        if not (bend or coloured):
            return spectrum
        plane = self._gathering.plane
        samples = plane.shape[0] * plane.shape[1]
        operations = 6 * self._gathering.operations + DISTORTION_OPERATIONS * samples
        self._ledger.add("lateral colour" if coloured else "distortion", operations, 16 * samples)
        return distort(spectrum, plane, self._s.camera, bend=bend, scale=scale)

    def _with_ghosts(self, light: torch.Tensor, straight: torch.Tensor) -> torch.Tensor:
        """Add the lens' ghosts to the light, and take their share from the picture.

        straight: the picture's spectrum, not moved; ghosts are paraxial, and of one scale.
        """
        ghosts, plane = self._s.camera.ghosts, self._gathering.plane
        total = (1 - total_share(ghosts)) * light
        for one in ghosts:
            self._check()
            self._ledger.add("lens ghosts", ghost_operations(plane.shape), 24 * straight.numel())
            ghost = ghost_on_pixels(
                straight, plane, self._s.camera.sensor.plane, one,
                aperture=self._recipe.pixel_aperture,
            )  # fmt: skip
            total = total + one.share * ghost
        return total

    def _with_glare(self, light: torch.Tensor) -> torch.Tensor:
        """Spread a share of the light evenly, as veiling glare."""
        self._ledger.add("veiling glare", 3.0 * light.numel(), 4 * light.numel())
        mean = light.mean(dim=(-2, -1), keepdim=True, dtype=torch.float64).to(light)
        return torch.lerp(light, mean, self._s.camera.glare)
