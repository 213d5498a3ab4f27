"""`labapp accuracy edof`: measure what the design of patterns for depth of field costs in time."""

from __future__ import annotations

from pathlib import Path

from labapp.accuracy import edof_design, edof_psf
from labapp.accuracy.diagram import draw
from labapp.accuracy.edof_case import EdofCase
from labapp.accuracy.row_output import print_data, print_rows, write_plot
from labapp.accuracy.work_precision import LONGEST_CALL
from labapp.common.console import terminal_progress
from labapp.common.speed import machine_speed
from optics.accuracy import Budget
from optics.threads import single_threaded


@single_threaded
def accuracy_edof(
    case: EdofCase, *, part: str, most_steps: int, as_json: bool, plot: Path | None
) -> None:
    """Measure designs for depth of field and PSFs with gradients, and print the rows.

    part: "design", "psf", or "all" for both.
    plot: file of the diagram: of designs, or of PSFs if they alone are measured.
    """
    designs, gradients = list[edof_design.DesignRow](), list[edof_psf.GradientRow]()
    with terminal_progress() as progress:
        if part != "design":
            budget = Budget(speed=machine_speed(progress.part(0.0, 0.05)), seconds=LONGEST_CALL)
            share = progress.part(0.05, 0.3 if part == "all" else 1.0)
            gradients = edof_psf.measure_gradients(case, budget, share)
        if part != "psf":
            share = progress.part(0.3 if part == "all" else 0.0, 1.0)
            designs = edof_design.measure_designs(case, most_steps, share)
    if as_json:
        print_data([*designs, *gradients])
    if designs and not as_json:
        title = f"Design for depth of field: {design_name(case)}"
        print_rows(title, edof_design.COLUMNS, edof_design.REMARK, designs, as_json=False)
    if gradients and not as_json:
        title = f"PSF with gradient: {psf_name(case)}"
        print_rows(title, edof_psf.COLUMNS, edof_psf.REMARK, gradients, as_json=False)
    if designs:
        write_plot(plot, lambda: draw(design_name(case), designs, edof_design.ERROR_NAME))
    else:
        write_plot(plot, lambda: draw(psf_name(case), gradients, edof_psf.ERROR_NAME))


def design_name(case: EdofCase) -> str:
    """Describe in words what is designed for."""
    return f"{case.camera_name}, 0 to 2 D, noise {case.noise:g}, pictures of {case.size}²"


def psf_name(case: EdofCase) -> str:
    """Describe the PSFs with gradients in words."""
    return f"{case.camera_name}, {case.nearest_distance:g} m, {case.window}² samples"
