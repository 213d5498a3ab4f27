"""Spectra of a target's layers on the samples of a picture, weighted over the field."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from optics.caching import ByteCache
from simulator.formation.exposure_cells import ExposureCell
from simulator.formation.kernels import Kernels
from simulator.formation.nodes import (
    angle_share,
    field_nodes,
    interpolation_weights,
    rendered_angles,
)
from simulator.formation.sample_grid import SampleGrid
from simulator.formation.vignetting import vignetting
from simulator.recipe import Recipe
from simulator.scene.drawable import Drawable, UniformLight
from simulator.scene.target import Layer
from simulator.situation import Situation


def place_count(s: Situation, recipe: Recipe) -> int:
    """Return the places along each axis of the field that have PSFs of their own."""
    of_shadow = recipe.places if s.camera.separation else 1
    of_lens = recipe.aberrated_places if s.camera.lens.field_aberrations else 1
    return max(of_shadow, of_lens)


def field_effect(recipe: Recipe) -> str:
    """Return the effect to which the ledger ascribes the work on more than one place."""
    return "field position" if recipe.places > 1 else "field aberrations"


Place = tuple[float, float]
"""(y, x) metres on the sensor."""


@dataclass(frozen=True)
class LayerPlacement:
    """Size and place of a layer's picture during an exposure cell.

    shift: (y, x) metres on the object by which it has moved. path: (y, x) metres on the sensor
    along which it moves.
    """

    magnification: float
    shift: tuple[float, float]
    path: tuple[float, float]


class ObjectSpectra:
    """Spectra of a target's pictures, one for each place in the field and its PSF.

    Vignetting and the weights of the places apply to the points that emit light, and so come before
    any blur.
    """

    def __init__(
        self,
        s: Situation,
        recipe: Recipe,
        gathering: SampleGrid,
        kernels: Kernels,
        cache: ByteCache,
    ) -> None:
        self._s, self._recipe, self._gathering, self._cache = s, recipe, gathering, cache
        self._kernels, self._plane = kernels, gathering.plane
        halves = [n * s.camera.sensor.pitch / 2 for n in s.camera.sensor.shape]
        count = place_count(s, recipe)
        self._grid = [field_nodes(count, half) for half in halves]
        self._squared_sines = tuple(rendered_angles(s, recipe))
        self.places: list[Place] = [(y, x) for y in self._grid[0] for x in self._grid[1]]

    def placement(
        self, layer: Layer, cell: ExposureCell, off: Place = (0.0, 0.0)
    ) -> LayerPlacement | None:
        """Return where and how large a layer's picture is during an exposure cell.

        off: (y, x) metres on the sensor by which the picture is shifted further. None for a layer
        at infinity that would have to be shifted.
        """
        scale = self._s.camera.magnification(layer.distance)
        shift = cell.shift
        if any(off):
            if not scale:
                return None
            shift = (shift[0] + off[0] / scale, shift[1] + off[1] / scale)
        return LayerPlacement(scale, shift, (cell.path[0] * scale, cell.path[1] * scale))

    def is_off_plane(self, picture: Drawable, layer: Layer, cell: ExposureCell, off: Place) -> bool:
        """Whether a picture shifted by `off` is wholly beside the samples."""
        scale = self._s.camera.magnification(layer.distance)
        ends = picture.extent(scale, cell.shift)
        plane = self._plane
        halves = (n * pitch / 2 for n, pitch in zip(plane.shape, plane.pitch, strict=True))
        return any(
            abs(away) - end - abs(path) * scale > half
            for away, end, path, half in zip(off, ends, cell.path, halves, strict=True)
        )

    def picture_spectrum(
        self, picture: Drawable, where: LayerPlacement, effect: str
    ) -> torch.Tensor:
        """Return the spectrum of a picture smeared along its path, from the cache if possible."""
        return self._cache.get(
            ("object", picture, where, self._plane, self._recipe.picture_samples_per_pixel),
            lambda: self._compute_picture_spectrum(picture, where, effect),
        )

    def _compute_picture_spectrum(
        self, picture: Drawable, where: LayerPlacement, effect: str
    ) -> torch.Tensor:
        spectrum = self._gathering.spectrum(picture, where.magnification, where.shift, effect)
        smear = self._gathering.motion_transfer(where.path)
        return spectrum if smear is None else spectrum * smear

    def light_spectra(
        self,
        picture: Drawable,
        layer: Layer,
        where: LayerPlacement,
        off: Place = (0.0, 0.0),
        angle: int = 0,
    ) -> list[torch.Tensor]:
        """Return the spectra of a picture's light for each place, with vignetting.

        off: (y, x) metres on the sensor by which the picture was shifted further. angle: number of
        the angle at the filter by whose share of each point's light the picture is weighted; 0 for
        none. For uniform light without it, the spectra are those of the deviation from uniform that
        vignetting causes, if any: see is_uniform().
        """
        even = self.is_uniform(picture) and not angle
        if even and not self._recipe.vignetting:
            return []
        if not self._recipe.vignetting and len(self.places) == 1 and not angle:
            return [self.picture_spectrum(picture, where, "picture")]
        causes = (
            "shining", self._kernels.camera, self._s.mount, picture, where, off, self._plane,
            len(self.places), self._recipe.vignetting, layer.distance,
            self._recipe.picture_samples_per_pixel, angle and (angle, self._squared_sines),
        )  # fmt: skip

        def weighted_spectra() -> list[torch.Tensor]:
            # The unweighted spectrum isn't needed again, so it isn't cached.
            bare = self._compute_picture_spectrum(picture, where, "picture")
            return self._weight_by_place(bare, self._attenuation(layer, off, angle), even)

        return self._cache.get(causes, weighted_spectra)

    def is_uniform(self, picture: Drawable) -> bool:
        """Whether a picture's light is uniform, endless and hidden by nothing.

        Such light stays uniform however it is blurred, and whatever share goes to side orders.
        """
        return isinstance(picture, UniformLight) and not self._recipe.occlusion

    def uniform_dc_term(self, picture: Drawable, angle: int = 0) -> float:
        """Return the spectrum of uniform light at frequency 0; 0 for other pictures.

        Blur doesn't change this value. angle: as in light_spectra(), which has all light of others.
        """
        rows, columns = self._plane.shape
        if angle or not isinstance(picture, UniformLight) or not self.is_uniform(picture):
            return 0.0
        return picture.value * rows * columns

    def cover_spectra(self, cover: Drawable, where: LayerPlacement) -> list[torch.Tensor]:
        """Return the spectra of a layer's cover, one for each place."""
        bare = self.picture_spectrum(cover, where, "occlusion")
        if len(self.places) == 1:
            return [bare]
        return self._weight_by_place(bare, None)

    def _attenuation(self, layer: Layer, off: Place, angle: int) -> torch.Tensor | None:
        """Return a layer's vignetting times an angle's share, on samples; None with neither.

        Light that was shifted is vignetted by its original place.
        """
        camera, mount, distance = self._kernels.camera, self._s.mount, layer.distance
        y, x = (middle - away for middle, away in zip(self._plane.centre, off, strict=True))
        before = replace(self._plane, centre=(y, x))
        seen = None
        if self._recipe.vignetting and any(off):
            seen = vignetting(camera, mount, before, distance)
        elif self._recipe.vignetting:
            seen = self._cache.get(
                ("vignetting", camera, mount, before, distance),
                lambda: vignetting(camera, mount, before, distance),
            )
        if not angle:
            return seen
        share = angle_share(self._squared_sines, angle, self._s.camera, before)
        return share if seen is None else seen * share

    def _weight_by_place(
        self, bare: torch.Tensor, attenuation: torch.Tensor | None, even: bool = False
    ) -> list[torch.Tensor]:
        """Weight a picture by vignetting and place in the field; return the spectra."""
        effect = "vignetting" if len(self.places) == 1 else field_effect(self._recipe)
        light = self._gathering.samples(bare, effect)
        if attenuation is not None:
            light = light * (attenuation - 1 if even else attenuation)
        if len(self.places) == 1:
            return [self._gathering.transform_samples(light, effect)]
        down, along = (
            torch.from_numpy(
                interpolation_weights(self._grid[axis], self._plane.coordinates(axis).numpy())
            ).to(torch.float32)
            for axis in (0, 1)
        )
        return [
            self._gathering.transform_samples(light * v[:, None] * u, effect)
            for v in down
            for u in along
        ]
