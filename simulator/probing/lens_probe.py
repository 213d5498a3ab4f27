"""Probe what lens and stop do to uniform light on the panel, independently of its pattern."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import torch

from optics.caching import ByteCache
from optics.camera import Camera
from optics.camera.pupil import object_to_lens_distance, pupil_amplitude
from optics.validation import as_number
from optics.zernike import zernike
from simulator.probing.far_field import FarField

T = TypeVar("T")


class LensProbe:
    """The effect of a camera's lens and stop at a wavelength, for points at several distances.

    wavelength, nearest: metres. nearest: the least distance of a point; the stop's shadow on the
    panel is computed for its light. cache: stores the results, which other patterns share.
    samples_per_spot: of far fields.
    """

    def __init__(
        self,
        camera: Camera,
        wavelength: float,
        nearest: float,
        cache: ByteCache,
        samples_per_spot: float = 2,
    ) -> None:
        self._camera, self._wavelength, self._nearest = camera, wavelength, nearest
        self._cache, self._samples_per_spot = cache, samples_per_spot

    @property
    def aperture_share(self) -> torch.Tensor:
        """Return the share of each panel pixel that the probed lens' stop leaves open.

        The shape is (rows, columns).
        """
        return self._from_cache(self._compute_aperture_share, ())

    def path(self, distance: float) -> torch.Tensor:
        """Return the optical path that the probed lens adds to light on the panel, metres.

        The light comes from a point at `distance`.
        """
        return self._from_cache(self._compute_path, (distance,))

    def lens_phase(self, distance: float) -> torch.Tensor:
        """Return the phase that the probed lens adds to a point's light on the panel, radians."""
        return 2 * math.pi / self._wavelength * self.path(distance)

    def field(self, distance: float) -> torch.Tensor:
        """Return uniform light's field on the panel behind the probed lens and stop, complex64."""
        return self._from_cache(self._compute_field, (distance, self._wavelength))

    def unmodulated_far_field(self, distance: float) -> FarField:
        """Return the probed far field of light that the panel's pattern doesn't modulate."""
        return self._from_cache(self._compute_unmodulated_far_field, (distance, self._wavelength))

    def _from_cache(self, find: Callable[..., T], of: tuple[float, ...]) -> T:
        """Return a result of the lens probe from the cache, or compute it."""
        causes = (find.__name__, self._camera, self._nearest, self._samples_per_spot, *of)
        return self._cache.get(causes, lambda: find(*of[:1]))

    def _compute_aperture_share(self) -> torch.Tensor:
        camera = self._camera
        spread = 1 + as_number(camera.separation) / self._nearest
        lens = replace(camera.lens, f_number=camera.lens.f_number * spread)
        return pupil_amplitude(replace(camera, lens=lens, separation=0.0))

    def _compute_path(self, distance: float) -> torch.Tensor:
        camera, lens = self._camera, self._camera.lens
        spread = 1 + as_number(camera.separation) / distance
        vergence = 1 / object_to_lens_distance(camera, distance) - 1 / lens.focus_distance
        y, x = camera.panel.plane.mesh()
        bent = spread * lens.image_distance / as_number(camera.ray_matrix_b) * vergence
        path = bent / 2 * (y**2 + x**2)
        radius = as_number(lens.stop_diameter) / 2 / spread
        for n, m, strength in lens.aberrations:
            path = path + as_number(strength) * zernike(n, m, y / radius, x / radius)
        return torch.where(self.aperture_share > 0, path, 0.0)

    def _compute_field(self, distance: float) -> torch.Tensor:
        return torch.polar(self.aperture_share, self.lens_phase(distance)).to(torch.complex64)

    def _compute_unmodulated_far_field(self, distance: float) -> FarField:
        side = math.sqrt(self._camera.panel.fill_factor)
        return FarField(self.field(distance), side, self._samples_per_spot)
