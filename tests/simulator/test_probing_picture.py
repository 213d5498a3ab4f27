import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from optics.camera import Camera, Lens, Sensor
from optics.camera.system_mtf import electron_rate
from optics.light import Band, Spectrum, halogen
from optics.plane import Plane
from optics.sensor import Mosaic
from simulator.probing.picture_probe import MARGIN, PictureProbe, electron_rates
from simulator.probing.sampled_frequencies import RadialProfile
from simulator.scene import Cube, Dark, Flat, PhotographPrint, Sheet, Sheets, Star, UniformLight
from simulator.scene.pixel_picture import PixelPicture
from simulator.scene.polygons import Polygons, merge_pictures, rectangle

CAMERA = Camera(lens=Lens(focus_distance=2.0), sensor=Sensor(shape=(24, 30), pitch=5e-6))
NARROW = Band(550e-9, 1e-12, "open")


def probe(target, camera=CAMERA, band=NARROW):
    return PictureProbe(target.for_camera(camera), camera, band)


def test_a_narrow_bands_electrons_are_the_camera_equations():
    (rate,) = electron_rates(Spectrum.flat(3e8), NARROW, CAMERA, 1.7)
    assert rate == pytest.approx(electron_rate(CAMERA, 3e8, 1e-12, 550e-9, 1.7), rel=1e-6)
    apart = replace(CAMERA, separation=0.05)
    (rate,) = electron_rates(Spectrum.flat(3e8), NARROW, apart, 0.7)
    assert rate == pytest.approx(electron_rate(apart, 3e8, 1e-12, 550e-9, 0.7), rel=1e-6)


@pytest.mark.parametrize("shape", ["gaussian", "lyot", "interference", "open"])
def test_a_bands_electrons_are_the_sum_of_many_narrow_ones(shape):
    """Lamp, filter, leak, photons' energies and a sensor's curve, by a fine sum."""
    band = Band(600e-9, 20e-9, shape, leak=1e-3, leak_range=(450e-9, 700e-9))
    curve = Spectrum((400e-9, 500e-9, 680e-9), (0.2, 0.7, 0.1))
    camera = replace(CAMERA, sensor=replace(CAMERA.sensor, spectral_efficiency=curve))
    lamp = halogen().with_scale(2e8)
    x = np.linspace(400e-9, 680e-9, 560_001)
    one = electron_rate(CAMERA, 1.0, 1.0, 500e-9, 2.0) / 500e-9 / CAMERA.sensor.quantum_efficiency
    expected = (
        float(np.trapezoid(lamp.at(x) * band.total_transmission(x) * curve.at(x) * x, x)) * one
    )
    assert electron_rates(lamp, band, camera, 2.0)[0] == pytest.approx(expected, rel=5e-5)
    without = float(np.trapezoid(lamp.at(x) * band.transmission(x) * curve.at(x) * x, x)) * one
    (rate,) = electron_rates(lamp, band, camera, 2.0, leak=False)
    assert rate == pytest.approx(without, rel=5e-5)


def test_each_channel_has_its_own_electrons():
    curves = {"R": Spectrum.flat(0.4), "G": Spectrum.flat(0.6), "B": Spectrum.flat(0.0)}
    colour = replace(CAMERA.sensor, colour=Mosaic(("RG", "GB"), curves))
    rates = electron_rates(Spectrum.flat(1e8), NARROW, replace(CAMERA, sensor=colour), 2.0)
    whole = electron_rate(CAMERA, 1e8, 1e-12, 550e-9, 2.0) / CAMERA.sensor.quantum_efficiency
    assert rates == pytest.approx((0.4 * whole, 0.6 * whole, 0.0))


def test_a_stars_light_is_all_there():
    """Disc area times magnification squared times electrons a square metre."""
    star = probe(Star(3e-4, 2.0, 1e9))
    area = math.pi / 4 * (3e-4 * CAMERA.magnification(2.0)) ** 2
    electrons = electron_rate(CAMERA, 1e9, 1e-12, 550e-9, 2.0) * area
    assert star.total == pytest.approx(electrons, rel=1e-5)
    assert star.norm_bound == pytest.approx(float(star.sharp_picture.double().norm()), rel=1e-5)
    assert star.brightest == pytest.approx(float(star.sharp_picture.max()))
    assert not star.is_dark
    assert probe(Dark()).is_dark
    assert probe(Dark()).norm_bound == 0


def test_the_profiles_powers_add_up_to_the_pictures_squares():
    rng = np.random.default_rng(2)
    for shape in ((20, 24), (21, 25)):
        plane = Plane(shape, (5e-6, 4e-6))
        picture = torch.tensor(rng.normal(size=shape))
        profile = RadialProfile.of(torch.fft.rfft2(picture), plane)
        assert profile.norm == pytest.approx(float(picture.norm()))
        assert (profile.least <= profile.power * (1 + 1e-9)).all()


