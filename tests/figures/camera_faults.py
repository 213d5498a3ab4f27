"""Every fault of a camera behind the wire, at random moments of every call."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from judges.wire_frames import telling, tells
from numpy.typing import NDArray

from drivers.aravis import AravisCamera
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from figures import Figure
from labapp.common.console import print_message
from simulator.wire.fake_gige import (
    CAMERA_FAULT_KINDS,
    CameraFault,
    CameraFaultKind,
    FakeGigECamera,
)

_SHAPE = (64, 64)
_MOMENTS = 20
_MARGIN = 1.0
_NAME = "GigE Vision camera: every fault x every call at 20 random moments"
_GOAL = "DeviceError or the right value in time; the next call works"


def camera_fault_figure(folder: Path) -> list[Figure]:
    """Setting an exposure, taking a picture, asking for health, each disturbed and then not."""
    try:
        found = disturbed(_MOMENTS)
    except (OSError, DeviceError) as error:
        return [Figure(_NAME, _GOAL, f"no camera behind the wire: {error}", None)]
    trouble = [words for words in found if words not in ("right", "named")]
    measured = f"{found['right']} right, {found['named']} named"
    if trouble:
        measured += f", {sum(found[words] for words in trouble)} in trouble: {trouble[0]}"
    return [Figure(_NAME, _GOAL, measured, not trouble)]


def disturbed(moments: int, seed: int = 0) -> Counter[str]:
    """How often a disturbed call gave the right value, was named, or what else it did."""
    found: Counter[str] = Counter()
    rng = np.random.default_rng(seed)
    with (
        FakeGigECamera(_picture, _SHAPE, "Mono12p") as fake,
        AravisCamera(
            Surroundings(RealClock()), fake.address, packet_size=576, frame_timeout_ms=300
        ) as camera,
    ):
        for kind in CAMERA_FAULT_KINDS:
            print_message(f"  {kind}")
            for _ in range(moments):
                for call in (_capture, _set_exposure, _health):
                    found[_one(fake, camera, kind, call, rng)] += 1
    return found


def _one(
    fake: FakeGigECamera,
    camera: AravisCamera,
    kind: CameraFaultKind,
    call: Callable[[AravisCamera, float], bool],
    rng: np.random.Generator,
) -> str:
    first, second = rng.uniform(1e-3, 20e-3, 2)
    camera.set_exposure(first)
    now = time.monotonic()
    fake.inject(CameraFault(kind, now + rng.uniform(0, 0.05), float(rng.choice([0.05, 1e3]))))
    allowed = camera.exposure + camera.frame_time + camera.reply_time + _MARGIN
    came = _suffered(camera, call, second)
    if time.monotonic() - now > allowed:
        came = f"{kind}, {call.__name__}: {time.monotonic() - now:.1f} s"
    fake.clear_faults()
    after = _suffered(camera, _capture, second)
    if after == "named":
        # What went wrong unnoticed is named once, by the call that meets it.
        after = _suffered(camera, _capture, second)
    return came if after == "right" else f"{kind}, {call.__name__}: then {after}"


def _suffered(camera: AravisCamera, call: Callable[[AravisCamera, float], bool], to: float) -> str:
    try:
        return "right" if call(camera, to) else f"{call.__name__}: wrong value"
    except DeviceError:
        return "named"
    except Exception as error:
        return f"{call.__name__}: {type(error).__name__}: {error}"


def _capture(camera: AravisCamera, to: float) -> bool:
    frame = camera.capture(lambda: False)
    return tells(frame.image, frame.exposure)


def _set_exposure(camera: AravisCamera, to: float) -> bool:
    actual = camera.set_exposure(to).actual
    return abs(actual - to) <= 1e-6


def _health(camera: AravisCamera, to: float) -> bool:
    return camera.health()["protocol"] == "GigE Vision"


def _picture(exposure: float, gain_db: float) -> NDArray[np.uint16]:
    return telling(np.random.default_rng(), _SHAPE, exposure)


MEASUREMENTS = {"camera-faults": camera_fault_figure}
