"""`labapp accuracy chain`: measure every PSF method for a panel that stands apart from its lens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.accuracy.command import show_measurements
from labapp.accuracy.option_validation import require_pattern
from labapp.accuracy.references.psf_problem import ChainProblem, PSFReference
from labapp.accuracy.work_precision import (
    LONGEST_CALL,
    Candidate,
    Comparison,
    Row,
    candidates_by_tolerance,
    measure,
    similar_wavelength,
)
from labapp.common.console import terminal_progress
from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from labapp.prediction.lens_options import LensCase, read_panel
from optics.accuracy import Budget
from optics.camera import Camera, Panel
from optics.psf import PSFOperator
from optics.threads import single_threaded

Array = NDArray[np.float64]

TOLERANCES = tuple(10.0**-k for k in range(1, 7))


@dataclass(frozen=True)
class ChainCase:
    """A PSF problem of a chain, and its name in words."""

    problem: ChainProblem
    name: str


def chain_case_from_options(
    case: LensCase,
    *,
    panel: str | None,
    separation_mm: float | None,
    pattern: str,
    field: tuple[float, float],
    sphere: bool,
    most_products: float = 2e12,
) -> ChainCase:
    """Build the problem that the options of `labapp accuracy chain` describe.

    case: lens, object and window; its camera is None where no camera file was given.
    panel: "ROWSxCOLUMNSxMICROMETRES"; only where no camera file describes a panel.
    field: position (y, x) of the image on the sensor, from the axis, metres.
    most_products: that the exact integral may take. The default takes many minutes.
    Raises UserError for options that are unknown or contradict each other, and for a camera whose
    exact integral would take too long.
    """
    camera = _camera(case, panel, separation_mm)
    phase = _phase(pattern, camera.panel.shape)
    problem = ChainProblem(
        camera, case.distance, case.wavelength, case.pixels, False, TOLERANCES[0], phase, field,
        sphere,
    )  # fmt: skip
    # The exact integral's cost doesn't depend on where in the window the light arrives.
    terms = problem.build_reference(np.ones(problem.pixels.shape)).product_count
    if not terms <= most_products:
        raise UserError(
            f"the exact integral of this camera is a sum of {terms:.0e} products, which takes too "
            "long; give a larger --f-number, a larger --separation-mm, or a smaller panel."
        )
    rows, columns = camera.panel.shape
    words = [
        f"{rows}x{columns} pixels of {camera.panel.pitch * 1e6:g} µm, {pattern}",
        f"{camera.separation * 1e3:g} mm before {case.name}"
        if camera.separation
        else f"in the plane of {case.name}",
    ]
    if any(field):
        words.append("field {:g}, {:g} mm".format(*(1e3 * place for place in field)))
    return ChainCase(problem, ", ".join([*words, *(["sphere"] if sphere else [])]))


def _camera(case: LensCase, panel: str | None, separation_mm: float | None) -> Camera:
    """Return the camera with a panel, of which a lens alone gets one 50 mm before it."""
    if case.camera is None:
        shape, pitch = read_panel(panel or "96x128x8")
        camera = Camera(Panel(shape, pitch, unmodulated=0.0), case.lens, separation=50e-3)
    elif panel is not None:
        raise UserError(f"--panel {panel}: the camera's file has a panel; leave one of them out.")
    else:
        camera = case.camera
    if separation_mm is None:
        return camera
    try:
        return replace(camera, separation=separation_mm * 1e-3)
    except ValueError as error:
        raise UserError(f"--separation-mm {separation_mm:g}: {error}.") from error


def _phase(pattern: str, shape: tuple[int, int]) -> Array:
    """Return the phase on the panel, (rows, columns), radians."""
    require_pattern(pattern)
    if pattern == "random":
        return np.random.default_rng(0).uniform(0, 2 * np.pi, shape)
    y, x = ((np.arange(n) - n // 2) / n for n in shape)
    # y and x end at 1/2, so that the phase rises by 40 / 8 = 5 rad from the middle to an edge.
    cubic: Array = 40.0 * (y[:, None] ** 3 + x**3)
    return cubic if pattern == "cubic" else 0 * cubic


def build_reference(problem: ChainProblem) -> PSFReference:
    """Return the exact light on rows and columns of the window, drawn by an approximate PSF.

    If no method gives one, all are equally likely.
    """
    try:
        light = problem.light(problem.operator(problem.tol))
    except ValueError:
        light = np.ones(problem.pixels.shape)
    return problem.build_reference(light)


def candidates(case: ChainCase, reference: PSFReference, budget: Budget) -> Iterator[Candidate]:
    """Yield every PSF method at every tolerance."""
    problem = case.problem

    def build_call(operator: PSFOperator) -> Callable[[], Array]:
        return lambda: reference.weighted_samples(problem.light(operator))

    row = Row("chain", case.name, "", "float64", None)
    plan = partial(problem.operator, budget=budget)
    return candidates_by_tolerance(row, problem.methods, TOLERANCES, plan, build_call)


def compare_methods(case: ChainCase, budget: Budget) -> Comparison:
    """Return what is measured of a chain's PSF, with the exact one on some samples."""
    reference = build_reference(case.problem)
    truth = reference.exact_samples
    other = replace(case.problem, wavelength=similar_wavelength(case.problem.wavelength))
    similar = candidates(ChainCase(other, case.name), reference, budget)
    return Comparison(list(candidates(case, reference, budget)), truth, similar)


@single_threaded
def accuracy_chain(case: ChainCase, *, memory: int, as_json: bool, plot: Path | None) -> None:
    """Measure error and time of every PSF method for a chain, and print the rows.

    memory: bytes that each method may use.
    """
    with terminal_progress() as progress:
        budget = Budget(memory, machine_speed(progress.part(0.0, 0.1)), seconds=LONGEST_CALL)
        progress.report(0.1, "the exact integral")
        found, truth, similar = compare_methods(case, budget)
        progress.report(0.3, "planning")
        measured = measure(found, truth, progress.part(0.3, 1.0), warm_up=similar)
    show_measurements("Chain", case.name, measured, as_json, plot)
