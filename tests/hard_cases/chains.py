"""The camera's chain: panel, space, lens and stop, space, sensor (thesis §5.3)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from judges import Apart, by_chain, by_panel
from judges.view import WAVELENGTH, View
from numpy.typing import NDArray

from hard_cases.panels import camera, neutral, random, squares, stop_of
from hard_cases.table import (
    DOUBLE,
    SINGLE,
    Case,
    Holds,
    Refused,
    Seen,
    Slope,
    require_close,
)
from optics.accuracy import Budget
from optics.camera import Camera
from optics.camera.stop import Circle, Stop, regular_polygon
from optics.plane import Plane
from optics.psf import PSFOperator

POINTS = Plane((3, 4), (20e-6, 30e-6), (1e-5, -2e-5))
PIXELS = Plane((3, 4), (20e-6, 20e-6))
STOP = 0.9e-3


def apart(
    separation: Any = 0.05, lens: dict[str, Any] | None = None, stop: float = STOP, **panel: Any
) -> Camera:
    """A panel of 8 x 9 pixels of 40 µm, 5 cm before a 125 mm lens, unless told otherwise."""
    optics = camera(stop_of(stop, **(lens or {})), **{"shape": (8, 9), **panel})
    return replace(optics, separation=separation)


def at(
    optics: Camera | None = None,
    distance: Any = 1.5,
    pattern: Callable[[Camera], NDArray[Any]] = random,
    pixels: Plane = POINTS,
    **view: Any,
) -> Apart:
    """What a point sends through a chain to points around its image, or to whole pixels."""
    optics = optics or apart()
    return Apart(
        optics, pixels, distance, integrate=pixels is PIXELS, phase=pattern(optics), **view
    )


def seen(name: str, hard_because: str, view: Apart, **row: Any) -> Seen:
    return Seen(name, hard_because, view, by_chain, **row)


def off(share: float, stop: float = STOP) -> tuple[float, float]:
    """The place on the sensor at which the panel's shadow has left the axis by so many of the
    stop's radii."""
    optics = apart()
    spread = 1 + optics.separation / 1.5
    away = share * stop / 2 * optics.lens.image_distance / optics.separation / spread
    return 0.6 * away, -0.8 * away


def steep(optics: Camera) -> NDArray[np.float64]:
    """Thousands of waves between neighbours, and a fraction of one that counts."""
    return random(optics, 5000.0)


# Laws


def light(view: Apart, tol: float) -> NDArray[Any]:
    return np.asarray(view.light(view.operator(tol)).detach(), dtype=float)


@cache
def usual_light(tol: float) -> NDArray[Any]:
    """Of the question that most rows change a little: it is answered."""
    return light(at(), tol)


def attempt(view: Apart, tol: float) -> tuple[NDArray[Any], str]:
    """The light, or zeros and what the refusal says."""
    try:
        return light(view, tol), ""
    except ValueError as error:
        return np.zeros(view.pixels.shape), str(error)


def continuous_from_zero(tol: float) -> None:
    """A panel that nearly touches the lens is one that does; where a stop cuts pixels, but for
    their edges, which are their covered share of light as long as both stand together."""
    for stop in (4e-3, 0.2e-3) if tol >= SINGLE else (4e-3,):
        view = at(apart(0.0, stop=stop))
        together = by_panel(View(view.optics, POINTS, 1.5, integrate=False, phase=view.phase))
        require_close(light(view, tol), together, tol)
        for z1, allowed in ((1e-12, 0.0), (1e-9, 1e-4)):
            near = light(replace(view, optics=apart(z1, stop=stop)), tol)
            allowed = allowed if stop > 1e-3 else 0.1
            assert np.linalg.norm(near - together) <= (tol + allowed) * np.linalg.norm(together)


