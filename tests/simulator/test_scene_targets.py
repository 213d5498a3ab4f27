import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from optics.camera import Camera, Lens, Sensor
from optics.light import Spectrum, Waveform, halogen
from optics.plane import Plane
from simulator.scene import (
    Cube,
    Dark,
    Display,
    Flat,
    PhotographPrint,
    Pinhole,
    Relief,
    Sheet,
    Sheets,
    Star,
    UniformLight,
    basis_of,
    display_primaries,
    distances_of,
    mix_reflectances,
    primaries,
)

CAMERA = Camera(lens=Lens(focus_distance=2.0), sensor=Sensor(shape=(40, 60), pitch=5e-6))
PLANE = Plane((60, 80), (5e-6, 5e-6))
SCALE = CAMERA.magnification(2.0)
RNG = np.random.default_rng(7)
IMAGE = torch.tensor(RNG.uniform(0, 1, (8, 12, 3)))


def seen(target, wavelength, camera=CAMERA, plane=PLANE):
    """Radiance on each sample, of a target of one layer."""
    (layer,) = target.for_camera(camera).layers
    scale = camera.magnification(layer.distance)
    return sum(
        float(part.spectrum.at(wavelength)) * part.picture.light(plane, scale).double()
        for part in layer.parts
    ).numpy()


def test_a_print_that_is_lit_anew_is_another_one():
    dim = PhotographPrint(IMAGE, 2.0, 3.0).for_camera(CAMERA)
    bright = replace(dim, radiance=6.0, side=None)
    assert bright.for_camera(CAMERA).radiance == 6.0
    np.testing.assert_allclose(seen(bright, 550e-9), 2 * seen(dim, 550e-9))


def test_every_target_has_its_radiance_in_the_light_of_its_lamp():
    lamp = halogen()
    for target in (
        Flat(2.0, 3.0, light=lamp),
        PhotographPrint(torch.ones(4, 4, 3), 2.0, 3.0, light=lamp),
        Cube(torch.ones(4, 4, 2), (4e-7, 7e-7), 2.0, 3.0, light=lamp),
        Star(1.0, 2.0, 3.0, light=lamp),
        Sheets((Sheet(2.0, ((None, UniformLight()),)),), 3.0, light=lamp),
    ):
        middle = seen(target, 500e-9)[30, 40] if not isinstance(target, Star) else 3.0 * float(
            target.layers[0].parts[0].spectrum.at(500e-9)
        ) / 3.0  # fmt: skip
        assert middle == pytest.approx(3.0 * float(lamp.at(500e-9)), rel=1e-4)
        assert target.distance == 2.0


def test_without_a_lamp_every_wavelength_is_alike():
    assert Flat(2.0, 3.0).layers[0].parts[0].spectrum.at([3e-7, 5.5e-7, 1.1e-6]).tolist() == [3] * 3
    assert Dark().layers[0].parts == ()


def test_a_photograph_is_as_its_reflectance_at_every_wavelength():
    photo = PhotographPrint(IMAGE, 2.0, 2.0)
    for wavelength in (430e-9, 500e-9, 575e-9, 650e-9):
        # Linear between what red, green and blue stand for.
        shares = [np.interp(wavelength * 1e9, (450, 540, 610), line) for line in np.eye(3)]
        reflected = IMAGE @ torch.tensor(shares[::-1], dtype=IMAGE.dtype)
        grey = PhotographPrint(reflected[..., None].expand(-1, -1, 3), 2.0, 2.0)
        assert seen(photo, wavelength) == pytest.approx(seen(grey, 540e-9), abs=1e-6)


def test_a_print_covers_the_frame_or_has_a_height():
    """Cover 1.2: the scarcer side is 1.2 frames. Height: of the object, times magnification."""
    white = torch.ones(10, 10, 3)
    by_cover = seen(PhotographPrint(white, 3.0, 1.0, cover=1.2), 550e-9)
    assert (by_cover[30] > 0.5).sum() == pytest.approx(1.2 * 60, abs=1)
    by_height = seen(PhotographPrint(white, 2.0, 1.0, height=1e-4 / SCALE), 550e-9)
    assert by_height.sum() == pytest.approx((1e-4 / 5e-6) ** 2, rel=1e-5)


def test_a_print_for_a_camera_is_one_object():
    photo = PhotographPrint(IMAGE, 2.0, 1.0)
    fitted = photo.for_camera(CAMERA)
    assert photo.for_camera(replace(CAMERA, transmission=0.1)) is fitted
    assert fitted.for_camera(CAMERA) is fitted
    assert photo.for_camera(replace(CAMERA, sensor=Sensor(shape=(80, 60)))) is not fitted
    with pytest.raises(ValueError, match="use for_camera"):
        _ = photo.layers


