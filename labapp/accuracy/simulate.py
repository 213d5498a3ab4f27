"""`labapp accuracy simulate`: measure what a tolerance costs the simulator, and check errors."""

from __future__ import annotations

from dataclasses import dataclass

from labapp.accuracy.row_output import Columns, print_rows
from labapp.accuracy.work_precision import ENDLESS, Deadline
from labapp.common.console import terminal_progress
from labapp.prediction.simulating.all_effects import (
    Deviation,
    RenderedPicture,
    render_all_effects,
    render_by_plan,
)
from labapp.prediction.simulating.picture_request import (
    PictureRequest,
    prepare_bench_scene,
    prepare_scene,
    small_bench_setup,
)
from optics.progress import Progress
from optics.threads import single_threaded
from simulator.situation import Situation

TOLERANCES = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3)


@dataclass(frozen=True)
class SimulationRow:
    """Measured cost and error of one simulated picture.

    tol, told: of the effect plan: its tolerance, None for all effects at their finest, and its
    error bound.
    mean, variance, sigma: relative L2 errors of the mean picture, the variance and the standard
    deviation, against all effects at their finest.
    work: counted operations.
    cpu_s, deciding_s: processor seconds of the whole, and of the effect plan alone.
    left_out, caused: effects that are off or coarser than their finest, of those decided about.
    """

    tol: float | None
    told: float
    mean: float
    variance: float
    sigma: float
    work: float
    cpu_s: float
    deciding_s: float
    left_out: int
    caused: int

    @property
    def is_within_tolerance(self) -> bool:
        return self.tol is None or max(self.mean, self.variance, self.sigma) <= self.tol


_COLUMNS: Columns[SimulationRow] = {
    "tol ": lambda row: "all on" if row.tol is None else f"{row.tol:g}",
    "told ": lambda row: _error(row.told),
    "mean ": lambda row: _error(row.mean),
    "var. ": lambda row: _error(row.variance),
    "σ ": lambda row: _error(row.sigma),
    "less ": lambda row: f"{row.left_out}/{row.caused}",
    "work ": lambda row: f"{row.work:.0e}",
    "CPU ms ": lambda row: f"{1e3 * row.cpu_s:.0f}",
    "plan ": lambda row: f"{1e3 * row.deciding_s:.0f}",
    "": lambda row: "" if row.is_within_tolerance else "beyond",
}
_REMARK = (
    "told: the error that the plan allows for, at most. mean, var., σ: relative L2 errors "
    "against everything on at its finest. less: effects that are off, or coarser than their "
    "finest. work: operations, counted. CPU ms: one thread, plan included."
)


@single_threaded
def accuracy_simulate(request: PictureRequest, *, as_json: bool) -> None:
    """Measure simulated pictures at five tolerances, and print the rows.

    The reference is the same picture with all effects at their finest. Without a bench file the
    bundled bench with few pixels is used. The process ends with exit code 1 if an error exceeds its
    tolerance.
    """
    with terminal_progress() as progress:
        s = prepare_situation(request, progress.part(0.0, 0.1))
        found = measure_tolerances(s, progress.part(0.1, 1.0))
    print_rows(describe_situation(s), _COLUMNS, _REMARK, found, as_json=as_json)
    if not all(row.is_within_tolerance for row in found):
        raise SystemExit(1)


def prepare_situation(request: PictureRequest, progress: Progress) -> Situation:
    """Return what is simulated: with the request's bench, or the bundled one with few pixels."""
    if request.bench is not None:
        scene = prepare_scene(request, progress)
    else:
        scene = prepare_bench_scene(small_bench_setup(request.scene), request, progress)
    with scene as staged:
        return staged.situation


def measure_tolerances(
    s: Situation, progress: Progress, deadline: Deadline = ENDLESS
) -> list[SimulationRow]:
    """Return a row of a simulated picture at each tolerance, the largest first.

    The last row is for all effects at their finest. Tolerances left at the deadline are left out.
    """
    share = 1 / (len(TOLERANCES) + 1)
    progress.report(0.0, "everything on")
    truth = render_all_effects(s, progress.raise_if_cancelled)
    # What libraries do at their first use is in no row's time.
    render_by_plan(s, TOLERANCES[0], progress.raise_if_cancelled)
    found = []
    for number, tol in enumerate(TOLERANCES):
        if deadline.is_over:
            break
        progress.report((number + 1) * share, f"tolerance {tol:g}")
        found.append(_row(render_by_plan(s, tol, progress.raise_if_cancelled), truth, tol))
    caused = found[0].caused if found else 0
    whole = SimulationRow(None, 0, 0, 0, 0, truth.operations, truth.cpu, 0, 0, caused)
    return [*found, whole]


def _row(picture: RenderedPicture, reference: RenderedPicture, tol: float) -> SimulationRow:
    plan, error = picture.plan, Deviation.of(picture.picture, reference.picture)
    assert plan is not None
    below = sum(line.level != line.levels[-1] for line in plan.decisions)
    return SimulationRow(
        tol, plan.relative_error, error.mean, error.variance, error.sigma,
        picture.operations, picture.cpu, picture.planning_cpu, below, len(plan.decisions),
    )  # fmt: skip


def describe_situation(s: Situation) -> str:
    """Describe a picture in one line: target, wavelength, exposure, pixels."""
    rows, columns = s.camera.sensor.shape
    return (
        f"{s.target.name} at {s.wavelength * 1e9:g} nm, {s.exposure * 1e3:.3g} ms, "
        f"{columns} x {rows} pixels"
    )


def _error(value: float) -> str:
    return f"{value:.0e}" if value else "0"
