"""A panel whose middle lies beside the lens' axis, against rays and a sum over its pixels."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import relative
from optical_situations import before_lens
from small_bench.world import CAMERA, NEUTRAL, WIDE_OPEN, light_of, world

from optics.camera.pupil import pupil_phase
from optics.camera.stop import Circle, Stop, regular_polygon
from optics.measuring.gratings import blazed_grating_phase
from optics.measuring.registration import register
from optics.measuring.spots import find_spot
from optics.plane import Plane
from optics.psf import PSFOperator
from optics.slm import phase_to_grey
from optics.zernike import zernike
from simulator.formation.rays import RayOperator
from simulator.mount import Mount, shift_aberrations
from simulator.scene import Scene, Star

WAVELENGTH = 550e-9
SHIFT = (0.11e-3, -0.19e-3)
MOUNTS = [
    Mount(shift=SHIFT),
    Mount(0.6, flip_x=True, shift=SHIFT),
    Mount(math.pi / 2, flip_y=True, shift=SHIFT),
]
ONLY_LIGHT = {"unmodulated light": False}


def landing(camera, distance: float, height: float) -> float:
    """Where a ray from the axis through a height of the panel meets the sensor, by steps."""
    slope = height / distance
    at_lens = height + camera.separation * slope
    slope -= at_lens / camera.lens.focal_length
    return at_lens + camera.lens.image_distance * slope


def centroid(light: np.ndarray) -> np.ndarray:
    """Of all light, in pixels from the middle."""
    index = np.mgrid[: light.shape[0], : light.shape[1]]
    middle = np.array([n // 2 for n in light.shape])
    return np.array([(i * light).sum() / light.sum() for i in index]) - middle


@pytest.mark.parametrize("mount", MOUNTS, ids=str)
def test_a_psf_out_of_focus_is_that_of_pixels_where_they_are(mount, rng):
    """The wave of the lens is taken where each pixel really lies; aberrations included."""
    lens = replace(WIDE_OPEN.lens, aberrations=((3, 1, 9e-8), (2, -2, 6e-8), (4, 0, 3e-8)))
    camera, distance, plane = replace(WIDE_OPEN, lens=lens), 1.5, Plane((60, 60), (12e-6, 12e-6))
    phase = rng.uniform(0, 1, camera.panel.shape)
    y, x = (camera.panel.plane.coordinates(axis).numpy() for axis in (0, 1))
    v, u = (plane.coordinates(axis).numpy() for axis in (0, 1))
    side = math.sqrt(camera.panel.fill_factor) * camera.panel.pitch
    scale, field = WAVELENGTH * lens.image_distance, np.zeros(plane.shape, dtype=complex)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    for dy, wy in zip(nodes * side / 2, weights / 2, strict=True):
        for dx, wx in zip(nodes * side / 2, weights / 2, strict=True):
            at = before_lens(mount, *np.broadcast_arrays((y + dy)[:, None], (x + dx)[None, :]))
            sy, sx = (torch.from_numpy(p / (lens.stop_diameter / 2)) for p in at)
            wave = pupil_phase(lens, distance, WAVELENGTH, sy, sx).numpy() + phase
            down = np.exp(-2j * np.pi / scale * np.outer(v, at[0].ravel()))
            along = np.exp(-2j * np.pi / scale * np.outer(at[1].ravel(), u))
            field += (down * (wy * wx * np.exp(1j * wave)).ravel()) @ along
    truth = np.abs(field) ** 2 * side**2 * plane.pitch[0] ** 2 / (scale**2 * phase.size)

    there = mount.plane_in_panel_axes(plane)
    moved = mount.image_shift_in_panel_axes(camera, distance)
    there = replace(there, centre=(-moved[0], -moved[1]))
    operator = PSFOperator(
        mount.camera_in_panel_axes(camera), distance, WAVELENGTH, there,
        integrate=False, unmodulated=0.0, tol=1e-6,
    )  # fmt: skip
    seen = mount.to_sensor_axes(operator(torch.from_numpy(phase)), plane).numpy()
    assert relative(seen, truth) <= 2e-5
    # The shift isn't too small to be missed.
    straight = PSFOperator(
        camera, distance, WAVELENGTH, plane, integrate=False, unmodulated=0.0, tol=1e-6
    )(torch.from_numpy(phase))
    assert relative(straight.numpy(), truth) > 0.2


@pytest.mark.parametrize("diffraction", [True, False])
def test_a_star_out_of_focus_moves_with_the_panel(diffraction):
    """By the ray through the panel's middle; in focus it stays."""
    scene = Scene({"near": Star(1e-6, 1.4, 1e12), "focus": Star(1e-6, 2.0, 1e12)})
    forced = ONLY_LIGHT | {"diffraction": diffraction}
    for target, distance in (("near", 1.4), ("focus", 2.0)):
        found = [
            centroid(light_of(world(WIDE_OPEN, scene, mount=one, forced=forced), target=target))
            for one in (Mount(shift=SHIFT), Mount())
        ]
        expected = [landing(WIDE_OPEN, distance, s) / WIDE_OPEN.sensor.pitch for s in SHIFT]
        assert np.allclose(found[0] - found[1], expected, atol=0.03)
    assert max(abs(landing(WIDE_OPEN, 1.4, s)) for s in SHIFT) > WIDE_OPEN.sensor.pitch / 4


