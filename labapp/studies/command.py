"""The command `labapp study`: carry out a study on a bench, or evaluate an existing record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labapp.bench.opening import BenchFiles, open_bench
from labapp.common.console import out, print_json, print_table, styled_line, terminal_progress
from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.common.stopwatch import Stopwatch
from labapp.files.output_paths import RECORD, STUDY_FILES
from labapp.files.reading import bundled_path
from labapp.files.sensor_file import require_monochrome_sensor
from labapp.files.writing import make_folder, require_free_names
from labapp.runs.acquisition.attendance import AskOperator, Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import ExecutionOptions, interactive_progress, require_complete
from labapp.runs.state import State
from labapp.studies.contract import Study, StudyResults, StudySettings
from labapp.studies.page import CompletedStudy, study_as_data, write_study_files
from labapp.studies.study_lookup import (
    find_study,
    read_study_settings,
    settings_from_record,
    with_study_metadata,
)
from optics.camera import Camera
from optics.progress import Progress


@dataclass(frozen=True)
class StudyRequest:
    """Name a study, with KEY=VALUE settings, and the bench to carry it out on.

    Where `bench` or `scene` is None, the study's own file is used.
    """

    name: str
    keys: Sequence[str] = ()
    seed: int = 1
    quick: bool = False
    bench: Path | None = None
    scene: Path | None = None
    faults: Path | None = None


def run_study(request: StudyRequest, folder: Path, manner: ExecutionOptions) -> None:
    """Acquire a record, evaluate it, write its picture and page, and print its table."""
    with interactive_progress(manner) as (progress, ask):
        account = carry_out_study(request, folder, manner, progress, ask)
    _print_results(account, folder, (RECORD, *STUDY_FILES), manner)


def carry_out_study(
    request: StudyRequest,
    folder: Path,
    manner: ExecutionOptions | None = None,
    progress: Progress | None = None,
    ask: AskOperator | None = None,
) -> CompletedStudy:
    """Acquire a study's record and evaluate it, without printing anything.

    The folder gets run.h5, study.png, study.html and study.json. Raises UserError if a setting is
    wrong, a file exists, the folder can't be written, or the bench can't do the study. After
    Cancelled, the record remains and can be resumed.
    """
    manner, progress = manner or ExecutionOptions(), progress or Progress()
    found = find_study(request.name)
    settings = read_study_settings(request.name, request.keys, quick=request.quick)
    require_free_names(folder, (RECORD, *STUDY_FILES), force=manner.force)
    files = BenchFiles(
        request.bench or bundled_path(found.bench),
        request.scene or bundled_path(found.scene),
        faults=request.faults,
    )
    watch = Stopwatch()
    # The acquisition is shown as 70 % of the study's progress.
    acquiring, evaluating = progress.part(0, 0.7), progress.part(0.7, 1)
    with open_bench(files, speed=manner.speed) as bench:
        _require_sensor(found, request.name, bench.description)
        plan = with_study_metadata(
            found.plan(settings, bench.description), request.name, settings, request.seed
        )
        make_folder(folder)
        outcome = run_plan(
            bench,
            plan,
            folder / RECORD,
            Attendance(progress=acquiring, ask=ask),
            source=f"study {request.name}",
            force=manner.force,
            stopwatch=watch,
        )
    require_complete(outcome)
    return _evaluate_and_write(
        request.name, found, settings, outcome.path, folder, watch, evaluating
    )


def evaluate_record(name: str, record: Path, folder: Path, manner: ExecutionOptions) -> None:
    """Evaluate a record again, as after a resume; raises as carry_out_study() does."""
    found = find_study(name)
    require_free_names(folder, STUDY_FILES, force=manner.force)
    with Record(record) as opened:
        settings = settings_from_record(opened, name)
    make_folder(folder)
    with terminal_progress() as progress:
        account = _evaluate_and_write(name, found, settings, record, folder, Stopwatch(), progress)
    _print_results(account, folder, STUDY_FILES, manner)


def _evaluate_and_write(
    name: str,
    found: Study[Any],
    settings: StudySettings,
    path: Path,
    folder: Path,
    watch: Stopwatch,
    progress: Progress,
) -> CompletedStudy:
    with Record(path) as record:
        _require_sensor(found, name, record.camera)
        if record.state is not State.COMPLETE:
            raise UserError(
                f"{path}: the run is {record.state}, and the study needs all of its frames. "
                f"Take the rest: labapp resume {shell_word(path)}"
            )
        with watch.stage("evaluate"):
            results: StudyResults = found.evaluate(record, settings, progress.part(0, 0.9))
        simulated, seed = record.simulated_devices, record.seed
    progress.report(0.9, "page")
    account = CompletedStudy(name, found, settings, seed, path, simulated, results, watch.seconds)
    write_study_files(account, folder)
    return account


def _require_sensor(found: Study[Any], name: str, camera: Camera) -> None:
    """Raise UserError for colour filters on the sensor, if the evaluation can't take them."""
    if not found.takes_colour:
        require_monochrome_sensor(camera.sensor, f"study {name}")


def _print_results(
    account: CompletedStudy, folder: Path, names: Sequence[str], manner: ExecutionOptions
) -> None:
    if manner.as_json:
        print_json(study_as_data(account))
        return
    badge = account.simulation_badge
    heading = f"{account.study.title} ({account.study.source})"
    out.print(styled_line((heading, "bold"), "  ", (badge, "yellow")))
    out.print()
    rows = [[row.what, row.published, row.expected, row.ours] for row in account.results.rows]
    print_table("", ["what", "published", "expected", "ours"], rows)
    for note in account.results.notes:
        out.print(note, style="dim")
    for one in names:
        out.print(f"wrote {folder / one}", soft_wrap=True)
