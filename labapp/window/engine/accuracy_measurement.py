"""The full measurement of what accuracy costs, which a person can start and cancel."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from labapp.accuracy.overview.measuring import measure_all, write_outcome
from labapp.accuracy.overview.operations import OPERATIONS
from labapp.files.output_paths import ACCURACY_FILES
from labapp.files.writing import make_folder
from labapp.window.messages import AccuracyMeasured
from optics.camera import Camera
from optics.progress import Progress


def measure_accuracy(camera: Camera, parent: Path, progress: Progress) -> AccuracyMeasured:
    """Measure every operation for a camera, and write the page to a new subfolder.

    What was measured before a person cancels is written all the same. Raises UserError, before
    anything is measured, if the folder can't be made.
    """
    folder = parent / f"accuracy_{datetime.now():%Y-%m-%d_%H%M%S}"
    make_folder(folder)
    try:
        outcome = measure_all(camera, "The camera of the bench", progress)
    except BaseException:
        folder.rmdir()
        raise
    write_outcome(outcome, folder)
    measured = len(outcome.operations)
    page = folder / ACCURACY_FILES[0]
    return AccuracyMeasured(page, measured, len(OPERATIONS), outcome.cancelled)
