"""PSFs behind a panel: patterns, stops across pixels, orders, tensors of all kinds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from judges import by_panel
from judges.view import WAVELENGTH, View
from numpy.typing import NDArray

from hard_cases.table import DOUBLE, SINGLE, Agrees, Case, Holds, Refused, Seen, require_close
from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.stop import Circle, Stop, regular_polygon
from optics.plane import Plane
from optics.psf import PolychromaticPSF, PSFOperator

CAMERA = Camera(
    Panel((12, 15), 40e-6, 0.81, unmodulated=0.0), Lens(0.125, 5.0, 2.0), Sensor((20, 21), 20e-6)
)


def camera(lens: dict[str, Any] | None = None, **panel: Any) -> Camera:
    return replace(
        CAMERA, panel=replace(CAMERA.panel, **panel), lens=replace(CAMERA.lens, **(lens or {}))
    )


def stop_of(diameter: float, **lens: Any) -> dict[str, Any]:
    """A lens whose stop is so wide, metres."""
    return {"f_number": CAMERA.lens.focal_length / diameter, **lens}


def window(rows: int, columns: int, y: float = 0.0, x: float = 0.0) -> Plane:
    return CAMERA.sensor.window_plane((rows, columns), centre=(y, x))


def random(optics: Camera = CAMERA, waves: float = 1.0, seed: int = 0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 2 * np.pi * waves, optics.panel.shape)


def neutral(optics: Camera = CAMERA) -> NDArray[np.float64]:
    return np.zeros(optics.panel.shape)


def squares(optics: Camera = CAMERA) -> NDArray[np.float64]:
    """0 and pi in turn, which cancel on the axis."""
    return np.pi * (np.indices(optics.panel.shape).sum(0) % 2)


def seen(
    name: str,
    hard_because: str,
    optics: Camera = CAMERA,
    pixels: Plane | None = None,
    distance: float = 2.0,
    pattern: Callable[[Camera], NDArray[Any]] = random,
    integrate: bool = True,
    **row: Any,
) -> Seen:
    """A row about a camera that shows a pattern."""
    view = View(
        optics, pixels or window(5, 6), distance, integrate=integrate, phase=pattern(optics)
    )
    return Seen(name, hard_because, view, by_panel, **row)


def order(number: int) -> float:
    """Metres to a diffraction order of the panel's pixels."""
    return number * WAVELENGTH * CAMERA.lens.image_distance / CAMERA.panel.pitch


# Laws


def operator(tol: float = SINGLE, optics: Camera = CAMERA, **settings: Any) -> PSFOperator:
    return PSFOperator(optics, 2.0, WAVELENGTH, window(5, 6), tol=tol, **settings)


PHASE = torch.from_numpy(random())


def lost_fraction(tol: float) -> None:
    """Any phase will do, but the picture is finite and no brighter than a neutral one."""
    light = operator(tol)(PHASE * 1e18)
    assert torch.isfinite(light).all()
    assert float(light.sum()) <= float(operator(tol)(torch.zeros(12, 15)).sum())


def unwrapped(tol: float) -> None:
    """Whole waves more change nothing, in value and in gradient."""
    whole = np.random.default_rng(1).integers(-(10**5), 10**5, PHASE.shape)
    answers = []
    for phase in (PHASE, PHASE + torch.from_numpy(2 * np.pi * whole)):
        phase = phase.clone().requires_grad_()
        light = operator(tol)(phase)
        (light**2).sum().backward()
        answers.append((light, phase.grad))
    require_close(answers[1][0], answers[0][0].detach(), max(1e-8, 1e-3 * tol))
    require_close(answers[1][1], answers[0][1], max(1e-7, 1e-2 * tol))


def no_light(tol: float) -> None:
    """Zero light and zero gradients, not 0 / 0."""
    phase = PHASE.clone().requires_grad_()
    amplitude = torch.zeros(12, 15, dtype=torch.float64, requires_grad=True)
    light = operator(tol)(phase, amplitude)
    (light**2).sum().backward()
    for zero in (light.detach(), phase.grad, amplitude.grad):
        assert zero is not None
        assert not zero.any()


