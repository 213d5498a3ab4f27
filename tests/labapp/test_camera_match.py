"""A bench whose camera isn't as its file describes it isn't opened, and says what to write."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.interfaces import Frame, Setting
from labapp.bench.camera_match import require_described_camera
from labapp.bench.selftest.camera_checks import DescribedCamera, camera_checks
from labapp.bench.selftest.checks import run_checks
from labapp.common.errors import UserError
from optics.camera import Sensor
from optics.progress import Progress
from simulator.clock import VirtualClock

SENSOR = Sensor(shape=(40, 60))


class ConverterCamera:
    """A camera of a converter that is sent in other numbers; it obeys a new exposure late.

    top: its largest number. gamma: of its table.
    """

    pixel_format, bayer, exposure_range = "Mono16", "", (1e-4, 0.5)
    shape, latency_option = (40, 60), "latency_frames"

    def __init__(self, full_scale=65535, top=65520, gamma=1.0, latency=4):
        self.full_scale, self._top, self._gamma, self._latency = full_scale, top, gamma, latency
        self._rng, self._number = np.random.default_rng(0), 0

    def set_exposure(self, exposure):
        self._exposure = exposure
        return Setting(exposure, exposure, 0.0)

    def capture(self, cancelled):
        self._number += 1
        y, x = np.mgrid[:40, :60]
        rate = 4e5 * np.exp(-((y - 20) ** 2 + (x - 30) ** 2) / 50.0)
        light = self._rng.poisson(rate * self._exposure) / (12_000 / self._top)
        light = self._top * (light / self._top) ** self._gamma
        number = np.rint(light + self._rng.normal(900, 12, (40, 60)))
        image = np.clip(number, 0, self._top).astype(np.uint16)
        return Frame(image, self._exposure, 1.0, 0.0, self._number)

    def measure_latency(self, exposures):
        return self._latency


@pytest.mark.parametrize(
    ("camera", "sensor", "said"),
    [
        (
            ConverterCamera(255),
            SENSOR,
            r"bits = 8 in \[sensor\], with gain_electrons_per_dn = 41.6",
        ),
        (ConverterCamera(65535), SENSOR, "numbers up to 65535"),
        (ConverterCamera(3000), SENSOR, r"Write clip_level_dn = 3000 in \[sensor\]"),
        (ConverterCamera(4095), Sensor(shape=(40, 64)), "64 x 40 pixels, and the camera has 60 x"),
    ],
)
def test_another_camera_is_refused_with_what_to_write(camera, sensor, said):
    with pytest.raises(UserError, match=said):
        require_described_camera(camera, sensor, "bench.toml")


def test_mosaics_must_be_described():
    camera = ConverterCamera(4095)
    require_described_camera(camera, SENSOR, "bench.toml")
    camera.bayer = "RG"
    with pytest.raises(UserError, match="colour mosaic"):
        require_described_camera(camera, SENSOR, "bench.toml")


def seen(camera, **described):
    sensor = Sensor(shape=(40, 60), bits=16, gain=0.18, full_well=1e6, **described)
    told = DescribedCamera(sensor, tells_clip_level=sensor.clip_level is not None)
    found = run_checks(camera_checks(camera, VirtualClock(), told), Progress())
    wanted = ("as described", "black level", "clip level", "linearity", "latency")
    return {one.check: one for one in found if one.check in wanted}, told.lines


def test_what_the_file_should_say_is_told():
    checks, lines = seen(ConverterCamera(), black_level=64.0)
    assert not checks["black level"].passed
    assert not checks["clip level"].passed
    assert checks["linearity"].passed
    assert "65520 DN, where the converter ends" in checks["clip level"].detail
    said = dict(line.split("#")[0].split(" = ") for line in lines)
    assert float(said["black_level_dn"]) == pytest.approx(900, abs=1)
    assert (int(said["clip_level_dn"]), int(said["latency_frames"])) == (65520, 4)


def test_a_file_that_says_it_is_right():
    checks, lines = seen(ConverterCamera(), black_level=900.0, clip_level=65520)
    assert all(one.passed for one in checks.values())
    assert [line.split(" = ")[0] for line in lines] == ["latency_frames"]


class FlickeringLamp(ConverterCamera):
    """Before a lamp whose light goes up and down a hundred times a second, by `depth` of it.

    Each exposure begins at any phase; the light is the integral of the lamp's over it. All are
    shorter than two of its periods, so that the linearity rests on what it does.
    """

    exposure_range = (1e-4, 0.018)

    def __init__(self, depth, seed, **options):
        super().__init__(**options)
        self._depth, self._phases = depth, np.random.default_rng(seed)

    def capture(self, cancelled):
        lit, turn = self._exposure, 2 * np.pi * 100
        begin = self._phases.uniform(0, 0.01)
        wave = (np.sin(turn * (begin + lit)) - np.sin(turn * begin)) / turn
        return self._lit(50 * (1 + self._depth * wave / lit))

    def _lit(self, share):
        exposure, self._exposure = self._exposure, self._exposure * share
        try:
            frame = super().capture(lambda: False)
        finally:
            self._exposure = exposure
        return replace(frame, exposure=exposure)


@pytest.mark.parametrize("gamma", [1.0, 0.45])
@pytest.mark.parametrize("depth", [0.1, 0.4, 0.9])
def test_a_lamp_that_flickers_is_told_from_a_gamma(depth, gamma):
    for seed in range(6):
        checks, _ = seen(FlickeringLamp(depth, seed, gamma=gamma), black_level=900.0)
        found = checks["linearity"]
        if gamma == 1:
            assert "A gamma" not in found.detail, (seed, found.detail)
            assert found.passed or "the lamp flickers too much" in found.detail
        else:
            assert not found.passed, (seed, found.detail)


def test_a_gamma_fails():
    checks, _ = seen(ConverterCamera(gamma=0.45), black_level=900.0)
    assert not checks["linearity"].passed
    assert "A gamma, a table (LUT) or an automatic is on" in checks["linearity"].detail
