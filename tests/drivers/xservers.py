"""X servers of our own for tests, which fail or are skipped where there are none."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.screen import driver
from simulator import screens
from simulator.screens import NoXServer, XServer

REPLYING = driver._TIMEOUTS.call
"""Seconds that a panel's window is given in use."""

PATIENCE = 60
"""Seconds after which what should have come long ago is given up."""


def wait_for(seen: Callable[[], object], what: str) -> None:
    late = time.monotonic() + PATIENCE
    while not seen():
        assert time.monotonic() < late, f"never: {what}"
        time.sleep(0.02)


def be_patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give a panel's windows the time that they may need on a busy machine."""
    monkeypatch.setattr(driver, "_TIMEOUTS", replace(driver._TIMEOUTS, call=40.0, reopen=40.0))


@contextmanager
def xvfb(columns: int, rows: int) -> Iterator[XServer]:
    with ExitStack() as stack:
        try:
            server = stack.enter_context(screens.xvfb(columns, rows))
        except NoXServer as error:
            pytest.fail(str(error))
        yield server


@contextmanager
def xorg(folder: Path) -> Iterator[XServer]:
    if os.geteuid():
        pytest.skip("Xorg without a screen of its own wants root")
    with ExitStack() as stack:
        try:
            server = stack.enter_context(screens.xorg(folder))
        except NoXServer as error:
            pytest.fail(str(error))
        yield server


def edid(name: bytes, serial: bytes) -> bytes:
    """By VESA's E-EDID standard, release A2: maker HEC, two text descriptors."""
    told = bytearray(128)
    told[:8] = bytes.fromhex("00ffffffffffff00")
    told[8:10] = (8 << 10 | 5 << 5 | 3).to_bytes(2, "big")
    for at, kind, text in ((72, 0xFC, name), (90, 0xFF, serial)):
        told[at : at + 5] = bytes([0, 0, 0, kind, 0])
        told[at + 5 : at + 18] = (text + b"\n").ljust(13)[:13]
    told[127] = -sum(told) % 256
    return bytes(told)
