"""What a self-test finds, and how it goes on when something is found wrong."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.errors import DeviceError
from labapp.common.errors import UserError
from optics.progress import Cancelled, Progress

log = logging.getLogger(__name__)

Check = tuple[str, Callable[[], str]]
"""What is looked at, and what looks: it tells what it saw, or raises Wrong or DeviceError."""


class Wrong(Exception):
    """A device did something other than it says, in words."""


@dataclass(frozen=True)
class Finding:
    """One check's end. seconds: of the wall, that it took."""

    check: str
    passed: bool
    detail: str
    seconds: float


def who_is(device: Any) -> str:
    """A device's model and serial number, and whether it is simulated."""
    who = device.identity
    simulated = ", SIMULATED" if who.simulated else ""
    return f"{who.model}, serial number {who.serial or 'unknown'}{simulated}"


def in_words(error: Exception, name: str) -> str:
    """What to say of an error, also of a driver that raises what no driver may.

    That goes to the log, too: a broken driver of somebody else's hides no other device.
    """
    if isinstance(error, DeviceError | UserError | Wrong):
        return str(error)
    log.info("%s", name, exc_info=error)
    return f"its driver broke: {type(error).__name__}: {error}"


def look(checks: list[Check], progress: Progress) -> list[Finding]:
    """Every check in turn, whatever the others found; raises Cancelled between them."""
    found = []
    for number, (name, check) in enumerate(checks):
        progress.report(number / len(checks), name)
        found.append(looked(name, check))
    return found


def looked(name: str, check: Callable[[], str]) -> Finding:
    """One check; whatever a driver raises is a finding. UserError: it was asked wrongly."""
    began = time.perf_counter()
    try:
        passed, detail = True, check()
    except (UserError, Cancelled):
        raise
    except Exception as error:
        passed, detail = False, in_words(error, name)
    return Finding(name, passed, detail, time.perf_counter() - began)
