import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from virtual_bench import CAMERA, NEUTRAL, ring_pattern, world

import simulator.devices
from drivers.errors import DeviceError
from drivers.interfaces import (
    SLM,
    Camera,
    Device,
    Identity,
    SpectralFilter,
    Surroundings,
    TargetChanger,
)
from simulator.clock import VirtualClock
from simulator.devices import (
    SimulatedCamera,
    SimulatedFilter,
    SimulatedSLM,
    SimulatedTargets,
)

KINDS = [
    (SimulatedSLM, SLM),
    (SimulatedFilter, SpectralFilter),
    (SimulatedCamera, Camera),
    (SimulatedTargets, TargetChanger),
]


def never() -> bool:
    return False


@pytest.fixture
def surroundings() -> Surroundings:
    w = world()
    w.target = "star"
    return Surroundings(w.clock, w)


def photograph(surroundings, seed=(1, 2, 3), exposure=0.01) -> np.ndarray:
    with SimulatedCamera(surroundings) as camera:
        surroundings.world.begin(*seed)
        camera.set_exposure(exposure)
        return camera.capture(never).image


@pytest.mark.parametrize(("device", "interface"), KINDS)
def test_a_device_has_all_that_its_interface_asks(device, interface, surroundings):
    with device(surroundings) as opened:
        for protocol in (interface, Device):
            for name in [n for n in vars(protocol) if not n.startswith("_")]:
                assert hasattr(opened, name), name


@pytest.mark.parametrize(("device", "interface"), KINDS)
def test_a_simulated_device_says_that_it_is(device, interface, surroundings):
    with device(surroundings) as opened:
        identity = opened.identity
        assert isinstance(identity, Identity)
        assert identity.simulated
        assert "simulated" in identity.model
        opened.make_safe()
        opened.make_safe()


@pytest.mark.parametrize(("device", "interface"), KINDS)
def test_without_a_world_a_device_does_not_open(device, interface):
    with pytest.raises(DeviceError, match=r"simulated .*: open: .*no virtual world. Name a scene"):
        device(Surroundings(VirtualClock()))


def test_the_panel_shows_what_it_is_given_and_neutral_at_the_end(surroundings):
    grey = ring_pattern(100e-6)
    with SimulatedSLM(surroundings) as slm:
        assert slm.shape == (48, 64)
        assert slm.shown == "neutral"
        setting = slm.show("ring", grey)
        assert (setting.asked, setting.actual) == ("ring", "ring")
        assert setting.ready_at == pytest.approx(CAMERA.panel.settling)
        assert slm.shown == "ring"
        assert np.array_equal(surroundings.world.grey, grey)
        grey[:] = 7
        assert not np.array_equal(surroundings.world.grey, grey)
    assert slm.shown == "neutral"
    assert np.array_equal(surroundings.world.grey, NEUTRAL)


@pytest.mark.parametrize(
    ("grey", "words"),
    [
        (np.zeros((64, 48), dtype=np.uint8), r"show x: .*48x64 pixels; the panel needs 64x48"),
        (np.zeros((48, 64)), r"show x: .*float64; the panel shows uint8"),
    ],
)
def test_the_panel_refuses_what_is_no_pattern(grey, words, surroundings):
    with SimulatedSLM(surroundings) as slm, pytest.raises(DeviceError, match=words):
        slm.show("x", grey)


def test_the_filter_tunes_to_whole_steps_and_says_so(surroundings):
    """A VariSpec resolves 0.01 nm."""
    with SimulatedFilter(surroundings, (430.0, 700.0), 10.0, 80.0) as tuned:
        setting = tuned.set_wavelength(550.1234e-9)
        assert setting.asked == 550.1234e-9
        assert setting.actual == pytest.approx(550.12e-9, abs=1e-18)
        assert tuned.wavelength == setting.actual == surroundings.world.wavelength
        assert setting.ready_at == pytest.approx(0.08)
        assert tuned.wavelength_range == pytest.approx((430e-9, 700e-9))
        assert tuned.bandwidth == surroundings.world.bandwidth == pytest.approx(10e-9)
    assert tuned.wavelength == pytest.approx(430e-9)


@pytest.mark.parametrize("wavelength", [429e-9, 701e-9, math.nan, 0.0])
def test_the_filter_refuses_what_it_cannot_pass(wavelength, surroundings):
    with (
        SimulatedFilter(surroundings, (430.0, 700.0)) as tuned,
        pytest.raises(DeviceError, match=r"tune to .* nm: out of range, 430 to 700 nm. Choose a"),
    ):
        tuned.set_wavelength(wavelength)


