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
"""What is looked at, and what looks: it tells what it saw, or raises SelfTestFailure or
DeviceError."""


class SelfTestFailure(Exception):
    """A device did something other than it says, in words."""


@dataclass(frozen=True)
class CheckResult:
    """One check's end. seconds: of the wall, that it took."""

    check: str
    passed: bool
    detail: str
    seconds: float


def identity_text(device: Any) -> str:
    """A device's model and serial number, and whether it is simulated."""
    who = device.identity
    simulated = ", SIMULATED" if who.simulated else ""
    return f"{who.model}, serial number {who.serial or 'unknown'}{simulated}"


def describe_error(error: Exception, name: str) -> str:
    """What to say of an error, also of a driver that raises what no driver may.

    That goes to the log, too: a broken driver of somebody else's hides no other device.
    """
    if isinstance(error, DeviceError | UserError | SelfTestFailure):
        return str(error)
    log.info("%s", name, exc_info=error)
    return f"its driver broke: {type(error).__name__}: {error}"


def run_checks(checks: list[Check], progress: Progress) -> list[CheckResult]:
    """Every check in turn, whatever the others found; raises Cancelled between them."""
    found = []
    for number, (name, check) in enumerate(checks):
        progress.report(number / len(checks), name)
        found.append(run_check(name, check))
    return found


def run_check(name: str, check: Callable[[], str]) -> CheckResult:
    """One check; whatever a driver raises is a finding. UserError: it was asked wrongly."""
    began = time.perf_counter()
    try:
        passed, detail = True, check()
    except (UserError, Cancelled):
        raise
    except Exception as error:
        passed, detail = False, describe_error(error, name)
    return CheckResult(name, passed, detail, time.perf_counter() - began)
