"""Exact spheres from half a metre, and panels of unusual shapes, seen from several depths."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from judges import by_panel, richardson
from judges.basics import positions
from judges.depths import by_spheres
from judges.view import View

from hard_cases.depth_waves import (
    BITS,
    CAMERA,
    DIOPTRES,
    PIXELS,
    WAVELENGTH,
    contrast,
    summed,
    transfer_of,
)
from hard_cases.table import DOUBLE, ONCE, SINGLE, Agrees, Case, Holds, Refused, require_close
from optics.camera import Camera, Panel
from optics.edof import FullTransfer, QuarterTransfer
from optics.plane import Plane
from optics.psf import PSFOperator

# Spheres

LARGE = replace(
    CAMERA,
    panel=Panel((27, 47), 320e-6, 0.81, unmodulated=0.0),
    lens=replace(CAMERA.lens, focus_distance=0.5),
)
"""As large as the thesis' panel, and in focus at half a metre, where only the sphere is left."""

GENTLE = np.random.default_rng(9).normal(0, 0.3, LARGE.panel.shape)
SPOT = Plane((5, 5), (3.45e-6, 3.45e-6))


def of_a_sphere(phase: Any, distance: Any, tol: float, exact: bool = True) -> torch.Tensor:
    operator = PSFOperator(
        LARGE, distance, WAVELENGTH, SPOT, sphere=exact, integrate=False, tol=tol
    )
    return operator(phase)


def sphere_or_parabola(tol: float) -> None:
    """Both as their judges have them; apart by less than a thousandth, and not by nothing.

    At the panel's corner the waves are .011 of a wave apart.
    """
    places = positions(5, 3.45e-6)
    found, true = [], []
    for exact in (True, False):
        found.append(of_a_sphere(torch.from_numpy(GENTLE), 0.5, tol, exact))
        true.append(by_spheres(LARGE, WAVELENGTH, GENTLE, 0.5, places, exact))
        require_close(found[-1], true[-1], tol)
    between = float(np.linalg.norm(true[0] - true[1]) / np.linalg.norm(true[1]))
    assert 1e-4 < between < 1e-3
    assert abs(float((found[0] - found[1]).norm() / found[1].norm()) - between) <= 2 * tol


def slope_of_a_sphere(tol: float) -> torch.Tensor:
    phase = torch.from_numpy(GENTLE).requires_grad_()
    (of_a_sphere(phase, 0.5, tol).double() ** 2).sum().backward()
    assert phase.grad is not None
    return (phase.grad * torch.from_numpy(GENTLE[::-1].copy())).sum()


def slope_of_judged_spheres() -> Any:
    places = positions(5, 3.45e-6)

    def total(t: float) -> Any:
        pattern = GENTLE + t * GENTLE[::-1]
        return (by_spheres(LARGE, WAVELENGTH, pattern, 0.5, places, True) ** 2).sum()

    return richardson(total, 0.0, 0.2)


# Shapes


def shaped(rows: int, columns: int) -> Camera:
    return replace(CAMERA, panel=replace(CAMERA.panel, shape=(rows, columns)))


SHAPES = ((1, 1), (1, 24), (24, 1), (23, 31))


def narrow_panels(tol: float) -> None:
    """Direct sums, and a gradient that is finite; of a single pixel, zero."""
    rng = np.random.default_rng(3)
    for shape in SHAPES:
        camera, pattern = shaped(*shape), rng.uniform(0, 2 * np.pi, shape)
        phase = torch.from_numpy(pattern).requires_grad_()
        found = transfer_of(FullTransfer, tol, camera)(phase, DIOPTRES)
        require_close(found, summed(FullTransfer, pattern, camera), tol)
        contrast(found).backward()
        assert phase.grad is not None
        assert torch.isfinite(phase.grad).all()
        assert (float(phase.grad.abs().max()) < tol) == (shape == (1, 1))


def mirrored_odd_panel(tol: float) -> None:
    """A quarter with the middle row and column, as PSFs take it: as the whole panel's judge."""
    camera = shaped(23, 31)
    quarter = np.random.default_rng(4).uniform(0, 2 * np.pi, (12, 16))
    half = np.concatenate([quarter[:0:-1], quarter], 0)
    pattern = np.concatenate([half[:, :0:-1], half], 1)
    operator = PSFOperator(camera, 0.5, WAVELENGTH, PIXELS, symmetry="quarter", tol=tol)
    phase = torch.from_numpy(quarter).requires_grad_()
    light = operator(phase)
    require_close(light, by_panel(View(camera, PIXELS, 0.5, WAVELENGTH, phase=pattern)), tol)
    (light**2).sum().backward()
    assert phase.grad is not None
    assert torch.isfinite(phase.grad).all()


CUT = replace(CAMERA, lens=replace(CAMERA.lens, f_number=0.1 / 4.5e-3))
"""Its stop is smaller than the panel."""

LINES = np.random.default_rng(5).uniform(0, 2 * np.pi * 3000, sum(CAMERA.panel.shape))
LINES = LINES.astype(np.float32)


def lines_that_are_cut(tol: float) -> torch.Tensor:
    operator = PSFOperator(CUT, 0.5, WAVELENGTH, PIXELS, symmetry="separable", tol=tol)
    return operator(torch.from_numpy(LINES))


def sums_of_lines() -> Any:
    y, x = np.split(LINES.astype(np.longdouble), [CAMERA.panel.shape[0]])
    return by_panel(View(CUT, PIXELS, 0.5, WAVELENGTH, phase=y[:, None] + x))


CASES: list[Case] = [
    Holds("a sphere and its parabola", "sqrt(d² + r²) - d; the usual parabola is nearly the same",
          "0.5 m, in focus, a panel of 8.6 mm x 15 mm", sphere_or_parabola,
          "Gauss-Legendre, both ways", tols=(SINGLE, 1e-6)),
    Agrees("the derivative behind an exact sphere", "its factor is in the gradient too", "0.5 m",
           slope_of_a_sphere, slope_of_judged_spheres, "differences of Gauss-Legendre sums",
           tols=(1e-2, 1e-5)),
    Holds("panels one pixel wide, and odd ones", "an axis of length 1, a middle pixel",
          "1x1, 1x24, 24x1, 23x31", narrow_panels, "direct sums", tols=BITS),
    Holds("a quarter of an odd panel", "the middle line is its own mirror image",
          "23x31 from 12x16", mirrored_odd_panel, "Gauss-Legendre over every pixel",
          tols=(SINGLE, DOUBLE)),
    Agrees("lines of 3000 waves behind a stop", "the sum of two large phases in single precision "
           "loses a thousandth of a radian", "24 + 32 lines, float32, a stop that cuts the panel",
           lines_that_are_cut, sums_of_lines, "Gauss-Legendre over every pixel"),
    Refused("OTFs of a quarter of an odd panel", "its middle isn't between pixels", "23x31",
            lambda: transfer_of(QuarterTransfer, 1.0, shaped(23, 31)),
            "a quarter needs even numbers: design a pattern of the whole panel",
            lambda _: transfer_of(FullTransfer, 1.0, shaped(23, 31))(
                torch.zeros(23, 31), DIOPTRES), tols=ONCE),
]  # fmt: skip
