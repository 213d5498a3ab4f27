"""The command `labapp refine`: correct a design by pictures of the bench's own camera."""

from __future__ import annotations

from pathlib import Path

from labapp.bench.opening import Bench, BenchFiles, open_bench
from labapp.common.console import print_message
from labapp.common.errors import UserError
from labapp.files.design_file import DesignContents, read_design, write_design
from labapp.files.output_paths import is_design
from labapp.files.writing import make_folder, require_free_names, require_writable, write_atomically
from labapp.refining.psf_measurement import PSFMeasurer, record_path
from labapp.refining.refinement_request import RefinementRequest, with_star_size
from labapp.refining.result import RefinementResult, print_report, refined_design_contents
from labapp.refining.sensor_view import build_view
from labapp.refining.start import build_start
from labapp.runs.acquisition.attendance import AskOperator
from labapp.runs.run_commands import ExecutionOptions, interactive_progress
from optics.progress import Progress
from optics.retrieval import refine


def refine_design(
    design: Path,
    path: Path,
    runs: Path | None,
    request: RefinementRequest,
    files: BenchFiles,
    manner: ExecutionOptions,
) -> None:
    """Correct a design on a bench, write the new file and its picture, and print a report.

    `runs` is the folder of the pictures' records. Raises UserError if the design, the bench or an
    output path doesn't allow it.
    """
    if not is_design(path):
        raise UserError(f"{path}: the ending must be .h5.")
    drawn = path.with_name(f"{path.stem}_psf.png")
    folder = runs or path.with_name(f"{path.stem}_runs")
    for file in (path, drawn):
        require_writable(file, force=manner.force)
    records = [record_path(folder, number + 1).name for number in range(request.pictures)]
    require_free_names(folder, records, force=manner.force)
    before = read_design(design)
    with (
        open_bench(files, speed=manner.speed) as bench,
        interactive_progress(manner) as (progress, ask),
    ):
        # The pictures take about 95 % of the time; predicting the PSF takes the rest.
        pictures, predicting = progress.part(0, 0.95), progress.part(0.95, 1)
        result = run_refinement(
            bench, before, design, folder, request, pictures, ask, force=manner.force
        )
        contents = refined_design_contents(result, design, before, bench.file, predicting)
        name = bench.file.name
    write_design(path, contents)
    from labapp.refining.refinement_picture import draw_refinement

    notes = f"{name}, {result.start.spec.wavelength_nm:g} nm, {len(result.pictures)} pictures"
    write_atomically(drawn, draw_refinement(contents.title, notes, result))
    print_report(result, [path, drawn], as_json=manner.as_json)


def run_refinement(
    bench: Bench,
    contents: DesignContents,
    design: Path,
    folder: Path,
    request: RefinementRequest,
    progress: Progress | None = None,
    ask: AskOperator | None = None,
    *,
    force: bool = False,
) -> RefinementResult:
    """Correct a design by pictures that a bench takes, each into a record in `folder`.

    `design` is the design file's name in errors. Raises UserError if a picture or the design is
    wrong, and Cancelled if the progress was cancelled. The bench is left safe.
    """
    start = build_start(contents, design, bench.description)
    request = with_star_size(request, bench)
    assert request.star_um is not None
    assert request.star_m is not None
    view = build_view(bench.file, start.goal, request.star_um * 1e-6, request.star_m)
    if not view.is_calibrated:
        print_message(
            "no registration is in force: the star is taken to be seen in the middle of the "
            "sensor, with nothing turned or mirrored, by the bench file's distances. If that isn't "
            "so, calibrate this bench first: labapp calibrate"
        )
    make_folder(folder)
    watcher = PSFMeasurer(bench, request, start, view, folder, force, ask)
    try:
        found = refine(
            start.goal,
            start.phases,
            watcher,
            request.pictures,
            blur=view.convolve_with_star,
            progress=progress,
        )
    except ValueError as error:
        raise UserError(f"{design}: {error}.") from error
    return RefinementResult(
        start, request, view, watcher.measurements, start.phases_on_panel(found.phases)
    )
