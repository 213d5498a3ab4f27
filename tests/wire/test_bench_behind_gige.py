"""The virtual bench behind the wire: the camera sees what is on the panel."""

from __future__ import annotations

import numpy as np
import pytest
from coded_pictures import never

from drivers.aravis import AravisCamera
from drivers.clock import RealClock
from drivers.interfaces import Surroundings
from optics.camera import Camera, Lens, Panel, Sensor
from simulator.devices import SimulatedCamera
from simulator.scene import Scene, Star
from simulator.wire.fake_gige import FakeGigECamera, frame_renderer
from simulator.world import World

BENCH = Camera(
    Panel(shape=(48, 64), pitch=40e-6, fill_factor=0.81, unmodulated=0.05),
    Lens(focal_length=0.125, f_number=40.0, focus_distance=2.0),
    Sensor(shape=(40, 45), pitch=14e-6),
)


def world() -> World:
    return World(BENCH, Scene({"star": Star(20e-6, 2.0, 2e12)}))


@pytest.mark.aravis
def test_the_camera_sees_the_very_picture_of_the_virtual_bench() -> None:
    behind = world()
    bits = BENCH.sensor.bits
    with (
        FakeGigECamera(
            frame_renderer(behind), BENCH.sensor.shape, f"Mono{bits}", always_render=True
        ),
        # The bench's pictures take what they take to be computed.
        AravisCamera(
            Surroundings(RealClock()), "127.0.0.1", latency_frames=0, frame_timeout_ms=60e3
        ) as camera,
    ):
        for exposure in (1e-3, 4e-3):
            alone = world()
            for each in (behind, alone):
                each.begin_frame(1, 2, 3)
            camera.set_exposure(exposure)
            seen = camera.capture(never)
            with SimulatedCamera(Surroundings(alone.clock, alone)) as simulated:
                simulated.set_exposure(exposure)
                expected = simulated.capture(never)
            np.testing.assert_array_equal(seen.image, expected.image)
            assert seen.exposure == pytest.approx(expected.exposure)


def test_gain_multiplies_and_clips() -> None:
    first, second = world(), world()
    image = frame_renderer(first)(1e-3, 0.0)
    more = frame_renderer(second)(1e-3, 20.0)
    full = BENCH.sensor.full_scale
    np.testing.assert_array_equal(more, np.minimum(image.astype(int) * 10, full))