def far_and_farthest(tol: float) -> None:
    """From 1e3 m on the light tends to that of infinity, and is there without a NaN."""
    infinite = light(at(distance=math.inf), tol)
    for distance, allowed in ((1e4, 1e-4), (1e6, 1e-6), (1e9, 1e-9), (1e15, 0.0)):
        near = light(at(distance=distance), tol)
        assert np.linalg.norm(near - infinite) <= (2 * tol + allowed) * np.linalg.norm(infinite)


def far_sphere(tol: float) -> None:
    """The exact wave of a far point is its parabola, on the axis and off it, up to infinity."""
    for place in ((0.0, 0.0), off(0.5)):
        for distance in (1e3, math.inf) if any(place) else (1e3,):
            view = at(distance=distance, off_axis=place)
            exact = light(replace(view, sphere=True), tol)
            # Off the axis a sphere is dimmer by the square of its cosine, 2e-6 here.
            require_close(exact, light(view, tol), 2 * tol + 1e-4)


def vignetted(tol: float) -> None:
    """The farther off the axis, the less light, down to none: never NaN, and no refusal
    without words."""
    totals = []
    for share in (0.0, 0.7, 1.0, 1.3, 2.0, 5.0, 30.0):
        view = at(pattern=neutral, off_axis=off(share), pixels=PIXELS)
        found, words = attempt(view, tol)
        assert not words or (share >= 2 and "light" in words)
        totals.append(float(found.sum()))
    assert all(map(math.isfinite, totals))
    assert min(totals) >= 0
    assert all(later <= earlier for earlier, later in pairwise(totals))
    assert totals[-1] <= 1e-3 * totals[0]


def shifted_stop(tol: float) -> None:
    """A stop whose only hole is beside the panel's shadow: next to nothing, and finite."""
    view = at(apart(lens={"stop": Stop(Circle(0.02, (0.0, 0.97)))}, stop=20e-3), pattern=neutral)
    found, words = attempt(view, tol)
    assert not words or "light" in words
    assert np.isfinite(found).all()
    assert found.min() >= 0


def no_more_light(tol: float) -> None:
    """A window of many orders gets no more than there is, at any place and separation."""
    wide = Plane((24, 25), (150e-6, 150e-6))
    for z1 in (1e-3, 0.05, 1.0):
        for place in ((0.0, 0.0), off(0.8)):
            view = replace(at(apart(z1), pixels=PIXELS, off_axis=place), pixels=wide)
            assert 0 <= light(view, tol).sum() <= 1 + tol


def mirrored(tol: float) -> None:
    """Panel, place and window turned by half a turn: the light is turned as well."""
    odd = apart(shape=(7, 9))
    pattern = random(odd)
    one = Apart(odd, Plane((5, 7), (2e-5, 2e-5)), 1.5, integrate=False, phase=pattern,
                off_axis=off(0.7))  # fmt: skip
    other = replace(one, phase=pattern[::-1, ::-1].copy(), off_axis=tuple(-p for p in off(0.7)))  # type: ignore[arg-type]
    require_close(light(other, tol)[::-1, ::-1].copy(), light(one, tol), 2 * tol)


def all_ways(tol: float) -> None:
    """Every method that accepts a chain."""
    small = apart(0.01, stop=1.2e-3, shape=(3, 2), pitch=20e-6)
    for view in (at(small), at(apart(1.0))):
        truth, accepted = by_chain(view), 0
        for method in ("collapsed", "chain", "chain, quadrature"):
            one = replace(view, method=method)
            try:
                operator = one.operator(tol)
            except ValueError:
                continue
            accepted += 1
            require_close(one.light(operator), truth, tol)
        assert accepted


def unwrapped(tol: float) -> None:
    """Whole waves more change nothing, in value and gradient."""
    whole = 2 * np.pi * np.random.default_rng(1).integers(-(10**5), 10**5, (8, 9))
    operator, answers = at().operator(tol), []
    for phase in (random(apart()), random(apart()) + whole):
        shown = torch.from_numpy(phase).requires_grad_()
        found = operator(shown)
        (found**2).sum().backward()
        answers.append((found.detach(), shown.grad))
    require_close(answers[1][0], answers[0][0], max(1e-8, 1e-3 * tol))
    require_close(answers[1][1], answers[0][1], max(1e-7, 1e-2 * tol))