def test_the_camera_counts_microseconds_and_says_so(surroundings):
    with SimulatedCamera(surroundings) as camera:
        setting = camera.set_exposure(0.0012345678)
        assert setting.actual == pytest.approx(0.001235, abs=1e-12)
        assert camera.capture(never).exposure == setting.actual
        assert camera.exposure_range == CAMERA.sensor.exposure_range
        assert camera.full_scale == CAMERA.sensor.full_scale
        assert camera.shape == CAMERA.sensor.shape


@pytest.mark.parametrize("exposure", [1e-6, 31.0, math.nan, -1.0])
def test_the_camera_refuses_an_exposure_out_of_range(exposure, surroundings):
    with (
        SimulatedCamera(surroundings) as camera,
        pytest.raises(DeviceError, match=r"expose .* ms: out of range, 0.02 to 30000 ms. Choose"),
    ):
        camera.set_exposure(exposure)


def test_a_frame_carries_its_settings_and_the_clock_moves(surroundings):
    with SimulatedCamera(surroundings, readout_ms=10.0) as camera:
        camera.set_exposure(0.5)
        first, second = camera.capture(never), camera.capture(never)
    assert (first.image.dtype, first.image.shape) == (np.uint16, (40, 45))
    assert (first.number, second.number) == (1, 2)
    assert first.gain == CAMERA.sensor.gain
    assert second.time - first.time == pytest.approx(0.51)


def test_the_same_seed_gives_the_same_bits(surroundings):
    assert np.array_equal(photograph(surroundings), photograph(surroundings))


@pytest.mark.parametrize("seed", [(2, 2, 3), (1, 3, 3), (1, 2, 4), (3, 2, 1)])
def test_every_part_of_the_seed_counts(surroundings, seed):
    assert not np.array_equal(photograph(surroundings, seed), photograph(surroundings))


def test_without_a_new_seed_every_frame_has_its_own_noise(surroundings):
    with SimulatedCamera(surroundings) as camera:
        assert not np.array_equal(camera.capture(never).image, camera.capture(never).image)


def test_exposure_and_target_change_the_frame(surroundings):
    """Twice the time, twice the electrons: digital numbers above black, summed."""
    black = CAMERA.sensor.black_level
    short, long = (photograph(surroundings, exposure=t).astype(float) - black for t in (0.01, 0.02))
    assert short.sum() > 1000
    assert long.sum() == pytest.approx(2 * short.sum(), rel=0.1)
    with SimulatedTargets(surroundings) as targets:
        targets.place("dark")
    assert abs((photograph(surroundings).astype(float) - black).mean()) < 0.2


def test_targets_are_placed_by_name(surroundings):
    with SimulatedTargets(surroundings) as targets:
        assert targets.names == ("dark", "star", "near star", "card")
        assert targets.place("card").actual == "card"
        assert targets.placed == "card"
        with pytest.raises(DeviceError, match=r"place moon: no such target. Choose one of dark"):
            targets.place("moon")
        assert targets.placed == "card"


def test_stages_that_are_off_are_not_called(monkeypatch):
    """With both noises off, no random number is drawn."""

    def refuse(*args, **kwargs):
        raise AssertionError("a stage that is off was called")

    monkeypatch.setattr(torch, "poisson", refuse)
    monkeypatch.setattr(torch, "randn", refuse)
    off = dict.fromkeys(("shot noise", "read noise", "dark current"), False)
    w = world(forced=off)
    w.target = "star"
    quiet = photograph(Surroundings(w.clock, w))
    assert np.array_equal(quiet, photograph(Surroundings(w.clock, w), seed=(9, 9, 9)))


def test_forced_stages_reach_the_sensor(monkeypatch):
    heard = {}

    def listen(*args, **flags):
        heard.update(flags)
        return torch.zeros(40, 45, dtype=torch.int32)

    monkeypatch.setattr(simulator.devices, "expose", listen)
    w = world(forced={"shot noise": False, "read noise": True, "dark current": True})
    photograph(Surroundings(w.clock, w))
    assert heard == {"shot_noise": False, "read_noise": True, "dark_current": True}


def test_a_world_that_cannot_be_computed_is_a_device_error(surroundings):
    surroundings.world.wavelength = 900e-9
    with (
        SimulatedCamera(surroundings) as camera,
        pytest.raises(DeviceError, match=r"capture: wavelength 900 nm is outside"),
    ):
        camera.capture(never)


def test_a_longer_exposure_of_a_brighter_scene_clips_at_full_scale():
    w = world(replace(CAMERA, sensor=replace(CAMERA.sensor, full_well=3000.0, read_noise=6.0)))
    w.target = "card"
    image = photograph(Surroundings(w.clock, w), exposure=20.0)
    assert (image >= w.camera.sensor.full_scale).mean() > 0.999
