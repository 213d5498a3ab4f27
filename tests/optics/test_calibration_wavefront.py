"""Wavefront, focus and unmodulated light, judged by a bench that computes its light another way."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges.calibration_bench import NumpyBench, curve, mapped, turned
from sweeps import some

from optics.camera import Camera, Lens, Panel, Sensor
from optics.measuring.spots import frame_variance
from optics.measuring.star_model import StarModel
from optics.measuring.wavefront import StarPictures, fit_wavefront
from optics.measuring.zeroth_order import measure_zeroth_order, zeroth_order_share

WAVELENGTH = 532e-9
SCALE = 190.0
HALF = 20
CORNER = (61 - HALF, 78 - HALF)
TRUE = {(2, 0): 60e-9, (2, 2): -40e-9, (3, 1): 35e-9, (4, 0): 20e-9}


def camera():
    lens = Lens()
    pitch = WAVELENGTH * lens.image_distance / (SCALE * 3.45e-6)
    return Camera(
        Panel(shape=(96, 128), pitch=pitch, unmodulated=0.0), lens, Sensor(shape=(120, 160))
    )


def disc(made):
    """Radius of the circle about the panel, and places on it in that unit."""
    radius = math.hypot(96, 128) * made.panel.pitch / 2
    y = (np.arange(96) - 48)[:, None] * made.panel.pitch / radius
    x = (np.arange(128) - 64)[None, :] * made.panel.pitch / radius
    return radius, y, x


def true_path(made):
    """Metres; the polynomials as Noll writes them."""
    _, y, x = disc(made)
    r2 = y**2 + x**2
    return (
        TRUE[2, 0] * math.sqrt(3) * (2 * r2 - 1)
        + TRUE[2, 2] * math.sqrt(6) * (x**2 - y**2)
        + TRUE[3, 1] * math.sqrt(8) * (3 * r2 - 2) * x
        + TRUE[4, 0] * math.sqrt(5) * (6 * r2**2 - 6 * r2 + 1)
    )


@pytest.fixture(scope="module")
def seen():
    """Camera, model and pictures of a star through a wavefront on a turned, mirrored panel."""
    made = camera()
    _, y, x = disc(made)
    levels = curve(6.7 * np.pi * 1.1, 1.15)
    path = 2 * np.pi * true_path(made) / WAVELENGTH
    bench = NumpyBench(
        levels[None, None], turned(4.0, True, stretch=1.03), path=path, unmodulated=0.05
    )
    bowl = 3 * np.pi * (y**2 + x**2)
    greys = [np.zeros((96, 128), np.uint8)] + [
        np.searchsorted(levels, wanted).astype(np.uint8) for wanted in (bowl, bowl.max() - bowl)
    ]
    dark = bench.dark()
    frames = [bench.frame(grey, 7e-3) for grey in greys]
    part = tuple(slice(c, c + 2 * HALF) for c in CORNER)
    good = dark < 200
    pictures = StarPictures(
        np.stack([(f - dark)[part] for f in frames]),
        np.stack(
            [
                (frame_variance(f, made.sensor) + frame_variance(dark, made.sensor))[part]
                for f in frames
            ]
        ),
        np.stack([((f < made.sensor.full_scale) & good)[part] for f in frames]),
    )
    registration = mapped(bench.centre, bench.matrix)
    star = 3.45e-6 * made.lens.focus_distance / made.lens.image_distance
    model = StarModel(
        made,
        [torch.from_numpy(levels[grey]) for grey in greys],
        registration,
        WAVELENGTH,
        corner=CORNER,
        shape=(2 * HALF, 2 * HALF),
        diameter=star,
        distance=made.lens.focus_distance,
        unmodulated=0.05,
    )
    return made, model, pictures


def test_a_wavefront_is_found_through_the_star(seen):
    """42 nm of it, to 4 nm over the pupil; focus, by the Zernike defocus, is a part of it."""
    made, model, pictures = seen
    found = fit_wavefront(model, pictures)
    missed = found.path(made.panel).numpy() - true_path(made)
    _, y, x = disc(made)
    flat = np.stack([np.ones((96, 128)), y + 0 * x, x + 0 * y]).reshape(3, -1).T
    missed = missed.ravel() - flat @ np.linalg.lstsq(flat, missed.ravel(), rcond=None)[0]
    assert missed.std() < 4e-9
    assert found.sigma < 4e-9
    assert found.rms == pytest.approx(42.4e-9, abs=4e-9)
    assert found.residual < 0.1
    vergence, sigma = found.vergence
    radius, _, _ = disc(made)
    assert vergence == pytest.approx(
        4 * math.sqrt(3) * TRUE[2, 0] / radius**2, abs=4 * sigma + 3e-4
    )


def test_a_model_is_differentiable_in_path_and_place(seen):
    _, model, _ = seen
    path = torch.zeros(model.plane.shape, dtype=torch.float64, requires_grad=True)
    place = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    model(path, place)[:, :HALF].sum().backward()
    assert float(place.grad.abs().max()) > 0
    assert path.grad.isfinite().all()


def test_what_does_not_go_together_is_refused(seen):
    _, model, pictures = seen
    one = StarPictures(pictures.light[:1], pictures.variance[:1], pictures.usable[:1])
    with pytest.raises(ValueError, match="two at least"):
        fit_wavefront(model, one)
    with pytest.raises(ValueError, match="three axes"):
        StarPictures(pictures.light, pictures.variance[:1], pictures.usable)
    with pytest.raises(ValueError, match="variance positive"):
        StarPictures(pictures.light, 0 * pictures.variance, pictures.usable)


@pytest.mark.parametrize("share", some([0.03, 0.0, 0.2]))
def test_the_light_that_stays_in_the_centre_is_found(share):
    """Gratings 10 % beyond a wave leave some in the centre by themselves: it isn't counted."""
    levels = 2.2 * np.pi * np.arange(256) / 255
    bench = NumpyBench(levels[None, None], turned(2.0), unmodulated=share)
    sensor = Sensor(shape=bench.sensor)
    dark = bench.dark()
    neutral = bench.frame(np.zeros((96, 128), np.uint8), 5e-3)
    steered, left, noise = [], [], []
    for vector in [(0.1, 0.15), (-0.12, 0.1), (0.05, -0.17)]:
        y, x = np.arange(96)[:, None], np.arange(128)[None, :]
        grey = np.floor(np.mod(vector[0] * y + vector[1] * x, 1) * 256).astype(np.uint8)
        frame = bench.frame(grey, 5e-3)
        steered.append(frame - dark)
        noise.append(frame_variance(frame, sensor))
        left.append(zeroth_order_share(np.exp(1j * levels[grey])))
    found = measure_zeroth_order(neutral - dark, steered, noise, left, bench.centre, dark < 200)
    assert found.share == pytest.approx(share, abs=max(4 * found.sigma, 0.004))
    assert found.sigma < 0.01


