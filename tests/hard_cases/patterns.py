"""Patterns that the pixels hardly show, or don't, and targets that hardly fit, or don't."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import torch
from judges import explicit_zernike
from numpy.typing import NDArray

from hard_cases.table import ONCE, Agrees, Case, Holds, Refused
from optics import patterns, targets
from optics.camera import Panel
from optics.plane import Plane

WAVELENGTH = 550e-9
PANEL = Panel(shape=(31, 40), pitch=8e-6)
FULL = Panel()
PLANE = Plane((64, 65), (2e-6, 2e-6))


def wrapped(phase: Any) -> NDArray[np.float64]:
    """Within half a wave of zero."""
    turns = np.asarray(phase) / (2 * math.pi)
    return (turns - np.round(turns)) * 2 * math.pi


PIXELS = ((0, 0), (1079, 1919), (3, 1000), (540, 0), (701, 1400))


def steep_lens(tol: float) -> NDArray[np.float64]:
    phase = patterns.fresnel_lens(FULL, 0.2235, WAVELENGTH)
    return wrapped(torch.stack([phase[pixel] for pixel in PIXELS]))


def steep_lens_by_digits() -> NDArray[np.float64]:
    answer = []
    with mpmath.workdps(50):
        for row, column in PIXELS:
            r2 = mpmath.mpf(FULL.pitch) ** 2 * ((row - 540) ** 2 + (column - 960) ** 2)
            turns = -r2 / (2 * mpmath.mpf(WAVELENGTH) * mpmath.mpf(0.2235))
            answer.append(float((turns - mpmath.nint(turns)) * 2 * mpmath.pi))
    return np.array(answer)


def high_polynomial(tol: float) -> torch.Tensor:
    return patterns.zernike_pattern(PANEL, [(40, 4, 1e-9)], 2.1e-4, WAVELENGTH)


def high_polynomial_by_sum() -> NDArray[np.float64]:
    y, x = (axis.numpy() / 2.1e-4 for axis in PANEL.plane.mesh())
    y, x = np.broadcast_arrays(y, x)
    values = explicit_zernike(40, 4, y.astype(np.longdouble), x.astype(np.longdouble))
    return (2 * math.pi * 1e-9 / WAVELENGTH * values).astype(np.float64)


def one_pixel(tol: float) -> None:
    """Every pattern, on panels of a pixel and of a line."""
    generator = torch.Generator().manual_seed(0)
    for shape in ((1, 1), (1, 9), (9, 1)):
        panel = Panel(shape=shape)
        for phase in (
            patterns.constant_phase(panel),
            patterns.fresnel_lens(panel, 1.0, WAVELENGTH, (1e-6, 0.0)),
            patterns.axicon(panel, 1e-5, 0.1, WAVELENGTH),
            patterns.cubic_phase_mask(panel, 0.1),
            patterns.blazed_grating(panel, 3.0, 0.3),
            patterns.steering_grating(panel, (1e-5, 1e-5), 0.1, WAVELENGTH),
            patterns.binary_grating(panel, 2.0, 1.0),
            patterns.sine_grating(panel, 1.0, 4.0),
            patterns.random_patches(panel, shape, generator),
            patterns.zernike_pattern(panel, [(4, 0, 1e-9), (3, -1, 1e-9)], 1e-4, WAVELENGTH),
            patterns.superpose(panel),
        ):
            assert phase.shape == shape
            assert torch.isfinite(phase).all()


def stripes_on_pixel_edges(tol: float) -> None:
    """Whole periods: every stripe has as many pixels as the others, at any angle by 90 degrees."""
    for direction, axis in ((0.0, 1), (math.pi / 2, 0), (math.pi, 1), (-math.pi / 2, 0)):
        phase = patterns.binary_grating(Panel(shape=(60, 60)), 6.0, 1.0, direction)
        line = phase.select(1 - axis, 0)
        lengths = torch.unique_consecutive(line, return_counts=True)[1].tolist()
        assert set(lengths[1:-1]) == {3}
        assert float(phase.mean()) == 0.5


def merging_turns(tol: float) -> None:
    """No brighter than one stroke, and finite, where strokes lie over each other."""
    light = targets.spiral(PLANE, 36e-6, 12e-6, turns=6)
    drawing = targets.spiral.draw(36e-6, 12e-6, 6)
    brightness = drawing.brightness(PLANE)
    assert torch.isfinite(light).all()
    assert float(brightness.max()) <= 1 + 1e-12
    assert abs(float(light.sum()) - 1) <= 1e-12


def odd_and_even(tol: float) -> None:
    """The centroid is the axis, for both, to a nanometre."""
    for rows in (64, 65):
        for columns in (64, 65):
            plane = Plane((rows, columns), (2e-6, 2e-6))
            y, x = plane.mesh()
            for light in (
                targets.ring(plane, 40e-6, 3e-6),
                targets.infinity(plane, 40e-6, 3e-6),
                targets.dots(plane, targets.ring_positions(5, 40e-6), 3e-6),
            ):
                for axis in (y, x):
                    assert abs(float((light * axis).sum())) < 1e-9


def fine_logo(tol: float) -> torch.Tensor:
    picture = np.random.default_rng(0).uniform(0, 1, (700, 900))
    return targets.logo(
        Plane((10, 12), (2e-6, 2e-6), (1e-6, 1e-6)), torch.from_numpy(picture), 18e-6
    )


def fine_logo_by_means() -> NDArray[np.float64]:
    picture = np.random.default_rng(0).uniform(0, 1, (700, 900))
    # Half samples of 50 pixels: the picture begins in the middle of a sample.
    halves = np.pad(picture.reshape(14, 50, 18, 50).sum((1, 3)), 1) / picture.sum()
    return np.pad(halves.reshape(8, 2, 10, 2).sum((1, 3)), 1)


def single_points(tol: float) -> None:
    """A full stop is a dot, and so is a stroke without length."""
    light = targets.letters(PLANE, ".", 40e-6, 5e-6)
    dot = targets.dots(PLANE, [(0.0, 0.0)], 5e-6)
    assert torch.allclose(light, dot, atol=1e-7 * float(dot.max()))


def refused(
    name: str,
    why: str,
    given: str,
    ask: Callable[[], Any],
    words: str,
    remedy: Callable[[], Any],
) -> Refused:
    return Refused(name, why, given, ask, words, lambda tol: remedy())


HALVES = (patterns.blazed_grating(PANEL, 3.0), patterns.blazed_grating(PANEL, 3.0))

CASES: list[Case] = [
    Agrees("a lens at the pixels' limit", "thousands of radians have to wrap to the right place",
           "0.2235 m, 1920x1080", steep_lens, steep_lens_by_digits, "50 digits", tols=(1e-10,)),
    Agrees("a polynomial of degree 40 on a panel",
           "monomials cancel, recurrences are slow: values on few nodes know it all",
           "(40, 4), 31x40", high_polynomial, high_polynomial_by_sum,
           "Born and Wolf's sum in extended precision", tols=(1e-6,)),
    Holds("panels of a pixel or a line", "differences of nothing, division by half a side",
          "1x1, 1x9, 9x1", one_pixel, "finite", tols=ONCE),
    Holds("stripes whose edges are pixel centres", "rounding gives a stripe one pixel more",
          "period 6, four directions", stripes_on_pixel_edges, "counting", tols=ONCE),
    refused("a lens a hair too steep", "its edge becomes another lens' edge",
            "0.2 m", lambda: patterns.fresnel_lens(FULL, 0.2, WAVELENGTH),
            "focal_length changes the phase by 1.12 pi .* choose at least 0.224 m",
            lambda: patterns.fresnel_lens(FULL, 0.224, WAVELENGTH)),
    refused("a sine of two pixels", "sampled at its zeros it is nothing at all",
            "2 pixels", lambda: patterns.sine_grating(PANEL, 0.5, 2.0),
            "period is 2 pixels; choose at least 4",
            lambda: patterns.sine_grating(PANEL, 0.5, 4.0)),
    refused("rings thinner than pixels", "they alias to other rings",
            "100 rings", lambda: patterns.annular_phase_mask(PANEL, 100, 0.1),
            "rings is 100; choose 1 to 12", lambda: patterns.annular_phase_mask(PANEL, 12, 0.1)),
    refused("a sum that is steeper than its parts", "each part passes by itself",
            "two blazes of 3 pixels", lambda: patterns.superpose(PANEL, *HALVES),
            r"the sum changes the phase by 1.33 pi .* all by 0.75",
            lambda: patterns.superpose(PANEL, *(0.749 * half for half in HALVES))),
    refused("polynomials far beyond their disc", "r to the 80th power overflows",
            "(80, 0), a disc of 10 nm",
            lambda: patterns.zernike_pattern(PANEL, [(80, 0, 1e-9)], 1e-8, WAVELENGTH),
            "radius is 1e-08 m; the polynomials overflow",
            lambda: patterns.zernike_pattern(PANEL, [(80, 0, 1e-12)], 2e-4, WAVELENGTH)),
    refused("a number that is none", "NaN compares with nothing",
            "strength NaN", lambda: patterns.cubic_phase_mask(PANEL, math.nan), "strength is nan",
            lambda: patterns.cubic_phase_mask(PANEL, 1.0)),
    Holds("turns that merge", "strokes that overlap add up, or divide by nothing",
          "6 turns, 12 µm", merging_turns, "one stroke's brightness", tols=ONCE),
    Holds("targets on odd and even grids", "the axis is a sample, or between two",
          "64 and 65", odd_and_even, "the centroid", tols=ONCE),
    Agrees("a logo a hundred times finer than the samples",
           "whoever picks pixels gets noise", "900x700 into 12x10",
           fine_logo, fine_logo_by_means, "means of blocks", tols=(1e-12,)),
    Holds("a stroke without length", "no direction to be a distance from", "a full stop",
          single_points, "a dot", tols=ONCE),
    refused("a stroke between the samples", "0 / 0 of light", "0.1 µm on 2 µm",
            lambda: targets.heart(PLANE, 40e-6, 1e-7), "width 0.1 µm falls between samples",
            lambda: targets.heart(PLANE, 40e-6, 1e-6)),
    refused("a shape that leaves the window", "what is cut off, nobody misses", "64 of 64 µm",
            lambda: targets.eye(PLANE, 64e-6, 3e-6), "fit in the window, which reaches 64 µm",
            lambda: targets.eye(PLANE, 55e-6, 3e-6)),
    refused("a black logo", "0 / 0 of light", "zeros",
            lambda: targets.logo(PLANE, np.zeros((4, 4)), 4e-5), "picture has no light",
            lambda: targets.logo(PLANE, np.zeros((4, 4)) + 1, 4e-5)),
    refused("a text of blanks", "nothing to draw", "three blanks",
            lambda: targets.letters(PLANE, "   ", 4e-5, 3e-6), "give one sign at least",
            lambda: targets.letters(PLANE, " A ", 4e-5, 3e-6)),
]  # fmt: skip
