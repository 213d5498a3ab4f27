"""`labapp study`: a study on a bench, or of a record that is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labapp.bench.opening import BenchFiles, open_bench
from labapp.common.console import out, print_json, table, watched
from labapp.common.errors import UserError
from labapp.common.stopwatch import Stopwatch
from labapp.files.places import RECORD, STUDY_FILES
from labapp.files.reading import bundled
from labapp.files.writing import make_folder, require_free
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.acquisition.taking import Ask
from labapp.runs.record.reader import Record
from labapp.runs.running import Manner, attended, require_complete
from labapp.runs.state import State
from labapp.studies.contract import Results, Settings, Study
from labapp.studies.finding import find_study, marked, read_settings, settings_of
from labapp.studies.page import Account, as_data, write
from optics.progress import Progress

_ACQUIRING = 0.7
"""Share of a study's progress."""


@dataclass(frozen=True)
class Asked:
    """A study by its name, with KEY=VALUE settings, on a bench; files: None are the study's."""

    name: str
    keys: Sequence[str] = ()
    seed: int = 1
    quick: bool = False
    bench: Path | None = None
    scene: Path | None = None
    faults: Path | None = None


def run_study(asked: Asked, folder: Path, manner: Manner) -> None:
    """Take a study's record, evaluate it, write picture and page, print the table."""
    with attended(manner) as (progress, ask):
        account = study(asked, folder, manner, progress, ask)
    _tell(account, folder, (RECORD, *STUDY_FILES), manner)


def study(
    asked: Asked,
    folder: Path,
    manner: Manner | None = None,
    progress: Progress | None = None,
    ask: Ask | None = None,
) -> Account:
    """The same without a word: run.h5, study.png, study.html and study.json in a folder.

    UserError if a setting is wrong, a file is there already, the folder can't be written, or
    the bench can't do it; Cancelled leaves the record as it is then, to be resumed.
    """
    manner, progress = manner or Manner(), progress or Progress()
    found = find_study(asked.name)
    settings = read_settings(asked.name, asked.keys, quick=asked.quick)
    require_free(folder, (RECORD, *STUDY_FILES), force=manner.force)
    files = BenchFiles(
        asked.bench or bundled(found.bench),
        asked.scene or bundled(found.scene),
        faults=asked.faults,
    )
    watch = Stopwatch()
    with open_bench(files, speed=manner.speed) as bench:
        plan = marked(found.plan(settings, bench.description), asked.name, settings, asked.seed)
        make_folder(folder)
        outcome = run_plan(
            bench,
            plan,
            folder / RECORD,
            source=f"study {asked.name}",
            force=manner.force,
            progress=progress.part(0, _ACQUIRING),
            ask=ask,
            watch=watch,
        )
    require_complete(outcome)
    part = progress.part(_ACQUIRING, 1)
    return _evaluated(asked.name, found, settings, outcome.path, folder, watch, part)


def evaluate_record(name: str, record: Path, folder: Path, manner: Manner) -> None:
    """Evaluate a study's record once more: after a resume, or elsewhere. Errors as above."""
    found = find_study(name)
    require_free(folder, STUDY_FILES, force=manner.force)
    with Record(record) as opened:
        settings = settings_of(opened, name)
    make_folder(folder)
    with watched() as progress:
        account = _evaluated(name, found, settings, record, folder, Stopwatch(), progress)
    _tell(account, folder, STUDY_FILES, manner)


def _evaluated(
    name: str,
    found: Study[Any],
    settings: Settings,
    path: Path,
    folder: Path,
    watch: Stopwatch,
    progress: Progress,
) -> Account:
    with Record(path) as record:
        if record.state is not State.COMPLETE:
            raise UserError(
                f"{path}: the run is {record.state}, and the study needs all of its frames. "
                f"Take the rest: labapp resume {path}"
            )
        with watch.stage("evaluate"):
            results: Results = found.evaluate(record, settings, progress.part(0, 0.9))
        simulated, seed = record.simulated, record.seed
    progress.report(0.9, "page")
    account = Account(name, found, settings, seed, path, simulated, results, watch.seconds)
    write(account, folder)
    return account


def _tell(account: Account, folder: Path, names: Sequence[str], manner: Manner) -> None:
    if manner.as_json:
        print_json(as_data(account))
        return
    badge = account.badge
    heading = f"{account.study.title} ({account.study.source})"
    out.print(f"[bold]{heading}[/bold]  [yellow]{badge}[/yellow]\n")
    rows = [[row.what, row.published, row.expected, row.ours] for row in account.results.rows]
    table("", ["what", "published", "expected", "ours"], rows)
    for note in account.results.notes:
        out.print(note, style="dim", markup=False)
    for one in names:
        out.print(f"wrote {folder / one}", markup=False, soft_wrap=True)
