"""A panel that is turned or mirrored before the sensor, against sums over its turned pixels."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import relative
from small_bench.world import CAMERA, NEUTRAL, WIDE_OPEN, light_of, ring_pattern, world
from sweeps import some

import simulator.mount
from optics.camera import Lens
from optics.camera.pupil import pupil_phase
from optics.camera.stop import Circle, Polygon, Stop, regular_polygon
from optics.patterns import steering_grating
from optics.plane import Plane
from optics.psf import PSFOperator
from optics.slm import phase_to_grey
from optics.zernike import zernike
from simulator.mount import Mount
from simulator.scene import Dark, PhotographPrint, Scene, Star

WAVELENGTH = 550e-9
MOUNTS = [
    Mount(0.03),
    Mount(-1.9),
    Mount(math.pi / 4, flip_y=True),
    Mount(2.4, flip_x=True, flip_y=True),
    Mount(math.pi / 2),
    Mount(math.pi),
    Mount(-math.pi / 2, flip_x=True),
    Mount(flip_x=True),
    Mount(flip_y=True),
]


def turned(mount: Mount, y, x):
    """Where a point of the panel's axes lies before the sensor: mirrored, then turned."""
    y, x = (-y if mount.flip_y else y), (-x if mount.flip_x else x)
    c, s = math.cos(mount.rotation), math.sin(mount.rotation)
    return x * s + y * c, x * c - y * s


def turned_psf(lens: Lens, phase, mount: Mount, plane: Plane, nodes: int = 1):
    """The sum over nodes inside every panel pixel, one after the other, each where it really is.

    The panel is WIDE_OPEN's, without a stop. The lens' wave lies in the sensor's axes.
    """
    panel, scale = CAMERA.panel, WAVELENGTH * lens.image_distance
    side = math.sqrt(panel.fill_factor) * panel.pitch
    inner, weight = np.polynomial.legendre.leggauss(nodes)
    y, x = (panel.plane.coordinates(axis).numpy() for axis in (0, 1))
    v, u = (plane.coordinates(axis).numpy() for axis in (0, 1))
    field = np.zeros(plane.shape, dtype=complex)
    for dy, wy in zip(inner * side / 2, weight / 2, strict=True):
        for dx, wx in zip(inner * side / 2, weight / 2, strict=True):
            at = turned(mount, *np.broadcast_arrays((y + dy)[:, None], (x + dx)[None, :]))
            sy, sx = (torch.from_numpy(p / (lens.stop_diameter / 2)) for p in at)
            wave = pupil_phase(lens, 2.0, WAVELENGTH, sy, sx).numpy() + phase
            amplitude = (wy * wx * np.exp(1j * wave)).ravel()
            down = np.exp(-2j * np.pi / scale * np.outer(v, at[0].ravel()))
            along = np.exp(-2j * np.pi / scale * np.outer(at[1].ravel(), u))
            field += (down * amplitude) @ along
    light = np.abs(field) ** 2
    if nodes == 1:
        # The square of a pixel turns, too: its spectrum lies along the panel's axes.
        along = turned(Mount(mount.rotation), np.zeros(1), np.ones(1))
        across = turned(Mount(mount.rotation), np.ones(1), np.zeros(1))
        for ay, ax in (along, across):
            light *= np.sinc((v[:, None] * ay + u[None, :] * ax) * side / scale) ** 2
    return light * side**2 * plane.pitch[0] * plane.pitch[1] / (scale**2 * phase.size)


def seen(lens: Lens, phase, mount: Mount, plane: Plane):
    """The same by the panel's PSF operator and the mount."""
    camera = replace(WIDE_OPEN, lens=mount.lens_in_panel_axes(lens))
    operator = PSFOperator(
        camera,
        2.0,
        WAVELENGTH,
        mount.plane_in_panel_axes(plane),
        integrate=False,
        unmodulated=0.0,
        tol=1e-6,
    )
    return mount.to_sensor_axes(operator(torch.from_numpy(phase)), plane).numpy()


