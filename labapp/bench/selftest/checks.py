"""Running checks one by one, on after one that fails."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.errors import DeviceError
from drivers.interfaces import Clock, Setting
from labapp.common.errors import UserError
from optics.progress import Cancelled, Progress

log = logging.getLogger(__name__)

Check = tuple[str, Callable[[], str]]
"""Name of a check, and the function that does it. The function returns what it found, or raises
SelfTestFailure or DeviceError."""


class SelfTestFailure(Exception):
    """A device didn't do what it reports; the message says what it did."""


@dataclass(frozen=True)
class CheckResult:
    """Outcome of one check; `seconds` is the wall-clock time that it took."""

    check: str
    passed: bool
    detail: str
    seconds: float


def identity_text(device: Any) -> str:
    """Describe a device in words: model, serial number, and whether it is simulated."""
    who = device.identity
    simulated = ", SIMULATED" if who.simulated else ""
    return f"{who.model}, serial number {who.serial or 'unknown'}{simulated}"


def wait_until_ready(setting: Setting[Any], clock: Clock) -> None:
    """Wait until a setting stands."""
    clock.wait_until(setting.ready_at, lambda: False)


def require_refusal(act: Callable[[], object], what: str) -> str:
    """Check that a device refuses an act, and return its reply.

    Raises SelfTestFailure if the device doesn't refuse.
    """
    try:
        act()
    except DeviceError as error:
        return f"{what} is refused: {error.reply}"
    raise SelfTestFailure(f"{what} was taken without a word")


def describe_error(error: Exception, name: str) -> str:
    """Return an error's message, whatever a driver raised.

    An exception that drivers must not raise is logged with its traceback. It isn't raised again,
    so that the other devices are still checked.
    """
    if isinstance(error, DeviceError | UserError | SelfTestFailure):
        return str(error)
    log.info("%s", name, exc_info=error)
    return f"its driver broke: {type(error).__name__}: {error}"


def run_checks(checks: list[Check], progress: Progress) -> list[CheckResult]:
    """Run all checks in turn, even if some fail.

    Raises Cancelled between two checks.
    """
    found = []
    for number, (name, check) in enumerate(checks):
        progress.report(number / len(checks), name)
        found.append(run_check(name, check))
    return found


def run_check(name: str, check: Callable[[], str]) -> CheckResult:
    """Run one check; an exception of the driver makes it fail.

    UserError and Cancelled are raised again, because they don't tell anything about the device.
    """
    began = time.perf_counter()
    try:
        passed, detail = True, check()
    except (UserError, Cancelled):
        raise
    except Exception as error:
        passed, detail = False, describe_error(error, name)
    return CheckResult(name, passed, detail, time.perf_counter() - began)
