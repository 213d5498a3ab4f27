"""Pixels that a stop's shadow cuts, few samples in a stop, and what isn't there at all."""

import math

import numpy as np
import pytest
import torch
from judges import positions, relative
from judges.chain_sums import direct_chain

from optics.accuracy import Budget, ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Circle, Stop, rectangle
from optics.plane import Plane
from optics.psf import PSFOperator
from optics.psf.chain_collapsed import cut_pixel_error_share
from optics.psf.request import PSFRequest

WAVELENGTH = 550e-9
SIDE = 40e-6


def camera(stop: float, shape=(3, 4), shapes: Stop | None = None, separation=1e-4, **panel):
    lens = Lens(0.1, 0.1 / stop, 1.5, shapes or Stop())
    return Camera(
        Panel(shape, SIDE, unmodulated=0.0, **{"fill_factor": 1.0, **panel}),
        lens,
        separation=separation,
    )


@pytest.mark.parametrize("fill", [1.0, 0.25])
@pytest.mark.parametrize("cycles", [0.02, 0.3, 0.9])
def test_half_a_pixel_isnt_a_whole_one_of_half_the_light(fill, cycles):
    """Four columns, of which the outer two are cut in the middle: a half sends
    sinc(f/2) exp(i pi f/2) / 2 and is taken as sinc(f) / 2, for f cycles across a pixel."""
    # The panel's middle lies half a pixel to the left, three of four pixels are open.
    opening = Stop(rectangle(1.0, 0.75, (0.0, -0.125)))
    cut = camera(8 * SIDE, (3, 4), opening, 0.0, fill_factor=fill)
    scale = WAVELENGTH * cut.lens.image_distance
    point = Plane((1, 1), (1e-6, 1e-6), (0.0, cycles / SIDE * scale))
    question = PSFRequest(cut.lens, 1.5, WAVELENGTH, point, 1e-2, Budget())
    f = cycles * math.sqrt(fill)
    half = np.sinc(f / 2) * np.exp(0.5j * np.pi * f) / 2
    wrong, right = 6 * abs(half - np.sinc(f) / 2) ** 2, 6 * (abs(half) ** 2 + np.sinc(f) ** 2)
    # The window is lit from three columns of three pixels.
    straight = 9 * SIDE**2 * np.sinc(f) ** 2
    assert cut_pixel_error_share(question, cut, straight) == pytest.approx(wrong / right, rel=2e-2)


def test_whole_pixels_have_nothing_to_tell():
    wide = camera(1e-2, separation=0.0)
    point = Plane((1, 1), (1e-6, 1e-6))
    question = PSFRequest(wide.lens, 1.5, WAVELENGTH, point, 1e-2, Budget())
    assert cut_pixel_error_share(question, wide, 12 * SIDE**2) == 0.0


@pytest.mark.parametrize("fill", [1.0, 0.5])
def test_a_collapsed_camera_knows_what_its_cut_pixels_cost(fill, rng):
    """Against a double sum over panel and stop."""
    optics = camera(0.12e-3, fill_factor=fill)
    window = Plane((5, 6), (1e-4, 1e-4))
    modulation = np.exp(1j * rng.uniform(0, 2 * np.pi, (3, 4)))
    y, x = (positions(n, 1e-4) for n in (5, 6))
    nodes = {"across_pixel": 60, "rings": 60}
    truth = direct_chain(optics, modulation, 1.5, WAVELENGTH, y, x, **nodes) * 1e-8
    settings = {"integrate": False, "tol": 0.9, "method": "collapsed"}
    operator = PSFOperator(optics, 1.5, WAVELENGTH, window, **settings)
    off = relative(operator(np.angle(modulation)), truth)
    assert off > 0.02
    assert off <= operator.account.error
    with pytest.raises(ToleranceError, match="take method"):
        PSFOperator(optics, 1.5, WAVELENGTH, window, **{**settings, "tol": 0.02})


