"""Derivatives: in lengths, strengths, patterns, and where they vanish."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from judges import (
    Judge,
    by_airy,
    by_lines,
    by_lommel,
    by_panel,
    by_rings,
    direct_transform,
    richardson,
)
from judges.view import WAVELENGTH, View
from numpy.typing import NDArray

from hard_cases.lenses import HEXAGON, LENS, WIDE, behind, defocused, with_aberrations
from hard_cases.panels import CAMERA, camera, random, stop_of, window
from hard_cases.table import DOUBLE, SINGLE, Agrees, Case, Holds, Slope, require_close
from hard_cases.transforms import ways
from optics.camera import Camera, Lens
from optics.camera.stop import Circle, rectangle
from optics.fourier import FourierGeometry
from optics.plane import Plane
from optics.psf import PolychromaticPSF

FEW = Plane((4, 5), (3e-6, 3e-6), (1e-6, 2e-6))
DISTANCE = defocused(LENS, 1.0)


def dioptres_of_a_radian(lens: Lens) -> float:
    """The change of 1 / distance that turns the wave at the stop's edge by a radian."""
    radius = float(lens.stop_diameter) / 2
    return WAVELENGTH / (math.pi * radius**2)


def metres_of_a_radian(lens: Lens, distance: float) -> float:
    return distance**2 * dioptres_of_a_radian(lens)


def in_distance(
    name: str,
    hard_because: str,
    lens: Lens,
    distance: float,
    judge: Judge,
    pixels: Plane = FEW,
    **row: Any,
) -> Slope:
    """The derivative in the object's distance."""
    settings = {key: row.pop(key) for key in ("integrate", "method") if key in row}
    return Slope(
        name,
        hard_because,
        lambda d: View(lens, pixels, d, **settings),
        distance,
        metres_of_a_radian(lens, distance),
        judge,
        **row,
    )


def in_lens(
    name: str,
    hard_because: str,
    changed: Callable[[Any], dict[str, Any]],
    at: float,
    unit: float,
    judge: Judge = by_rings,
    lens: Lens = LENS,
    distance: float = DISTANCE,
    **row: Any,
) -> Slope:
    """The derivative in a length of the lens."""

    def view(x: Any) -> View:
        return View(replace(lens, **changed(x)), FEW, distance)

    return Slope(name, hard_because, view, at, unit, judge, **row)


DIRECTION = np.random.default_rng(5).normal(size=CAMERA.panel.shape)
SQUINT = Plane((4, 5), (10e-6, 10e-6), (40e-6, -20e-6))


def in_panel(
    name: str,
    hard_because: str,
    view_of: Callable[[Any], View],
    at: float,
    unit: float,
    **row: Any,
) -> Slope:
    """The derivative of a PSF behind a panel."""
    return Slope(name, hard_because, view_of, at, unit, by_panel, **row)


def along(base: NDArray[Any], t: Any, direction: NDArray[Any] = DIRECTION) -> Any:
    """A pattern and a share t of another one; a tensor if t is one."""
    if isinstance(t, torch.Tensor):
        return torch.from_numpy(base) + t * torch.from_numpy(direction)
    return base + t * direction


PATTERN = random()
LARGE_STOP = camera(stop_of(25e-3))


def shown(distance: Any = 2.0, optics: Camera = CAMERA, **settings: Any) -> View:
    return View(optics, settings.pop("pixels", SQUINT), distance, phase=PATTERN, **settings)


def large(**lens: Any) -> Camera:
    """A camera whose panel is the aperture, so that the stop's edge doesn't matter."""
    return replace(LARGE_STOP, lens=replace(LARGE_STOP.lens, **lens))


# Laws


def at_infinity(optics: Lens | Camera) -> Callable[[float], None]:
    def law(tol: float) -> None:
        """1 / d² is zero, and no NaN comes out of inf x 0."""
        distance = torch.tensor(math.inf, dtype=torch.float64, requires_grad=True)
        operator = quietly(lambda: View(optics, FEW, distance).operator(tol))
        operator().sum().backward()
        assert distance.grad is not None
        assert float(distance.grad) == 0

    return law


def focused_at_infinity(tol: float) -> None:
    """The same for the focus."""
    focus = torch.tensor(math.inf, dtype=torch.float64, requires_grad=True)
    operator = quietly(lambda: View(replace(LENS, focus_distance=focus), FEW, 200.0).operator(tol))
    operator().sum().backward()
    assert focus.grad is not None
    assert float(focus.grad) == 0