def test_a_cube_is_its_bands_and_between_them_linear():
    bands = np.linspace(450e-9, 650e-9, 9)
    cube = torch.tensor(np.abs(RNG.normal(size=(6, 9, 3))) @ np.abs(RNG.normal(size=(3, 9))))
    target = Cube(cube, tuple(bands), 2.0, 1.0)
    assert len(target.for_camera(CAMERA).layers[0].parts) <= 4
    for k in (0, 4, 8):
        grey = PhotographPrint(cube[..., k, None].expand(-1, -1, 3), 2.0, 1.0)
        assert seen(target, bands[k]) == pytest.approx(seen(grey, 540e-9), abs=1e-3)
    halfway = (seen(target, bands[3]) + seen(target, bands[4])) / 2
    assert seen(target, bands[3:5].mean()) == pytest.approx(halfway, abs=1e-6)
    assert seen(target, 300e-9) == pytest.approx(seen(target, bands[0]), abs=1e-6)


def test_a_cube_of_any_rank_keeps_its_tolerance():
    cube = torch.tensor(RNG.uniform(0, 1, (10, 10, 7)))
    bands = np.linspace(4e-7, 7e-7, 7)
    for tol in (0.3, 0.1, 1e-3, 0.0):
        target = Cube(cube, tuple(bands), 2.0, 1.0, tol=tol)
        again = sum(
            part.picture.image.double()[..., None] * torch.tensor(part.spectrum.at(bands))
            for part in target.for_camera(CAMERA).layers[0].parts
        )
        error = float((again - cube).norm() / cube.norm())
        assert error <= tol + 1e-6
    assert not seen(Cube(torch.zeros(4, 4, 2), (4e-7, 7e-7), 2.0, 1.0), 5e-7).any()


def test_colours_mix_to_one_reflectance():
    red, green, blue = primaries()
    assert mix_reflectances(primaries(), (0.2, 0.4, 0.8)).at(
        [450e-9, 540e-9, 610e-9]
    ) == pytest.approx([0.8, 0.4, 0.2])
    assert basis_of(red, green, blue) == (red, green, blue)
    short = Spectrum((5e-7, 6e-7), (0.2, 0.3))
    assert basis_of(short, short, short)[1].at([3e-7, 5.5e-7, 1e-6]) == pytest.approx(
        [0.2, 0.25, 0.3]
    )


def test_distances_follow_from_a_stereo_pair():
    """Baseline 193 mm, 994.978 px, 31.086 px: at 20 px 193e-3 x 994.978 / 51.086 = 3.7590 m."""
    depths = distances_of(np.array([20.0, np.nan]), 0.193001, 994.978, 31.086)
    assert depths[0] == pytest.approx(3.75899, rel=1e-5)
    assert np.isnan(depths[1])


def relief(**more):
    """Something near on the left of something far, and a hole of unknown depth in it."""
    depths = torch.full((20, 30), 4.0)
    depths[:, :10] = 1.0
    depths[5, 20] = math.nan
    image = torch.zeros(20, 30, 3)
    image[:, :10, 0] = 1.0
    image[:, 10:, 1] = torch.linspace(0.2, 0.8, 20)
    return Relief(image, depths, 1.0, height=1.0, **more)


def test_a_relief_hides_and_shows_and_fills_what_is_hidden():
    near, far = relief(levels=4).layers
    # In the middles of the outermost of four steps of 1/d from 1/4 to 1.
    assert near.distance == pytest.approx(1 / (1 - 0.75 / 8))
    assert far.distance == pytest.approx(1 / (0.25 + 0.75 / 8))
    plane = Plane((20, 30), (1.0 / 20, 1.0 / 20), (1.0 / 40, 1.0 / 40))
    assert near.cover.light(plane, 1.0)[:, :9].min() > 0.99
    assert near.cover.light(plane, 1.0)[:, 11:].max() == 0
    # The far layer goes on behind the near one, in the colours of its rim.
    assert far.cover.light(plane, 1.0).min() > 0.99
    green = far.parts[1].picture.light(plane, 1.0)
    assert green[:, 2:9].numpy() == pytest.approx(0.2, abs=1e-6)
    assert green[:, -1].numpy() == pytest.approx(0.8, abs=0.02)


def test_a_relief_of_one_depth_is_a_photograph():
    flat = Relief(IMAGE, torch.full((8, 12), 2.0), 1.5, cover=1.3)
    photo = PhotographPrint(IMAGE, 2.0, 1.5, cover=1.3)
    assert seen(flat, 550e-9) == pytest.approx(seen(photo, 550e-9))


