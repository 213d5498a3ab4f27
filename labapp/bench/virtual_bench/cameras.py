"""The camera behind its packets: GigE Vision on this computer's loopback."""

from __future__ import annotations

import subprocess
from contextlib import ExitStack

from drivers.aravis.link import PACKAGES, python_with_gi
from drivers.aravis.pixels import FORMATS
from drivers.interfaces import Clock
from labapp.bench.virtual_bench.instruments import Instrument, behind_packets
from labapp.bench.virtual_bench.shared import SharedWorld
from labapp.common.errors import UserError
from optics.camera import Sensor
from simulator.wire.fake_gige import FakeGigE

CAMERAS = ("gige", "none")

_ADDRESS = "127.0.0.1"

_COMPUTING_MS = 30_000.0
"""For which the driver waits for a picture: it must first be computed."""

_ARAVIS = """
import gi
gi.require_version("Aravis", "0.8")
from gi.repository import Aravis
"""


def serve_camera(sensor: Sensor, shared: SharedWorld, clock: Clock, stack: ExitStack) -> Instrument:
    """Start it until the stack is left; UserError if there is no Aravis, or no place for it."""
    name = f"Mono{sensor.bits}"
    if name not in FORMATS:
        raise UserError(
            f"a sensor of {sensor.bits} bits: a GigE camera sends 8, 10, 12, 14 or 16. Change "
            "'sensor.bits', or leave the camera out with --camera none."
        )
    _require_aravis()
    shortest, longest = sensor.exposure_range
    camera = FakeGigE(
        shared.seen,
        sensor.shape,
        name,
        fresh=True,
        exposure_us=(max(1, round(shortest * 1e6)), round(longest * 1e6)),
        address=_ADDRESS,
        clock=clock,
    )
    try:
        stack.enter_context(camera)
    except OSError as error:
        raise UserError(
            f"the camera doesn't start: {error}. There can be one at a time: end the other "
            "virtual bench that is served, or leave the camera out with --camera none."
        ) from error
    options = {
        "address": _ADDRESS,
        "pixel_format": name,
        "latency_frames": 0,
        "frame_timeout_ms": _COMPUTING_MS,
        "electrons_per_number": sensor.gain,
    }
    return behind_packets(options, camera, clock)


def _require_aravis() -> None:
    """Now and in words, where its process would just not come."""
    command = [*python_with_gi(), "-c", _ARAVIS]
    try:
        done = subprocess.run(command, capture_output=True, timeout=60, check=False)
        found = done.returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        found = False
    if not found:
        raise UserError(
            "the camera needs Aravis and Python's gi. Install them: sudo apt-get install "
            f"{PACKAGES}. Or leave the camera out with --camera none."
        )