@pytest.mark.parametrize("tol", [1e-3, pytest.param(1e-4, marks=pytest.mark.sweep)])
def test_a_handful_of_samples_in_a_small_stop_keep_their_tolerance(tol, rng):
    optics = camera(10e-6, (8, 9), separation=0.05)
    window = Plane((3, 4), (2e-5, 3e-5))
    modulation = np.exp(1j * rng.uniform(0, 2 * np.pi, (8, 9)))
    y, x = positions(3, 2e-5), positions(4, 3e-5)
    nodes = {"across_pixel": 8, "rings": 30}
    truth = direct_chain(optics, modulation, 1.5, WAVELENGTH, y, x, **nodes) * 6e-10
    operator = PSFOperator(
        optics, 1.5, WAVELENGTH, window, integrate=False, tol=tol, method="chain"
    )
    assert relative(operator(np.angle(modulation)), truth) <= operator.account.error


@pytest.mark.parametrize("method", ["collapsed", "chain", "chain, quadrature"])
def test_no_patterns_have_no_light(method):
    optics = camera(1e-3, separation=1e-3)
    operator = PSFOperator(
        optics, 1.5, WAVELENGTH, Plane((3, 5), (5e-6, 5e-6)), tol=0.5, method=method
    )
    for lead in ((0,), (2, 0)):
        phase = torch.zeros(*lead, 3, 4, requires_grad=True)
        found = operator(phase)
        assert found.shape == (*lead, 3, 5)
        found.sum().backward()
        assert phase.grad is not None


@pytest.mark.parametrize("separation", [0.0, 0.05])
@pytest.mark.parametrize(
    "lens",
    [Lens(0.1, 1e100, 1.5), Lens(0.1, 5.0, 1.5, Stop(Circle(0.02, (0.0, 0.97))))],
    ids=["closed", "beside"],
)
def test_a_stop_that_leaves_the_panel_dark_is_told(separation, lens):
    dark = Camera(Panel((8, 9), SIDE), lens, separation=separation)
    with pytest.raises(ValueError, match="covers the whole panel: no light passes"):
        PSFOperator(dark, 1.5, WAVELENGTH, Plane((3, 4), (5e-6, 5e-6)))


def test_a_small_hole_before_the_panel_is_none_of_them(rng):
    """A hole of a hundredth of the stop: the light of a stop that is as small."""
    phase = rng.uniform(0, 2 * np.pi, (8, 9))
    answers = []
    for stop, shapes in ((0.1e-3, Stop()), (1e-2, Stop(Circle(0.01)))):
        optics = camera(stop, (8, 9), shapes, 0.05)
        operator = PSFOperator(optics, 1.5, WAVELENGTH, Plane((3, 4), (2e-5, 3e-5)), tol=1e-3)
        answers.append(operator(phase))
    assert relative(*answers) <= 2e-3


@pytest.mark.parametrize("integrate", [True, pytest.param(False, marks=pytest.mark.sweep)])
@pytest.mark.parametrize("sphere", [True, pytest.param(False, marks=pytest.mark.sweep)])
def test_the_tolerance_that_a_refusal_names_is_kept(integrate, sphere, rng):
    optics = camera(0.9e-3, (8, 9), separation=0.05)
    settings = {"integrate": integrate, "sphere": sphere}
    question = (optics, 0.05 if sphere else 1.5, WAVELENGTH, Plane((3, 4), (2e-5, 2e-5)))
    with pytest.raises(ToleranceError, match=r"tol 1e-15 can't be kept; ask for tol") as caught:
        PSFOperator(*question, tol=1e-15, **settings)
    advised = float(str(caught.value).split()[-3])
    operator = PSFOperator(*question, tol=advised, **settings)
    assert operator.account.error <= advised < 1e-7
    assert np.isfinite(operator(rng.uniform(0, 2 * np.pi, (8, 9)))).all()
