"""Checks for each kind of device."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from drivers.interfaces import Clock, Spectrum
from labapp.bench.selftest.camera_checks import DescribedCamera, camera_checks
from labapp.bench.selftest.checks import (
    Check,
    SelfTestFailure,
    identity_text,
    require_refusal,
    wait_until_ready,
)


def device_checks(
    role: str, device: Any, clock: Clock, described: DescribedCamera | None = None
) -> list[Check]:
    """Return the checks of the device that the bench calls `role`.

    described: how the bench file describes a camera, which is then checked, too.
    """
    of_role: dict[str, Callable[[Any, Clock], list[Check]]] = {
        "targets": _target_checks,
        "filter": _filter_checks,
        "slm": _slm_checks,
        "camera": partial(camera_checks, described=described or DescribedCamera()),
        "spectroradiometer": _spectroradiometer_checks,
    }
    try:
        own = of_role[role](device, clock)
    except Exception as error:
        failure = error

        def fail() -> str:
            raise failure

        own = [("what it can do", fail)]

    def safe() -> str:
        device.make_safe()
        return f"made safe; answers within {device.reply_time:g} s as documented"

    return [
        ("identity", lambda: identity_text(device)),
        ("what it says of itself", lambda: _health(device)),
        *own,
        ("safe", safe),
    ]


def _health(device: Any) -> str:
    """Say what a device reports about its health."""
    try:
        health: dict[str, str] = device.health()
    except AttributeError:
        return "nothing: its driver has no such report"
    return "; ".join(f"{name}: {told}" for name, told in health.items())


def _target_checks(device: Any, clock: Clock) -> list[Check]:
    def place(name: str) -> str:
        wait_until_ready(device.place(name), clock)
        if device.current_target != name:
            raise SelfTestFailure(f"{name} was asked for, and {device.current_target} is there")
        return f"{name} is there"

    if device.by_hand:
        return [("targets", lambda: f"placed by hand: {', '.join(device.names)}")]
    return [(f"place {name}", partial(place, name)) for name in device.names]


def _filter_checks(device: Any, clock: Clock) -> list[Check]:
    low, high = device.wavelength_range

    def tune(wavelength: float) -> str:
        setting = device.set_wavelength(wavelength)
        wait_until_ready(setting, clock)
        told = device.wavelength
        if abs(told - wavelength) > 1e-10 or told != setting.actual:
            raise SelfTestFailure(
                f"{wavelength * 1e9:.2f} nm were asked for, and {told * 1e9:.2f} are set"
            )
        return f"{told * 1e9:.2f} nm, {device.bandwidth * 1e9:g} nm wide"

    def range_() -> str:
        return f"{low * 1e9:g} to {high * 1e9:g} nm, settles within {device.settling * 1e3:g} ms"

    def beyond() -> str:
        return require_refusal(
            lambda: device.set_wavelength(high + 100e-9), f"{high * 1e9 + 100:g} nm"
        )

    try:
        wavelengths = [slot.wavelength for slot in device.slots]
    except AttributeError:
        wavelengths = [round(one * 1e10) * 1e-10 for one in np.linspace(low, high, 5)]
    tried = [(f"tune to {w * 1e9:g} nm", partial(tune, w)) for w in wavelengths]
    return [("range", range_), *tried, ("beyond its range", beyond)]


def _slm_checks(device: Any, clock: Clock) -> list[Check]:
    rows, columns = device.shape
    rng = np.random.default_rng(0)

    def show(name: str, grey: np.ndarray[Any, np.dtype[np.uint8]]) -> str:
        began = time.perf_counter()
        setting = device.show(name, grey)
        took = time.perf_counter() - began
        wait_until_ready(setting, clock)
        if device.displayed_pattern != name:
            raise SelfTestFailure(
                f"{name} was shown, and {device.displayed_pattern} is on the panel"
            )
        return f"on the panel after {took * 1e3:.0f} ms"

    def play() -> str:
        count = 8
        video = rng.integers(0, 256, (count, rows, columns), np.uint8)
        setting = device.play("self-test video", video)
        clock.wait_until(setting.ready_at + 2 * count * device.frame_time, lambda: False)
        if device.displayed_pattern != "self-test video":
            raise SelfTestFailure(
                f"a video was shown, and {device.displayed_pattern} is on the panel"
            )
        each = f"{device.frame_time * 1e3:.2f} ms each"
        return f"{count} frames of {each}{_presentation_summary(device)}"

    def other_shape() -> str:
        grey = np.zeros((rows, columns + 1), np.uint8)
        return require_refusal(lambda: device.show("wrong", grey), f"{columns + 1} columns")

    y, x = np.ogrid[:rows, :columns]
    stills = {
        "all levels": np.broadcast_to((x % 256).astype(np.uint8), (rows, columns)),
        "checkerboard": ((y + x) % 2 * 255).astype(np.uint8),
        "noise": rng.integers(0, 256, (rows, columns), np.uint8),
    }
    return [
        ("size", lambda: f"{columns} x {rows} pixels, settles in {device.settling * 1e3:g} ms"),
        *((f"show {n}", partial(show, n, np.array(g))) for n, g in stills.items()),
        ("play a video", play),
        ("a pattern of another size", other_shape),
    ]


def _presentation_summary(device: Any) -> str:
    """Say how many frames a display showed, and how many were late.

    The text is empty if the display doesn't report this.
    """
    try:
        told = device.presentations()
    except AttributeError:
        return ""
    return f", {told.count} presented, {told.missed} late"


def _spectroradiometer_checks(device: Any, clock: Clock) -> list[Check]:
    wavelengths = device.wavelengths

    def range_() -> str:
        nm = wavelengths * 1e9
        return f"{nm[0]:g} to {nm[-1]:g} nm at {nm.size} wavelengths"

    def measure() -> str:
        told: Spectrum = device.measure(lambda: False)
        if not np.array_equal(told.wavelengths, wavelengths):
            raise SelfTestFailure("a spectrum has other wavelengths than the instrument")
        if told.radiance.shape != wavelengths.shape or not np.isfinite(told.radiance).all():
            raise SelfTestFailure(
                f"a spectrum of {told.radiance.shape} values, or not all of them finite"
            )
        total = float(np.trapezoid(told.radiance, wavelengths))
        most = wavelengths[np.argmax(told.radiance)] * 1e9
        light = f"{total:.4g} W/(sr m²) in all, most at {most:g} nm" if total > 0 else "no light"
        filtered = ", through its own grey filter" if told.nd_filter_used else ""
        return f"{light}, integrated for {told.integration_time:.3g} s{filtered}"

    return [("range", range_), ("measure", measure), ("measure again", measure)]
