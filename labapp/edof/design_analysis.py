"""Analyse patterns that extend the depth of field: restoration, transfer and PSFs over depth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.edof.design_problem import EdofProblem
from labapp.edof.design_request import STARTS
from optics.edof.depth_bound import known_depth_bound
from optics.edof.dioptres import midpoint_dioptres
from optics.edof.panel_transfer import QuarterTransfer
from optics.edof.pattern_rating import (
    DepthMemory,
    DesignResult,
    PatternRating,
    rate_pattern,
    rate_transfers,
)
from optics.edof.pattern_search import RATED_DEPTHS
from optics.edof.pattern_transfer import PatternTransfer
from optics.edof.picture_spectrum import FrequencyGrid
from optics.edof.protocol_psfs import compute_transfer
from optics.edof.spectral_criterion import error_level, filter_error, known_depth_error
from optics.plane import Plane
from optics.progress import Progress
from optics.psf import PSFOperator
from optics.quarter_symmetry import crop_quarter
from optics.slm import grey_to_phase

SHOWN_DEPTHS = 6
"""Depths whose PSFs and transfer functions are shown."""

_BENCH_DEPTHS = 32
"""Depths at which a pattern is rated as the bench shows it. Chosen, as for hand-made patterns."""

_HAND_MADE_DEPTHS = 32
"""Depths at which hand-made patterns are rated; twice as many change a rating by .05 dB at most
(measured for 0 to 2 dioptres)."""

MIRRORED_PATTERNS = ("rings", "sweep", "flat")
"""Hand-made patterns that are mirrored in the middle of the panel's pixels."""

_SHOWN_PIXELS = 128
"""Sensor pixels across the PSFs that are shown."""


@dataclass(frozen=True, eq=False)
class DepthCurves:
    """What linear restoration is expected to give at each depth.

    dioptres: (depths,).
    blind, known: (depths,), expected PSNR in dB, with one filter for all depths and with the depth
        known.
    rating: the same for all depths together.
    """

    dioptres: NDArray[np.float64]
    blind: NDArray[np.float64]
    known: NDArray[np.float64]
    rating: PatternRating


def analyse_depths(
    problem: EdofProblem, transfer: PatternTransfer, phase: torch.Tensor
) -> DepthCurves:
    """Compute the expected PSNR of linear restoration, depth by depth.

    phase: in the shape that `transfer` takes, radians.
    """
    dioptres = midpoint_dioptres(RATED_DEPTHS, problem.depth_range)
    spectrum, shares = problem.spectrum_on(transfer.grid).double(), transfer.grid.shares()
    noise = problem.request.noise
    with torch.no_grad():
        found = [transfer(phase, (one,)) for one in dioptres]
        memory = DepthMemory(len(dioptres), spectrum, noise)
        for one in found:
            memory.add(one[0])
        restoring = memory.filter()
        blind = [float(filter_error(restoring, one, spectrum, shares, noise)) for one in found]
        known = [float(known_depth_error(one, spectrum, shares, noise)) for one in found]
        rows = (one[0] for one in found)
        rating = rate_transfers(rows, len(found), spectrum, shares, noise)
    over_depth = [np.array([error_level(one) for one in errors]) for errors in (blind, known)]
    return DepthCurves(np.array(dioptres), over_depth[0], over_depth[1], rating)


def rate_on_bench(
    problem: EdofProblem, grey: torch.Tensor, wavelength: float, progress: Progress
) -> PatternRating:
    """Rate a pattern as the bench shows it: the panel's grey levels and pixels, and all its light.

    The PSFs are those of whole sensor pixels behind the bench's own camera, with the panel's
    unmodulated light, its gaps, its phase at the wavelength and its distance from the lens.

    grey: (rows, columns), uint8, what the panel shows.
    wavelength: metres.
    """
    phase, symmetry = grey_to_phase(problem.camera.panel, grey, wavelength), "none"
    if problem.mirrored and bool((grey == grey.flip(0)).all() and (grey == grey.flip(1)).all()):
        phase, symmetry = crop_quarter(phase), "quarter"
    grid = FrequencyGrid(problem.request.size)
    spectrum, noise = problem.spectrum.double(), problem.request.noise
    side = 2 * problem.window_reach(wavelength) + 1
    pixels = problem.camera.sensor.window_plane((side, side))
    dioptres = midpoint_dioptres(_BENCH_DEPTHS, problem.depth_range)

    def transfers() -> Iterator[torch.Tensor]:
        for number, one in enumerate(dioptres):
            progress.report(number / _BENCH_DEPTHS, f"on the bench, {one:.2f} D")
            operator = PSFOperator(
                problem.camera, 1 / one, wavelength, pixels, symmetry=symmetry, tol=1e-3, calls=1
            )
            yield compute_transfer(operator(phase), (grid.size, grid.size))

    return rate_transfers(transfers(), _BENCH_DEPTHS, spectrum, grid.shares(), noise)