def no_light(tol: float) -> None:
    """An amplitude of zero: zeros and zero gradients; beside bright pictures as well."""
    operator = at().operator(tol)
    phase = torch.from_numpy(random(apart())).requires_grad_()
    amplitude = torch.zeros(8, 9, dtype=torch.float64, requires_grad=True)
    found = operator(phase, amplitude)
    (found**2).sum().backward()
    for zero in (found.detach(), phase.grad, amplitude.grad):
        assert zero is not None
        assert not zero.any()
    both = operator(phase.detach(), torch.stack([0 * amplitude, 1 + 0 * amplitude]).detach())
    assert not both[0].any()
    require_close(both[1], by_chain(at()), tol)


def batches(tol: float) -> None:
    """Leading axes are pictures of their own; none is none."""
    operator = at().operator(tol)
    phases = torch.from_numpy(np.stack([random(apart(), seed=s) for s in range(4)]))
    together = operator(phases.reshape(2, 2, 8, 9))
    assert together.shape == (2, 2, 3, 4)
    require_close(together[1, 0], operator(phases[2]), max(1e-12, 1e-2 * tol))
    assert operator(phases[:0]).shape == (0, 3, 4)


def mixed_precision(tol: float) -> None:
    operator, phase = at().operator(tol), torch.from_numpy(random(apart()))
    plain = operator(phase)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        require_close(operator(phase), plain, 1e-12)


def strength(factor: float) -> Callable[[float], None]:
    def law(tol: float) -> None:
        amplitude = torch.full((8, 9), factor, dtype=torch.float64)
        found = at().operator(tol)(torch.from_numpy(random(apart())), amplitude)
        require_close(found.double() / factor**2, by_chain(at()), tol)

    return law


def two_steps(tol: float) -> None:
    """A second backward pass through one plan finds a graph of its own."""
    separation = torch.tensor(0.05, dtype=torch.float64, requires_grad=True)
    operator = quietly(lambda: at(apart(separation)).operator(tol))
    phase = torch.from_numpy(random(apart())).requires_grad_()
    found: list[tuple[float, float]] = []
    for _ in range(2):
        separation.grad = phase.grad = None
        quietly(lambda: operator(phase))[1, 2].backward()
        assert separation.grad is not None
        assert phase.grad is not None
        found.append((float(separation.grad), float(phase.grad.abs().sum())))
    assert found[0] == found[1]
    assert 0 not in found[0]


def descends(tol: float) -> None:
    """Five steps down the gradient put more light on a pixel each time."""
    phase = torch.from_numpy(random(apart(), seed=3)).requires_grad_()
    operator = at(apart(stop=SMALL_STOP)).operator(tol)
    scale = float(operator(phase).detach().max())
    optimiser = torch.optim.SGD([phase], lr=1.0)
    losses = []
    for _ in range(5):
        optimiser.zero_grad()
        loss = -operator(phase)[1, 2] / scale
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert all(later < earlier for earlier, later in pairwise(losses))


def moved(change: Callable[[Any], Apart], low: float, high: float) -> Callable[[float], None]:
    def law(tol: float) -> None:
        """After an optimiser's step the answer is the new number's, or a refusal."""
        number = torch.tensor(low, dtype=torch.float64, requires_grad=True)
        operator = quietly(lambda: change(number).operator(tol))
        phase = torch.from_numpy(random(apart()))
        quietly(lambda: operator(phase))
        with torch.no_grad():
            number.fill_(high)
        try:
            found = quietly(lambda: operator(phase))
        except ValueError:
            return
        require_close(found, by_chain(change(high)), tol)

    return law


