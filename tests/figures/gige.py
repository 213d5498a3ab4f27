"""How many frames a second a GigE Vision camera delivers through the loopback."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from drivers.aravis import AravisCamera
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from figures import Figure
from simulator.wire.fake_gige import FakeGigECamera

_SHAPE = (2048, 2048)
_RATE = 30.0
_GOAL = 25.0
_SECONDS = 60.0
_PACKET = 16000
_PICTURES = 9
"""More than among which the driver looks for a frame that comes again."""
_LATE = 3
"""Seconds at the beginning that aren't counted: memory that nobody has used yet is slow."""


def gige_figure(folder: Path) -> list[Figure]:
    """Frames of 2048 x 2048 pixels of 8 bits for a minute; each compared with what was sent."""
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 256, _SHAPE, dtype=np.uint16) for _ in range(_PICTURES)]
    made = iter(range(1 << 30))
    known = {picture[:2].tobytes(): picture for picture in pictures}
    name = "GigE Vision on loopback, 2048², 60 s"
    goal = f"≥ {_GOAL:.0f} frames/s, 0 unreported drops"
    try:
        with (
            FakeGigECamera(
                lambda exposure, gain: pictures[next(made) % _PICTURES],
                _SHAPE,
                "Mono8",
                always_render=False,
                cycle_length=_PICTURES,
            ) as fake,
            AravisCamera(
                Surroundings(RealClock()),
                fake.address,
                trigger="free",
                frame_rate=_RATE,
                packet_size=_PACKET,
                buffers=16,
            ) as camera,
        ):
            camera.set_exposure(5e-3)
            return [_measured(name, goal, camera, known)]
    except (OSError, DeviceError) as error:
        return [Figure(name, goal, f"not measured: {error}", None)]


def _measured(name: str, goal: str, camera: AravisCamera, known: dict[bytes, np.ndarray]) -> Figure:
    start = time.monotonic() + _LATE
    while time.monotonic() < start:
        last = camera.next_frame(lambda: False).number
    before = camera.counts
    frames = gaps = wrong = 0
    began = time.monotonic()
    while time.monotonic() - began < _SECONDS:
        frame = camera.next_frame(lambda: False)
        frames += 1
        # The camera's numbers have 16 bits, without 0.
        gaps += (frame.number - last) % 65535 - 1
        last = frame.number
        sent = known.get(frame.image[:2].tobytes())
        wrong += sent is None or not np.array_equal(frame.image, sent)
    seconds = time.monotonic() - began
    kinds = ("dropped", "incomplete", "corrupt")
    reported = sum(camera.counts[kind] - before[kind] for kind in kinds)
    measured = (
        f"{frames / seconds:.1f} frames/s for {seconds:.0f} s, {wrong} not bit-exact, "
        f"{gaps} dropped, {gaps - reported} of them unreported"
    )
    good = frames / seconds >= _GOAL and not wrong and gaps == reported
    return Figure(name, goal, measured, good)


MEASUREMENTS = {"gige": gige_figure}
