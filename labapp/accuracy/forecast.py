"""What each tolerance of a camera's PSF costs by accounts alone; nothing is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from labapp.accuracy.work_precision import (
    AUTOMATIC,
    CALLS,
    LONGEST_CALL,
    Row,
    mark_chosen,
    mark_front,
    with_account,
)
from optics.accuracy import Budget, MachineSpeed
from optics.camera import Camera
from optics.camera.pupil import panel_to_focus_distance
from optics.plane import Plane
from optics.progress import Progress
from optics.psf import CHAIN_METHODS, PANEL_METHODS, PSFOperator

TOLERANCES = tuple(10.0**-k for k in range(1, 9))
"""Tolerances that are predicted, one for each decade from fast to exact."""


def forecast_psf(
    camera: Camera,
    wavelength: float,
    pixels: Plane,
    speed: MachineSpeed,
    progress: Progress,
    tolerances: Sequence[float] = TOLERANCES,
) -> list[Row]:
    """Predict error and time of a camera's PSF by every method at every tolerance.

    Errors and times are those that accounts predict, with the front and the automatic choice
    marked. A method that refuses gives a row with the reason.
    camera: its object is in focus.
    wavelength: in metres.
    """
    distance = panel_to_focus_distance(camera)
    methods = CHAIN_METHODS if camera.separation else PANEL_METHODS
    rows: list[Row] = []
    for number, tol in enumerate(tolerances):
        for k, method in enumerate((*methods, None)):
            part = (number + k / (len(methods) + 1)) / len(tolerances)
            progress.report(part, f"tolerance {tol:.0e}")
            row = Row("psf", "", method or AUTOMATIC, "", tol)
            try:
                operator = PSFOperator(
                    camera, distance, wavelength, pixels, unmodulated=0.0, tol=tol,
                    method=method,
                    budget=Budget(speed=speed, calls=CALLS[-1], seconds=LONGEST_CALL),
                )  # fmt: skip
            except (ValueError, MemoryError) as error:
                rows.append(replace(row, failure=str(error)))
                continue
            account = operator.account
            row = replace(with_account(row, account), peak_bytes=account.bytes)
            if method is None and mark_chosen(rows, row, CALLS[-1]):
                continue
            rows.append(
                replace(
                    row,
                    error_achieved=account.error,
                    cpu_s=account.cpu_predicted,
                    first_answer_s=account.first_answer_predicted,
                    chosen_for=() if method else CALLS[-1:],
                )
            )
    return mark_front(rows)
