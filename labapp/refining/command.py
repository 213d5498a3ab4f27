"""`labapp refine`: from a design to one that the bench's own camera has corrected."""

from __future__ import annotations

from pathlib import Path

from labapp.bench.opening import Bench, BenchFiles, open_bench
from labapp.common.errors import UserError
from labapp.files.design_file import DesignContents, read_design, write_design
from labapp.files.places import is_design
from labapp.files.writing import make_folder, require_free, require_writable, write_whole
from labapp.refining.exposing import record_of
from labapp.refining.request import Request, completed
from labapp.refining.result import Result, contents_of
from labapp.refining.start import start_from
from labapp.refining.telling import tell, warn_of_description
from labapp.refining.view import view_of
from labapp.refining.watching import Watcher
from labapp.runs.acquisition.taking import Ask
from labapp.runs.running import Manner, attended
from optics.progress import Progress
from optics.retrieval import refine

_SHARE = 0.95
"""Of the time that pictures take; predicting the PSF takes the rest."""


def refine_design(
    design: Path, path: Path, runs: Path | None, request: Request, files: BenchFiles, manner: Manner
) -> None:
    """Write the refined design and its picture; say how good every picture of the bench was.

    runs: the folder of the pictures' records. UserError if something can't be.
    """
    if not is_design(path):
        raise UserError(f"{path}: the ending must be .h5.")
    drawn = path.with_name(f"{path.stem}_psf.png")
    folder = runs or path.with_name(f"{path.stem}_runs")
    for file in (path, drawn):
        require_writable(file, force=manner.force)
    records = [record_of(folder, number + 1).name for number in range(request.pictures)]
    require_free(folder, records, force=manner.force)
    before = read_design(design)
    with open_bench(files, speed=manner.speed) as bench, attended(manner) as (progress, ask):
        pictures = progress.part(0, _SHARE)
        result = refined(bench, before, design, folder, request, pictures, ask, force=manner.force)
        contents = contents_of(result, design, before, bench.file, progress.part(_SHARE, 1))
        name = bench.file.name
    write_design(path, contents)
    from labapp.refining.picture import picture

    notes = f"{name}, {result.start.spec.wavelength_nm:g} nm, {len(result.pictures)} pictures"
    write_whole(drawn, picture(contents.title, notes, result))
    tell(result, [path, drawn], as_json=manner.as_json)


def refined(
    bench: Bench,
    contents: DesignContents,
    design: Path,
    folder: Path,
    request: Request,
    progress: Progress | None = None,
    ask: Ask | None = None,
    *,
    force: bool = False,
) -> Result:
    """Take the pictures of a design on a bench, each into a record of a folder.

    design: the file's name in errors. UserError says what is wrong; Cancelled if the progress
    was cancelled. The bench is left safe.
    """
    start = start_from(contents, design, bench.description)
    request = completed(request, bench)
    assert request.star_um is not None
    assert request.star_m is not None
    view = view_of(bench.file, start.goal, request.star_um * 1e-6, request.star_m)
    if not view.calibrated:
        warn_of_description()
    make_folder(folder)
    watcher = Watcher(bench, request, start, view, folder, force, ask, [])
    try:
        found = refine(
            start.goal,
            start.phases,
            watcher,
            request.pictures,
            blur=view.blurred,
            progress=progress,
        )
    except ValueError as error:
        raise UserError(f"{design}: {error}.") from error
    return Result(start, request, view, watcher.seen, start.on_panel(found.phases))
