"""What went wrong, as the window says it."""

from __future__ import annotations

import logging

from drivers.errors import DeviceError
from labapp.common.errors import UserError
from labapp.window.engine.benchtop import Benchtop
from labapp.window.messages import Failure

log = logging.getLogger(__name__)


def failure(error: Exception, top: Benchtop) -> Failure:
    """An error in words; one that nobody foresaw also goes to the log, in full."""
    if isinstance(error, DeviceError):
        return Failure(str(error), top.devices.blame(error))
    if isinstance(error, OSError) and error.filename is not None:
        remedy = "Choose another place, or check the path."
        return Failure(f"{error.filename}: {error.strerror}. {remedy}")
    if isinstance(error, UserError | ValueError | OSError):
        return Failure(str(error))
    log.error("in the engine", exc_info=error)
    return Failure(f"The engine met an error of its own, {error!r}. What you asked was not done.")