@pytest.mark.parametrize("mount", MOUNTS, ids=str)
@pytest.mark.parametrize("distance", [1.4, 5.0])
def test_rays_land_with_the_panel_if_it_stands_apart(mount, distance):
    """Their centroid is that of the ray through the panel's middle, also off the axis."""
    # No stop cuts the light, which would move the centroid.
    lens = replace(WIDE_OPEN.lens, f_number=1.5)
    camera = replace(WIDE_OPEN, lens=lens, separation=0.08)
    plane, found = Plane((121, 121), (8e-6, 8e-6)), []
    middle = [(n % 2 - 1) / 2 * camera.panel.pitch for n in camera.panel.shape]
    for one in (mount, replace(mount, shift=(0.0, 0.0))):
        there, moved = (
            one.plane_in_panel_axes(plane),
            one.image_shift_in_panel_axes(camera, distance),
        )
        operator = RayOperator(
            one.camera_in_panel_axes(camera),
            distance,
            WAVELENGTH,
            replace(there, centre=(-moved[0], -moved[1])),
            one.place_in_panel_axes((0.3e-3, -0.5e-3), camera, distance),
        )
        seen = operator.straight()
        # All light is on the samples.
        assert float(seen.sum()) == pytest.approx(1.0, abs=1e-6)
        found.append(centroid(one.to_sensor_axes(seen, plane).numpy()) * plane.pitch[0])
        expected = [
            landing(camera, distance, place) for place in before_lens(one, *np.array(middle))
        ]
        # The ray through the middle of the lens is the place's own.
        chief = 0.08 * np.array([0.3e-3, -0.5e-3]) / lens.image_distance
        expected = np.array(expected) + [landing(camera, distance, c) for c in chief]
        assert np.allclose(found[-1], expected, atol=0.1e-6)
    assert np.abs(found[0] - found[1]).max() > 1e-6


def test_a_stop_cuts_another_part_of_a_shifted_panel():
    """A stop within the panel's short side: the light of the lens' axis is that of the stop."""
    side = min(CAMERA.panel.shape) * CAMERA.panel.pitch
    lens = replace(CAMERA.lens, f_number=CAMERA.lens.focal_length / (1.2 * side))
    camera = replace(CAMERA, lens=lens)
    half = [n * camera.panel.pitch / 2 for n in camera.panel.shape]
    points = np.random.default_rng(0).uniform(-1, 1, (2, 200_000))
    y, x = points[0] * half[0], points[1] * half[1]
    light = []
    for shift in ((0.0, 0.0), (0.0, 0.8 * half[1])):
        mount = Mount(shift=shift)
        stop = mount.camera_in_panel_axes(camera).lens.stop
        radius = mount.lens_in_panel_axes(lens).stop_diameter / 2
        open_ = stop.opening.contains(y / radius, x / radius)
        inside = np.hypot(y + shift[0], x + shift[1]) <= lens.stop_diameter / 2
        assert np.array_equal(open_, inside)
        scene = Scene({"star": Star(20e-6, 2.0, 1e12)})
        seen = light_of(world(camera, scene, mount=mount, forced=ONLY_LIGHT))
        light.append(seen.sum() / inside.mean())
    assert light[1] == pytest.approx(light[0], rel=0.02)