def squares_cancel(tol: float) -> None:
    """|u| has no derivative at u = 0; |u|² has: zero."""
    phase = torch.from_numpy(squares()).requires_grad_()
    point = PSFOperator(CAMERA, 2.0, WAVELENGTH, window(1, 1), tol=tol, integrate=False)
    # An odd column is left over: cover it.
    amplitude = torch.ones(12, 15)
    amplitude[:, -1] = 0
    light = point(phase, amplitude)
    light.sum().backward()
    most = float(point(torch.zeros(12, 15)).sum())
    assert float(light.detach().sum()) <= 1e-12 * most
    assert phase.grad is not None
    assert torch.isfinite(phase.grad).all()
    assert float(phase.grad.abs().max()) <= 1e-6 * most


def one_pixel_shows_nothing(tol: float) -> None:
    """The phase of the only open pixel changes no intensity: its gradient is zero."""
    optics = camera(stop_of(20e-6))
    phase = PHASE.clone().requires_grad_()
    light = operator(tol, optics)(phase)
    (light**2).sum().backward()
    assert phase.grad is not None
    assert float(phase.grad.abs().max()) <= 1e-6 * float((light.detach() ** 2).sum())


def batches(tol: float) -> None:
    """Leading axes are pictures of their own, whatever their number."""
    phases = torch.stack([torch.from_numpy(random(seed=s)) for s in range(6)]).reshape(2, 3, 12, 15)
    together = operator(tol)(phases)
    assert together.shape == (2, 3, 5, 6)
    require_close(together[1, 2], operator(tol)(phases[1, 2]), max(1e-12, 1e-3 * tol))


def a_dark_picture_among_others(tol: float) -> None:
    """The bright one is what it is alone; the dark one is exactly dark."""
    far = View(CAMERA, window(5, 6, 0.9e-3, 0.9e-3), phase=neutral())
    amplitude = torch.stack([torch.zeros(12, 15), torch.ones(12, 15)])
    light = far.operator(tol)(torch.zeros(12, 15), amplitude)
    assert not light[0].any()
    require_close(light[1], by_panel(far), tol)


def no_pictures(tol: float) -> None:
    """None in, none out."""
    assert operator(tol)(torch.zeros(0, 12, 15)).shape == (0, 5, 6)


def kinds_of_arrays() -> dict[str, Any]:
    """The same numbers, kept in unusual ways."""
    array = PHASE.numpy()
    read_only = array.copy()
    read_only.setflags(write=False)
    return {
        "transposed tensor": PHASE.T.contiguous().T,
        "every other column": torch.stack([PHASE, PHASE], -1).flatten(-2)[:, ::2],
        "expanded": PHASE[None].expand(1, 12, 15)[0],
        "read-only array": read_only,
        "Fortran's order": np.asfortranarray(array),
        "flipped twice": array[::-1].copy()[::-1],
        "the other endianness": array.astype(array.dtype.newbyteorder()),
    }


def kept_as(name: str) -> Callable[[float], None]:
    def law(tol: float) -> None:
        value = kinds_of_arrays()[name]
        light = operator(tol)(value)
        assert isinstance(light, type(value))
        require_close(light, operator(tol)(PHASE), 1e-12)

    return law


def conjugated(tol: float) -> None:
    """torch only marks a conjugate; whoever looks at its parts must resolve it."""
    amplitude = torch.polar(torch.ones_like(PHASE), PHASE)
    require_close(operator(tol)(None, amplitude.conj()), operator(tol)(-PHASE), max(1e-12, tol))


def whole_numbers(tol: float) -> None:
    """Phases of 0, 1, 2 … rad, kept in bytes."""
    numbers = torch.arange(180, dtype=torch.uint8).reshape(12, 15)
    require_close(operator(tol)(numbers), operator(tol)(numbers.double()), 1e-12)


