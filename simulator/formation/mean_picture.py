"""The mean picture of a situation by a recipe: electrons on each pixel, side orders included."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch

from optics.caching import ByteCache
from optics.camera.ghost import total_share
from optics.formation import rfft2_frequencies
from optics.sensor.stages import mix_neighbours
from simulator.formation.coarse_orders import CoarseOrders
from simulator.formation.compositing import Compositor, LightPath, ZerothOrderPath
from simulator.formation.distorting import DISTORTION_OPERATIONS, distort
from simulator.formation.dust_shadows import cast_shadows
from simulator.formation.exposure_cells import ExposureCell, exposure_cells
from simulator.formation.ghosts import ghost_on_pixels, ghost_operations
from simulator.formation.kernels import Kernels
from simulator.formation.layer_psfs import LayerPSFs
from simulator.formation.nodes import channel_efficiencies, wavelengths
from simulator.formation.objects import ObjectSpectra
from simulator.formation.sample_grid import SampleGrid
from simulator.formation.windows import rendering_windows
from simulator.ledger import Ledger
from simulator.recipe import Recipe
from simulator.situation import Situation


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
        for cell in exposure_cells(s, recipe):
            check()
            light = render.light(cell)
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


def image_vibration(s: Situation) -> float:
    """Return how far the image trembles during an exposure, metres rms along an axis.

    A vibration of frequency f and any phase leaves 1 - sinc²(f T) of its variance about the mean
    place in an exposure T.
    """
    camera = s.camera
    if not camera.vibration:
        return 0.0
    periods = camera.vibration_frequency * s.exposure
    return camera.vibration * math.sqrt(max(1 - float(np.sinc(min(periods, 1e9))) ** 2, 0.0))


def _require_counts(recipe: Recipe) -> None:
    """Raise ValueError if one of a recipe's counts is too small."""
    ones = ["window", "samples_per_pixel", "wavelengths", "depths", "places", "motion"]
    for least, names in ((1, [*ones, "aberrated_places"]), (0, ["leak", "orders"])):
        for name in names:
            if (count := getattr(recipe, name)) < least:
                raise ValueError(f"the recipe's {name} is {count}; it is {least} at least")


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
        self._s, self._recipe, self._cache = s, recipe, cache
        self._ledger, self._check = ledger, check
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
        objects = ObjectSpectra(self._gathering, kernels)
        spreading = LayerPSFs(kernels, objects)
        self._wavelengths = [one.metres for one in spreading.nodes]
        ways: list[LightPath] = [ZerothOrderPath(self._gathering, objects, spreading)]
        if not windows.merged_orders:
            span = range(-orders, orders + 1)
            sides = [(y, x) for y in span for x in span if y or x]
            ways += [LightPath(self._gathering, objects, spreading, one) for one in sides]
        self._layered = Compositor(self._gathering, spreading, ways, recipe.occlusion)
        self._coarse_orders = CoarseOrders(kernels, spreading, objects) if coarse else None

    def light(self, cell: ExposureCell) -> torch.Tensor:
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
        return self._cache.get(causes, lambda: self._compute_light(cell))

    def _compute_light(self, cell: ExposureCell) -> torch.Tensor:
        aperture = self._recipe.pixel_aperture
        light = []
        for spectrum, straight in self._spectra(cell):
            self._check()
            light.append(self._gathering.light_on_pixels(spectrum, aperture))
            if self._recipe.ghosts:
                light[-1] = self._with_ghosts(light[-1], straight)
        total = torch.stack(light)
        if self._coarse_orders is not None:
            self._check()
            total += self._coarse_orders.light(cell)
        return self._with_glare(total) if self._recipe.glare else total

    def _spectra(self, cell: ExposureCell) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """Return all light where it lands, and straight, as two spectra for each channel."""
        groups = [([*range(len(self._wavelengths))], 1.0)]
        if self._recipe.lateral_colour:
            scale = self._s.camera.lens.image_scale
            groups = [([node], scale(one)) for node, one in enumerate(self._wavelengths)]
        total: list[tuple[torch.Tensor, torch.Tensor]] = []
        for nodes, scaled in groups:
            straight = [self._blurred(one) for one in self._layered.spectra(cell, nodes)]
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
        fy, fx = rfft2_frequencies(self._gathering.plane)
        # A normally distributed vibration.
        transfer = torch.exp(-2 * (math.pi * self._vibration) ** 2 * (fy**2 + fx**2))
        return spectrum * transfer.to(torch.float32)

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