def test_shifted_zernike_polynomials_have_the_same_values_elsewhere(rng):
    terms = ((1, 1, 1.0), (2, 2, 0.5), (3, -3, 0.2), (4, 0, 0.7), (5, 1, 0.1), (6, -2, 0.3))
    y, x = (torch.from_numpy(one) for one in rng.uniform(-0.7, 0.7, (2, 50)))

    def path(some, y, x):
        return sum(a * zernike(n, m, y, x) for n, m, a in some)

    moved = path(terms, y + 0.07, x - 0.3)
    found = path(shift_aberrations(terms, 0.07, -0.3), y, x)
    assert float((found - moved).std()) <= 1e-12
    wider = path(shift_aberrations(terms, 0.07, -0.3, 1.4), y / 1.4, x / 1.4)
    assert float((wider - moved).std()) <= 1e-12
    assert shift_aberrations(terms, 0.0, 0.0) == terms
    assert shift_aberrations((), 0.1, 0.2) == ()


def test_a_stop_of_any_shape_is_shifted():
    stop = Stop(regular_polygon(5), (Circle(0.2, (0.1, 0.3)),))
    lens = replace(CAMERA.lens, stop=stop)
    seen = Mount(shift=SHIFT).lens_in_panel_axes(lens)
    own, other = lens.stop_diameter / 2, seen.stop_diameter / 2
    y, x = np.random.default_rng(1).uniform(-1, 1, (2, 300)) * own
    for here, there in zip(
        (seen.stop.opening, *seen.stop.obscurations),
        (stop.opening, *stop.obscurations),
        strict=True,
    ):
        expected = there.contains((y + SHIFT[0]) / own, (x + SHIFT[1]) / own)
        assert np.array_equal(here.contains(y / other, x / other), expected)


@pytest.mark.parametrize("distance", [1.5])
def test_a_registration_does_not_depend_on_the_shift(distance):
    """Gratings move the light by their vectors, wherever the panel stands."""
    vectors = np.array([(0.0, 0.0), (0.0, 0.12), (0.11, 0.0), (-0.08, 0.1), (0.05, -0.13)])
    scene = Scene({"star": Star(30e-6, distance, 1e12)})
    found = []
    for mount in (Mount(), Mount(shift=SHIFT)):
        bench, spots = world(CAMERA, scene, mount=mount, forced=ONLY_LIGHT), []
        for vector in vectors:
            phase = torch.from_numpy(blazed_grating_phase(CAMERA.panel.shape, vector))
            grey = phase_to_grey(CAMERA.panel, phase, WAVELENGTH).numpy()
            light = light_of(bench, grey)
            spots.append(find_spot(light, np.ones_like(light)))
        found.append(register(vectors, spots, WAVELENGTH))
    assert np.allclose(
        found[1].matrix, found[0].matrix, rtol=2e-3, atol=2e-3 * abs(found[0].matrix).max()
    )
    moved = np.array(found[1].centre) - np.array(found[0].centre)
    expected = [landing(CAMERA, distance, s) / CAMERA.sensor.pitch for s in SHIFT]
    assert np.allclose(moved, expected, atol=0.1)


def test_light_of_a_shifted_panel_is_bounded_by_its_reach():
    """What a shift moves out of a window counts as beyond it."""
    scene = Scene({"near": Star(1e-6, 1.4, 1e12)})
    bench = world(WIDE_OPEN, scene, mount=Mount(shift=SHIFT))
    bench.target = "near"
    expected = math.hypot(*(landing(WIDE_OPEN, 1.4, s) for s in SHIFT))
    assert bench.situation().image_shift == pytest.approx(expected, rel=1e-9)
    assert world().situation().image_shift == 0.0


@pytest.mark.parametrize("shift", [(math.nan, 0.0), (0.0, math.inf)])
def test_a_shift_that_is_none_is_refused(shift):
    with pytest.raises(ValueError, match=r"shift is .* m; give finite lengths"):
        Mount(shift=shift)


def test_a_shift_before_a_stigmatic_lens_is_refused():
    lens = replace(WIDE_OPEN.lens, kind="stigmatic")
    with pytest.raises(ValueError, match="the lens is stigmatic; a shift of the panel is known"):
        Mount(shift=SHIFT).lens_in_panel_axes(lens)
    assert Mount(0.1).lens_in_panel_axes(lens).kind == "stigmatic"
    assert np.array_equal(
        light_of(world(mount=Mount(shift=(0.0, 0.0)))), light_of(world(), NEUTRAL)
    )