def mixed_precision(tol: float) -> None:
    """Under autocast torch multiplies in eight bits; optics may not."""
    plain = operator(tol)(PHASE)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        require_close(operator(tol)(PHASE), plain, 1e-12)


def strength(factor: float) -> Callable[[float], None]:
    def law(tol: float) -> None:
        amplitude = torch.full((12, 15), factor, dtype=torch.float64)
        light = operator(tol)(PHASE, amplitude).double() / factor**2
        require_close(light, operator(tol)(PHASE).double(), tol)

    return law


def all_unmodulated(tol: float) -> None:
    """Whatever is shown, the light is that of a neutral panel."""
    light = operator(tol, unmodulated=1.0)(PHASE)
    require_close(light, operator(tol)(torch.zeros(12, 15)), max(1e-12, tol))


def all_orders(tol: float) -> None:
    """A window of 41 orders gets all light but the envelope's tails."""
    pixels = Plane((41, 41), (order(1), order(1)))
    full = camera(fill_factor=1.0)
    light = PSFOperator(full, 2.0, WAVELENGTH, pixels, tol=tol)(PHASE)
    assert 1 - 2 * 1.1 / (np.pi**2 * 20.5) - tol <= float(light.sum()) <= 1 + tol


def two_colours(tol: float) -> torch.Tensor:
    colours = PolychromaticPSF(CAMERA, 1.9, (450e-9, 650e-9), (1, 3), window(5, 6), tol=tol)
    return colours(torch.stack([PHASE, 0.6 * PHASE]))


def by_colours() -> NDArray[Any]:
    blue, red = (
        by_panel(View(CAMERA, window(5, 6), 1.9, wavelength, phase=phase * PHASE.numpy()))
        for wavelength, phase in ((450e-9, 1.0), (650e-9, 0.6))
    )
    return 0.25 * blue + 0.75 * red


STEEP = camera(stop_of(12.5e-3, kind="stigmatic"), shape=(10, 12), pitch=400e-6)

