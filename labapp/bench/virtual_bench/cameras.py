"""A simulated camera, served as GigE Vision packets on this computer's loopback."""

from __future__ import annotations

from typing import cast

from drivers.aravis.library_process import PACKAGES
from drivers.aravis.pixel_formats import FORMATS
from labapp.bench.virtual_bench.instruments import ServedInstrument, ServingContext
from labapp.common.errors import UserError
from optics.camera import Sensor
from simulator.wire.fake_gige import (
    CAMERA_FAULT_KINDS,
    CameraFault,
    CameraFaultKind,
    FakeGigECamera,
    NoAravis,
)

_ADDRESS = "127.0.0.1"


def serve_camera(sensor: Sensor, site: ServingContext) -> ServedInstrument:
    """Serve a simulated GigE camera until the site's stack is left.

    Raises UserError without Aravis, for bits that GigE cameras don't send, or if another virtual
    bench already serves a camera.
    """
    name = f"Mono{sensor.bits}"
    if name not in FORMATS:
        raise UserError(
            f"a sensor of {sensor.bits} bits: a GigE camera sends 8, 10, 12, 14 or 16. Change "
            "'sensor.bits', or leave the camera out with --camera none."
        )
    shortest, longest = sensor.exposure_range
    camera = FakeGigECamera(
        site.shared.render_frame,
        sensor.shape,
        name,
        exposure_us=(max(1, round(shortest * 1e6)), round(longest * 1e6)),
        address=_ADDRESS,
        clock=site.clock,
    )
    try:
        site.stack.enter_context(camera)
    except NoAravis as error:
        raise UserError(
            "the camera needs Aravis and Python's gi. Install them: sudo apt-get install "
            f"{PACKAGES}. Or leave the camera out with --camera none."
        ) from error
    except OSError as error:
        raise UserError(
            f"the camera doesn't start: {error}. There can be one at a time: end the other "
            "virtual bench that is served, or leave the camera out with --camera none."
        ) from error
    options = {
        "address": _ADDRESS,
        "pixel_format": name,
        "latency_frames": 0,
        # The picture has to be computed first, so that the driver waits up to 30 s.
        "frame_timeout_ms": 30_000.0,
        "electrons_per_number": sensor.gain,
    }

    def fail(kind: str, seconds: float) -> None:
        camera.inject(CameraFault(cast(CameraFaultKind, kind), site.clock.now(), seconds))

    kinds = CAMERA_FAULT_KINDS
    return ServedInstrument("aravis-camera", options, kinds, fail, camera.clear_faults)
