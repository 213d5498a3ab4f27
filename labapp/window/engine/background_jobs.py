"""Patterns and reconstructions, computed in the background while live view goes on."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from labapp.bench.opening import Bench
from labapp.prediction.pattern_psf import USUAL_TOLERANCE
from labapp.window.commands import (
    DECODER,
    ComputePreview,
    ForecastAccuracy,
    MeasureAccuracy,
    OpenRecord,
    ReconstructRun,
    SaveRestored,
    ShowPattern,
)
from labapp.window.engine.bench_controller import BenchController
from labapp.window.engine.channel import Channel
from labapp.window.engine.failures import describe_failure
from labapp.window.engine.jobs import Jobs
from labapp.window.engine.pattern_designer import SETTINGS, PatternDesigner
from labapp.window.engine.plan_building import validate_pattern
from labapp.window.messages import PictureSaved
from labapp.window.spectral_messages import ListBands, RestoreCube, ShowCubeColours
from optics.progress import Cancelled, Progress

if TYPE_CHECKING:
    from labapp.window.engine.cube_restoration import CubeRestoration
    from labapp.window.engine.decoding import Decoding
    from labapp.window.engine.reconstruction import Restoration


@dataclass(frozen=True, eq=False)
class ComputedPattern:
    """A computed pattern, until the main thread shows it on the SLM."""

    name: str
    grey: NDArray[np.uint8]


class BackgroundJobs:
    """Run the jobs that don't use the bench; a newer job cancels one of its kind."""

    def __init__(self, bench: Bench, channel: Channel, jobs: Jobs, top: BenchController) -> None:
        self._channel, self._jobs, self._controller = channel, jobs, top
        self._camera = bench.description
        self._world = bench.camera_world
        self._designer = PatternDesigner(self._camera)
        self._last_restoration: Restoration | Decoding | CubeRestoration | None = None
        # With two threads, a pattern needn't wait for a reconstruction.
        self._threads = ThreadPoolExecutor(2, "beside")

    def close(self) -> None:
        self._threads.shutdown(cancel_futures=True)

    def preview(self, command: ComputePreview) -> None:
        def work(progress: Progress) -> None:
            done = self._designer.preview(command.pattern, command.wavelength, progress)
            self._channel.send(done)

        self._start("preview", work)

    def compute_pattern(self, command: ShowPattern) -> None:
        name = validate_pattern(command.pattern).label

        def work(progress: Progress) -> None:
            self._channel.post(
                ComputedPattern(name, self._designer.grey_levels(command.pattern, progress))
            )

        self._start("pattern", work)

    def reconstruct(self, command: ReconstructRun) -> None:
        def work(progress: Progress) -> None:
            # Its libraries take a second to load, for which the first picture needn't wait.
            from labapp.window.engine.decoding import decode_record
            from labapp.window.engine.reconstruction import reconstruct_record

            restore = decode_record if command.method == DECODER else reconstruct_record
            self._last_restoration = restored = restore(command, progress)
            self._channel.send(restored.result_message)

        self._start("reconstruction", work)

    def open_record(self, command: OpenRecord) -> None:
        def work(progress: Progress) -> None:
            from labapp.window.engine.opened_record import open_record

            self._channel.send(open_record(command.path))

        self._start("opening", work)

    def restore_cube(self, command: RestoreCube) -> None:
        def work(progress: Progress) -> None:
            from labapp.window.engine.cube_restoration import restore_cube

            self._last_restoration = restored = restore_cube(command, progress)
            self._channel.send(restored.result_message)

        self._start("reconstruction", work)

    def show_cube_colours(self, command: ShowCubeColours) -> None:
        def work(progress: Progress) -> None:
            from labapp.window.engine.cube_restoration import CubeRestoration

            restored = self._last_restoration
            if isinstance(restored, CubeRestoration):
                shown = restored.with_light(command.light)
                self._channel.send(shown.colours)
                if self._last_restoration is restored:
                    self._last_restoration = shown

        self._start("colours", work)

    def list_bands(self, command: ListBands) -> None:
        def work(progress: Progress) -> None:
            from labapp.window.engine.cube_restoration import list_bands
            from labapp.window.engine.decoding import find_decoder

            decoder = find_decoder(command.path) or ""
            self._channel.send(replace(list_bands(command.path), decoder=Path(decoder).name))

        self._start("bands", work)

    def set_tolerance(self, tol: float | None) -> None:
        """Set the relative error of predictions; None: the usual."""
        self._designer.tol = USUAL_TOLERANCE if tol is None else tol

    def forecast_accuracy(self, command: ForecastAccuracy) -> None:
        def work(progress: Progress) -> None:
            from labapp.window.engine.accuracy_forecast import forecast_accuracy

            self._channel.send(
                forecast_accuracy(
                    self._camera,
                    self._world,
                    command.exposure,
                    command.wavelength,
                    SETTINGS.psf_window,
                    progress,
                )
            )

        self._start("forecast", work)

    def measure_accuracy(self, command: MeasureAccuracy) -> None:
        def work(progress: Progress) -> None:
            from labapp.window.engine.accuracy_measurement import measure_accuracy

            self._channel.send(measure_accuracy(self._camera, command.folder, progress))

        self._start("accuracy", work)

    def save_restored(self, command: SaveRestored) -> None:
        def work(progress: Progress) -> None:
            if self._last_restoration is not None:
                self._last_restoration.save(command.path)
                self._channel.send(PictureSaved(command.path))

        self._start("saving", work)

    def _start(self, job: str, work: Callable[[Progress], None]) -> None:
        progress = self._jobs.begin(job)

        def run_job() -> None:
            try:
                progress.raise_if_cancelled()
                work(progress)
            except Cancelled:
                pass
            except Exception as error:
                self._channel.send(describe_failure(error, self._controller))
            finally:
                self._jobs.end(job, progress)

        self._threads.submit(run_job)
