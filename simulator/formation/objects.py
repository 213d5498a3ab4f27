"""The layers of a target on the samples of a picture, weighed by where they are in the field."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.caching import ByteCache
from simulator.formation.gathering import Gathering
from simulator.formation.kernels import Kernels
from simulator.formation.nodes import place_weights, places
from simulator.formation.time import Cell
from simulator.formation.vignetting import vignetting
from simulator.recipe import Recipe
from simulator.scene.drawable import Drawable, Even
from simulator.scene.target import Layer
from simulator.situation import Situation

Place = tuple[float, float]


@dataclass(frozen=True)
class Where:
    """A layer's picture during a cell: magnification, (y, x) metres on the object that it has
    moved, and (y, x) metres on the sensor on which it is on its way."""

    magnification: float
    shift: tuple[float, float]
    path: tuple[float, float]


class Objects:
    """Spectra of pictures, one for each place in the field, whose PSF it is to be convolved with.

    Vignetting and the weights of the places are of the points that shine, and so come before any
    blur.
    """

    def __init__(
        self,
        s: Situation,
        recipe: Recipe,
        gathering: Gathering,
        kernels: Kernels,
        cache: ByteCache,
    ) -> None:
        self._s, self._recipe, self._gathering, self._cache = s, recipe, gathering, cache
        self._kernels, self._plane = kernels, gathering.plane
        halves = [n * s.camera.sensor.pitch / 2 for n in s.camera.sensor.shape]
        count = recipe.places if s.camera.separation else 1
        self._grid = [places(count, half) for half in halves]
        self.places: list[Place] = [(y, x) for y in self._grid[0] for x in self._grid[1]]

    def where(self, layer: Layer, cell: Cell, off: Place = (0.0, 0.0)) -> Where | None:
        """off: (y, x) metres on the sensor by which the picture is moved besides. None where
        a layer at infinity can't be moved."""
        scale = self._s.camera.magnification(layer.distance)
        shift = cell.shift
        if any(off):
            if not scale:
                return None
            shift = (shift[0] + off[0] / scale, shift[1] + off[1] / scale)
        return Where(scale, shift, (cell.path[0] * scale, cell.path[1] * scale))

    def beside(self, picture: Drawable, layer: Layer, cell: Cell, off: Place) -> bool:
        """Whether nothing of a picture that is moved so far is on the plane: then it needn't be
        drawn."""
        scale = self._s.camera.magnification(layer.distance)
        ends = picture.extent(scale, cell.shift)
        plane = self._plane
        halves = (n * pitch / 2 for n, pitch in zip(plane.shape, plane.pitch, strict=True))
        return any(
            abs(away) - end - abs(path) * scale > half
            for away, end, path, half in zip(off, ends, cell.path, halves, strict=True)
        )

    def bare(self, picture: Drawable, where: Where, effect: str) -> torch.Tensor:
        """The spectrum of a picture, and of the path that it takes."""
        return self._cache.get(
            ("object", picture, where, self._plane, self._recipe.drawn),
            lambda: self._bare(picture, where, effect),
        )

    def _bare(self, picture: Drawable, where: Where, effect: str) -> torch.Tensor:
        spectrum = self._gathering.spectrum(picture, where.magnification, where.shift, effect)
        smear = self._gathering.smear(where.path)
        return spectrum if smear is None else spectrum * smear

    def shining(
        self, picture: Drawable, layer: Layer, where: Where, off: Place = (0.0, 0.0)
    ) -> list[torch.Tensor]:
        """Of what shines, vignetting in it, for each place; off: as it was moved besides.

        Of endless even light, by how much vignetting makes it less than even, if at all: see
        even().
        """
        if self.even(picture) and not self._recipe.vignetting:
            return []
        if not self._recipe.vignetting and len(self.places) == 1:
            return [self.bare(picture, where, "picture")]
        causes = (
            "shining", self._kernels.camera, self._s.mount, picture, where, off, self._plane,
            len(self.places), self._recipe.vignetting, layer.distance, self._recipe.drawn,
        )  # fmt: skip
        even = self.even(picture)

        def weighed() -> list[torch.Tensor]:
            # Nobody will ask for the bare one again: it isn't kept beside this.
            bare = self._bare(picture, where, "picture")
            return self._weighed(bare, self._attenuation(layer, off), even)

        return self._cache.get(causes, weighed)

    def even(self, picture: Drawable) -> bool:
        """Whether a picture is endless and even, and nothing stands before it: then it is even
        however it is blurred, and whatever goes aside."""
        return isinstance(picture, Even) and not self._recipe.occlusion

    def evenly(self, picture: Drawable) -> float:
        """The spectrum's entry at frequency 0 of such a picture, blurred; 0 of any other."""
        rows, columns = self._plane.shape
        if not isinstance(picture, Even) or not self.even(picture):
            return 0.0
        return picture.value * rows * columns

    def hiding(self, cover: Drawable, where: Where) -> list[torch.Tensor]:
        """Of what covers, for each place."""
        bare = self.bare(cover, where, "occlusion")
        if len(self.places) == 1:
            return [bare]
        return self._weighed(bare, None)

    def _attenuation(self, layer: Layer, off: Place) -> torch.Tensor | None:
        if not self._recipe.vignetting:
            return None
        camera, mount, plane = self._kernels.camera, self._s.mount, self._plane
        if not any(off):
            causes = ("vignetting", camera, mount, plane, layer.distance)
            return self._cache.get(causes, lambda: vignetting(camera, mount, plane, layer.distance))
        # What was moved shines from where it was.
        centre = (plane.centre[0] - off[0], plane.centre[1] - off[1])
        away = type(plane)(plane.shape, plane.pitch, centre)
        return vignetting(camera, mount, away, layer.distance)

    def _weighed(
        self, bare: torch.Tensor, attenuation: torch.Tensor | None, even: bool = False
    ) -> list[torch.Tensor]:
        effect = "vignetting" if len(self.places) == 1 else "field position"
        light = self._gathering.samples(bare, effect)
        if attenuation is not None:
            light = light * (attenuation - 1 if even else attenuation)
        if len(self.places) == 1:
            return [self._gathering.transformed(light, effect)]
        down, along = (
            torch.from_numpy(place_weights(self._grid[axis], self._plane.coordinates(axis).numpy()))
            .to(torch.float32)
            for axis in (0, 1)
        )  # fmt: skip
        return [
            self._gathering.transformed(light * v[:, None] * u, effect) for v in down for u in along
        ]