def quietly(make: Callable[[], Any]) -> Any:
    """Without torch's warning about tensors that become numbers, which has a row of its own."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Converting a tensor with requires_grad")
        return make()


def without_a_warning(tol: float) -> None:
    """Programs that turn warnings into errors must be able to ask for derivatives."""
    before = torch.is_warn_always_enabled()
    torch.set_warn_always(True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for optics in (LENS, CAMERA):
                distance = torch.tensor(1.9, dtype=torch.float64, requires_grad=True)
                View(optics, FEW, distance).operator(tol)().sum().backward()
    finally:
        torch.set_warn_always(before)


def moved_in_place(change: Callable[[Any], View], low: float, high: float) -> Callable[..., None]:
    def law(tol: float) -> None:
        """After an optimiser's step the answer is that of the new number, or a refusal."""
        number = torch.tensor(low, dtype=torch.float64, requires_grad=True)
        operator = quietly(lambda: change(number).operator(tol))
        operator()
        with torch.no_grad():
            number.fill_(high)
        try:
            light = quietly(operator).detach()
        except ValueError:
            return
        require_close(light, change(high).operator(tol)(), 3 * tol)

    return law


def twice(tol: float) -> None:
    """The second backward pass finds a graph of its own, and the same gradient."""
    distance = torch.tensor(1.9, dtype=torch.float64, requires_grad=True)
    operator = quietly(lambda: View(LENS, FEW, distance).operator(tol))
    gradients: list[float] = []
    for _ in range(2):
        distance.grad = None
        quietly(operator)[1, 2].backward()
        assert distance.grad is not None
        gradients.append(float(distance.grad))
    assert gradients[0] == gradients[1] != 0


def steps_that_descend(tol: float) -> None:
    """Five steps down the gradient put more light on a pixel each time."""
    phase = torch.from_numpy(random(seed=3)).requires_grad_()
    operator = shown().operator(tol)
    optimiser = torch.optim.SGD([phase], lr=30.0)
    losses = []
    for _ in range(5):
        optimiser.zero_grad()
        loss = -operator(phase)[1, 2]
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert all(later < earlier for earlier, later in pairwise(losses))


def kept_types(tol: float) -> None:
    """A gradient has the type of what it belongs to."""
    for dtype in (torch.float32, torch.float64):
        phase = torch.from_numpy(PATTERN).to(dtype).requires_grad_()
        shown().operator(tol)(phase).sum().backward()
        assert phase.grad is not None
        assert phase.grad.dtype == dtype


def without_a_graph(tol: float) -> None:
    """The same numbers inside torch.no_grad(), and nothing to differentiate."""
    distance = torch.tensor(1.9, dtype=torch.float64, requires_grad=True)
    operator = quietly(lambda: View(LENS, FEW, distance).operator(tol))
    with torch.no_grad():
        silent = operator()
    assert not silent.requires_grad
    require_close(operator(), silent, 1e-12)
    assert operator().requires_grad


def of_each(tol: float) -> None:
    """Gradients of a batch are those of its pictures."""
    phases = torch.stack([torch.from_numpy(random(seed=s)) for s in range(3)]).requires_grad_()
    operator = shown().operator(tol)
    (operator(phases) ** 2).sum().backward()
    alone = phases.detach()[1].clone().requires_grad_()
    (operator(alone) ** 2).sum().backward()
    assert phases.grad is not None
    require_close(phases.grad[1], alone.grad, max(1e-5 * tol, 1e-12) + 1e-2 * tol)


PUPIL, IMAGE = (
    Plane((7, 6), (1e-5, 1.3e-5), (2e-4, 0.0)),
    Plane((4, 5), (2e-6, 3e-6), (1e-5, -2e-5)),
)
FIELD = np.random.default_rng(2).normal(size=(2, 7, 6))
BETWEEN = FourierGeometry(PUPIL, IMAGE, 1e-9)


def stretched(tol: float) -> torch.Tensor:
    """The derivative of the light in a stretch of the image, by every transform."""
    field = torch.from_numpy(FIELD[0] + 1j * FIELD[1])
    answers = []
    for way in ways(BETWEEN, tol):
        one = torch.ones((), dtype=torch.float64, requires_grad=True)
        light = way(field, one).abs() ** 2
        (light * torch.arange(20).reshape(4, 5)).sum().backward()
        answers.append(one.grad)
    return torch.stack(answers)  # type: ignore[arg-type]


def stretched_sums() -> NDArray[Any]:
    def total(stretch: float) -> Any:
        light = np.abs(direct_transform(FIELD[0] + 1j * FIELD[1], PUPIL, IMAGE, 1e-9 / stretch))
        return np.sum(light**2 * np.arange(20).reshape(4, 5))

    return np.full(len(ways(BETWEEN, 1.0)), richardson(total, 1.0, 0.05))


def of_colours(tol: float) -> torch.Tensor:
    distance = torch.tensor(1.9, dtype=torch.float64, requires_grad=True)
    colours = quietly(
        lambda: PolychromaticPSF(LENS, distance, (450e-9, 650e-9), (1, 3), FEW, tol=tol)
    )
    (colours() * torch.arange(20).reshape(4, 5)).sum().backward()
    assert distance.grad is not None
    return distance.grad


