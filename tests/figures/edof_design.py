"""Patterns for an extended depth of field that are designed without a picture, and their bound."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import torch

from figures import Figure
from optics.camera import Camera, Lens, Panel, Sensor
from optics.edof.depth_bound import Rule, known_depth_bound, rms_transfer_limit
from optics.edof.dioptres import midpoint_dioptres, random_dioptres
from optics.edof.panel_transfer import FullTransfer, QuarterTransfer
from optics.edof.pattern_rating import rate_pattern
from optics.edof.pattern_search import design_pattern
from optics.edof.pattern_transfer import PatternTransfer
from optics.edof.picture_spectrum import (
    NATURAL_SPECTRUM,
    FrequencyGrid,
    SpectrumModel,
    fit_spectrum_model,
    measure_picture_spectrum,
)
from optics.edof.transfer_design import TransferDesign
from optics.patterns import cubic_phase_mask, even_vergences, multi_focus_rings
from optics.quarter_symmetry import crop_quarter
from optics.threads import single_threaded

_PHOTOGRAPHS = Path(__file__).parents[3] / "shared/data/natural/bsds500_train"

WAVELENGTH, NOISE, SIZE = 520e-9, 0.008, 512

CAMERA = Camera(Panel(unmodulated=0.0), Lens(0.1, 5.6, math.inf), Sensor(pitch=3.45e-6))
"""The thesis' camera of chapter 5: the panel is its stop."""


@dataclass(frozen=True)
class _Task:
    """A design: its criterion, fixed number of steps, and the goals in dB and processor seconds."""

    criterion: Literal["blind", "known"]
    steps: int
    level: float
    seconds: float


_SHORT, _LONG = _Task("blind", 400, 20.8, 30.0), _Task("blind", 5000, 21.0, 600.0)
_KNOWN = _Task("known", 1700, 23.2, 600.0)
_WORDS = {"blind": "one filter for all depths", "known": "depth known"}
_SPECTRUM_GOAL, _BOUND_GOAL = 0.05, 0.1


@single_threaded
def edof_design_figures(folder: Path) -> list[Figure]:
    """Spectrum, bound, and both designs."""
    return [spectrum_figure(), bound_figure(), *design_figures()]


def spectrum_figure() -> Figure:
    """The packaged spectrum against that of its photographs, in the bound and in a criterion."""
    name, goal = (
        "spectrum of natural photographs, modelled",
        f"≤ {_SPECTRUM_GOAL:g} dB in the bound",
    )
    if not _PHOTOGRAPHS.is_dir():
        return Figure(name, goal, "not measured: the photographs aren't beside the checkout", None)
    spectrum = measure_picture_spectrum(luminances(), SIZE)
    grid = FrequencyGrid(SIZE)
    limit = rms_transfer_limit(CAMERA, WAVELENGTH, grid, folded=False)
    modelled = NATURAL_SPECTRUM.on_grid(grid)
    levels = [known_depth_bound(limit, s, grid.shares(), NOISE) for s in (modelled, spectrum)]
    rings, transfer = _rings(), QuarterTransfer(TransferDesign(CAMERA, WAVELENGTH, SIZE))
    blind = [
        rate_pattern(transfer, rings, s, NOISE, midpoint_dioptres(16)).blind
        for s in (grid.select_quarter(modelled), grid.select_quarter(spectrum))
    ]
    error = max(abs(levels[0] - levels[1]), abs(blind[0] - blind[1]))
    return Figure(
        name,
        goal + " and in the blind criterion",
        f"bound {levels[0]:.2f} for {levels[1]:.2f} dB, rings {blind[0]:.2f} for {blind[1]:.2f} dB",
        error <= _SPECTRUM_GOAL,
    )


def fit_natural_spectrum() -> SpectrumModel:
    """Fit the packaged spectrum anew; print its coefficients to update `NATURAL_SPECTRUM`."""
    return fit_spectrum_model(measure_picture_spectrum(luminances(), SIZE), NATURAL_SPECTRUM.source)


def luminances() -> Iterator[torch.Tensor]:
    """The photographs' luminance in linear light."""
    for path in sorted(_PHOTOGRAPHS.glob("*.jpg")):
        coded = np.asarray(cv2.imread(str(path)), dtype=np.float64) / 255
        linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
        # OpenCV's order is blue, green, red.
        yield torch.from_numpy(linear @ [0.0722, 0.7152, 0.2126])


def bound_figure() -> Figure:
    """The bound by two quadratures, without and with the orders that the pixels fold."""
    grid = FrequencyGrid(SIZE, quarter=True)
    spectrum, shares = NATURAL_SPECTRUM.on_grid(grid), grid.shares()
    rules: tuple[tuple[Rule, int], ...] = (("gauss-legendre", 100), ("midpoint", 150))
    levels = []
    for folded in (False, True):
        limits = (
            rms_transfer_limit(CAMERA, WAVELENGTH, grid, folded=folded, rule=rule, nodes=nodes)
            for rule, nodes in rules
        )
        levels.append([known_depth_bound(one, spectrum, shares, NOISE) for one in limits])
    apart = max(abs(first - second) for first, second in levels)
    return Figure(
        "bound for any pattern, depth known, by two quadratures",
        f"≤ {_BOUND_GOAL:g} dB apart",
        f"{levels[0][0]:.2f} dB before sampling, {levels[1][0]:.2f} dB with folded orders; "
        f"{apart:.4f} dB apart",
        apart <= _BOUND_GOAL,
    )


def design_figures() -> list[Figure]:
    """Designs for one filter and for a known depth, at other depths, with their processor time."""
    design = TransferDesign(CAMERA, WAVELENGTH, SIZE)
    y, x = CAMERA.panel.plane.mesh()
    # Twenty waves at the edges, and focus in the middle of the range.
    middle = math.pi / WAVELENGTH * (y**2 + x**2)
    cubic = cubic_phase_mask(CAMERA.panel, 40 * math.pi) - middle
    return [
        *(_design_figure(QuarterTransfer(design), _rings(), one) for one in (_SHORT, _LONG)),
        _design_figure(FullTransfer(design), cubic, _KNOWN),
    ]


def _design_figure(transfer: PatternTransfer, start: torch.Tensor, task: _Task) -> Figure:
    spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)
    began = time.process_time()
    found = design_pattern(
        transfer,
        start,
        spectrum,
        NOISE,
        steps=task.steps,
        generator=torch.Generator().manual_seed(1),
        criterion=task.criterion,
    )
    seconds = time.process_time() - began
    depths = random_dioptres(64, torch.Generator().manual_seed(2))
    rating = rate_pattern(transfer, found.phase, spectrum, NOISE, depths)
    name = "blind" if task.criterion == "blind" else "known_depth"
    level, first = getattr(rating, name), getattr(found.start_rating, name)
    return Figure(
        f"designed pattern, expected PSNR, {_WORDS[task.criterion]}, {task.steps} steps",
        f"≥ {task.level:g} dB at 64 random depths, ≤ {task.seconds:g} s",
        f"{level:.2f} dB from {first:.2f} dB in {seconds:.0f} s of processor time",
        level >= task.level and seconds <= task.seconds,
    )


def _rings() -> torch.Tensor:
    """A quarter of rings of ten foci."""
    rings = multi_focus_rings(CAMERA.panel, even_vergences(2.0, 0.0, 10), WAVELENGTH)
    return crop_quarter(rings)


MEASUREMENTS = {"edof-design": edof_design_figures}