@pytest.mark.parametrize("mount", MOUNTS, ids=str)
@pytest.mark.parametrize(
    ("side", "pitch"), [pytest.param(60, 12e-6, marks=pytest.mark.sweep), (57, 13.6e-6)]
)
def test_a_psf_turns_with_the_panel(mount, side, pitch, rng):
    """Also one that fills its window, with hardly more samples than it needs: 14.3 µm apart."""
    plane = Plane((side, side), (pitch, pitch))
    spread = rng.uniform(0, 2 * np.pi, CAMERA.panel.shape)
    for phase in (spread, np.zeros(CAMERA.panel.shape)):
        truth = turned_psf(WIDE_OPEN.lens, phase, mount, plane)
        assert relative(seen(WIDE_OPEN.lens, phase, mount, plane), truth) <= 1e-5


@pytest.mark.parametrize(
    "mount",
    [
        pytest.param(MOUNTS[1], marks=pytest.mark.sweep),
        MOUNTS[2],
        pytest.param(MOUNTS[6], marks=pytest.mark.sweep),
    ],
    ids=str,
)
def test_the_lens_aberrations_stay_with_the_sensor(mount, rng):
    lens = replace(WIDE_OPEN.lens, aberrations=((3, 1, 9e-7), (2, -2, 6e-7), (4, 0, 3e-7)))
    plane, phase = Plane((60, 60), (12e-6, 12e-6)), rng.uniform(0, 1, CAMERA.panel.shape)
    truth = turned_psf(lens, phase, mount, plane, nodes=3)
    assert relative(seen(lens, phase, mount, plane), truth) <= 2e-5
    # They aren't too weak to be missed.
    assert relative(seen(WIDE_OPEN.lens, phase, mount, plane), truth) > 0.1


@pytest.mark.parametrize("mount", MOUNTS, ids=str)
def test_a_lens_in_the_panels_axes_is_the_same_lens(mount, rng):
    """Its path and stop at a point of the panel are its own where that point lies before it."""
    y, x = rng.uniform(-0.7, 0.7, (2, 50))
    terms = ((1, 1, 1e-6), (1, -1, -3e-7), (2, 2, 5e-7), (3, -3, 2e-7), (4, 0, 7e-7), (5, 1, 1e-7))
    stop = Stop(regular_polygon(5), (Circle(0.2, (0.1, 0.3)),))
    lens = mount.lens_in_panel_axes(replace(CAMERA.lens, aberrations=terms, stop=stop))

    def path(terms, y, x):
        return sum(a * zernike(n, m, y, x) for n, m, a in terms)

    there = turned(mount, y, x)
    assert np.allclose(path(lens.aberrations, y, x), path(terms, *there), rtol=0, atol=1e-18)
    for here, before in zip(
        (lens.stop.opening, *lens.stop.obscurations),
        (stop.opening, *stop.obscurations),
        strict=True,
    ):
        assert np.array_equal(here.contains(y, x), before.contains(*there))
    assert isinstance(lens.stop.opening, Polygon)