def rate_all_hand_made(problem: EdofProblem) -> dict[str, PatternRating]:
    """Rate the hand-made patterns that the panel can show, by name."""
    found = {}
    for name in STARTS:
        # Pixels may be too large for a pattern's slope; the design doesn't depend on it.
        with suppress(ValueError):
            found[name] = rate_hand_made(problem, name)
    return found


def rate_hand_made(problem: EdofProblem, name: str) -> PatternRating:
    """Rate the hand-made pattern of a name for the same camera, pictures and depths."""
    wavelength = problem.request.wavelengths[0]
    transfer = problem.transfer(wavelength, mirrored=name in MIRRORED_PATTERNS)
    phase = problem.pattern(name, wavelength)
    if isinstance(transfer, QuarterTransfer):
        phase = crop_quarter(phase)
    dioptres = midpoint_dioptres(_HAND_MADE_DEPTHS, problem.depth_range)
    spectrum = problem.spectrum_on(transfer.grid)
    return rate_pattern(transfer, phase, spectrum, problem.request.noise, dioptres)


def bound_level(problem: EdofProblem, limit: torch.Tensor) -> float:
    """Return the highest expected PSNR in dB that any pattern can reach, with the depth known.

    limit: what `EdofProblem.limit` gives.
    """
    grid = FrequencyGrid(problem.request.size, quarter=True)
    spectrum = problem.spectrum_on(grid)
    return known_depth_bound(limit, spectrum, grid.shares(), problem.request.noise)


@dataclass(frozen=True, eq=False)
class DepthPictures:
    """PSFs at some depths, and their transfer functions along x.

    psfs: (depths, rows, columns), share of the light on each sensor pixel, as the bench's panel
    makes it. transfer: (depths, frequencies), modulus. frequencies: cycles per pixel.
    """

    dioptres: NDArray[np.float64]
    pixels: Plane
    psfs: NDArray[np.float64]
    frequencies: NDArray[np.float64]
    transfer: NDArray[np.float64]


def compute_depth_pictures(
    problem: EdofProblem, transfer: PatternTransfer, phase: torch.Tensor, progress: Progress
) -> DepthPictures:
    """Compute PSFs and transfer functions at some depths of the range.

    The PSFs are those of the bench's camera: with the panel's pixels, its unmodulated light, its
    distance from the lens and whole sensor pixels. phase: of the whole panel, radians.
    """
    far, near = problem.depth_range
    dioptres = np.linspace(far, near, SHOWN_DEPTHS)
    side = min(_SHOWN_PIXELS, *problem.camera.sensor.shape)
    pixels = problem.camera.sensor.window_plane((side, side))
    wavelength, psfs = problem.request.wavelengths[0], []
    for number, one in enumerate(dioptres):
        progress.report(number / SHOWN_DEPTHS, f"PSF at {one:.2f} D")
        distance = 1 / one if one > 0 else math.inf
        operator = PSFOperator(problem.camera, distance, wavelength, pixels, calls=1, tol=1e-2)
        psfs.append(operator(phase).double().numpy())
    given = crop_quarter(phase) if problem.mirrored else phase
    with torch.no_grad():
        found = transfer(given, tuple(float(one) for one in dioptres))
    frequencies = transfer.grid.frequencies()[1][0].numpy()
    return DepthPictures(
        dioptres, pixels, np.stack(psfs), frequencies, found[:, 0].abs().double().numpy()
    )


@dataclass(frozen=True, eq=False)
class FinishedDesign:
    """A designed pattern with everything that is told of it.

    grey: (rows, columns), uint8, the pattern as the panel shows it.
    start, design: expected PSNR over depth, of the pattern at the start and of the design.
    on_bench: by wavelength in metres.
    bound: highest expected PSNR of any pattern, dB.
    limit: largest rms transfer function of any pattern.
    """

    problem: EdofProblem
    result: DesignResult
    phase: torch.Tensor
    grey: np.ndarray
    start: DepthCurves
    design: DepthCurves
    on_bench: dict[float, PatternRating]
    hand_made: dict[str, PatternRating]
    bound: float
    limit: torch.Tensor
    pictures: DepthPictures
    steps: int
    cpu_seconds: float
