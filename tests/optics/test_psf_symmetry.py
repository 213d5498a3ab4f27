"""PSFs of symmetric patterns: as those of all their pixels, and as a direct sum."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import quadrature_psf, relative

from optics.camera import Camera, Lens, Panel, Sensor
from optics.plane import Plane
from optics.psf import PSFOperator, PSFStack, expand_phase, symmetric_shape

WAVELENGTH = 520e-9

METHODS = {
    "quarter": "cosine transform with curved pixels",
    "separable": "one-dimensional transforms",
}


def open_camera(shape=(24, 33)) -> Camera:
    """A camera whose stop leaves the panel open, with a sensor that sees all of its order."""
    return Camera(
        Panel(shape=shape, pitch=40e-6, unmodulated=0.05),
        Lens(focal_length=0.1, f_number=10.0, focus_distance=math.inf),
        Sensor(pitch=20e-6),
    )


def random_pattern(symmetry: str, shape, seed=0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.uniform(0, 6, symmetric_shape(symmetry, shape)))


@pytest.mark.parametrize("symmetry", ["quarter", "separable"])
@pytest.mark.parametrize("shape", [(24, 33), (25, 32)])
@pytest.mark.parametrize("distance", [math.inf, 0.5])
def test_a_symmetric_pattern_on_points_is_as_a_direct_sum(symmetry, shape, distance):
    camera = replace(open_camera(shape), panel=replace(open_camera(shape).panel, unmodulated=0.0))
    given = random_pattern(symmetry, shape)
    whole = expand_phase(symmetry, given, shape)
    truth = quadrature_psf(camera, whole.numpy(), distance, WAVELENGTH, (9, 8))
    operator = PSFOperator(
        camera, distance, WAVELENGTH, camera.sensor.window_plane((9, 8)), symmetry=symmetry
    )
    assert operator.account.method in (
        "cosine transform with curved pixels",
        "one-dimensional transforms",
    )
    assert relative(operator(given).numpy(), truth) <= 1e-3


@pytest.mark.parametrize("integrate", [True, False])
@pytest.mark.parametrize("symmetry", ["quarter", "separable"])
def test_a_symmetric_pattern_is_as_all_its_pixels(symmetry, integrate):
    camera = open_camera()
    pixels = Plane((30, 41), (20e-6, 20e-6), (60e-6, -15e-6))
    given = random_pattern(symmetry, camera.panel.shape)
    settings = {"integrate": integrate, "tol": 1e-3}
    one = PSFOperator(camera, 0.5, WAVELENGTH, pixels, symmetry=symmetry, **settings)
    all_pixels = PSFOperator(
        camera,
        0.5,
        WAVELENGTH,
        pixels,
        method="matrix DFT with curved pixels",
        integrate=integrate,
        tol=1e-7,
    )
    truth = all_pixels(expand_phase(symmetry, given, camera.panel.shape))
    assert relative(one(given).numpy(), truth.numpy()) <= 1e-5
    assert relative(one().numpy(), all_pixels().numpy()) <= 1e-5
    batch = torch.stack([given, 0.5 * given])
    assert torch.allclose(one(batch)[1], one(0.5 * given), rtol=1e-4, atol=1e-9)


CUT = {
    "a stop that cuts the panel": {"lens": Lens(0.1, 100.0, math.inf)},
    "an aberrated lens": {"lens": Lens(0.1, 10.0, math.inf, aberrations=((3, 1, 1e-7),))},
    "a panel apart from its lens": {"separation": 0.02},
}


@pytest.mark.parametrize("symmetry", ["quarter", "separable"])
@pytest.mark.parametrize("why", CUT)
def test_where_the_light_is_not_symmetric_the_pattern_is_expanded(why, symmetry):
    camera = replace(open_camera((20, 24)), **CUT[why])
    pixels = camera.sensor.window_plane((6, 7))
    given = random_pattern(symmetry, camera.panel.shape).requires_grad_()
    one = PSFOperator(camera, 1.0, WAVELENGTH, pixels, symmetry=symmetry, tol=1e-2)
    plain = PSFOperator(camera, 1.0, WAVELENGTH, pixels, tol=1e-2)
    whole = expand_phase(symmetry, given.detach(), camera.panel.shape)
    light = one(given)
    assert torch.allclose(light.detach(), plain(whole), rtol=1e-4)
    light.sum().backward()
    assert given.grad.isfinite().all()
    assert float(given.grad.abs().max()) > 0


def test_an_amplitude_takes_all_pixels():
    camera = open_camera()
    pixels = camera.sensor.window_plane((6, 7))
    given = random_pattern("quarter", camera.panel.shape)
    amplitude = given / 6
    one = PSFOperator(camera, 1.0, WAVELENGTH, pixels, symmetry="quarter")
    plain = PSFOperator(camera, 1.0, WAVELENGTH, pixels)
    whole = [expand_phase("quarter", p, camera.panel.shape) for p in (given, amplitude)]
    assert torch.allclose(one(given, amplitude), plain(*whole))
    assert torch.allclose(one.unmodulated_psf(amplitude), plain.unmodulated_psf(whole[1]))
    assert math.isclose(
        one.light_budget(given, amplitude).window, plain.light_budget(*whole).window, rel_tol=1e-6
    )


@pytest.mark.parametrize("symmetry", ["quarter", "separable"])
def test_gradients_are_those_of_finite_differences(symmetry):
    camera = open_camera((6, 7))
    operator = PSFOperator(
        camera, 0.5, WAVELENGTH, camera.sensor.window_plane((5, 4)), symmetry=symmetry, tol=1e-7
    )
    phase = random_pattern(symmetry, camera.panel.shape).requires_grad_()
    assert torch.autograd.gradcheck(lambda p: 100 * operator(p), (phase,), atol=1e-6)


def test_dark_light_of_a_mirrored_pattern_keeps_the_tolerance():
    """A grating that is mirrored sends its light far beside the window."""
    camera = replace(open_camera(), panel=replace(open_camera().panel, unmodulated=0.0))
    rows, columns = symmetric_shape("quarter", camera.panel.shape)
    stripes = math.pi * (torch.arange(columns) % 2).double().expand(rows, columns)
    pixels = camera.sensor.window_plane((4, 5))
    one = PSFOperator(camera, math.inf, WAVELENGTH, pixels, symmetry="quarter", tol=1e-3)
    plain = PSFOperator(
        camera, math.inf, WAVELENGTH, pixels, method="matrix DFT with curved pixels", tol=1e-8
    )
    truth = plain(expand_phase("quarter", stripes, camera.panel.shape))
    assert relative(one(stripes).numpy(), truth.numpy()) <= 1e-3


def test_a_stack_takes_symmetric_patterns_and_sums_losses():
    camera, pixels = open_camera(), Plane((9, 8), (20e-6, 20e-6))
    stack = PSFStack(
        camera, (math.inf, 0.5), (WAVELENGTH, 6e-7), pixels, symmetry="quarter", integrate=False
    )
    given = random_pattern("quarter", camera.panel.shape)
    both = torch.stack([given, 0.8 * given])
    light = stack(both)
    assert light.shape == (2, 2, 1, 9, 8)
    for distance, row in enumerate(stack.operators):
        for band, (operator,) in enumerate(row):
            assert torch.equal(light[distance, band, 0], operator(both[band]))
    leaf = both.clone().requires_grad_()
    weights = torch.rand(2, 2, 9, 8)
    together = (stack(leaf)[:, :, 0] * weights).sum()
    together.backward()
    value, gradient = stack.value_and_gradient(
        both, lambda psf, distance, band, _: (psf * weights[distance, band]).sum()
    )
    assert math.isclose(value, float(together.detach()), rel_tol=1e-5)
    assert torch.allclose(gradient, leaf.grad, rtol=1e-4, atol=1e-9)


def test_bad_symmetries_and_shapes_are_refused():
    camera = open_camera()
    pixels = camera.sensor.window_plane((4, 5))
    with pytest.raises(ValueError, match="symmetry is 'round'; choose none, quarter, separable"):
        PSFOperator(camera, 1.0, WAVELENGTH, pixels, symmetry="round")
    with pytest.raises(ValueError, match="a lens without a panel has no pixels"):
        PSFOperator(camera.lens, 1.0, WAVELENGTH, pixels, symmetry="quarter")
    with pytest.raises(ValueError, match=r"phase is \(24, 33\); the pupil has \(12, 17\) pixels"):
        PSFOperator(camera, 1.0, WAVELENGTH, pixels, symmetry="quarter")(torch.zeros(24, 33))
    with pytest.raises(ValueError, match=r"phase is \(3, 3\); with symmetry 'quarter' it is"):
        expand_phase("quarter", torch.zeros(3, 3), (24, 33))
    with pytest.raises(ValueError, match=r"phase has 1 NaN"):
        PSFOperator(camera, 1.0, WAVELENGTH, pixels, symmetry="separable")(
            torch.full((57,), math.nan).where(torch.arange(57) == 3, torch.zeros(57))
        )


@pytest.mark.parametrize("distance", [math.inf, 1.0])
def test_a_mirrored_pattern_apart_from_an_open_lens_takes_a_quarter(distance):
    """The stop cuts nothing but what the pixels scatter, which the tolerance allows for."""
    camera = replace(open_camera(), lens=Lens(0.1, 5.0, math.inf), separation=0.05)
    pixels = camera.sensor.window_plane((10, 11))
    given = random_pattern("quarter", camera.panel.shape)
    one = PSFOperator(camera, distance, WAVELENGTH, pixels, symmetry="quarter", tol=3e-2)
    chain = PSFOperator(camera, distance, WAVELENGTH, pixels, method="chain", tol=1e-3)
    assert one.account.method == "collapsed"
    assert one.engine.points()[1].shape == (1, 17)
    truth = chain(expand_phase("quarter", given, camera.panel.shape))
    assert relative(one(given).numpy(), truth.numpy()) <= 3e-2
    strict = PSFOperator(camera, distance, WAVELENGTH, pixels, symmetry="quarter", tol=1e-3)
    assert relative(strict(given).numpy(), truth.numpy()) <= 2e-3


def test_a_stack_apart_from_its_lens_takes_a_quarter():
    """Its PSFs are computed from one spectrum of the whole panel, as those of single operators."""
    camera = replace(open_camera((12, 16)), separation=0.05)
    pixels, given = Plane((5, 4), (20e-6, 20e-6)), random_pattern("quarter", (12, 16))
    settings = {"symmetry": "quarter", "integrate": False, "tol": 1e-2}
    stack = PSFStack(camera, (1.0, 0.5), (WAVELENGTH,), pixels, **settings)
    whole = expand_phase("quarter", given, camera.panel.shape)
    half = torch.full(given.shape, math.sqrt(0.5))
    for light in (stack(given), 2 * stack(given, half)):
        for distance, found in zip((1.0, 0.5), light[:, 0, 0], strict=True):
            plain = PSFOperator(camera, distance, WAVELENGTH, pixels, integrate=False, tol=1e-3)
            assert relative(found.numpy(), plain(whole).numpy()) <= 1.2e-2


def test_an_integration_that_was_asked_for_holds_for_all_pixels_too():
    """An operator that's planned again for a pattern on all pixels keeps every argument."""
    camera = open_camera()
    pixels = Plane((3, 4), (20e-6, 20e-6))
    amplitude = random_pattern("quarter", camera.panel.shape)
    asked = {"symmetry": "quarter", "tol": 0.1}
    finest, finer, coarse = (
        PSFOperator(camera, 0.5, WAVELENGTH, pixels, pixel_tol=one, **asked).unmodulated_psf(
            amplitude
        )
        for one in (1e-7, 1e-5, 1e-2)
    )
    assert relative(finer.numpy(), finest.numpy()) <= 1e-5 < relative(coarse, finest)