def quietly(make: Callable[[], Any]) -> Any:
    """Without torch's warning about tensors that become numbers, which has a row of its own."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Converting a tensor with requires_grad")
        return make()


def at_infinity(tol: float) -> None:
    """1 / d² is zero, and no NaN comes out of inf x 0."""
    distance = torch.tensor(math.inf, dtype=torch.float64, requires_grad=True)
    view = at(distance=distance)
    quietly(lambda: view.light(view.operator(tol))).sum().backward()
    assert distance.grad is not None
    assert float(distance.grad) == 0


def refused(
    name: str,
    hard_because: str,
    given: str,
    ask: Callable[[], Any],
    words: str,
    remedy: Callable[[float], Any] | None = None,
) -> Refused:
    return Refused(name, hard_because, given, ask, words, remedy or usual_light)


def small(memory: int, shape: tuple[int, int], **settings: Any) -> PSFOperator:
    """A chain of many panel pixels, in little memory."""
    optics = apart(stop=20e-3, shape=shape)
    return PSFOperator(
        optics, 1.5, WAVELENGTH, POINTS, budget=Budget(memory=memory), tol=1e-2, **settings
    )


SMALL_STOP = 0.5e-3
HEXAGON = Stop(regular_polygon(6), (Circle(0.2, (0.1, -0.1)),))
ABERRATED = {"aberrations": ((3, 1, 200e-9), (4, 0, 150e-9))}


def in_chain(
    name: str,
    hard_because: str,
    view_of: Callable[[Any], Apart],
    at: float,
    unit: float,
    **row: Any,
) -> Slope:
    return Slope(name, hard_because, view_of, at, unit, by_chain, **row)


def _along(t: Any) -> Any:
    """A pattern and a share t of another one; a tensor if t is one."""
    one, other = random(apart()), random(apart(), seed=7)
    if isinstance(t, torch.Tensor):
        return torch.from_numpy(one) + t * torch.from_numpy(other)
    return one + t * other


def in_lens(value: str) -> Callable[[Any], Apart]:
    """A view for a value of a length of the lens; its stop stays what it is."""

    def view(x: Any) -> Apart:
        lens = {"focal_length": 0.125, "focus_distance": 2.0, value: x}
        lens["f_number"] = lens["focal_length"] / SMALL_STOP
        optics = apart()
        return at(replace(optics, lens=replace(optics.lens, **lens)))

    return view


CASES: list[Case] = [
    # Separations
    seen("a panel 5 cm before its lens", "its pixels' edges diffract before the stop cuts them",
         at()),
    seen("a panel 5 cm before its lens, on pixels", "fringes finer than a pixel of the sensor",
         at(pixels=PIXELS)),
    seen("a panel 1 cm before its lens", "hundreds of fringes from every edge, inside the stop",
         at(apart(0.01, stop=SMALL_STOP))),
    seen("a panel a metre before its lens", "the stop sees a single Fresnel zone of it",
         at(apart(1.0))),
    seen("a panel in the plane in focus", "the lens images it: no Fourier transform is left, 1 / 0",
         at(apart(2.0))),
    seen("a panel beyond the plane in focus", "its wave has the other curvature",
         at(apart(3.0))),
    seen("a panel in the front focal plane", "A of the ray matrix is what it is at infinity",
         at(apart(0.125))),
    Holds("a panel that nearly touches the lens", "1 / z1, and square roots of it",
          "0, 1 pm, 1 nm", continuous_from_zero, "the panel in the lens, pixel by pixel"),
    # Objects
    *(
        seen(f"a chain's object at {d:g} m", why, at(distance=d))
        for d, why in (
            (0.02, "closer to the lens than its focal length: no image, virtual or not, is near"),
            (0.075, "in the front focal plane of the lens, to the last digit"),
            (1.95, "the plane in focus, 2 m from the lens and not from the panel"),
            (math.inf, "1 / inf is 0, and inf - inf must not happen"),
        )
    ),
    seen("chain, object and focus at infinity", "two infinities that are equal",
         at(apart(lens={"focus_distance": math.inf}), math.inf)),
    seen("chain, focus at infinity", "1 / inf is 0 in the lever of the panel",
         at(apart(lens={"focus_distance": math.inf}), 3.0), tols=(SINGLE,)),
    Holds("a chain's object far away", "far terms that cancel only on paper",
          "1e4 m to ∞", far_and_farthest, "its limit",
          tols=(1e-6,)),
    seen("an exact sphere over the panel", "sqrt(d² + r²) - d, and its amplitude",
         at(distance=0.05, sphere=True), tols=(SINGLE, 1e-6)),
    Holds("exact spheres from far away", "tilted waves whose large phases cancel",
          "1 km and ∞, on and off the axis", far_sphere, "the parabola",
          tols=(SINGLE,)),
    # Panels and stops
    seen("a chain's panel far larger than its stop", "most of the panel never meets the stop",
         at(apart(shape=(40, 41), stop=0.3e-3))),
    seen("a chain's panel far smaller than its stop", "the stop cuts only diffracted light",
         at(apart(shape=(3, 2), pitch=20e-6, stop=1.6e-3))),
    seen("a chain's panel of one pixel", "one square's diffraction, and nothing else",
         at(apart(shape=(1, 1)))),
    seen("a chain's row of pixels", "an axis of length 1", at(apart(shape=(1, 20))),
         tols=(DOUBLE,)),
    seen("a chain's panel, nearly all gap", "hundreds of orders of equal strength",
         at(apart(fill_factor=1e-2))),
    seen("a chain's stop of ten micrometres", "smaller than a pixel: a pinhole in Fresnel's field",
         at(apart(stop=10e-6))),
    seen("a stop that cuts a chain's pixels", "light as the covered share of a pixel is light of a "
         "whole pixel",
         at(apart(1e-4, stop=0.1e-3, shape=(3, 4)),
            pixels=Plane((3, 4), (2e-4, 3e-4), (1e-5, -2e-5))), tols=(0.1, 1e-2)),
    seen("a hexagon behind a chain's panel", "slanted edges in fringes, and one inside",
         at(apart(lens={"stop": HEXAGON}))),
    seen("an aberrated lens behind a chain's panel", "a wave that no parabola follows",
         at(apart(lens=ABERRATED))),
    seen("a stigmatic lens behind a chain's panel", "differences of spheres",
         at(apart(lens={"kind": "stigmatic"}, stop=3e-3, separation=0.5))),
    Holds("a hole beside the panel's shadow", "no light over no light",
          "stop of 2 cm, closed but at its rim", shifted_stop, "finite, or refused in words",
          tols=(SINGLE,)),
    # Patterns
    seen("a chain's phase of thousands of waves", "stored in single precision it is noise",
         at(pattern=steep)),
    seen("a chain's pattern that cancels", "the axis is dark but for what the edges bend",
         at(pattern=squares)),
    seen("a third of a chain's light unmodulated", "it adds in intensity, through the same chain",
         at(apart(unmodulated=0.3)), tols=(DOUBLE,)),
    seen("an odd panel's chain on an even window", "half a sample of shift",
         at(apart(shape=(7, 9)), pixels=Plane((4, 4), (20e-6, 20e-6))), tols=(DOUBLE,)),
    seen("an even panel's chain on an odd window", "the other parity",
         at(apart(shape=(8, 10)), pixels=Plane((3, 5), (20e-6, 20e-6))), tols=(DOUBLE,)),
    seen("a chain's window of one point", "no neighbours",
         at(pixels=Plane((1, 1), (20e-6, 20e-6), (3e-5, 1e-5))), tols=(DOUBLE,)),
    seen("a chain's window in the third order", "the kernel turns by three waves a pixel",
         at(pixels=Plane((3, 4), (20e-6, 30e-6), (5.4e-3, 0.0))), tols=(SINGLE, 1e-6)),
    # Off the axis
    seen("a point half vignetted", "a sign of the shift, and the panel leaves on the wrong side",
         at(off_axis=off(1.0))),
    seen("a point that only a panel's corner reaches", "a per cent of the light",
         at(off_axis=off(1.4)), tols=(SINGLE, 1e-6)),
    seen("a point beyond vignetting", "diffracted light alone passes: a 1e-5th",
         at(pattern=neutral, off_axis=off(3.0)), tols=(SINGLE, 1e-6)),
    seen("a point off the axis, at infinity", "tilt times distance is inf x 0",
         at(distance=math.inf, off_axis=off(0.6))),
    seen("a point off the axis in the front focal plane", "its image isn't where its chief ray is",
         at(distance=0.075, off_axis=off(0.6))),
    Holds("from the axis to the dark", "0 / 0 beyond complete vignetting",
          "0 to 30 stop radii", vignetted, "less and less light, and no NaN", tols=(1e-2,)),
    Holds("a chain turned by half a turn", "a sign of one axis", "7x9 pixels, off the axis",
          mirrored, "symmetry", tols=(1e-6,)),
    Holds("power of a chain", "shares that are normalised by what is left", "24x25 of 0.15 mm",
          no_more_light, "no more than there is", tols=(SINGLE,)),
    Holds("a chain by all ways", "a method's error is invisible to itself",
          "1 cm to 1 m", all_ways, "Fresnel's integrals, line by line"),
    # Tensors
    Holds("a chain's phases, unwrapped", "2e5 waves between neighbours", "random whole waves",
          unwrapped, "each other"),
    Holds("a chain without light", "no light over no light", "amplitude 0", no_light,
          "zero, in value and gradient"),
    Holds("a chain's batches", "axes that are flattened", "phases (2, 2, 8, 9), and none",
          batches, "each alone", tols=(SINGLE,)),
    Holds("a chain under autocast", "eight bits for a chirp", "bfloat16", mixed_precision,
          "the same outside", tols=(SINGLE,)),
    Holds("a chain's very faint light", "squares of 1e-22", "amplitude 1e-22", strength(1e-22),
          "amplitude 1, scaled", tols=(SINGLE,)),
    Holds("a chain's very bright light", "squares of 1e20", "amplitude 1e20", strength(1e20),
          "amplitude 1, scaled", tols=(SINGLE,)),
    # Derivatives
    in_chain("in a chain's separation", "in spread, shift and every fringe at once",
             lambda z: at(apart(z, stop=SMALL_STOP)), 0.05, 5e-3),
    in_chain("in a chain's distance", "through 1 / d, in panel and stop",
             lambda d: at(apart(stop=SMALL_STOP), d), 0.3, 0.05),
    in_chain("in a chain's wavelength", "every fringe, and the picture's scale",
             lambda w: at(apart(stop=SMALL_STOP), wavelength=w), WAVELENGTH, 0.05 * WAVELENGTH),
    in_chain("in a chain's point off the axis", "the panel's shadow moves across the stop",
             lambda x: at(apart(stop=SMALL_STOP), off_axis=(0.2e-3, x)), 0.5e-3, 5e-5),
    in_chain("in a chain's point on the axis", "hypot(0, 0) has a NaN for a gradient",
             lambda x: at(apart(stop=SMALL_STOP), off_axis=(0.0, x)), 0.0, 5e-5),
    in_chain("in a chain's window", "the kernel alone",
             lambda x: at(apart(stop=SMALL_STOP), pixels=Plane((3, 4), (2e-5, 3e-5), (0.0, x))),
             1e-5, 5e-5),
    in_chain("in a chain's focal length", "image distance and scale follow; the stop doesn't",
             in_lens("focal_length"), 0.125, 0.01),
    in_chain("in a chain's focus", "the wave in the stop, and the lever",
             in_lens("focus_distance"), 2.0, 0.5),
    in_chain("in a chain's aberration of zero", "it isn't there: who leaves it out has none",
             lambda s: at(apart(lens={"aberrations": ((3, 1, s),)}, stop=SMALL_STOP)), 0.0, 1e-7),
    in_chain("in a chain's sphere", "the distance is in its amplitude too",
             lambda d: at(apart(stop=SMALL_STOP), d, sphere=True), 0.05, 2e-3, tols=(SINGLE,)),
    in_chain("in a chain's pattern", "through two transforms and a stop",
             lambda t: replace(at(apart(stop=SMALL_STOP)), phase=_along(t)), 0.0, 0.5),
    Holds("in a chain's distance, at infinity", "inf x 0", "object at ∞", at_infinity, "zero",
          tols=(SINGLE,)),
    Holds("two backward passes through a chain", "what the first kept has lost its graph",
          "separation and phase, twice", two_steps, "each other", tols=(SINGLE,)),
    Holds("five steps of descent through a chain", "a wrong sign or scale shows at once",
          "SGD on a pattern", descends, "a falling loss", tols=(SINGLE,)),
    *(
        Holds(f"an optimiser moves a chain's {name}", "a plan was made for the old number",
              f"{low:g} to {high:g} m, in place", moved(change, low, high),
              "the new number's own light, or a refusal", tols=(SINGLE,))
        for name, change, low, high in (
            ("separation", lambda z: at(apart(z, stop=SMALL_STOP)), 0.05, 0.055),
            ("point", lambda x: at(apart(stop=SMALL_STOP), off_axis=(0.0, x)), 0.0, 5e-4),
            ("focus", in_lens("focus_distance"), 2.0, 2.4),
        )
    ),
    # Refusals
    *(
        refused(f"a separation of {z:g} m", "NaN passes every comparison that is written wrongly",
                f"separation {z:g}", lambda z=z: apart(z), f"separation is {z:g} m")
        for z in (-1e-3, math.nan, math.inf)
    ),
    *(
        refused(f"a chain's point at {x:g} m", "a place that is no number", f"field ({x:g}, 0)",
                lambda x=x: at(off_axis=(x, 0.0)).operator(SINGLE), "field is")
        for x in (math.nan, math.inf)
    ),
    refused("a chain's object on the panel", "a nanometre away: a million radians across a pixel",
            "object at 1e-9 m", lambda: light(at(distance=1e-9), SINGLE),
            "distance|object|can't be kept|panel pixel"),
    refused("a chain's stop that is closed", "no light over no light", "f/1e100",
            lambda: light(at(apart(lens={"f_number": 1e100})), SINGLE),
            "no light|covers the whole panel", lambda tol: light(at(apart(stop=1e-5)), tol)),
    refused("a sphere before a lens alone", "there is no panel for it", "Lens, sphere=True",
            lambda: PSFOperator(apart().lens, 1.5, WAVELENGTH, POINTS, sphere=True), "sphere is"),
    refused("a chain by a method of a lens", "an answer to another question", "scattered",
            lambda: replace(at(), method="scattered").operator(SINGLE),
            "method is 'scattered'; for a panel apart"),
    refused("a chain that no memory holds", "allocating first and failing then",
            "10000 x 10000 pixels, 64 MB", lambda: small(1 << 26, (10_000, 10_000)),
            "MB|can't be kept", lambda tol: small(1 << 28, (8, 9))()),
    refused("a chain to a tolerance below rounding", "float64 ends at 1e-16", "tol 1e-15",
            lambda: at().operator(1e-15), r"tol \S+ can't be kept"),
    refused("NaN in a chain's phase", "one NaN makes every sample NaN", "9 of 72",
            lambda: at().operator(SINGLE)(
                torch.from_numpy(random(apart())).index_fill(0, torch.tensor(3), math.nan)),
            "phase has 9 NaN or infinite values"),
    refused("a chain's transposed phase", "72 numbers either way", "(9, 8)",
            lambda: at().operator(SINGLE)(torch.zeros(9, 8)), r"phase is \(9, 8\)"),
]  # fmt: skip