def test_a_phase_of_nothing_stays_in_the_centre_and_a_grating_does_not():
    assert zeroth_order_share(np.full((8, 8), np.exp(3j))) == pytest.approx(1.0)
    stripes = np.where(np.arange(8) % 2, np.pi, 0.0)[None].repeat(8, 0)
    assert zeroth_order_share(np.exp(1j * stripes)) == pytest.approx(0.0)


def test_a_dark_centre_is_refused():
    black = np.zeros((20, 20))
    with pytest.raises(ValueError, match="dark or clipped"):
        measure_zeroth_order(black, [black], [black + 1], [0.0], (10, 10), black == 0)
    with pytest.raises(ValueError, match="one of each"):
        measure_zeroth_order(black, [], [], [], (10, 10), black == 0)


def test_a_panel_apart_from_its_lens_is_one_in_a_lens_of_the_same_ray_matrix():
    """A and B of 50 mm, the lens, and the way to the sensor, multiplied here; a star out of
    focus, whose image has the size that the ray through the lens' middle gives it."""
    made, apart, distance = camera(), 0.05, 1.7
    lens = made.lens
    space, back = np.array([[1, apart], [0, 1]]), np.array([[1, lens.image_distance], [0, 1]])
    (a, b), _ = back @ np.array([[1, 0], [-1 / lens.focal_length, 1]]) @ space
    focal_length = b / (1 - a)
    thin = Lens(focal_length, 1.0, 1 / (1 / focal_length - 1 / b))
    assert thin.image_distance == pytest.approx(b)
    wide = replace(made, lens=replace(lens, f_number=1.0))
    image = 2e-4 * lens.image_distance / (distance + apart)
    rng = np.random.default_rng(0)
    phases = [torch.from_numpy(rng.uniform(0, 3, (96, 128)))]
    registration = mapped((61.3, 78.4), turned(0.0))

    def light(seen, diameter):
        model = StarModel(
            seen,
            phases,
            registration,
            WAVELENGTH,
            corner=CORNER,
            shape=(2 * HALF, 2 * HALF),
            diameter=diameter,
            distance=distance,
        )
        path = torch.zeros(model.plane.shape, dtype=torch.float64)
        return model(path, torch.zeros(2, dtype=torch.float64))

    got = light(replace(wide, separation=apart), 2e-4)
    want = light(replace(made, lens=thin), image * distance / b)
    assert torch.linalg.norm(got - want) <= 1e-5 * torch.linalg.norm(want)
    straight = light(wide, 2e-4)
    assert torch.linalg.norm(straight - want) > 1e-3 * torch.linalg.norm(want)
