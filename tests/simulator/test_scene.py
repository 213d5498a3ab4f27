import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from small_bench.world import CAMERA, NEUTRAL, WIDE_OPEN, light_of, ring_pattern, world

from optics.plane import Plane
from simulator.clock import VirtualClock
from simulator.scene import Dark, Flat, PhotographPrint, Scene, Star

PLANE = Plane((60, 62), (7e-6, 7e-6))


def picture_of(target, wavelength=550e-9) -> torch.Tensor:
    """Of a target on PLANE before any blur: radiance at a wavelength, (rows, columns)."""
    (layer,) = target.for_camera(CAMERA).layers
    scale = CAMERA.magnification(layer.distance)
    light = torch.zeros(PLANE.shape)
    for part in layer.parts:
        light += float(part.spectrum.at(wavelength)) * part.picture.light(PLANE, scale)
    return light


def test_the_photographs_colours_are_met_and_mixed():
    """Red, green and blue stand for 610, 540 and 450 nm; halfway between, the mean."""
    image = torch.tensor([0.2, 0.4, 0.8]).expand(2, 2, 3)
    photo = PhotographPrint(image, 2.0, 1.0, cover=5.0)
    expected = {610e-9: 0.2, 575e-9: 0.3, 540e-9: 0.4, 495e-9: 0.6, 450e-9: 0.8,
                400e-9: 0.8, 700e-9: 0.2}  # fmt: skip
    for wavelength, value in expected.items():
        assert float(picture_of(photo, wavelength)[30, 31]) == pytest.approx(value)


@pytest.mark.parametrize("size", [(20, 20), (200, 150), (7, 300)])
def test_a_print_covers_the_frame_by_its_cover(size):
    """A white print: samples of one inside, the frame times the cover on its scarcer side."""
    photo = PhotographPrint(torch.ones(*size, 3), 2.0, 1.0, cover=1.2)
    picture = picture_of(photo).numpy()
    frame = [n * 14e-6 / 7e-6 for n in CAMERA.sensor.shape]
    scale = 1.2 * max(f / n for f, n in zip(frame, size, strict=True))
    expected = [min(n * scale, m) for n, m in zip(size, PLANE.shape, strict=True)]
    inside = picture > 0.5
    assert inside.any(1).sum() == pytest.approx(expected[0], abs=1)
    assert inside.any(0).sum() == pytest.approx(expected[1], abs=1)
    assert np.allclose(picture[inside], 1, atol=1e-6)


def test_a_print_keeps_its_place_and_orientation():
    """One white corner pixel of a 2 x 2 print lights the same quarter of the plane."""
    image = torch.zeros(2, 2, 3)
    image[0, 1] = 1
    picture = picture_of(PhotographPrint(image, 2.0, 1.0, cover=1.0))
    quarters = [picture[:30, :31], picture[:30, 31:], picture[30:, :31], picture[30:, 31:]]
    assert int(torch.stack([q.sum() for q in quarters]).argmax()) == 1


def test_a_stars_samples_count_its_area():
    """pi/4 (diameter z / distance)² over the area of a sample; z for 2 m focus."""
    z = 1 / (1 / 0.125 - 1 / 2.0)
    expected = math.pi / 4 * (2e-3 * z / 4.0) ** 2 / (7e-6) ** 2
    assert float(picture_of(Star(2e-3, 4.0, 1.0)).sum()) == pytest.approx(expected)


def test_a_flat_field_gives_a_flat_picture():
    """Even where a pattern blurs it, and out of focus: there is nothing that could be blurred.

    Also at the borders, for the field has no end.
    """
    for distance, grey in ((2.0, NEUTRAL), (1.6, NEUTRAL), (2.0, ring_pattern(80e-6))):
        scene = Scene({"flat": Flat(distance, 1e7)})
        light = light_of(world(CAMERA, scene), grey, target="flat")
        assert light.min() > 0
        assert np.ptp(light) <= 1e-4 * light.mean()


def test_a_flat_field_is_as_bright_as_white_paper_of_its_radiance():
    """The camera equation written out, L A / z² on every pixel, in photons.

    Without gaps between the panel's pixels, only its edges send the paper's light beyond the
    rendered PSF: less than a per cent of it. Endless even light has it back from elsewhere.
    """
    camera = replace(WIDE_OPEN, panel=replace(WIDE_OPEN.panel, fill_factor=1.0))
    white = PhotographPrint(torch.ones(50, 50, 3), 2.0, 1e7, cover=20.0)
    scene = Scene({"flat": Flat(2.0, 1e7), "white": white})
    light = light_of(world(camera, scene), target="flat")
    # The panel, 48 x 64 pixels of 40 µm, is smaller than the stop.
    z = 1 / (1 / 0.125 - 1 / 2.0)
    # The integral over a Gaussian band of 7 nm at half maximum.
    band = 7e-9 * 0.5 * math.sqrt(math.pi / math.log(2))
    watts = 1e7 * band * (48 * 64 * 40e-6**2) / z**2 * 14e-6**2
    watts *= camera.panel.reflectivity * camera.transmission
    photons = watts * 550e-9 / (6.62607015e-34 * 299792458)
    assert light.mean() == pytest.approx(photons * camera.sensor.quantum_efficiency, rel=2e-3)
    paper = light_of(world(camera, scene), target="white")
    middle = (slice(15, 25), slice(15, 30))
    assert light[middle] == pytest.approx(paper[middle], rel=0.01)


def test_the_dark_sends_no_light():
    assert not picture_of(Dark()).any()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Scene({}), r"targets is empty; a scene needs at least one"),
        (lambda: Star(-1.0, 2.0, 1.0), r"diameter is -1 m; it must be positive"),
        (lambda: Star(1e-4, 0.0, 1.0), r"distance is 0 m; it must be positive"),
        (lambda: Star(1e-4, 2.0, -1.0), r"radiance is -1 .*negative"),
        (lambda: Star(1e-4, 2.0, math.nan), r"radiance is nan"),
        (lambda: Flat(0.0, 1.0), r"distance is 0 m; it must be positive"),
        (lambda: Flat(2.0, -1.0), r"radiance is -1 .*negative"),
        (lambda: Flat(2.0, math.inf), r"radiance is inf"),
        (lambda: PhotographPrint(torch.ones(2, 2, 3), -2.0, 1.0), r"distance is -2 m"),
        (lambda: PhotographPrint(torch.ones(2, 2, 3), 2.0, -1.0), r"radiance is -1"),
        (lambda: PhotographPrint(torch.ones(2, 2, 3), 2.0, 1.0, cover=0.0), r"cover is 0"),
        (lambda: PhotographPrint(torch.ones(2, 2), 2.0, 1.0), r"image is \(2, 2\).* 3"),
        (lambda: PhotographPrint(torch.ones(0, 2, 3), 2.0, 1.0), r"image is \(0, 2, 3\)"),
        (lambda: PhotographPrint(torch.full((2, 2, 3), math.nan), 2.0, 1.0), r"image has 12 NaN"),
    ],
)
def test_a_target_that_cannot_stand_there_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_the_virtual_clock_jumps_and_never_goes_back():
    clock = VirtualClock()
    assert clock.now() == 0
    clock.wait_until(5.0, lambda: False)
    assert clock.now() == 5.0
    clock.wait_until(3.0, lambda: False)
    assert clock.now() == 5.0
    clock.wait_until(9.0, lambda: True)
    assert clock.now() == 5.0