def differences_of_colours() -> NDArray[Any]:
    def total(distance: float) -> Any:
        blue, red = (by_rings(View(LENS, FEW, distance, w)) for w in (450e-9, 650e-9))
        return np.sum((0.25 * blue + 0.75 * red) * np.arange(20).reshape(4, 5))

    return np.asarray(richardson(total, 1.9, metres_of_a_radian(LENS, 1.9) / 8))


CASES: list[Case] = [
    # In the distance
    in_distance("an object out of focus", "the phase must reach the light through J0 and radii",
                LENS, DISTANCE, by_rings),
    in_distance("in focus exactly", "by symmetry zero, and 0 / 0 in formulas with 1 / defocus",
                LENS, 2.0, by_rings),
    in_distance("in focus, with an aberration", "no symmetry: focus isn't the best place",
                with_aberrations((4, 0, 150e-9)), 2.0, by_rings),
    in_distance("a hexagon's focus", "nodes that follow edges, by non-uniform FFT", HEXAGON,
                DISTANCE, by_lines),
    in_distance("a square's focus, on a grid", "wrapped phases, in single precision",
                behind(rectangle(1.2, 1.4)), defocused(LENS, 0.3), by_lines, method="sampled",
                tols=(2e-2,)),
    in_distance("a thousand waves out of focus",
                "phases of 6000 rad, whose derivative has 6000 too",
                LENS, defocused(LENS, 1000), by_lommel, Plane((1, 2), (3e-4, 3e-4), (0, 2e-3)),
                integrate=False, tols=(SINGLE,)),
    in_distance("three thousand waves over a whole blur",
                "the integral along the rim would be shorter, and has no derivative",
                LENS, defocused(LENS, 3000), by_lommel, Plane((2, 3), (4e-4, 4e-4), (0.0, 2e-3)),
                integrate=False, tols=(SINGLE,)),
    in_distance("a stigmatic f/1.4", "differences of differences of spheres", WIDE, 0.995,
                by_rings),
    Holds("at infinity", "1 / inf is 0, its derivative -1 / inf²; inf x 0 is NaN",
          "lens, focus 2 m", at_infinity(LENS), "zero"),
    Holds("at infinity, behind a panel", "bent pixels, and inf x 0",
          "camera, focus 2 m", at_infinity(CAMERA), "zero"),
    Holds("focused at infinity", "the same for the focus", "object 200 m", focused_at_infinity,
          "zero"),
    # In the lens
    Slope("in the wavelength", "it scales the phase, the picture and the light",
          lambda w: View(LENS, FEW, DISTANCE, w), WAVELENGTH, 0.1 * WAVELENGTH, by_rings),
    in_lens("in the f-number", "the stop grows, the wave with it, and the light is normalised",
            lambda x: {"f_number": x}, 5.6, 0.5),
    in_lens("in a ring's f-number", "both of its edges move",
            lambda x: {"f_number": x}, 5.6, 0.5, lens=behind(Circle(), Circle(0.6))),
    in_lens("in the focal length", "stop and image distance follow",
            lambda x: {"focal_length": x}, 0.1, 0.005),
    in_lens("in the focus distance", "the wave, and the image distance a little",
            lambda x: {"focus_distance": x}, 2.0, metres_of_a_radian(LENS, 2.0)),
    in_lens("in an aberration of zero", "it isn't there: who leaves it out has no derivative",
            lambda x: {"aberrations": ((3, 1, x),)}, 0.0, WAVELENGTH / 6, by_lines),
    in_lens("in one of three aberrations", "each has its own place in a tuple",
            lambda x: {"aberrations": ((3, 1, 1e-7), (2, 2, x), (4, 0, 5e-8))}, 2e-7,
            WAVELENGTH / 6, by_lines),
    # In the position
    Slope("across a bright lobe", "differences of pixels would be its only other derivative",
          lambda x: View(LENS, Plane((4, 5), (2e-6, 2e-6), (0.5e-6, x)), 2.0), 0.7e-6, 1e-6,
          by_airy),
    Slope("at the very centre", "hypot(0, 0) has a NaN for a gradient",
          lambda x: View(LENS, Plane((3, 3), (2e-6, 2e-6), (0.0, x)), 2.0, integrate=False), 0.0,
          1e-6, by_airy),
    Slope("a hundred rings off the axis", "the kernel's tilt has 300 rad, its derivative too",
          lambda y: View(HEXAGON, Plane((3, 4), (2e-6, 2e-6), (y, 2e-4)), 2.0, integrate=False),
          1e-4, 1e-6, by_lines),
    # Behind a panel
    in_panel("a panel's pattern", "through pixels, transform and squared modulus",
             lambda t: View(CAMERA, SQUINT, 1.9, phase=along(PATTERN, t)), 0.0, 0.5),
    in_panel("a panel's pattern, bent pixels", "the wave inside the pixels is in the matrices",
             lambda t: View(CAMERA, SQUINT, 0.4, phase=along(PATTERN, t)), 0.0, 0.5),
    in_panel("a pattern whose light is elsewhere", "a 1e-5th of it, redone in double precision",
             lambda t: View(CAMERA, window(3, 4, 0.9e-3, 0.9e-3), phase=along(0 * PATTERN, t)),
             0.01, 0.5),
    in_panel("a pattern with unmodulated light", "two pictures of one amplitude",
             lambda t: View(camera(unmodulated=0.3), SQUINT, 1.9, phase=along(PATTERN, t)), 0.0,
             0.5),
    in_panel("a panel's amplitude", "no phase is in the way, and the light isn't normalised",
             lambda t: shown(1.9, amplitude=along(1 + 0 * PATTERN, t)), 0.0, 0.5),
    in_panel("a panel's amplitude at zero", "the light is t²: sqrt and abs have no derivative here",
             lambda t: shown(1.9, amplitude=along(0 * PATTERN, t)), 0.3, 0.5),
    in_panel("a panel, slightly out of focus", "flat pixels",
             lambda d: shown(d), 1.99, 0.3, tols=(1e-2,)),
    in_panel("a panel, out of focus", "bent pixels: curvature is a number in their matrices",
             lambda d: shown(d), 0.7, 0.1),
    in_panel("a panel's wavelength", "scale, wave and envelope",
             lambda w: shown(1.9, wavelength=w), WAVELENGTH, 0.1 * WAVELENGTH),
    in_panel("a panel's focal length", "pixels stay where they are when the stop grows",
             lambda f: shown(1.2, large(focal_length=f, f_number=5.0)), 0.125, 0.005,
             tols=(DOUBLE,)),
    in_panel("a panel's f-number", "the panel is the aperture: nothing changes",
             lambda n: shown(1.2, large(f_number=n)), 5.0, 0.5),
    in_panel("a panel's focus distance", "the wave, and the image distance a little",
             lambda d: shown(1.2, large(focus_distance=d)), 2.0, 0.3),
    in_panel("a panel's lens' aberration", "nodes inside the pixels",
             lambda s: shown(1.9, camera(stop_of(1.1e-3, aberrations=((4, 0, s), (3, 1, 1e-7))))),
             1e-7, WAVELENGTH / 6),
    in_panel("a panel's window", "the envelope of a pixel moves as well as the kernel",
             lambda x: shown(1.9, pixels=Plane((4, 5), (1e-5, 1e-5), (9e-4, x))), 7e-4, 3e-5),
    # Sums
    Agrees("the derivative of a transform in its scale", "adjoints, off the axis on both sides",
           "7x6 to 4x5 samples", stretched, stretched_sums, "differences of the sum",
           tols=(1e-5, 1e-8)),
    Agrees("a derivative of two colours", "one distance, two operators", "450 and 650 nm",
           of_colours, differences_of_colours, "differences of Gauss-Legendre sums",
           tols=(1e-2, 1e-6)),
    # Laws of autograd
    Holds("lengths that are tensors", "torch warns where a tensor that wants a derivative becomes "
          "a number", "warnings are errors", without_a_warning, "silence", tols=(SINGLE,)),
    *(
        Holds(f"an optimiser moves the {what}", "a plan was made for the old number",
              f"{low:g} to {high:g} m, in place", moved_in_place(view, low, high),
              "the new number's own plan, or a refusal", tols=(1e-6,))
        for what, view, low, high in (
            ("wavelength", lambda w: View(LENS, FEW, 1.9, w), 550e-9, 600e-9),
            ("window", lambda x: View(LENS, Plane((4, 5), (3e-6, 3e-6), (0.0, x)), 1.9), 0.0, 4e-6),
            ("focus", lambda d: View(replace(LENS, focus_distance=d), FEW, 1.9), 2.0, 2.1),
        )
    ),
    Holds("two backward passes", "what is kept from the first has lost its graph", "twice", twice,
          "each other"),
    Holds("five steps of descent", "a gradient with a wrong sign or scale shows at once",
          "SGD on a pattern", steps_that_descend, "a falling loss"),
    Holds("types of gradients", "double precision inside, single outside", "float32, float64",
          kept_types, "the type of what is differentiated"),
    Holds("no graph where none is wanted", "what no_grad() made must not be kept for later",
          "torch.no_grad(), then without", without_a_graph, "the same numbers"),
    Holds("a batch of gradients", "sums over leading axes", "3 patterns", of_each, "each alone"),
]  # fmt: skip
