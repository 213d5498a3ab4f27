"""All operations that are measured: what each computes, and how it is measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from labapp.accuracy import (
    blurs,
    chain,
    deconvolve,
    edof,
    edof_design,
    edof_psf,
    hdr,
    hdr_case,
    hdr_diagram,
    multispectral,
    propagate,
    psf,
    retrieval,
    simulate,
    spectral_case,
)
from labapp.accuracy.overview.cases import (
    Scope,
    chain_case,
    depth_of_field_case,
    field_case,
    lens_case,
    panel_case,
    retrieval_goal,
)
from labapp.accuracy.work_precision import CALLS, Comparison, Deadline, Row, mark_front, measure
from labapp.pictures.networks import bundled_denoiser
from labapp.prediction.simulating.picture_request import PictureRequest
from optics.progress import Progress

Measured = tuple[str, Sequence[Row]]
"""A case in words, and its measured rows."""


@dataclass(frozen=True)
class Operation:
    """An operation of the page.

    measure: returns the case in words and the rows. It raises UserError or ValueError with the
    reason if the operation can't be measured for a camera.
    """

    name: str
    title: str
    what: str
    error_name: str
    measure: Callable[[Scope, Progress, Deadline], Measured]


def _measure_lens(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    case = lens_case(scope)
    exact = progress.part(0.0, 0.2)
    found = psf.compare_methods(case, scope.budget, exact, grids=False)
    return case.name, _measure(found, scope, progress.part(0.2, 1.0), deadline)


def _measure_panel(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    return _measure_camera(panel_case(scope), scope, progress)


def _measure_chain(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    return _measure_camera(chain_case(scope), scope, progress)


def _measure_camera(case: chain.ChainCase, scope: Scope, progress: Progress) -> Measured:
    """Measure the PSF methods of a camera with a panel."""
    progress.report(0.0, "the exact integral")
    found = chain.compare_methods(case, scope.budget)
    # The exact integral of a large panel may take longer than all methods together.
    deadline = Deadline.after(scope.settings.operation_s)
    return case.name, _measure(found, scope, progress.part(0.3, 1.0), deadline)


def _measure_propagation(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    case = field_case(scope)
    progress.report(0.0, "the exact field")
    found = propagate.compare_methods(case, scope.budget)
    return case.name, _measure(found, scope, progress.part(0.2, 1.0), deadline)


def _measure(
    comparison: Comparison, scope: Scope, progress: Progress, deadline: Deadline
) -> Sequence[Row]:
    """Measure methods from the largest tolerance to the least.

    What is cut at the deadline is then the most exact, and slowest.
    """
    candidates, truth, similar = comparison
    least = 0.99 * scope.settings.least_tolerance
    found = [one for one in candidates if one.row.tol is None or one.row.tol >= least]
    found.sort(key=lambda one: -(one.row.tol or math.inf))
    return measure(found, truth, progress, warm_up=similar, deadline=deadline).rows


def _measure_deconvolution(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    size = scope.settings.picture_size
    case = blurs.photograph_from_options(None, "disk of 7", None, 0.01, "unknown", size, 0)
    found = deconvolve.measure_deconvolution(
        case, bundled_denoiser(), scope.budget.speed, progress, deadline=deadline
    )
    return case.name, found[1:]


def _measure_spectra(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    size = scope.settings.picture_size
    case = spectral_case.spectral_case_from_options(None, "ring", 0.01, size, 0)
    return case.name, multispectral.measure_multispectral(case, progress, deadline)


def _measure_merges(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    pixels = scope.settings.picture_size
    cases = [
        hdr_case.BracketCase(frames, 4.0, 1e-3, 4.0, 16, 12, 2.6, 2.4, pixels, 0)
        for frames in (2, 4, 8)
    ]
    return hdr.cases_name(cases), hdr.measure_merges(cases, progress, deadline)


def _measure_pattern_gradients(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    case = depth_of_field_case(scope)
    rows = edof_psf.measure_gradients(case, scope.budget, progress, deadline)
    return edof.psf_name(case), rows


def _measure_designs(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    case = depth_of_field_case(scope)
    rows = edof_design.measure_designs(case, scope.settings.edof_steps, progress, deadline)
    return edof.design_name(case), rows


def _measure_retrieval(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    goal, name = retrieval_goal(scope)
    rows = retrieval.measure_retrieval(
        goal, name, 1, scope.settings.retrieval_s, scope.budget.speed, progress, deadline
    )
    return name, rows


def _measure_simulation(scope: Scope, progress: Progress, deadline: Deadline) -> Measured:
    # A star, on few pixels.
    s = simulate.prepare_situation(PictureRequest(target="star"), progress.part(0.0, 0.1))
    found = simulate.measure_tolerances(s, progress.part(0.1, 1.0), deadline)
    name = f"{simulate.describe_situation(s)}, on the bench with few pixels"
    return name, mark_front([_simulation_row(one, name) for one in found if one.tol is not None])


def _simulation_row(row: simulate.SimulationRow, name: str) -> Row:
    """Return a simulated picture's cost as a row.

    The first answer includes the effect plan, which later pictures of the same scene share.
    """
    return Row(
        "simulate", name, "effect plan", "float32", row.tol,
        error_achieved=max(row.mean, row.variance, row.sigma),
        error_predicted=row.told,
        cpu_s=row.cpu_s - row.deciding_s,
        first_answer_s=row.cpu_s,
        engine="effect plan",
        chosen_for=CALLS,
    )  # fmt: skip


OPERATIONS = (
    Operation(
        "chain",
        "PSF of a panel apart from its lens",
        "Light goes from a point to the panel, on to the lens and its stop, and to the sensor, on "
        "whose whole pixels it is integrated. Here each decimal has its price.",
        "error, relative L2",
        _measure_chain,
    ),
    Operation(
        "panel",
        "PSF behind a panel",
        "The light of a point behind an SLM that stands in the plane of the lens and shows random "
        "phases. One Fourier transform leads to the sensor, so that accuracy costs little.",
        "error, relative L2",
        _measure_panel,
    ),
    Operation(
        "lens",
        "PSF of a lens",
        "The light of a point behind a lens with a stop: Fraunhofer's integral over the stop, "
        "squared.",
        "error, relative L2",
        _measure_lens,
    ),
    Operation(
        "edof-psf",
        "PSF of a pattern, with its gradient",
        "What each step of a design computes, for a pattern that is mirrored and separable. The "
        "last two methods serve such patterns alone. A call is a PSF and its gradient, the first "
        "answer a PSF with its planning.",
        edof_psf.ERROR_NAME,
        _measure_pattern_gradients,
    ),
    Operation(
        "propagate",
        "Propagation through free space",
        "The complex field on one plane, from that on another plane before it. Paraxial methods "
        "are shown where their approximation allows the tolerance.",
        "error of the field, relative L2",
        _measure_propagation,
    ),
    Operation(
        "simulate",
        "Simulated pictures",
        "A picture of the virtual bench. Its tolerance decides which effects are left out; the "
        "error is the largest of mean, variance and standard deviation, against all effects at "
        "their finest. The first answer includes the decision.",
        "error, relative L2",
        _measure_simulation,
    ),
    Operation(
        "retrieval",
        "Phase retrieval",
        "A pattern for the SLM whose PSF has a wanted shape. There is no exact answer: the error "
        "levels off, and more iterations don't reach any error that one may wish.",
        retrieval.ERROR_NAME,
        _measure_retrieval,
    ),
    Operation(
        "edof-design",
        "Design for depth of field",
        "A pattern for the SLM from whose photographs one filter restores all depths best. The "
        "error is how far the expected PSNR stays below what no pattern can pass with the depth "
        "known, in dB: it levels off above zero.",
        edof_design.ERROR_NAME,
        _measure_designs,
    ),
    Operation(
        "hdr",
        "Merging of exposure brackets",
        "Light of four decades from two, four and eight exposures. Noise limits what can be known: "
        "for each number of exposures, the error levels off.",
        hdr_diagram.ERROR_NAME,
        _measure_merges,
    ),
    Operation(
        "deconvolve",
        "Restoration of a blurred photograph",
        "A sharp picture from a blurred and noisy one. Noise limits what can be known, so that the "
        "error levels off.",
        deconvolve.ERROR_NAME,
        _measure_deconvolution,
    ),
    Operation(
        "multispectral",
        "Restoration of spectral bands",
        "Six bands of a chart from one photograph of a colour sensor, which sees each band blurred "
        "by a ring of its own. Noise and mixed bands limit what can be known, so that the error "
        "levels off.",
        multispectral.ERROR_NAME,
        _measure_spectra,
    ),
)
"""All operations, in the page's order."""
