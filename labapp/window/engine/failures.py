"""Errors as reports to the person."""

from __future__ import annotations

import logging

from drivers.errors import DeviceError
from labapp.common.errors import UserError
from labapp.common.memory_shortage import explain_shortage
from labapp.window.engine.bench_controller import BenchController
from labapp.window.messages import FailureReport

log = logging.getLogger(__name__)


def describe_failure(error: Exception, controller: BenchController) -> FailureReport:
    """Turn an error into a report; log an unexpected one in full."""
    shortage = "" if isinstance(error, UserError | ValueError) else explain_shortage(error)
    if isinstance(error, DeviceError):
        return FailureReport(shortage or str(error), controller.devices.mark_failed(error))
    if shortage:
        return FailureReport(shortage)
    if isinstance(error, OSError) and error.filename is not None:
        remedy = "Choose another place, or check the path."
        return FailureReport(f"{error.filename}: {error.strerror}. {remedy}")
    if isinstance(error, UserError | ValueError | OSError):
        return FailureReport(str(error))
    log.error("in the engine", exc_info=error)
    return FailureReport(
        f"The engine met an error of its own, {error!r}. What you asked was not done."
    )