CASES: list[Case] = [
    # Phases
    seen(
        "single-precision phases of 1e5 rad",
        "multiplied by anything in single precision, they lose their fraction",
        pattern=lambda optics: random(optics, 16_000).astype(np.float32),
    ),
    seen(
        "double-precision phases of 1e5 waves",
        "stored in single precision before they are reduced, they are noise",
        pattern=lambda optics: random(optics, 1e5),
    ),
    Holds(
        "wrapped and unwrapped phases",
        "2e5 waves between neighbours",
        "random phases, random whole waves",
        unwrapped,
        "each other",
    ),
    Holds(
        "phases that have lost their fraction",
        "at 1e18 rad even double precision knows no fraction",
        "random phases of 1e18 rad",
        lost_fraction,
        "finite, and no brighter than neutral",
    ),
    # Sizes
    seen(
        "an odd panel, an even window",
        "half a sample of shift is the classical error of one of the parities",
        camera(shape=(11, 13)),
        window(4, 6),
    ),
    seen(
        "an even panel, an odd window",
        "the other parity",
        camera(shape=(12, 14)),
        window(5, 7),
    ),
    seen(
        "a panel of one pixel",
        "nothing interferes: one envelope, whatever the phase",
        camera(shape=(1, 1)),
    ),
    seen(
        "a window of one pixel",
        "its margin is larger than itself",
        pixels=window(1, 1),
    ),
    seen(
        "a row of pixels behind a column of pixels",
        "axes of length 1 on opposite sides",
        camera(shape=(30, 1)),
        window(1, 20),
    ),
    seen(
        "sensor pixels twelve times wider than high",
        "one pitch for both axes is the usual assumption",
        pixels=Plane((6, 3), (5e-6, 60e-6)),
    ),
    seen(
        "a sensor pixel that takes in whole orders",
        "a sample at its centre would see the brightest order alone",
        pixels=Plane((2, 3), (3e-3, 3e-3)),
    ),
    seen(
        "sensor pixels of ten nanometres",
        "the finest fringe is ten thousand of them",
        pixels=Plane((2, 3), (1e-8, 1e-8)),
    ),
    seen(
        "a panel that is nearly all gap",
        "a thousandth of its area modulates: hundreds of orders of equal strength",
        camera(fill_factor=1e-3),
        window(4, 4, 0.0, order(7)),
    ),
    # Stops
    seen(
        "a stop smaller than a panel pixel, at points",
        "an eighth of one pixel is open: a mask of 0 and 1 would be closed",
        camera(stop_of(16e-6)),
        integrate=False,
    ),
    seen(
        "a stop smaller than a panel pixel, on pixels",
        "the light's finest fringe is that of the pixel's square, not of the stop",
        camera(stop_of(16e-6)),
        Plane((2, 3), (2e-3, 2e-3)),
        tols=(1e-4, DOUBLE),
    ),
    seen(
        "a stop of an ångström",
        "1e-12 of one pixel is open: areas must not vanish in differences of areas",
        camera(stop_of(1e-10)),
        integrate=False,
    ),
    seen(
        "a stop of two pixels",
        "its edge covers every pixel in part",
        camera(stop_of(90e-6)),
        window(5, 6),
    ),
    seen(
        "a stop that cuts the panel",
        "an edge of stairs is 1 % off",
        camera(stop_of(0.41e-3)),
    ),
    seen(
        "a hexagon across the panel, out of focus",
        "slanted edges through pixels whose wave is bent",
        camera(stop_of(0.5e-3, stop=Stop(regular_polygon(6), (Circle(0.2),)))),
        distance=1.5,
    ),
    seen(
        "a stop larger than the panel",
        "the panel is the aperture: cut-off and normalisation are its own",
        camera(stop_of(25e-3)),
    ),
    # Defocus
    seen(
        "an object at infinity, focus near",
        "half a dioptre bends the wave inside every panel pixel",
        distance=math.inf,
    ),
    seen(
        "object and focus at infinity",
        "inf - inf must not happen; one wave of curvature is the panel's own",
        camera({"focus_distance": math.inf}),
        distance=math.inf,
    ),
    seen(
        "coarse pixels, very close",
        "waves of defocus inside a single panel pixel",
        camera(pitch=300e-6, shape=(4, 5)),
        distance=0.25,
    ),
    seen(
        "a slight defocus on light that cancels",
        "squares of 0 and pi: what is left on the axis comes from the bend inside the pixels",
        distance=1.9,
        pattern=squares,
        tols=(1e-2, SINGLE, DOUBLE),
    ),
    seen(
        "a stigmatic lens very close to a coarse panel",
        "a hundred radians across every panel pixel, and no parabola to integrate by matrices",
        STEEP,
        window(3, 3),
        0.1,
    ),
    seen(
        "a first order's window behind wide pixels, out of focus",
        "the envelope is near its null there, and light that the wave bends inside a pixel isn't",
        camera(fill_factor=0.95),
        pixels=window(5, 6, order(1), order(1)),
        distance=1.2,
    ),
    seen(
        "a neutral panel's first order, out of focus",
        "no pattern spreads the light, so that the pixel's own wave is all that is seen",
        camera(fill_factor=0.95),
        pixels=window(5, 6, order(1), order(1)),
        distance=1.6,
        pattern=neutral,
    ),
    seen(
        "a window ten orders away, out of focus",
        "tilts of ten turns a pixel, and a wave that bends in each",
        pixels=window(3, 4, order(10), -order(7)),
        distance=1.5,
    ),
    seen(
        "an aberrated lens",
        "no symmetry; the polynomial is steepest at the panel's corners",
        camera(stop_of(1.1e-3, aberrations=((4, 0, 200e-9), (3, 1, 300e-9)))),
        distance=1.9,
    ),
    seen(
        "a polynomial of degree 8 at a rim that cuts pixels",
        "just beyond the disc it is twice as steep as anywhere inside",
        camera(stop_of(0.2e-3, aberrations=((8, 0, 20e-9),)), pitch=20e-6),
        window(3, 3),
        tols=(1e-6,),
    ),
    # Far from the axis, and in the dark
    seen(
        "a window in the fifth order",
        "the kernel turns by five waves across a panel pixel",
        pixels=window(5, 6, order(5)),
    ),
    seen(
        "a window in the dark",
        "a millionth of the light: what single precision loses of the rest would be seen",
        pixels=window(5, 6, 0.9e-3, 0.9e-3),
        pattern=neutral,
    ),
    seen(
        "a window two centimetres away",
        "eleven orders out, a 1e-10th of the light, tilts of 11 turns a pixel",
        pixels=window(3, 4, 0.02, -0.02),
    ),
    Holds(
        "a dark picture among bright ones",
        "whoever asks for the darkest of a batch finds zero",
        "amplitudes 0 and 1, window in the dark",
        a_dark_picture_among_others,
        "Gauss-Legendre over every pixel of the panel and of the sensor",
    ),
    # Nothing
    Holds(
        "an amplitude of zero everywhere",
        "no light over no light",
        "amplitude 0",
        no_light,
        "zero, in value and gradient",
    ),
    Holds(
        "light that cancels exactly",
        "the gradient of |u| at 0 is NaN",
        "squares of 0 and pi, one point on the axis",
        squares_cancel,
        "zero, in value and gradient",
    ),
    Holds(
        "one open pixel",
        "its phase turns the field and changes no light",
        "stop of half a pixel",
        one_pixel_shows_nothing,
        "a gradient of zero",
    ),
    Holds(
        "a panel that modulates nothing",
        "pattern and neutral light add with weights 0 and 1",
        "unmodulated 1",
        all_unmodulated,
        "the neutral panel",
    ),
    seen(
        "a third of the light unmodulated",
        "it adds in intensity, not in amplitude",
        camera(unmodulated=0.3),
    ),
    Holds(
        "all orders together",
        "normalised sums hide what falls beside the window",
        "41x41 orders, no gaps",
        all_orders,
        "energy",
    ),
    # Tensors
    Holds(
        "a batch of batches",
        "axes are flattened for one library and not for the other",
        "phases (2, 3, 12, 15)",
        batches,
        "each alone",
    ),
    Holds(
        "a batch of none",
        "the minimum of nothing",
        "phases (0, 12, 15)",
        no_pictures,
        "an empty answer",
        tols=(SINGLE,),
    ),
    *(
        Holds(
            f"phases kept in {name}" if "order" in name or "endian" in name else f"phases: {name}",
            "strides and byte orders that torch or numpy don't share",
            "12x15 phases",
            kept_as(name),
            "the same numbers in a plain tensor; arrays are answered with arrays",
            tols=(SINGLE,),
        )
        for name in kinds_of_arrays()
    ),
    Holds(
        "a conjugated amplitude",
        "torch only marks a conjugate; its parts can't be looked at before it is resolved",
        "complex amplitude.conj()",
        conjugated,
        "the phase of opposite sign",
        tols=(SINGLE,),
    ),
    Holds(
        "phases in whole numbers",
        "0, 1, 2 … in bytes",
        "uint8",
        whole_numbers,
        "the same in double precision",
        tols=(SINGLE,),
    ),
    Holds(
        "mixed precision",
        "autocast multiplies in eight bits: two digits",
        "torch.autocast, bfloat16",
        mixed_precision,
        "the same outside",
    ),
    Holds(
        "very faint light",
        "the square of 1e-22 is zero in single precision",
        "amplitude 1e-22",
        strength(1e-22),
        "amplitude 1, scaled",
        tols=(SINGLE,),
    ),
    Holds(
        "very bright light",
        "the square of 1e20 is infinite in single precision",
        "amplitude 1e20",
        strength(1e20),
        "amplitude 1, scaled",
        tols=(SINGLE,),
    ),
    # Colours
    Agrees(
        "two colours",
        "each wavelength has its own scale, phases and defocus; weights needn't sum to 1",
        "450 and 650 nm, weights 1 and 3",
        two_colours,
        by_colours,
        "Gauss-Legendre over every pixel of the panel and of the sensor, for each",
    ),
    Refused(
        "colours without weight",
        "normalised by a sum of zero",
        "weights (0, 0)",
        lambda: PolychromaticPSF(CAMERA, 2.0, (450e-9, 650e-9), (0, 0), window(3, 3)),
        "weights must be finite and not negative, and one of them positive",
        lambda tol: PolychromaticPSF(CAMERA, 2.0, (450e-9, 650e-9), (0, 1), window(3, 3))(),
    ),
    # Refusals
    Refused(
        "NaN among the phases",
        "one NaN makes every sample NaN",
        "1 of 180",
        lambda: operator()(PHASE.clone().index_fill(0, torch.tensor(3), math.nan)),
        "phase has 15 NaN or infinite values of 180; give finite numbers",
        lambda tol: operator()(PHASE),
    ),
    Refused(
        "an infinite amplitude",
        "inf - inf in a sum",
        "1 of 180",
        lambda: operator()(PHASE, torch.full((12, 15), math.inf)),
        "amplitude has 180 NaN or infinite values",
        lambda tol: operator()(PHASE, torch.full((12, 15), 2.0)),
    ),
    Refused(
        "a complex phase",
        "its imaginary part is dropped with a warning, or none",
        "complex128",
        lambda: operator()(PHASE + 1j),
        "phase is .*complex",
        lambda tol: operator()(PHASE, torch.full((12, 15), math.exp(-1))),
    ),
    Refused(
        "a transposed phase",
        "180 numbers either way",
        "(15, 12)",
        lambda: operator()(PHASE.T),
        r"phase is \(15, 12\); the pupil has \(12, 15\) pixels",
        lambda tol: operator()(PHASE),
    ),
    Refused(
        "a closed stop",
        "no light over no light would be NaN everywhere",
        "f/1e100",
        lambda: operator(optics=camera({"f_number": 1e100})),
        r"covers the whole panel: no light passes; open it \(f_number is 1e\+100\)",
        lambda tol: operator(optics=camera({"f_number": 1e4}))(PHASE),
    ),
    Refused(
        "an object on the panel",
        "a micrometre away the wave turns by 1e5 radians across a pixel",
        "object at 1e-6 m",
        lambda: PSFOperator(CAMERA, 1e-6, WAVELENGTH, window(3, 3)),
        "bring the object closer to the plane in focus",
        lambda tol: operator()(PHASE),
    ),
    Refused(
        "an object before the panel, nearer than a wavelength",
        "a length in another unit, not a place: no lens forms an image of it",
        "object at 1e-9 m",
        lambda: PSFOperator(CAMERA, 1e-9, WAVELENGTH, window(3, 3)),
        "distance is 1e-09 m, less than a wavelength.* in metres",
        lambda tol: operator()(PHASE),
    ),
    *(
        Refused(
            f"a window at {value:g} m",
            "a position that is no number makes light that is none",
            f"centre ({value:g}, 0)",
            lambda value=value: PSFOperator(
                CAMERA, 2.0, WAVELENGTH, Plane((3, 3), (1e-6, 1e-6), (value, 0.0))
            )(PHASE),
            "centre .* finite",
            lambda tol: operator()(PHASE),
        )
        for value in (math.inf, math.nan)
    ),
    Refused(
        "pixels of infinite size",
        "0 x inf is NaN at the origin",
        "pitch inf",
        lambda: PSFOperator(CAMERA, 2.0, WAVELENGTH, Plane((3, 3), (math.inf, 1e-6)))(PHASE),
        "pitch .* finite",
        lambda tol: operator()(PHASE),
    ),
]
