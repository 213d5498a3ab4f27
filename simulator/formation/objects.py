"""Spectra of a target's layers on the samples of a picture, weighted over the field."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera, Lens
from optics.camera.pupil import share_through_stop
from optics.formation import rfft2_frequencies
from optics.plane import Plane
from simulator.formation.exposure_cells import ExposureCell
from simulator.formation.kernels import Kernels
from simulator.formation.nodes import (
    angle_share,
    field_nodes,
    interpolation_weights,
    rendered_angles,
)
from simulator.formation.sample_grid import SampleGrid
from simulator.mount import Mount
from simulator.recipe import Recipe
from simulator.scene.drawable import Drawable, UniformLight
from simulator.scene.target import Layer

Array = NDArray[np.float64]

_PLACES = 33  # places along an axis at which the light through the stop is computed. Chosen.


def vignetting(camera: Camera, mount: Mount, plane: Plane, distance: float) -> torch.Tensor:
    """Return each place's light over that on the axis, (rows, columns) float32 on a plane.

    camera: in the panel's axes. Vignetting is that of the lens, times the panel's light that passes
    the stop (share_through_stop()), which is interpolated between 33 x 33 places, the outermost on
    the plane's edges; a plane of fewer samples needs no others.
    """
    y, x = plane.mesh()
    share = _relative_illumination(camera.lens, y**2 + x**2)
    if camera.separation:
        share = share * _relative_stop_transmission(camera, mount, plane, distance)
    return share.to(torch.float32)


def _relative_illumination(lens: Lens, squared_height: torch.Tensor) -> torch.Tensor:
    """Return the vignetting of the lens: its curve where light lands, or cos⁴.

    The curve is linear in the squared height, m², which makes it smooth on the axis, and even
    beyond its last pair.
    """
    if not lens.relative_illumination:
        return (1 + squared_height / lens.image_distance**2) ** -2
    height, share = np.array(lens.relative_illumination).T
    squared = squared_height.numpy()
    by = lens.radial_distortion
    if by is not None:
        squared = by.distorted(np.sqrt(squared)) ** 2
    return torch.from_numpy(np.interp(squared, height**2, share))


def _relative_stop_transmission(
    camera: Camera, mount: Mount, plane: Plane, distance: float
) -> torch.Tensor:
    """Return the light through the stop by place, relative to that on the axis."""

    def share(y: float, x: float) -> float:
        return share_through_stop(
            camera, distance, mount.place_in_panel_axes((y, x), camera, distance)
        )

    axis = share(0.0, 0.0)
    if not axis:
        raise ValueError(
            "the stop hides the panel from the middle of the field; no light passes: move the "
            "panel nearer to the lens, or open the stop"
        )
    ends = [(float(one.min()), float(one.max())) for one in plane.mesh()]
    counts = (min(_PLACES, max(n, 2)) for n in plane.shape)
    grid = [np.linspace(*end, count) for end, count in zip(ends, counts, strict=True)]
    known = np.array([[share(float(y), float(x)) for x in grid[1]] for y in grid[0]])
    down = _interpolate(known / axis, plane.coordinates(0).numpy(), grid[0])
    return torch.from_numpy(_interpolate(down.T, plane.coordinates(1).numpy(), grid[1]).T)


def _interpolate(values: Array, at: Array, nodes: Array) -> Array:
    """Interpolate values linearly along the first axis, between evenly spaced nodes."""
    step = nodes[1] - nodes[0]
    if not step:
        return np.repeat(values[:1], len(at), axis=0)
    place = np.clip((at - nodes[0]) / step, 0, len(nodes) - 1)
    low = np.minimum(place.astype(int), len(nodes) - 2)
    share = (place - low)[:, None]
    return values[low] * (1 - share) + values[low + 1] * share


def field_effect(recipe: Recipe) -> str:
    """Return the effect to which the ledger ascribes the work on more than one place."""
    return "field position" if recipe.places > 1 else "field aberrations"


Place = tuple[float, float]
"""(y, x) metres on the sensor."""


@dataclass(frozen=True)
class LayerPlacement:
    """Size and place of a layer's picture during an exposure cell.

    distance: of the layer. shift: (y, x) metres on the object from its place. path, off: (y, x)
    metres on the sensor along which it moves, and by which a diffraction order shifts it.
    """

    distance: float
    magnification: float
    shift: tuple[float, float]
    path: tuple[float, float]
    off: Place


class ObjectSpectra:
    """Spectra of a target's pictures, one for each place in the field and its PSF.

    Vignetting and the weights of the places apply to the points that emit light, before any blur.
    """

    def __init__(self, gathering: SampleGrid, kernels: Kernels) -> None:
        self._gathering, self._kernels, self._plane = gathering, kernels, gathering.plane
        self._s, self._recipe, self._cache = kernels.s, kernels.recipe, kernels.cache
        s, recipe = kernels.s, kernels.recipe
        halves = [n * s.camera.sensor.pitch / 2 for n in s.camera.sensor.shape]
        # Places along each axis of the field that have PSFs of their own.
        of_shadow = recipe.places if s.camera.separation else 1
        of_lens = recipe.aberrated_places if s.camera.lens.field_aberrations else 1
        count = max(of_shadow, of_lens)
        self._grid = [field_nodes(count, half) for half in halves]
        self._squared_sines = tuple(rendered_angles(s, recipe))
        self.places: list[Place] = [(y, x) for y in self._grid[0] for x in self._grid[1]]

    def placement(
        self, layer: Layer, cell: ExposureCell, off: Place = (0.0, 0.0)
    ) -> LayerPlacement | None:
        """Return where and how large a layer's picture is during an exposure cell.

        off: (y, x) metres on the sensor by which it is shifted further: None if it is at infinity.
        """
        scale = self._s.camera.magnification(layer.distance)
        shift = cell.shift
        if any(off):
            if not scale:
                return None
            shift = (shift[0] + off[0] / scale, shift[1] + off[1] / scale)
        path = cell.path[0] * scale, cell.path[1] * scale
        return LayerPlacement(layer.distance, scale, shift, path, off)

    def is_off_plane(self, picture: Drawable, layer: Layer, cell: ExposureCell, off: Place) -> bool:
        """Whether a picture shifted by `off` is wholly beside the samples."""
        scale, plane = self._s.camera.magnification(layer.distance), self._plane
        ends = picture.extent(scale, cell.shift)
        axes = zip(off, ends, cell.path, plane.shape, plane.pitch, strict=True)
        return any(
            abs(away) - end - abs(path) * scale > n * pitch / 2
            for away, end, path, n, pitch in axes
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
        if not any(where.path):
            return spectrum
        fy, fx = rfft2_frequencies(self._plane)
        return spectrum * torch.sinc(fy * where.path[0] + fx * where.path[1]).to(torch.float32)

    def light_spectra(
        self, picture: Drawable, where: LayerPlacement, angle: int
    ) -> list[torch.Tensor]:
        """Return the spectra of a picture's light for each place, with vignetting.

        angle: number of the angle at the filter by whose share the light is weighted; 0 for none.
        Uniform light without it (see is_uniform()) has only what vignetting takes from it.
        """
        even = self.is_uniform(picture) and not angle
        if even and not self._recipe.vignetting:
            return []
        if not self._recipe.vignetting and len(self.places) == 1 and not angle:
            return [self.picture_spectrum(picture, where, "picture")]
        causes = (
            "shining", self._kernels.camera, self._s.mount, picture, where, self._plane,
            len(self.places), self._recipe.vignetting, self._recipe.picture_samples_per_pixel,
            angle and (angle, self._squared_sines),
        )  # fmt: skip

        def weighted_spectra() -> list[torch.Tensor]:
            # The unweighted spectrum isn't needed again, so it isn't cached.
            bare = self._compute_picture_spectrum(picture, where, "picture")
            return self._weight_by_place(bare, self._attenuation(where, angle), even)

        return self._cache.get(causes, weighted_spectra)

    def is_uniform(self, picture: Drawable) -> bool:
        """Whether a picture's light is uniform, endless and hidden by nothing.

        Such light stays uniform however it is blurred, and whatever share goes to side orders.
        """
        return isinstance(picture, UniformLight) and not self._recipe.occlusion

    def uniform_dc_term(self, picture: Drawable, angle: int) -> float:
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

    def _attenuation(self, where: LayerPlacement, angle: int) -> torch.Tensor | None:
        """Return a layer's vignetting times an angle's share, on samples; None with neither.

        Light that was shifted is vignetted by its original place.
        """
        camera, mount, distance = self._kernels.camera, self._s.mount, where.distance
        y, x = (middle - away for middle, away in zip(self._plane.centre, where.off, strict=True))
        before = replace(self._plane, centre=(y, x))
        seen = None
        if self._recipe.vignetting and any(where.off):
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
