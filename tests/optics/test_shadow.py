"""A panel apart from its lens: what the stop leaves of it, its lever, and the light behind it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import constants

from optics.camera import Camera, Lens, Panel
from optics.camera.pupil import (
    open_area,
    open_pupil_radius,
    panel_to_focus_distance,
    pupil_amplitude,
    share_through_stop,
    with_stop_shadow_on_panel,
)
from optics.camera.stop import Circle, Stop, regular_polygon
from optics.camera.system_mtf import electron_rate
from optics.retrieval.goal import design_plane, far_field_length

Z1 = 0.05
CAMERA = Camera(Panel((108, 192), 80e-6), Lens(0.1, 10.0, 2.0), separation=Z1)
NEAR = replace(CAMERA, separation=0.0)


def traced(camera: Camera, height: float, slope: float) -> tuple[float, float]:
    """Heights at lens and sensor of a ray that leaves the panel: free space, thin lens, free
    space, one after the other."""
    at_lens = height + camera.separation * slope
    behind = slope - at_lens / camera.lens.focal_length
    return at_lens, at_lens + camera.lens.image_distance * behind


@pytest.mark.parametrize("focus", [0.4, 2.0, math.inf])
def test_a_ray_at_the_shadows_rim_meets_the_stops(focus):
    camera = replace(CAMERA, lens=replace(CAMERA.lens, focus_distance=focus))
    rim = with_stop_shadow_on_panel(camera).lens.stop_diameter / 2
    slope = rim / (focus - Z1) if focus < math.inf else 0.0
    at_lens, at_sensor = traced(camera, rim, slope)
    assert at_lens == pytest.approx(camera.lens.stop_diameter / 2)
    # It comes from the axis in the plane in focus, and so goes to the axis on the sensor.
    assert at_sensor == pytest.approx(0, abs=1e-15)


def test_in_one_plane_there_is_no_other_shadow():
    assert with_stop_shadow_on_panel(NEAR) is NEAR
    assert panel_to_focus_distance(NEAR) == 2.0
    assert panel_to_focus_distance(CAMERA) == 2.0 - Z1
    assert (
        panel_to_focus_distance(replace(CAMERA, lens=replace(CAMERA.lens, focus_distance=math.inf)))
        == math.inf
    )


@pytest.mark.parametrize("separation", [0.15, 0.2])
def test_a_panel_in_the_plane_in_focus_is_refused(separation):
    camera = replace(NEAR, lens=Lens(0.1, 10.0, 0.15), separation=separation)
    for ask in (
        panel_to_focus_distance,
        with_stop_shadow_on_panel,
        lambda camera: design_plane(camera, 550e-9, (8, 8)),
    ):
        with pytest.raises(ValueError, match=f"separation is {separation:g} m; the panel must"):
            ask(camera)


def test_the_design_grid_lies_where_gratings_send_light():
    """The step of the far field is a grating of one wave in `length` pixels."""
    wavelength = 550e-9
    slope = wavelength / (far_field_length(CAMERA) * CAMERA.panel.pitch)
    _, straight = traced(CAMERA, 1e-3, 0.0)
    _, steered = traced(CAMERA, 1e-3, slope)
    pitch = design_plane(CAMERA, wavelength, (8, 8)).pitch[0]
    assert steered - straight == pytest.approx(pitch, rel=1e-9)
    assert pitch != pytest.approx(design_plane(NEAR, wavelength, (8, 8)).pitch[0], rel=1e-3)


def test_less_of_the_panel_is_open_than_the_stop_is_wide():
    camera, spread = replace(CAMERA, panel=Panel((150, 160), 80e-6)), 2.0 / (2.0 - Z1)
    area = float(pupil_amplitude(with_stop_shadow_on_panel(camera)).sum()) * 80e-6**2
    assert area == pytest.approx(math.pi * (5e-3 / spread) ** 2, rel=1e-9)
    assert open_pupil_radius(with_stop_shadow_on_panel(camera)) == pytest.approx(5e-3 / spread)


@pytest.mark.parametrize("distance", [0.5, 2.0, math.inf])
def test_light_through_a_panel_that_is_all_open_is_counted_by_its_cone(distance):
    """The flux of a patch of the object through the panel, over the area of the patch's image:
    L A / d² (d + z1)² / z2²."""
    panel = Panel((50, 60), 80e-6)
    camera = replace(CAMERA, panel=panel)
    z2 = camera.lens.image_distance
    seen = 1 / z2 if math.isinf(distance) else (distance + Z1) / distance / z2
    irradiance = 2.0 * 1e-8 * 50 * 60 * 80e-6**2 * seen**2
    electrons = irradiance * 0.6 * 0.6 * 550e-9 / (constants.h * constants.c) * 0.62
    assert electron_rate(camera, 2.0, 1e-8, 550e-9, distance) == pytest.approx(electrons)
    assert open_area(camera) == pytest.approx(50 * 60 * 80e-6**2)


@pytest.mark.parametrize("field", [(0.0, 0.0), (4e-3, -9e-3), (0.0, 30e-3), (0.1, 0.1)])
@pytest.mark.parametrize("distance", [0.3, math.inf])
def test_vignetting_is_the_share_of_rays_that_pass(field, distance):
    """Rays of a point from all over the panel, drawn on a lattice, to a stop with blades."""
    lens = Lens(0.1, 12.0, 2.0, Stop(regular_polygon(5, turn=0.3), (Circle(0.3),)))
    camera = Camera(Panel((50, 120), 80e-6), lens, separation=Z1)
    n, (rows, columns) = 10, camera.panel.shape
    y, x = (
        ((np.arange(n * count) + 0.5) / n - count // 2 - 0.5) * 80e-6 for count in (rows, columns)
    )
    stop = lens.stop_diameter / 2

    def passing(places):
        at = [place / stop for place in np.meshgrid(*places, indexing="ij")]
        return lens.stop.opening.contains(*at) & ~Circle(0.3).contains(*at)

    slopes = [f / lens.image_distance for f in field]
    # From the point, on the ray through the lens' middle, through the panel to the lens.
    ends = [
        p + Z1 * ((p + Z1 * s) / distance + s) if distance < math.inf else p + Z1 * s
        for p, s in zip((y, x), slopes, strict=True)
    ]
    share = passing(ends).sum() / passing((y, x)).sum()
    assert share_through_stop(camera, distance, field) == pytest.approx(share, abs=2e-3)


def test_without_a_separation_nothing_is_lost():
    assert share_through_stop(NEAR, 0.3, (0.02, 0.01)) == pytest.approx(1, abs=1e-12)


def test_in_one_plane_the_distance_does_not_matter_to_the_light():
    rates = [electron_rate(NEAR, 2.0, 1e-8, 550e-9, d) for d in (0.3, 2.0, math.inf)]
    assert rates == [electron_rate(NEAR, 2.0, 1e-8, 550e-9)] * 3
    for distance in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="distance is"):
            electron_rate(NEAR, 2.0, 1e-8, 550e-9, distance)


def test_a_point_beside_the_axis_is_imaged_by_the_chief_ray():
    """The ray through the middle of the lens goes straight on."""
    height, distance = 3e-3, 1.2
    slope = -height / (distance + Z1)
    _, at_sensor = traced(CAMERA, height + distance * slope, slope)
    assert CAMERA.magnification(distance) * height == pytest.approx(-at_sensor)
    assert np.isclose(NEAR.magnification(distance), NEAR.lens.image_distance / distance)
