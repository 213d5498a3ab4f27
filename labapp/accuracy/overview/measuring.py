"""`labapp accuracy` without a name: measures all operations, and writes the page and its data."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

from labapp.accuracy.overview.cases import OverviewSettings, Scope
from labapp.accuracy.overview.measured import LeftOut, MeasuredOperation, Outcome
from labapp.accuracy.overview.operations import OPERATIONS, Operation
from labapp.accuracy.overview.page import page_html
from labapp.accuracy.row_output import describe_machine
from labapp.accuracy.work_precision import LONGEST_CALL, Deadline
from labapp.common.console import out, print_json, print_message, print_table, terminal_progress
from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from labapp.files.bench_file import read_camera
from labapp.files.output_paths import ACCURACY_FILES
from labapp.files.writing import make_folder, write_atomically
from optics.accuracy import Budget
from optics.camera import Camera
from optics.progress import Cancelled, Progress
from optics.threads import single_threaded


@single_threaded
def measure_all(
    camera: Camera | None,
    scope: str,
    progress: Progress,
    settings: OverviewSettings | None = None,
    operations: Sequence[Operation] = OPERATIONS,
) -> Outcome:
    """Measure every operation.

    What was measured before the progress is cancelled is kept; an operation that is under way then
    is left out. Raises Cancelled if it is cancelled before anything was measured.
    camera: that the cases are for; None for the bundled cases.
    scope: the camera in words.
    """
    began, settings = time.monotonic(), settings or OverviewSettings()
    speed = machine_speed(progress.part(0.0, 0.05))
    asked = Scope(Budget(speed=speed, seconds=LONGEST_CALL), camera, settings)
    measured: list[MeasuredOperation] = []
    left_out: list[LeftOut] = []
    for number, one in enumerate(operations):
        start, stop = (0.05 + 0.95 * k / len(operations) for k in (number, number + 1))
        try:
            measured.append(_measure(one, asked, progress.part(start, stop)))
        except (Cancelled, KeyboardInterrupt):
            if not measured:
                raise
            left_out += [LeftOut(o.name, o.title, "cancelled") for o in operations[number:]]
            break
        except (UserError, ValueError, MemoryError) as error:
            left_out.append(LeftOut(one.name, one.title, str(error).rstrip(".") or "no memory"))
    return Outcome(
        describe_machine(), scope, measured, left_out, time.monotonic() - began,
        progress.is_cancelled,
    )  # fmt: skip


def _measure(one: Operation, scope: Scope, progress: Progress) -> MeasuredOperation:
    began = time.monotonic()
    named = Progress(lambda part, words: progress.report(part, f"{one.title}: {words}"))
    deadline = Deadline.after(scope.settings.operation_s)
    case, rows = one.measure(scope, named, deadline)
    return MeasuredOperation(
        one.name, one.title, one.what, case, one.error_name, rows, time.monotonic() - began
    )


def write_outcome(outcome: Outcome, folder: Path) -> None:
    """Write the page and its JSON to a folder, which is made if it doesn't exist."""
    make_folder(folder)
    page, data = (folder / name for name in ACCURACY_FILES)
    text = json.dumps(outcome.as_data(), indent=1, allow_nan=False, ensure_ascii=False)
    write_atomically(data, f"{text}\n".encode())
    write_atomically(page, page_html(outcome).encode())


def accuracy_page(
    camera: Path | None,
    folder: Path,
    *,
    as_json: bool,
) -> None:
    """Measure what accuracy costs in every operation, write the page, and print its summary.

    camera: file of the camera that is measured; None for the bundled cases.
    The process ends with exit code 130 if it was cancelled after something was measured; that is
    written all the same.
    """
    described = None if camera is None else read_camera(camera)
    scope = "Bundled cases" if camera is None else f"The camera of {camera.name}"
    with terminal_progress() as progress:
        outcome = measure_all(described, scope, progress, operations=OPERATIONS)
    write_outcome(outcome, folder)
    if as_json:
        print_json(outcome.as_data())
    else:
        rows = [row for one in outcome.operations for row in one.summary_rows]
        print_table("What accuracy costs", ["operation", "time of", "setting"], rows)
        for one in outcome.left_out:
            out.print(f"not measured: {one.title}: {one.why}")
        out.print(outcome.machine, style="dim")
    for name in ACCURACY_FILES:
        print_message(f"wrote {folder / name}")
    if outcome.cancelled:
        count = f"{len(outcome.operations)} of {len(OPERATIONS)}"
        print_message(f"cancelled: {count} operations were measured, and are on the page")
        raise SystemExit(130)
