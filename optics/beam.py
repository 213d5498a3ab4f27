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
from dataclasses import dataclass, replace

import torch

from optics.camera import Camera
from optics.camera.pupil import pupil_phase, require_valid_source
from optics.camera.stop_areas import coverage
from optics.plane import Plane
from optics.progress import Progress
from optics.propagation.fresnel_matrix import FresnelMatrices
from optics.propagation.span import FreeSpaceSpan
from optics.validation import accepts_numpy, require_finite, require_share


@dataclass(frozen=True)
class BeamSettings:
    """Tune how finely the beam is computed.

    tol: relative error allowed for each propagation; far below what a picture shows.
    max_stop_samples: largest number of samples across the stop; chosen.
    min_stretch: smallest value of the stretch m; chosen so small that a picture doesn't show the
        difference from the focus, where m is 0.
    """

    tol: float = 1e-3
    max_stop_samples: int = 2048
    min_stretch: float = 1e-9


_SETTINGS = BeamSettings()


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
    rays = _BeamPath(camera, distance, field)
    entering = _panel_fields(camera, phase)
    behind: torch.Tensor | None = None
    lines = []
    for number, depth in enumerate(depths):
        progress.report(number / len(depths), "the light along the axis")
        if depth <= camera.separation:
            wave = rays.field_before_lens(entering, depth, sample_row, wavelength)
        else:
            if behind is None:
                behind = rays.field_behind_stop(entering, wavelength)
            wave = rays.field_behind_lens(behind, depth, sample_row, wavelength)
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


class _BeamPath:
    """Propagate the beam along the paraxial rays of one object point.

    The wave is kept without its curvature. Lengths are in metres.
    """

    def __init__(self, camera: Camera, distance: float, field: tuple[float, float]) -> None:
        self._camera, self._distance = camera, distance
        lens = camera.lens
        # Slopes (y, x) of the ray through the lens' centre, and of the ray through the panel's.
        self._chief_ray_slopes = [place / lens.image_distance for place in field]
        stretch = 1 + camera.separation / distance
        self._panel_ray_slopes = [slope * stretch for slope in self._chief_ray_slopes]
        self._vergence = 1 / (distance + camera.separation) - 1 / lens.focal_length
        count = math.ceil(lens.stop_diameter / (camera.panel.pitch * stretch)) + 2
        count = min(count, _SETTINGS.max_stop_samples)
        pitch = lens.stop_diameter / (count - 2)
        self.stop_plane = Plane((count, count), (pitch, pitch))

    def _row_at_depth(self, across: Plane, depth: float) -> Plane:
        """Return the row of samples at a depth, at the y of the ray through the lens' centre."""
        y = self._chief_ray_slopes[0] * (depth - self._camera.separation)
        return replace(across, centre=(y, across.centre[1]))

    def field_before_lens(
        self, entering: torch.Tensor, depth: float, across: Plane, wavelength: float
    ) -> torch.Tensor:
        """Compute the field between panel and lens, on a row of samples."""
        panel = self._camera.panel
        cells = (panel.active_side, panel.active_side)
        target = self._row_at_depth(across, depth)
        return _propagate_flat_wave(
            entering, panel.plane, cells, target, self._step_to_depth(depth), wavelength
        )

    def _step_to_depth(self, depth: float) -> _PropagationStep:
        """Return the step from the panel to a plane before the lens."""
        moved = [slope * depth for slope in self._panel_ray_slopes]
        return _PropagationStep(depth, 1 + depth / self._distance, (moved[0], moved[1]))

    def field_behind_stop(self, entering: torch.Tensor, wavelength: float) -> torch.Tensor:
        """Compute the field just behind the lens, on the grid of its stop."""
        camera, lens = self._camera, self._camera.lens
        if camera.separation:
            way = self._step_to_depth(camera.separation)
            wave = _propagate_flat_wave(
                entering, camera.panel.plane, None, self.stop_plane, way, wavelength
            )
        else:
            self.stop_plane = camera.panel.plane
            wave = entering
        radius = lens.stop_diameter / 2
        opened = coverage(lens.stop, radius, self.stop_plane)
        # The vergence already holds the focus, so that only the aberrations are added here.
        flat = replace(lens, focus_distance=math.inf)
        y, x = (c / radius for c in self.stop_plane.mesh())
        phase = pupil_phase(flat, math.inf, wavelength, y, x)
        return wave * torch.polar(
            opened, phase.expand(self.stop_plane.shape).remainder(2 * math.pi)
        )

    def field_behind_lens(
        self, wave: torch.Tensor, depth: float, across: Plane, wavelength: float
    ) -> torch.Tensor:
        """Compute the field behind the lens, on the row of samples at a depth."""
        way = depth - self._camera.separation
        stretch = 1 + self._vergence * way
        if abs(stretch) < _SETTINGS.min_stretch:
            stretch = _SETTINGS.min_stretch
        moved = [slope * way for slope in self._chief_ray_slopes]
        side = self._camera.panel.active_side
        # The stop's samples aren't pixels. As squares they would make diffraction orders that
        # no panel makes.
        cells = None if self._camera.separation else (side, side)
        place = _PropagationStep(way, stretch, (moved[0], moved[1]))
        return _propagate_flat_wave(
            wave, self.stop_plane, cells, self._row_at_depth(across, depth), place, wavelength
        )


@dataclass(frozen=True)
class _PropagationStep:
    """One step through free space.

    distance: metres along the axis.
    stretch: factor by which the rays spread over that distance.
    displacement: metres along (y, x) by which the rays' slope moves them.
    """

    distance: float
    stretch: float
    displacement: tuple[float, float]


def _propagate_flat_wave(
    wave: torch.Tensor,
    source: Plane,
    cells: tuple[float, float] | None,
    target: Plane,
    step: _PropagationStep,
    wavelength: float,
) -> torch.Tensor:
    """Propagate a wave without its curvature and slope by one step, to the target's samples.

    cells: the sides (y, x) of the squares that the samples stand for, in metres. With None the wave
    has only the frequencies that its samples resolve.
    """
    plane = _scaled_target_plane(target, step)
    distance = step.distance / step.stretch
    span = FreeSpaceSpan(
        source, plane, distance, wavelength, cells=cells, paraxial=True, tol=_SETTINGS.tol
    )
    answer = FresnelMatrices(span).forward(wave) / abs(step.stretch)
    # Beyond the focus the rays have crossed, so that the picture is inverted.
    return answer if step.stretch > 0 else answer.flip(-2, -1)


def _scaled_target_plane(target: Plane, step: _PropagationStep) -> Plane:
    """Return the target plane in the coordinates of the wave without curvature.

    The coordinates rise from sample to sample.
    """
    pitch = [p / abs(step.stretch) for p in target.pitch]
    centre = [(c - m) / step.stretch for c, m in zip(target.centre, step.displacement, strict=True)]
    if step.stretch < 0:
        # When an even number of samples is reversed, its origin moves by one sample.
        even = [1 - n % 2 for n in target.shape]
        centre = [c + e * p for c, e, p in zip(centre, even, pitch, strict=True)]
    return Plane(target.shape, (pitch[0], pitch[1]), (centre[0], centre[1]))