def test_no_light_is_lost_where_sharp_layers_of_a_relief_meet():
    """Back to front each hides what is behind it: of a white one all must stay white."""
    steps = torch.ones(8, 12)
    steps[:, 3:7], steps[4:, 7:] = 2.0, 4.0
    target = Relief(torch.ones(8, 12, 3), steps, 1.0, levels=5, height=1.0)
    assert len(target.layers) == 3
    plane = Plane((24, 36), (1 / 24, 1 / 24), (1 / 48, 1 / 48))
    light = torch.zeros(24, 36)
    for layer in reversed(target.layers):
        hidden = layer.cover.light(plane, 1.0)
        light = light * (1 - hidden) + layer.parts[1].picture.light(plane, 1.0)
    assert light.numpy() == pytest.approx(1.0, abs=1e-5)


def test_a_display_shines_in_its_primaries():
    image = torch.zeros(4, 6, 3)
    image[..., 2] = 0.5
    target = Display(image, 2e-4, 2.0, 4.0, display_primaries(), fill=0.8, polarisation_angle=0.3)
    blue = seen(target, 455e-9)
    # Half of 4 in a window of 0.8 x 0.8 / 3 of each pixel.
    assert blue.mean() * 60 * 80 * 25e-12 == pytest.approx(
        0.5 * 4.0 * 0.64 / 3 * 24 * (2e-4 * SCALE) ** 2, rel=1e-3
    )
    assert seen(target, 610e-9).max() < 1e-6 * blue.max()
    assert target.size == pytest.approx((8e-4, 12e-4))
    assert target.polarisation_angle == 0.3


def test_sheets_keep_their_order_and_covers():
    sheets = Sheets((Sheet(1.0, (), UniformLight()), Sheet(2.0, ((None, UniformLight()),))), 1.0)
    assert [layer.distance for layer in sheets.layers] == [1.0, 2.0]
    assert sheets.layers[0].cover == UniformLight()
    assert sheets.distance == 1.0


def test_anything_may_move_or_be_polarised():
    moving = replace(Pinhole(), velocity=(0.0, 0.03), lamp=Waveform("sine", 100.0, 0.1))
    assert moving.is_moving
    assert not Pinhole().is_moving
    assert moving.layers[0].parts[0].picture == Pinhole().layers[0].parts[0].picture


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Flat(2.0, 1.0, velocity=(math.nan, 0.0)), "velocity is"),
        (lambda: Flat(2.0, 1.0, polarisation_angle=math.inf), "polarisation_angle is inf"),
        (lambda: PhotographPrint(IMAGE, 2.0, 1.0, height=0.0), "height is 0 m"),
        (lambda: Cube(torch.ones(2, 2, 3), (5e-7, 6e-7), 2.0, 1.0), "3 bands and 2 wavelengths"),
        (lambda: Cube(-torch.ones(2, 2, 2), (5e-7, 6e-7), 2.0, 1.0), "reflectances down to -1"),
        (lambda: Cube(torch.ones(2, 2, 2), (6e-7, 5e-7), 2.0, 1.0), "don't rise"),
        (lambda: Cube(torch.ones(2, 2), (6e-7, 5e-7), 2.0, 1.0), r"image is \(2, 2\)"),
        (lambda: Cube(torch.ones(2, 2, 2), (5e-7, 6e-7), 2.0, 1.0, tol=1.0), "tol is 1"),
        (lambda: Relief(IMAGE, torch.ones(2, 2), 1.0), "depths is"),
        (lambda: Relief(IMAGE, torch.full((8, 12), math.nan), 1.0), "known somewhere"),
        (lambda: Relief(IMAGE, -torch.ones(8, 12), 1.0), "positive and finite"),
        (lambda: Relief(IMAGE, torch.ones(8, 12), 1.0, levels=0), "levels is 0"),
        (lambda: distances_of(np.array([1.0, -2.0]), 0.1, 100.0), "come to -2 pixels"),
        (lambda: distances_of(np.array([1.0]), 0.0, 100.0), "baseline is 0 m"),
        (lambda: Sheets((), 1.0), "sheets is empty"),
        (lambda: Sheets((Sheet(2.0, ()), Sheet(1.0, ())), 1.0), "the nearest first"),
        (lambda: Sheet(0.0, ()), "distance is 0 m"),
        (lambda: Display(IMAGE, 0.0, 2.0, 1.0, primaries()), "pitch is 0 m"),
        (lambda: Display(IMAGE, 1e-4, 2.0, 1.0, primaries(), fill=0.0), "fill is 0"),
        (lambda: Display(IMAGE, 1e-4, 2.0, 1.0, primaries(), light=halogen()), "by itself"),
        (lambda: mix_reflectances(primaries(), (1.0, 2.0, 0.0)), "colour is"),
        (lambda: basis_of(*[Spectrum.flat(0.5)] * 3), "adds up to 1.5"),
    ],
)
def test_a_target_that_cannot_be_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