def test_a_filtered_picture_is_never_brighter_than_its_profile_says():
    """Any gain of the frequency; against the filtered picture itself."""
    rng = np.random.default_rng(3)
    plane = Plane((48, 40), (5e-6, 5e-6))
    picture = torch.tensor(rng.uniform(size=plane.shape)).cumsum(0)
    spectrum = torch.fft.rfft2(picture)
    profile = RadialProfile.of(spectrum, plane)
    fy = torch.fft.fftfreq(48, 5e-6, dtype=torch.float64)[:, None]
    fx = torch.fft.rfftfreq(40, 5e-6, dtype=torch.float64)
    for power in (0.5, 1.0, 3.0):

        def gain(k, power=power):
            return np.minimum((k / 2e4) ** power, 1.5)

        filtered = torch.fft.irfft2(
            spectrum * torch.tensor(gain(torch.hypot(fy, fx).numpy())), s=plane.shape
        )
        told = profile.filtered_norm_bound(gain)
        assert float(filtered.norm()) <= told <= 1.3 * float(filtered.norm()) + 1e-9


def sheets():
    near = Polygons((rectangle((0.0, -3e-4), (1e-3, 6e-4)),), (1.0,))
    grey = Spectrum.flat(0.5)
    return Sheets(
        (Sheet(1.5, ((grey, near),), near), Sheet(2.5, ((None, UniformLight()),), UniformLight())),
        1e8,
    )


def test_what_is_near_hides_what_is_far():
    found = probe(sheets())
    whole = electron_rate(CAMERA, 1e8, 1e-12, 550e-9, 2.5) * 25e-12
    picture = found.sharp_picture
    assert float(picture[0, 0]) == pytest.approx(whole, rel=1e-5)
    middle = picture[MARGIN + 12, MARGIN + 11]
    assert float(middle) == pytest.approx(0.5 * whole, rel=1e-5)
    assert found.brightest == pytest.approx(whole, rel=1e-5)
    assert found.brightest_behind(1) == pytest.approx(whole, rel=1e-5)
    # The perimeter of the near one, on the sensor.
    scale = CAMERA.magnification(1.5)
    assert found.edge_length == pytest.approx(2 * 1.6e-3 * scale, rel=0.02)
    assert found.distances == (1.5, 2.5)


def test_no_blur_makes_a_layered_picture_brighter_than_is_told():
    """Both layers and the cover blurred by different boxes."""
    found = probe(sheets())
    for reach in (1, 5, 20):

        def box(picture, reach=reach):
            kernel = torch.ones(1, 1, 2 * reach + 1, 2 * reach + 1) / (2 * reach + 1) ** 2
            return torch.nn.functional.conv2d(picture[None, None], kernel, padding=reach)[0, 0]

        near, far = found.lights
        seen = box(near) + (1 - box(found.covers[0])) * far
        assert float(seen.max()) <= found.brightest * (1 + 1e-5)
        inside = seen[MARGIN:-MARGIN, MARGIN:-MARGIN]
        assert float(inside.norm()) <= found.norm_bound * (1 + 1e-5)


def test_pictures_of_one_shape_are_drawn_as_one():
    rng = np.random.default_rng(0)
    photo = PhotographPrint(torch.tensor(rng.uniform(size=(6, 8, 3))), 2.0, 1e8).for_camera(CAMERA)
    cube = Cube(torch.tensor(rng.uniform(size=(6, 8, 4))), (4e-7, 5e-7, 6e-7, 7e-7), 2.0, 1e8)
    square = Polygons((rectangle((0, 0), (1e-3, 1e-3)),), (0.5,), 0.25)
    for target in (photo, cube.for_camera(CAMERA)):
        pairs = [(part.picture, k + 0.5) for k, part in enumerate(target.layers[0].parts)]
        pairs += [(square, 2.0), (UniformLight(), 0.0), (square, 1.0), (UniformLight(), 3.0)]
        plane, scale = CAMERA.sensor.plane, CAMERA.magnification(2.0)
        expected = sum(w * p.light(plane, scale) for p, w in pairs)
        few = merge_pictures(pairs)
        assert len(few) == 3
        drawn = sum(w * p.light(plane, scale) for p, w in few)
        assert drawn.numpy() == pytest.approx(expected.numpy(), rel=1e-5)
    assert not any(isinstance(p, PixelPicture) for p, _ in merge_pictures([(UniformLight(), 1.0)]))


def test_a_flat_fields_margins_are_in_it():
    found = probe(Flat(2.0, 1e8))
    assert found.plane.shape == (24 + 2 * MARGIN, 30 + 2 * MARGIN)
    rate = found.rates[0][0]
    assert found.total == pytest.approx(24 * 30 * rate, rel=1e-5)
    # In the frame alone, whatever is blurred into it.
    assert found.norm_bound == pytest.approx(rate * math.sqrt(24 * 30), rel=1e-5)
    assert found.power_spectrum.power[0] == pytest.approx(
        rate**2 * math.prod(found.plane.shape), rel=1e-5
    )


def test_a_star_beside_the_frame_may_still_be_seen():
    """Its blur may reach the frame: with all of its light on one pixel, at most."""
    inside, beside = probe(Star(3e-4, 2.0, 1e9)), probe(Star(3e-4, 2.0, 1e9, offset=(0.0, 0.1)))
    assert not beside.is_dark
    assert beside.total == 0
    assert beside.brightest == pytest.approx(inside.total, rel=1e-4)
    assert beside.norm_bound == pytest.approx(inside.total, rel=1e-4)
    assert beside.change_bound([lambda k: 0 * k]) >= inside.total
