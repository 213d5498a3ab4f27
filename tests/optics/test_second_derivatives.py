"""Second derivatives against Richardson's extrapolation of differences of first ones."""

import math

import pytest
import torch
from sweeps import some

from optics.camera import Camera, Lens, Panel, Sensor
from optics.edof.panel_transfer import FullTransfer
from optics.edof.transfer_design import TransferDesign
from optics.plane import Plane
from optics.psf import PSFOperator
from optics.psf.chain_choice import CHAIN_METHODS

WAVELENGTH = 550e-9
PIXELS = Plane((5, 6), (12e-6, 12e-6))
SHAPE = (8, 9)
WEIGHTS = torch.rand(PIXELS.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
PHASE = torch.rand(SHAPE, dtype=torch.float64, generator=torch.Generator().manual_seed(2)) * 3
DIRECTION = torch.rand(SHAPE, dtype=torch.float64, generator=torch.Generator().manual_seed(3))
LENGTHS = {
    "distance": 1.9,
    "wavelength": WAVELENGTH,
    "focal_length": 0.05,
    "f_number": 80.0,
    "focus_distance": 2.0,
    "aberration": 3e-8,
    "separation": 0.05,
    "field": 1e-5,
    "centre": 1e-5,
}


def light(kind: str, phase=PHASE, amplitude=None, *, method=None, tol=1e-9, pitch=12e-6, **lengths):
    """The light of a lens, of a panel at the lens, or of one apart, whose stop cuts its pixels."""
    given = LENGTHS | lengths
    lens = Lens(
        *(given[name] for name in ("focal_length", "f_number", "focus_distance")),
        aberrations=((4, 0, given["aberration"]),) if given["aberration"] else (),
    )
    separation = given["separation"] if kind == "apart" else 0.0
    optics = lens
    if kind != "lens":
        panel = Panel(SHAPE, 100e-6, fill_factor=0.9, unmodulated=0.1)
        optics = Camera(panel, lens, Sensor(pitch=pitch), separation=separation)
    operator = PSFOperator(
        optics,
        given["distance"],
        given["wavelength"],
        Plane(PIXELS.shape, (pitch, pitch), (given["centre"], 0.0)),
        field=(given["field"], 0.0),
        method=method,
        tol=tol,
    )
    return operator() if kind == "lens" else operator(phase, amplitude)


def error_of_second_derivative(function, at, direction, step):
    """Relative error of the derivative along `direction` of a function's gradient."""
    at = at.clone().requires_grad_()
    (first,) = torch.autograd.grad(function(at), at, create_graph=True)
    (second,) = torch.autograd.grad((first * direction).sum(), at)

    def gradient(place):
        place = place.detach().requires_grad_()
        return torch.autograd.grad(function(place), place)[0]

    def slope(h):
        return (gradient(at + h * direction) - gradient(at - h * direction)) / (2 * h)

    extrapolated = (4 * slope(step / 2) - slope(step)) / 3
    return float((second - extrapolated).norm() / extrapolated.norm())


@pytest.mark.parametrize(
    ("kind", "method", "tol"),
    some(
        [
            ("panel", "interpolated FFT with curved pixels", 1e-5),
            ("apart", "chain, quadrature", 1e-5),
            ("panel", None, 1e-9),
            ("panel", "gridded FFT", 1e-6),
            *(("apart", method, 1e-3) for method in CHAIN_METHODS if method != "collapsed"),
        ],
        0,
        1,
    ),
)
def test_of_phases_and_amplitudes(kind, method, tol):
    single = 2e-4 if tol > 1e-6 else 1e-6
    asked = {"method": method, "tol": tol}
    if method == "interpolated FFT with curved pixels":
        # It serves lenses without aberrations.
        asked |= {"pitch": 4e-6, "f_number": 8.0, "aberration": 0.0}

    def weighted_light(phase):
        return (light(kind, phase, **asked) * WEIGHTS).sum()

    assert error_of_second_derivative(weighted_light, PHASE, DIRECTION, 1e-2) <= single

    def squared_light(amplitude):
        return (light(kind, PHASE, amplitude, **asked) ** 2).sum()

    assert error_of_second_derivative(squared_light, DIRECTION + 0.1, DIRECTION, 1e-2) <= single


@pytest.mark.parametrize(
    ("kind", "name"),
    some(
        [
            ("panel", "distance"),
            ("panel", "f_number"),
            ("apart", "separation"),
            *((kind, name) for kind in ("lens", "panel", "apart") for name in LENGTHS),
        ],
        0,
        1,
        2,
    ),
)
def test_of_lengths(kind, name):
    if kind != "apart" and name in ("separation", "field"):
        pytest.skip("it has none")
    at = torch.tensor(LENGTHS[name], dtype=torch.float64)

    def weighted_light(length):
        tol = 1e-5 if kind == "apart" else 1e-9
        return (light(kind, tol=tol, **{name: length}) * WEIGHTS).sum() * 100

    step = 0.03 * at if name in ("aberration", "field", "centre") else 0.001 * at
    found = error_of_second_derivative(weighted_light, at, torch.ones_like(at), float(step))
    assert found <= 1e-4


def test_third_ones_of_what_a_stop_cuts_are_refused():
    at = torch.tensor(80.0, dtype=torch.float64, requires_grad=True)
    value = light("panel", f_number=at).sum()
    for _ in range(2):
        (value,) = torch.autograd.grad(value, at, create_graph=True)
    with pytest.raises(NotImplementedError, match="twice in its diameter; take differences"):
        torch.autograd.grad(value, at)


def test_those_that_are_not_computed_are_refused_in_words():
    """torch's own once_differentiable takes the first derivative to be constant here."""
    camera = Camera(Panel((8, 8), 100e-6, unmodulated=0.0), Lens(0.1, 20.0, math.inf), Sensor())
    transfer = FullTransfer(TransferDesign(camera, WAVELENGTH, 16, reach=20))
    phase = torch.rand(8, 8, dtype=torch.float64).requires_grad_()
    (first,) = torch.autograd.grad(transfer(phase, [0.5]).sum().real, phase, create_graph=True)
    with pytest.raises(NotImplementedError, match="the OTFs of a pattern can be differentiated o"):
        torch.autograd.grad(first.square().sum(), phase)


@pytest.mark.filterwarnings("ignore:.torch.jit.script")
@pytest.mark.parametrize(
    "derivative",
    [
        lambda f, x: torch.vmap(f)(x[None]),
        lambda f, x: torch.func.jvp(f, (x,), (x,)),
        lambda f, x: torch.func.hessian(lambda p: f(p).sum())(x),
        lambda f, x: torch.autograd.functional.jacobian(f, x, vectorize=True),
    ],
)
def test_other_ways_to_differentiate_say_what_to_use(derivative):
    camera = Camera(Panel((3, 4), 60e-6), Lens(0.05, 50.0, 2.0), Sensor(pitch=12e-6))
    operator = PSFOperator(camera, math.inf, WAVELENGTH, PIXELS)
    phase = torch.rand(3, 4, dtype=torch.float64)
    with pytest.raises(NotImplementedError, match=r"give a batch \(\.\.\., rows, columns\)"):
        derivative(operator, phase)
    twice = torch.autograd.functional.hessian(lambda p: operator(p)[2, 2], phase)
    assert twice.shape == (3, 4, 3, 4)
