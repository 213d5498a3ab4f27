"""Forecasts of what each tolerance costs, for the tab "Accuracy"."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from labapp.accuracy.forecast import TOLERANCES, forecast_psf
from labapp.accuracy.reading import curve_name
from labapp.accuracy.work_precision import AUTOMATIC, Row
from labapp.common.speed import machine_speed
from labapp.prediction.simulating.picture_time import seconds_per_operation
from labapp.window.messages import AccuracyForecast, AccuracyPoint, LivePrediction
from optics.accuracy import MachineSpeed
from optics.camera import Camera
from optics.progress import Progress

if TYPE_CHECKING:
    from simulator.situation import Situation
    from simulator.world import World


_MEMORY = 256 << 20
"""Bytes of probes that are kept while plans are computed. Chosen."""


def forecast_accuracy(
    camera: Camera,
    world: World | None,
    exposure: float,
    wavelength: float,
    window: int,
    progress: Progress,
) -> AccuracyForecast:
    """Predict what each tolerance costs in predicted PSFs and simulated pictures.

    world: None for a bench whose camera is real.
    exposure: that of live pictures, s.
    wavelength: m.
    window: side of the PSF, sensor pixels.
    """
    speed = machine_speed(progress.part(0.0, 0.3))
    pixels = camera.sensor.window_plane((window, window))
    rows = forecast_psf(camera, wavelength, pixels, speed, progress.part(0.3, 0.8))
    live: tuple[LivePrediction, ...] = ()
    if world is not None:
        live = _forecast_pictures(world, world.situation(exposure), speed, progress.part(0.8, 1.0))
    return AccuracyForecast(wavelength, TOLERANCES, tuple(_point(row) for row in rows), live)


def _point(row: Row) -> AccuracyPoint:
    return AccuracyPoint(
        method=curve_name(row) if row.method != AUTOMATIC else row.engine or AUTOMATIC,
        tol=row.tol or 0.0,
        error=row.error_achieved,
        first_seconds=row.first_answer_s,
        each_seconds=row.cpu_s,
        memory=row.peak_bytes,
        chosen=bool(row.chosen_for),
        on_front=row.on_front,
        failure=row.failure,
    )


def _forecast_pictures(
    world: World, s: Situation, speed: MachineSpeed, progress: Progress
) -> tuple[LivePrediction, ...]:
    """Predict error and time of a live picture on the virtual bench at each tolerance."""
    from simulator.imaging import Imaging

    imaging = Imaging(forced=world.imaging.forced, memory=_MEMORY, decide_by="estimate")
    each = seconds_per_operation(speed)
    found = []
    for number, tol in enumerate(TOLERANCES):
        progress.report(number / len(TOLERANCES), f"effects within {tol:.0e}")
        imaging.tol = tol
        try:
            plan = imaging.plan(s)
        except ValueError:
            # A picture that can't be planned can't be taken either; live view says why.
            return ()
        error = plan.relative_error
        seconds = each * plan.work
        found.append(LivePrediction(tol, error if math.isfinite(error) else None, seconds))
    return tuple(found)