@pytest.mark.parametrize("mount", some(MOUNTS, 0, 1, 3, 5), ids=str)
def test_a_pattern_sends_light_where_the_panel_points(mount):
    """A star's light is steered by a vector that turns with the panel, to a tenth of a pixel."""
    shift = (60e-6, 170e-6)
    camera = WIDE_OPEN
    phase = steering_grating(camera.panel, shift, camera.lens.image_distance, WAVELENGTH)
    grey = phase_to_grey(camera.panel, phase, WAVELENGTH).numpy()
    scene = Scene({"star": Star(1e-6, 2.0, 1e12)})
    light = light_of(world(camera, scene, mount=mount, forced={"unmodulated light": False}), grey)
    expected = np.array(turned(mount, *shift)) / camera.sensor.pitch
    peak = np.unravel_index(light.argmax(), light.shape)
    near = tuple(slice(p - 3, p + 4) for p in peak)
    index = np.mgrid[: light.shape[0], : light.shape[1]]
    centroid = [float((i[near] * light[near]).sum() / light[near].sum()) for i in index]
    middle = [n // 2 for n in light.shape]
    assert np.allclose(np.array(centroid) - middle, expected, atol=0.1)


def test_the_scene_is_not_turned():
    """A print that is bright on the left stays so: only what the panel does turns."""
    image = torch.zeros(40, 40, 3)
    image[:, :20] = 1
    scene = Scene({"print": PhotographPrint(image, 2.0, 1e7)})
    turned_, straight = (
        light_of(world(WIDE_OPEN, scene, mount=mount), target="print")
        for mount in (Mount(math.pi / 2, flip_x=True), None)
    )
    assert relative(turned_, straight) < 0.05
    assert straight[:, :15].mean() > 10 * straight[:, -15:].mean()


def test_a_world_with_a_turned_panel_is_bright_as_before():
    straight, turned_ = (
        light_of(world(mount=mount), ring_pattern(80e-6)) for mount in (None, Mount(0.4))
    )
    assert turned_.sum() == pytest.approx(straight.sum(), rel=0.02)
    assert relative(turned_, straight) > 0.05


def test_a_panel_that_is_aligned_costs_nothing(monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("called for nothing")

    for name in ("lens_in_panel_axes", "plane_in_panel_axes", "to_sensor_axes"):
        monkeypatch.setattr(simulator.mount.Mount, name, never)
    expected = light_of(world())
    for mount in (None, Mount(), Mount(2 * math.pi)):
        assert np.array_equal(light_of(world(mount=mount), NEUTRAL), expected)


@pytest.mark.parametrize("mount", [Mount(math.pi / 2), Mount(flip_y=True)], ids=str)
def test_whole_samples_need_no_transform(monkeypatch, mount):
    def never(*args, **kwargs):
        raise AssertionError("called for nothing")

    monkeypatch.setattr(simulator.mount, "NonuniformTransform", never)
    light_of(world(mount=mount))


def test_the_same_mount_gives_the_same_picture():
    first, again = (light_of(world(mount=Mount(0.3)), ring_pattern(90e-6)) for _ in range(2))
    assert np.array_equal(first, again)


@pytest.mark.parametrize("rotation", [math.nan, math.inf])
def test_a_rotation_that_is_none_is_refused(rotation):
    with pytest.raises(ValueError, match=r"rotation is .* rad; it must be finite"):
        Mount(rotation)


# A star off the axis.


@pytest.mark.parametrize("offset", [(0.0, 3e-3), (-1.1e-3, 2.03e-3), (1e-4, -1.7e-4)])
def test_a_star_off_the_axis_is_imaged_off_the_axis(offset):
    """At the offset times image over object distance: the same light, moved."""
    scene = Scene({"here": Star(20e-6, 2.0, 2e12), "there": Star(20e-6, 2.0, 2e12, offset)})
    camera = replace(WIDE_OPEN, sensor=replace(WIDE_OPEN.sensor, shape=(60, 70)))
    here, there = (light_of(world(camera, scene), target=name) for name in scene.targets)
    z = camera.lens.image_distance
    move = np.array(offset) * z / 2.0 / camera.sensor.pitch
    index = np.mgrid[:60, :70]

    def centroid(light):
        peak = np.unravel_index(light.argmax(), light.shape)
        near = tuple(slice(p - 4, p + 5) for p in peak)
        return np.array([(i[near] * light[near]).sum() / light[near].sum() for i in index])

    assert np.allclose(centroid(there) - centroid(here), move, atol=0.06)


def test_a_star_moved_by_whole_pixels_is_the_same_picture_moved():
    z = CAMERA.lens.image_distance
    offset = (5 * 14e-6 * 2.0 / z, -4 * 14e-6 * 2.0 / z)
    scene = Scene({"here": Star(20e-6, 2.0, 2e12), "there": Star(20e-6, 2.0, 2e12, offset)})
    here, there = (light_of(world(CAMERA, scene), target=name) for name in scene.targets)
    # Each has a plan of its own: both keep within the default tolerance.
    assert relative(there[10:35, 5:35], here[5:30, 9:39]) <= 1e-3


@pytest.mark.parametrize("metres", [0.5, -0.5, 30.0])
def test_a_star_far_beyond_the_frame_sends_no_light_into_it(metres):
    scene = Scene({"star": Star(20e-6, 2.0, 2e12, (0.0, metres)), "dark": Dark()})
    light = light_of(world(CAMERA, scene))
    assert not light.any()


def test_an_offset_that_is_none_is_refused():
    with pytest.raises(ValueError, match=r"offset is \(0.0, nan\) m; it must be finite"):
        Star(1e-5, 2.0, 1.0, (0.0, math.nan))
