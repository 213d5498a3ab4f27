"""PSFs of lenses: stops, defocus, aberrations, windows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from judges import (
    by_airy,
    by_edges,
    by_fresnel,
    by_lines,
    by_lommel,
    by_rings,
)
from judges.view import WAVELENGTH, View
from numpy.typing import NDArray

from hard_cases.table import SINGLE, Case, Holds, Refused, Seen
from optics.accuracy import Budget
from optics.camera import Lens
from optics.camera.stop import Circle, Polygon, Stop, rectangle, regular_polygon
from optics.plane import Plane
from optics.psf import PSFOperator

LENS = Lens(0.1, 5.6, 2.0)
FINE = Plane((8, 9), (2e-6, 2e-6))
COARSE = Plane((9, 8), (20e-6, 20e-6))


def points(view: View) -> View:
    """The same, at points instead of on whole pixels."""
    return replace(view, integrate=False)


def behind(opening: Circle | Polygon, *obscurations: Circle | Polygon) -> Lens:
    return replace(LENS, stop=Stop(opening, obscurations))


def defocused(lens: Lens, waves: float, wavelength: float = WAVELENGTH) -> float:
    """Metres to an object whose wave is `waves` wavelengths off at the stop's edge."""
    radius = lens.stop_diameter / 2
    return 1 / (1 / lens.focus_distance + 2 * waves * wavelength / radius**2)


def defocus(lens: Lens, waves: float) -> tuple[int, int, float]:
    """The same as an aberration: Z(2, 0) is sqrt(3) (2 r² - 1)."""
    return 2, 0, waves * WAVELENGTH / (2 * math.sqrt(3))


SPIDER = Stop(
    Circle(),
    (
        Circle(0.3),
        rectangle(0.04, 0.9, (0.0, 0.7)),
        rectangle(0.04, 0.9, (0.0, -0.7)),
        rectangle(0.9, 0.02, (0.7, 0.0)),
        rectangle(0.9, 0.02, (-0.7, 0.0)),
    ),
)
HEXAGON = behind(regular_polygon(6))
SQUARE = behind(rectangle(1.4, 1.4))
SLIT = behind(rectangle(1.9, 0.019))
WIDE = Lens(0.05, 1.4, 1.0, kind="stigmatic")
BACKWARDS = Lens(0.01, 0.5, 0.011, kind="stigmatic")


def with_aberrations(*terms: tuple[int, int, float]) -> Lens:
    return replace(LENS, aberrations=terms)


