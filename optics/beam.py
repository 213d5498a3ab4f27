"""Compute the light along the axis, from the panel through the lens to the sensor and beyond.

A paraxial wave with a curvature spreads like the same wave without its curvature, over another
distance and stretched (Talanov 1970; Sziklas and Siegman, Applied Optics 14, 1874, 1975). Behind
a wave of vergence v,

    U(x, z) = 1 / m  P[z / m](x / m),  m = 1 + v z,

where P[z] is what the wave without its curvature becomes after z metres (thesis Eq. 2.12). The
curvatures of the object's wave and of the lens therefore need no samples, and the light in the
focus is no harder to compute than the light beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch

from optics.camera import Camera
from optics.camera.pupil import pupil_phase, require_valid_source
from optics.camera.stop_areas import coverage
from optics.plane import Plane
from optics.progress import Progress
from optics.propagation.fresnel_matrix import FresnelMatrices
from optics.propagation.span import FreeSpaceSpan
from optics.validation import accepts_numpy, require_finite, require_share

_TOL = 1e-3  # relative error of each propagation; far below what a picture shows
_MOST_STOP_SAMPLES = 2048  # across the stop; chosen
_LEAST_STRETCH = 1e-9  # of m; chosen: a picture doesn't show the difference from the focus, m = 0


@accepts_numpy
def beam_irradiance(
    camera: Camera,
    phase: torch.Tensor | None,
    distance: float,
    wavelength: float,
    depths: Sequence[float],
    sample_row: Plane,
    *,
    field: tuple[float, float] = (0.0, 0.0),
    unmodulated: float | None = None,
    progress: Progress | None = None,
) -> torch.Tensor:
    """Compute the irradiance on a line across the axis at each depth, (depths, columns).

    The light comes from one point. phase: radians on the panel's pixels; None is a constant.
    distance: metres from the object to the panel, inf allowed. depths: metres behind the panel,
    more than 0. sample_row: one row of samples, whose x is metres from the axis; at each depth the
    row has the y of the ray through the lens' centre. field: (y, x) metres on the sensor, the
    position of the point's image. unmodulated: share of light that ignores the phase; the panel's
    own share if None.

    Values are irradiances relative to that on the panel. They are meant for pictures: behind a
    stop that stands apart from the panel, the light is sampled about once per panel pixel, and
    the diffraction orders of the panel's pixel grid are left out. The model is the paraxial one
    of PSFOperator. Raises ValueError for invalid input, and Cancelled through `progress`.
    """
    require_valid_source(distance, wavelength)
    share = camera.panel.unmodulated if unmodulated is None else unmodulated
    require_share("unmodulated", share)
    if sample_row.shape[0] != 1:
        raise ValueError(f"sample_row has {sample_row.shape[0]} rows; give one")
    if not all(0 < depth < math.inf for depth in depths):
        raise ValueError(f"depths are {list(depths)} m; the light is behind the panel, at > 0 m")
    progress = progress or Progress()
    rays = _BeamPath(camera, distance, field, wavelength, sample_row)
    entering = _panel_fields(camera, phase)
    behind: torch.Tensor | None = None
    lines = []
    for number, depth in enumerate(depths):
        progress.report(number / len(depths), "the light along the axis")
        if depth <= camera.separation:
            wave = rays.field_before_lens(entering, depth)
        else:
            if behind is None:
                behind = rays.field_behind_stop(entering)
            wave = rays.field_behind_lens(behind, depth)
        light = wave.real**2 + wave.imag**2
        lines.append((1 - share) * light[0, 0] + share * light[-1, 0])
    return torch.stack(lines)


def _panel_fields(camera: Camera, phase: torch.Tensor | None) -> torch.Tensor:
    """Return the field on the panel with its pattern, and without it, (1 or 2, rows, columns).

    Without a pattern both are the same, and one is returned.
    """
    straight = torch.ones(camera.panel.shape, dtype=torch.complex64)
    if phase is None:
        return straight[None]
    if tuple(phase.shape) != camera.panel.shape:
        raise ValueError(f"phase is {tuple(phase.shape)}; the panel has {camera.panel.shape}")
    require_finite("phase", phase)
    turned = phase.detach().to(torch.float64).remainder(2 * math.pi).to(torch.float32)
    return torch.stack([torch.polar(straight.real, turned), straight])


_Cell = tuple[float, float] | None


class _BeamPath:
    """Propagates the beam along the paraxial rays of one object point.

    The wave is kept without its curvature and slope. Lengths are in metres.
    """

    def __init__(
        self,
        camera: Camera,
        distance: float,
        field: tuple[float, float],
        wavelength: float,
        sample_row: Plane,
    ) -> None:
        self._camera, self._distance = camera, distance
        self._wavelength, self._sample_row = wavelength, sample_row
        lens = camera.lens
        # Slopes (y, x) of the ray through the lens' centre, and of the ray through the panel's.
        self._chief_ray_slopes = [place / lens.image_distance for place in field]
        stretch = 1 + camera.separation / distance
        self._panel_ray_slopes = [slope * stretch for slope in self._chief_ray_slopes]
        self._vergence = 1 / (distance + camera.separation) - 1 / lens.focal_length
        # Where stop and panel coincide, the panel's pixels are the samples. Else the samples aren't
        # pixels: as squares they would make diffraction orders that no panel makes.
        self._pixel = (camera.panel.active_side, camera.panel.active_side)
        self._stop_plane = camera.panel.plane
        self._stop_cell: _Cell = None if camera.separation else self._pixel
        if camera.separation:
            count = math.ceil(lens.stop_diameter / (camera.panel.pitch * stretch)) + 2
            count = min(count, _MOST_STOP_SAMPLES)
            pitch = lens.stop_diameter / (count - 2)
            self._stop_plane = Plane((count, count), (pitch, pitch))

    def field_before_lens(self, entering: torch.Tensor, depth: float) -> torch.Tensor:
        """Compute the field between panel and lens, on the row of samples at a depth."""
        return self._field_in_front(entering, self._pixel, self._row_at(depth), depth)

    def _row_at(self, depth: float) -> Plane:
        """Return the row of samples, at the y of the ray through the lens' centre."""
        y = self._chief_ray_slopes[0] * (depth - self._camera.separation)
        return replace(self._sample_row, centre=(y, self._sample_row.centre[1]))

    def _field_in_front(
        self, wave: torch.Tensor, cell: _Cell, target: Plane, depth: float
    ) -> torch.Tensor:
        stretch, source = 1 + depth / self._distance, self._camera.panel.plane
        slopes = self._panel_ray_slopes
        return self._propagate(wave, source, cell, target, depth, stretch, slopes)

    def field_behind_stop(self, wave: torch.Tensor) -> torch.Tensor:
        """Compute the field just behind the lens, on the grid of its stop."""
        camera, lens, plane = self._camera, self._camera.lens, self._stop_plane
        if camera.separation:
            wave = self._field_in_front(wave, None, plane, camera.separation)
        radius = lens.stop_diameter / 2
        opened = coverage(lens.stop, radius, plane)
        # The vergence already holds the focus, so that only the aberrations are added here.
        flat = replace(lens, focus_distance=math.inf)
        y, x = (c / radius for c in plane.mesh())
        phase = pupil_phase(flat, math.inf, self._wavelength, y, x)
        return wave * torch.polar(opened, phase.expand(plane.shape).remainder(2 * math.pi))

    def field_behind_lens(self, wave: torch.Tensor, depth: float) -> torch.Tensor:
        """Compute the field behind the lens, on the row of samples at a depth."""
        way, slopes = depth - self._camera.separation, self._chief_ray_slopes
        stretch = 1 + self._vergence * way
        if abs(stretch) < _LEAST_STRETCH:
            stretch = _LEAST_STRETCH
        target = self._row_at(depth)
        return self._propagate(
            wave, self._stop_plane, self._stop_cell, target, way, stretch, slopes
        )

    def _propagate(
        self,
        wave: torch.Tensor,
        source: Plane,
        cell: _Cell,
        target: Plane,
        way: float,
        stretch: float,
        slopes: list[float],
    ) -> torch.Tensor:
        """Propagate a wave over a distance, to samples whose rays spread and move on that way.

        cell: the sides (y, x) of the squares that the source's samples stand for. With None the
        wave has only the frequencies that its samples resolve.
        """
        # In the coordinates of the wave without curvature, which rise from sample to sample:
        pitch = [p / abs(stretch) for p in target.pitch]
        centre = [(c - s * way) / stretch for c, s in zip(target.centre, slopes, strict=True)]
        if stretch < 0:
            # When an even number of samples is reversed, its origin moves by one sample.
            even = [1 - n % 2 for n in target.shape]
            centre = [c + e * p for c, e, p in zip(centre, even, pitch, strict=True)]
        plane = Plane(target.shape, (pitch[0], pitch[1]), (centre[0], centre[1]))
        span = FreeSpaceSpan(
            source, plane, way / stretch, self._wavelength, cells=cell, paraxial=True, tol=_TOL
        )
        answer = FresnelMatrices(span).forward(wave) / abs(stretch)
        # Beyond the focus the rays have crossed, so that the picture is inverted.
        return answer if stretch > 0 else answer.flip(-2, -1)