def cubic(y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Four radians of the plate that extends depth of field (Dowski and Cathey 1995)."""
    radius = LENS.stop_diameter / 2
    return 4 * ((x / radius) ** 3 + (y / radius) ** 3) + 0 * y


def _steep_plate(phase_slope: float) -> torch.Tensor:
    operator = PSFOperator(LENS, 2.0, WAVELENGTH, FINE, method="scattered", phase_slope=phase_slope)
    return operator(10 * cubic(*operator.points))


def by_the_sum(view: View) -> NDArray[Any]:
    """Airy's, as the two phases cancel"""
    return by_airy(replace(view, optics=LENS))


def light(
    lens: Lens = LENS, distance: float = 2.0, pixels: Plane = FINE, **settings: Any
) -> NDArray[Any]:
    """A PSF, as an array."""
    return PSFOperator(lens, distance, WAVELENGTH, pixels, **settings)().numpy()


def far_and_farthest(tol: float) -> None:
    """From 1e9 m on nothing changes but rounding."""
    near, far, farther = (light(distance=d, pixels=COARSE, tol=tol) for d in (1e9, 1e12, math.inf))
    assert np.abs(far - farther).max() <= tol * farther.max()
    assert np.abs(near - farther).max() <= (tol + 1e-6) * farther.max()


def odd_in_even(tol: float) -> None:
    """The middle of 10 x 11 points is what 5 x 4 points around the same origin are."""
    large, small = (
        light(distance=1.9, pixels=Plane(n, (2e-6, 2e-6), (1e-6, 3e-6)), tol=tol, integrate=False)
        for n in ((10, 11), (5, 4))
    )
    assert np.abs(large[3:8, 3:7] - small).max() <= 2 * tol * large.max()


def mirrored(tol: float) -> None:
    """A round lens sends the same light to both sides of the axis."""
    picture = light(distance=1.9, pixels=Plane((9, 11), (2e-6, 2e-6)), tol=tol)
    for flipped in (picture[::-1], picture[:, ::-1], picture[::-1, ::-1]):
        assert np.abs(flipped - picture).max() <= 2 * tol * picture.max()


def all_light(tol: float) -> None:
    """A window of fifty rings gets all light but what Rayleigh's formula leaves outside."""
    pixels = Plane((20, 20), (30e-6, 30e-6))
    outside = 2 / (
        math.pi * math.pi * LENS.stop_diameter * 3e-4 / (WAVELENGTH * LENS.image_distance)
    )
    total = float(light(pixels=pixels, tol=tol).sum())
    assert 1 - 1.1 * outside - tol <= total <= 1 + tol


def through_all_engines(tol: float) -> None:
    """Three engines that share no quadrature agree."""
    pictures = [light(distance=1.9, tol=tol, method=m) for m in ("axial", "scattered", "sampled")]
    for picture in pictures[1:]:
        assert np.linalg.norm(picture - pictures[0]) <= 2 * tol * np.linalg.norm(pictures[0])


CASES: list[Case] = [
    # In focus
    Seen(
        "Airy's pattern",
        "a jagged edge of the stop costs 2 %, a grey one 1 %, at 512 samples across",
        View(LENS, FINE),
        by_airy,
    ),
    Seen(
        "a thin ring of a stop",
        "two discs that nearly cancel: what is left is 10 % of either",
        View(behind(Circle(), Circle(0.95)), FINE),
        by_airy,
    ),
    Seen(
        "a hexagonal stop",
        "slanted edges miss every grid; on the axis the closed form is 0 / 0",
        View(HEXAGON, FINE),
        by_edges,
    ),
    Seen(
        "a star of ten corners",
        "rays from the middle to its boundary are no fans of a convex shape",
        View(
            behind(
                Polygon(
                    tuple(
                        (r * math.sin(k * math.pi / 5), r * math.cos(k * math.pi / 5))
                        for k, r in enumerate([1, 0.4] * 5)
                    )
                )
            ),
            FINE,
        ),
        by_edges,
    ),
    Seen(
        "a spider that holds an obscuration",
        "vanes of a fiftieth of the radius fall between samples; they overlap with the disc",
        View(replace(LENS, stop=SPIDER), FINE),
        by_lines,
    ),
    Seen(
        "a slit a hundred times longer than wide",
        "nodes for the long side are wasted on the short one",
        View(SLIT, Plane((5, 3), (2e-6, 100e-6)), defocused(LENS, 3)),
        by_fresnel,
    ),
    # Out of focus
    Seen(
        "the benchmark: 38 waves of defocus",
        "a pupil of 512 samples a side is 2 % off, one of 2232 still 5e-4",
        View(Lens(0.1, 5.6, math.inf), Plane((7, 6), (3.45e-6, 3.45e-6)), 2.0, 520e-9),
        by_rings,
    ),
    Seen(
        "a thousand waves of defocus",
        "a grid needs 8000² samples before it stops to alias; at its dark centre light is 0 / 0",
        points(View(LENS, Plane((4, 5), (1e-4, 1e-4)), defocused(LENS, 1000))),
        by_lommel,
    ),
    Seen(
        "ten thousand waves, over the whole blur",
        "a Hankel matrix would have 40 000 columns; an integral along the rim has 2000 nodes",
        points(View(LENS, Plane((3, 5), (3e-4, 3e-4)), defocused(LENS, 10_000))),
        by_lommel,
    ),
    Seen(
        "a window across the rim of the blur",
        "geometric optics jumps from light to dark where stationary points leave through the edge",
        points(View(LENS, Plane((1, 9), (4e-6, 4e-6), (0, 3.89e-3)), defocused(LENS, 300))),
        by_lommel,
    ),
    Seen(
        "whole pixels a hundred waves out of focus",
        "fringes in every pixel: centres alone say nothing of their light",
        View(LENS, Plane((1, 4), (20e-6, 20e-6)), defocused(LENS, 100)),
        by_rings,
    ),
    Seen(
        "a ring out of focus",
        "no light at the blur's centre but Poisson's spot",
        View(behind(Circle(), Circle(0.95)), COARSE, defocused(LENS, 20)),
        by_rings,
    ),
    Seen(
        "a hexagon out of focus",
        "edges diffract where no symmetry helps",
        View(HEXAGON, Plane((3, 4), (2e-5, 2e-5)), defocused(LENS, 8)),
        by_lines,
    ),
    Seen(
        "a spider out of focus",
        "the shadow of thin vanes, with fringes",
        View(replace(LENS, stop=SPIDER), Plane((3, 4), (2e-5, 2e-5)), defocused(LENS, 4)),
        by_lines,
    ),
    Seen(
        "a square fifty waves out of focus",
        "Fresnel's integrals at arguments of 30",
        View(SQUARE, COARSE, defocused(LENS, 50)),
        by_fresnel,
    ),
    Seen(
        "a pinhole beside the axis, out of focus",
        "its light lies where its coordinate says; a flipped axis puts it opposite",
        View(
            behind(Circle(0.2, (0.5, 0.3))),
            Plane((5, 6), (2e-5, 2e-5), (55e-6, 33e-6)),
            defocused(LENS, 10),
        ),
        by_lines,
    ),
    Seen(
        "a hundred waves that an aberration undoes",
        "two phases of 600 rad whose difference is zero",
        View(with_aberrations(defocus(LENS, -100)), FINE, defocused(LENS, 100)),
        by_the_sum,
    ),
    # Aberrations
    Seen(
        "coma, astigmatism and defocus",
        "no symmetry is left; sines and cosines are easily swapped",
        View(
            with_aberrations((3, 1, 700e-9), (2, -2, 400e-9), (3, -3, 200e-9)),
            FINE,
            defocused(LENS, 1),
        ),
        by_lines,
    ),
    Seen(
        "an aberration of degree 30",
        "factorials of 30 cancel to the last digit in the textbooks' sum",
        View(with_aberrations((30, 0, 2e-7)), FINE),
        by_rings,
    ),
    Seen(
        "sixteen periods around the rim",
        "the wave turns around the axis, where quadrature along the radius is blind",
        View(with_aberrations((16, 16, 8e-8)), Plane((3, 4), (3e-6, 3e-6))),
        by_lines,
        tols=(SINGLE, 1e-6),
    ),
    Seen(
        "a gentle phase plate at the nodes",
        "the nodes were chosen for the bare wave",
        View(LENS, FINE, phase=cubic, method="scattered"),
        by_lines,
    ),
    Seen(
        "a steep phase plate at the nodes",
        "forty radians: nodes that are chosen for a flat wave don't see them",
        View(
            LENS,
            FINE,
            phase=lambda y, x: 10 * cubic(y, x),
            method="scattered",
            phase_slope=180.0,
        ),
        by_lines,
    ),
    Refused(
        "a phase plate that nobody announced",
        "the nodes were chosen before, for a wave without it",
        "forty radians at the nodes of a plain lens",
        lambda: _steep_plate(20.0),
        r"phase turns by \d+ radians per stop radius, .* with phase_slope=\d+",
        lambda _: _steep_plate(180.0),
    ),
    # Large apertures
    Seen(
        "f/1.4, stigmatic",
        "spheres of a metre that differ by micrometres: digits cancel",
        View(WIDE, FINE, 0.9),
        by_rings,
    ),
    Seen(
        "f/1.4, thin, the same",
        "no quadratic lens unites such rays; asked is the model that was chosen",
        View(replace(WIDE, kind="thin"), FINE, 0.9),
        by_rings,
    ),
    Seen(
        "focused at infinity on an object at a kilometre",
        "sqrt(d² + r²) - d keeps no digit in single precision here, and six in double",
        View(replace(WIDE, focus_distance=math.inf), FINE, 1e3),
        by_rings,
    ),
    Seen(
        "a lens the wrong way round",
        "an object half a focal length behind the focus of a lens of f/0.5: no parabola bounds it",
        View(BACKWARDS, Plane((5, 4), (1e-5, 1e-5)), 0.0105),
        by_rings,
    ),
    # Windows
    Seen(
        "one pixel",
        "its margin is larger than itself",
        View(LENS, Plane((1, 1), (2e-6, 2e-6))),
        by_airy,
    ),
    Seen(
        "one row of pixels",
        "an axis of length 1 has no frequencies",
        View(LENS, Plane((1, 30), (2e-6, 2e-6)), defocused(LENS, 3)),
        by_rings,
    ),
    Seen(
        "one column of points",
        "the other axis",
        points(View(HEXAGON, Plane((31, 1), (2e-6, 2e-6)))),
        by_edges,
    ),
    Seen(
        "pixels fifteen times wider than high",
        "one pitch for both axes is the usual assumption",
        View(HEXAGON, Plane((20, 3), (1e-6, 15e-6))),
        by_edges,
    ),
    Seen(
        "pixels a hundred times larger than the finest fringe",
        "a sample at the centre would see a thousand times too much, or nothing",
        View(LENS, Plane((2, 2), (300e-6, 300e-6))),
        by_airy,
    ),
    Seen(
        "pixels a hundred times smaller than the finest fringe",
        "hundreds of samples, and margins, on a single lobe",
        View(LENS, Plane((5, 4), (30e-9, 30e-9))),
        by_airy,
    ),
    Seen(
        "a window a thousand rings off the axis",
        "the kernel turns by 3000 rad across the stop, and light is a 1e-10th",
        View(LENS, Plane((3, 4), (2e-6, 2e-6), (2e-3, -3e-3))),
        by_airy,
    ),
    Seen(
        "the dark beside a square's cross",
        "1e-9 of the peak: errors of a transform are shares of all the light",
        View(SQUARE, Plane((3, 4), (2e-6, 2e-6), (2e-4, 2.5e-4))),
        by_fresnel,
    ),
    Seen(
        "the dark beside a hexagon's star",
        "1e-8 of the peak: errors of a quadrature are shares of all the light",
        View(HEXAGON, Plane((3, 4), (2e-6, 2e-6), (2e-4, -3e-4))),
        by_edges,
        tols=(SINGLE, 1e-6),
    ),
    Seen(
        "one dark pixel at the centre of a blur",
        "all that is bright lies in the margin that pixel integration adds",
        View(LENS, Plane((1, 1), (2e-6, 2e-6)), defocused(LENS, 1)),
        by_lommel,
        tols=(SINGLE,),
    ),
    # Limits and laws
    Holds(
        "an object at infinity",
        "1 / inf must be zero and inf - inf must not happen",
        "100 mm f/5.6, focus 2 m, objects at 1e9 m, 1e12 m, ∞",
        far_and_farthest,
        "the limit of far objects",
    ),
    Holds(
        "even and odd windows",
        "half a sample of shift, in one of the parities, is 8 % of a PSF",
        "10x11 and 5x4 points around one centre",
        odd_in_even,
        "samples that both have",
    ),
    Holds(
        "four quadrants",
        "a grid that ends at -n/2 and n/2 - 1 isn't symmetric",
        "9x11 pixels, one wave of defocus",
        mirrored,
        "symmetry",
    ),
    Holds(
        "all the light there is",
        "normalised sums hide what falls beside the window",
        "20x20 pixels of 30 µm",
        all_light,
        "Rayleigh's encircled energy",
        tols=(SINGLE, 1e-6),
    ),
    Holds(
        "three ways to one answer",
        "a method's error is invisible to itself",
        "axial, scattered, sampled",
        through_all_engines,
        "each other",
        tols=(1e-2, SINGLE),
    ),
    # Refusals
    Refused(
        "a dark point",
        "at one wave of defocus the axis is dark: a relative error of nothing",
        "one point on the axis",
        lambda: light(
            distance=defocused(LENS, 1), pixels=Plane((1, 1), (2e-6, 2e-6)), integrate=False
        ),
        "tol 0.001 can't be kept",
        lambda tol: light(
            distance=defocused(LENS, 1), pixels=Plane((2, 2), (2e-6, 2e-6)), integrate=False
        ),
    ),
    Refused(
        "a tolerance below rounding",
        "float64 ends at 1e-16, and light is made of 1e5 numbers",
        "tol 1e-15",
        lambda: light(tol=1e-15),
        r"tol 1e-15 can't be kept; ask for tol \S+ or more",
        lambda tol: light(tol=tol),
    ),
    Refused(
        "no tolerance at all",
        "NaN is neither smaller nor larger than any floor",
        "tol NaN",
        lambda: light(tol=math.nan),
        r"tol nan can't be kept; ask for tol \S+ or more",
        lambda tol: light(tol=tol),
    ),
    Refused(
        "an object on the lens",
        "a micrometre away the defocus has 1e7 waves",
        "object at 1e-6 m, hexagonal stop",
        lambda: light(HEXAGON, 1e-6),
        "bring the object closer to the plane in focus",
        lambda tol: light(HEXAGON, 1.9),
    ),
    Refused(
        "an object nearer than a wavelength",
        "a length in another unit, not a place: no lens forms an image of it",
        "object at 1e-9 m, hexagonal stop",
        lambda: light(HEXAGON, 1e-9),
        "distance is 1e-09 m, less than a wavelength.* in metres",
        lambda tol: light(HEXAGON, 1.9),
    ),
    Refused(
        "less memory than any method needs",
        "allocating first and failing then takes the machine along",
        "a megabyte for 512x512 pixels",
        lambda: light(pixels=Plane((512, 512), (2e-6, 2e-6)), budget=Budget(memory=1 << 20)),
        r"needs .* MB.* allow more memory",
        lambda tol: light(pixels=Plane((8, 8), (2e-6, 2e-6)), budget=Budget(memory=1 << 28)),
    ),
    Refused(
        "a ray steeper than any",
        "the sine of its angle would be 1.25",
        "stigmatic, f/0.4",
        lambda: Lens(0.05, 0.4, math.inf, kind="stigmatic"),
        "f_number is 0.4; no ray .* give 0.5 or more",
        lambda tol: light(Lens(0.05, 0.6, math.inf, kind="stigmatic"), math.inf),
    ),
    Refused(
        "an engine that can't serve",
        "a Hankel transform of a hexagon is an answer, to another question",
        "axial, hexagonal stop",
        lambda: light(HEXAGON, method="axial"),
        "method is 'axial'; it serves round stops",
        lambda tol: light(HEXAGON, method="scattered"),
    ),
    *(
        Refused(
            f"{what} of {value:g} m",
            "NaN passes every comparison that is written the wrong way round",
            f"{what} {value:g}",
            lambda what=what, value=value: replace(View(LENS, FINE), **{what: value}).operator(
                1e-3
            ),
            f"{what} is {value:g} m",
            lambda tol: light(),
        )
        for what, value in (
            ("distance", math.nan),
            ("distance", 0.0),
            ("distance", -2.0),
            ("wavelength", math.nan),
            ("wavelength", math.inf),
            ("wavelength", 0.0),
        )
    ),
]
