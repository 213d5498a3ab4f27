import math
import zlib
from dataclasses import replace

import numpy as np
import pytest
import torch
from small_bench.world import CAMERA, NEUTRAL, ring_pattern, world

from drivers.errors import DeviceError
from drivers.interfaces import (
    SLM,
    Camera,
    Device,
    FilterWheel,
    Identity,
    Slot,
    SpectralFilter,
    Spectroradiometer,
    Surroundings,
    TargetChanger,
)
from optics.light.bands import Band
from simulator.clock import VirtualClock
from simulator.devices import (
    SimulatedCamera,
    SimulatedFilter,
    SimulatedSLM,
    SimulatedSpectroradiometer,
    SimulatedTargets,
    SimulatedWheel,
)

KINDS = [
    (SimulatedSLM, SLM),
    (SimulatedFilter, SpectralFilter),
    (SimulatedWheel, SpectralFilter),
    (SimulatedWheel, FilterWheel),
    (SimulatedCamera, Camera),
    (SimulatedTargets, TargetChanger),
    (SimulatedSpectroradiometer, Spectroradiometer),
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
        surroundings.world.begin_frame(*seed)
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
        assert slm.displayed_pattern == "neutral"
        setting = slm.show("ring", grey)
        assert (setting.request, setting.actual) == ("ring", "ring")
        assert setting.ready_at == pytest.approx(CAMERA.panel.settling)
        assert slm.displayed_pattern == "ring"
        assert np.array_equal(surroundings.world.grey, grey)
        grey[:] = 7
        assert not np.array_equal(surroundings.world.grey, grey)
    assert slm.displayed_pattern == "neutral"
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


def test_the_panel_plays_a_video_and_keeps_its_own_copy(surroundings):
    video = np.stack([ring_pattern(100e-6), NEUTRAL, ring_pattern(60e-6)])
    first = video[0].copy()
    with SimulatedSLM(surroundings, frame_rate_hz=50.0) as slm:
        assert slm.frame_time == pytest.approx(0.02)
        setting = slm.play("turn", video)
        assert (setting.request, setting.actual) == ("turn", "turn")
        assert setting.ready_at == pytest.approx(CAMERA.panel.settling)
        assert slm.displayed_pattern == "turn"
        video[:] = 7
        assert np.array_equal(surroundings.world.grey, first)
        slm.show("still", NEUTRAL)
        assert slm.displayed_pattern == "still"
        slm.play("turn", video)
    assert slm.displayed_pattern == "neutral"
    assert np.array_equal(surroundings.world.grey, NEUTRAL)


def test_a_panel_shows_sixty_frames_a_second_unless_it_says_otherwise(surroundings):
    assert SimulatedSLM(surroundings).frame_time == pytest.approx(1 / 60)
    w = world(replace(CAMERA, panel=replace(CAMERA.panel, frame_rate=180.0)))
    assert SimulatedSLM(Surroundings(w.clock, w)).frame_time == pytest.approx(1 / 180)


@pytest.mark.parametrize(
    ("video", "words"),
    [
        (np.zeros((48, 64), np.uint8), r"play x: a video of shape \(48, 64\); it needs frames"),
        (np.zeros((0, 48, 64), np.uint8), r"play x: a video of shape \(0, 48, 64\); it needs"),
        (np.zeros((2, 64, 48), np.uint8), r"play x: .*48x64 pixels; the panel needs 64x48"),
        (np.zeros((2, 48, 64)), r"play x: .*float64; the panel shows uint8"),
    ],
)
def test_the_panel_refuses_what_is_no_video(video, words, surroundings):
    grey = ring_pattern(100e-6)
    with SimulatedSLM(surroundings) as slm:
        slm.show("ring", grey)
        with pytest.raises(DeviceError, match=words):
            slm.play("x", video)
        assert slm.displayed_pattern == "ring"
        assert np.array_equal(surroundings.world.grey, grey)


def test_one_bad_frame_spoils_a_video():
    w = world(replace(CAMERA, panel=replace(CAMERA.panel, levels=16)))
    video = np.zeros((3, 48, 64), np.uint8)
    video[2, 5, 5] = 16
    with (
        SimulatedSLM(Surroundings(w.clock, w)) as slm,
        pytest.raises(DeviceError, match=r"play x: .*level 16; the panel's levels are 0 to 15"),
    ):
        slm.play("x", video)


@pytest.mark.parametrize("rate", [0.0, -60.0, math.nan, math.inf])
def test_a_frame_rate_that_is_none_is_refused(rate, surroundings):
    with pytest.raises(ValueError, match=r"frame_rate_hz is .*; it must be positive and finite"):
        SimulatedSLM(surroundings, rate)


def test_a_panel_that_is_opened_again_shows_what_it_says(surroundings):
    """Nobody has closed it in order: it was killed, or its cable was pulled."""
    SimulatedSLM(surroundings).__enter__().show("ring", ring_pattern(100e-6))
    with SimulatedSLM(surroundings) as slm:
        assert slm.displayed_pattern == "neutral"
        assert np.array_equal(surroundings.world.grey, NEUTRAL)


def test_the_filter_tunes_to_whole_steps_and_says_so(surroundings):
    """A VariSpec resolves 0.01 nm."""
    with SimulatedFilter(surroundings, (430.0, 700.0), 10.0, 80.0) as tuned:
        setting = tuned.set_wavelength(550.1234e-9)
        assert setting.request == 550.1234e-9
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


def passed(surroundings, wavelengths) -> np.ndarray:
    return surroundings.world.band.total_transmission(np.asarray(wavelengths))


def test_a_filter_has_the_shape_and_the_leak_that_it_is_given(surroundings):
    """At the centre, at half of the width to each side, and far from it, by the definitions."""
    for shape in ("gaussian", "lyot", "interference"):
        options = {"bandwidth_nm": 10.0, "shape": shape, "leak": 1e-3}
        with SimulatedFilter(surroundings, **options, leak_range_nm=(500.0, 700.0)) as tuned:
            tuned.set_wavelength(600e-9)
            seen = passed(surroundings, [600e-9, 595e-9, 605e-9, 690e-9, 710e-9])
            assert tuned.bandwidth == pytest.approx(10e-9)
        # A lyot filter's half maxima aren't quite as far from its centre on both sides.
        assert seen[:3] == pytest.approx([1.001, 0.501, 0.501], abs=0.01)
        assert seen[3] == pytest.approx(1e-3, abs=2e-3 if shape == "lyot" else 1e-9)
        assert seen[4] <= (2e-3 if shape == "lyot" else 1e-9)
    SimulatedFilter(surroundings)
    assert passed(surroundings, [450e-9, 700e-9]).max() < 1e-12


def test_a_wheel_has_the_shape_and_the_leak_that_it_is_given(surroundings):
    options = {"slots_nm": [(532, 20), (633, 10)], "shape": "interference", "leak": 1e-4}
    with SimulatedWheel(surroundings, **options) as wheel:
        # A super-Gaussian of the sixth order at a quarter of its width: 2^-(1/2)⁶.
        assert passed(surroundings, [537e-9, 633e-9]) == pytest.approx(
            [2 ** -(0.5**6) + 1e-4, 1e-4], rel=1e-6
        )
        wheel.set_slot(2)
        assert passed(surroundings, [532e-9, 633e-9]) == pytest.approx([1e-4, 1.0001], rel=1e-6)


@pytest.mark.parametrize("device", [SimulatedFilter, SimulatedWheel])
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"shape": "square"}, "shape is 'square'; choose gaussian, lyot, interference"),
        ({"leak": -0.1}, "leak is -0.1; give a share from 0 to below 1"),
        ({"leak": 1.0}, "leak is 1; give a share"),
        ({"leak_range_nm": (700, 400)}, r"leak_range_nm is \(700, 400\); give the shorter"),
        ({"leak_range_nm": (0, 400)}, "leak_range_nm is .*; give the shorter"),
    ],
)
def test_a_band_that_is_none_is_refused(device, options, words, surroundings):
    with pytest.raises(ValueError, match=words):
        device(surroundings, **options)


def test_a_lyot_filter_as_wide_as_its_wavelength_is_refused(surroundings):
    with pytest.raises(ValueError, match=r"a lyot filter's is a quarter of its centre"):
        SimulatedFilter(surroundings, (420.0, 720.0), 150.0, shape="lyot")


SLOTS = ((450, 10), (532, 20), (632.8, 3), (550, 40), (600, 10))


@pytest.fixture
def wheel(surroundings):
    with SimulatedWheel(surroundings, slots_nm=SLOTS, step_ms=100.0) as opened:
        yield opened


def test_a_wheel_tells_its_slots(wheel):
    assert isinstance(wheel, FilterWheel)
    assert [slot.name for slot in wheel.slots] == [
        "450 nm", "532 nm", "632.8 nm", "550 nm", "600 nm"
    ]  # fmt: skip
    assert wheel.slots[2] == Slot("632.8 nm", pytest.approx(632.8e-9), pytest.approx(3e-9))
    assert wheel.wavelength_range == pytest.approx((450e-9, 632.8e-9))


def test_a_tunable_filter_is_no_wheel(surroundings):
    with SimulatedFilter(surroundings) as tuned:
        assert not isinstance(tuned, FilterWheel)
        assert not hasattr(tuned, "set_slot")


def test_a_wheel_is_opened_and_left_at_its_first_slot(surroundings):
    with SimulatedWheel(surroundings, slots_nm=SLOTS) as wheel:
        assert wheel.slot == 1
        assert surroundings.world.wavelength == pytest.approx(450e-9)
        wheel.set_slot(4)
        wheel.make_safe()
        assert wheel.slot == 1
        wheel.set_slot(4)
    assert surroundings.world.wavelength == pytest.approx(450e-9)


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
def test_a_slot_brings_its_wavelength_and_its_bandwidth(number, wheel, surroundings):
    setting = wheel.set_slot(number)
    centre, width = SLOTS[number - 1]
    assert (setting.request, setting.actual, wheel.slot) == (number, number, number)
    assert wheel.wavelength == surroundings.world.wavelength == pytest.approx(centre * 1e-9)
    assert wheel.bandwidth == surroundings.world.bandwidth == pytest.approx(width * 1e-9)


@pytest.mark.parametrize(
    ("start", "end", "steps"), [(1, 1, 0), (1, 3, 2), (1, 4, 2), (1, 5, 1), (5, 2, 2), (4, 3, 1)]
)
def test_a_wheel_turns_the_shorter_way(start, end, steps, wheel, surroundings):
    """Of five slots none is more than two steps away."""
    wheel.set_slot(start)
    surroundings.clock.wait_until(7.0, never)
    assert wheel.set_slot(end).ready_at == pytest.approx(7.0 + 0.1 * steps)
    assert 0.1 * steps <= wheel.settling == pytest.approx(0.2)


@pytest.mark.parametrize(("slots", "settling"), [(1, 0.0), (2, 0.1), (6, 0.3)])
def test_a_wheel_settles_in_half_a_turn(slots, settling, surroundings):
    listed = [(500 + 10 * n, 5) for n in range(slots)]
    wheel = SimulatedWheel(surroundings, slots_nm=listed, step_ms=100.0)
    assert wheel.settling == pytest.approx(settling)


def test_a_wheel_turns_to_the_slot_that_passes_a_wavelength(wheel):
    setting = wheel.set_wavelength(632.8e-9)
    assert wheel.slot == 3
    assert setting.request == 632.8e-9
    assert setting.actual == wheel.wavelength == pytest.approx(632.8e-9)
    assert setting.ready_at == pytest.approx(0.2)


@pytest.mark.parametrize("wavelength", [540e-9, 532.01e-9, math.nan, 0.0])
def test_a_wheel_refuses_a_wavelength_between_its_slots(wavelength, wheel):
    wheel.set_slot(2)
    with pytest.raises(
        DeviceError,
        match=r"tune to .* nm: no slot passes it\. Choose one of 450 nm, 532 nm, 632\.8",
    ):
        wheel.set_wavelength(wavelength)
    assert wheel.slot == 2


@pytest.mark.parametrize("number", [0, 6, -1])
def test_a_wheel_refuses_a_slot_that_it_has_not(number, wheel):
    with pytest.raises(DeviceError, match=rf"turn to slot {number}: no such slot\. Choose 1 to 5"):
        wheel.set_slot(number)
    assert wheel.slot == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"slots_nm": ()}, r"slots_nm is \(\); give \[centre, width\] of every slot"),
        (
            {"slots_nm": [(0, 10)]},
            r"slot 1 is \(0, 10\); give \[centre, width\] in nanometres, both greater",
        ),
        (
            {"slots_nm": [(500, -10)]},
            r"slot 1 is \(500, -10\); give \[centre, width\] in nanometres, both greater",
        ),
        ({"step_ms": -1.0}, r"step_ms is -1\.0; it must be finite and not negative"),
        ({"step_ms": math.nan}, "step_ms is nan; it must be finite"),
    ],
)
def test_a_wheel_that_is_none_is_refused(options, words, surroundings):
    with pytest.raises(ValueError, match=words):
        SimulatedWheel(surroundings, **options)


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


def test_a_frame_carries_the_checksum_of_its_bytes(surroundings):
    with SimulatedCamera(surroundings) as camera:
        frame = camera.capture(never)
    assert frame.checksum == zlib.crc32(frame.image.tobytes())


def test_a_camera_sees_a_video_as_the_mean_of_its_frames():
    """Over one period, to half a digital number of rounding for each picture."""
    off = dict.fromkeys(("shot noise", "read noise", "dark current"), False)
    w = world(forced=off)
    w.target = "star"
    surroundings = Surroundings(w.clock, w)
    video = np.stack([NEUTRAL, ring_pattern(60e-6)])
    pictures = []
    with SimulatedSLM(surroundings, 500.0) as slm, SimulatedCamera(surroundings) as camera:
        camera.set_exposure(0.004)
        for grey in video:
            slm.show("still", grey)
            pictures.append(camera.capture(never).image.astype(float))
        slm.play("both", video)
        seen = camera.capture(never).image.astype(float)
    assert np.max(pictures) < CAMERA.sensor.full_scale
    assert np.abs(pictures[0] - pictures[1]).max() > 50
    assert np.abs(seen - np.mean(pictures, axis=0)).max() <= 1.01


def test_a_camera_documents_the_time_that_it_is_given(surroundings):
    assert SimulatedCamera(surroundings, reply_s=2.5).reply_time == 2.5
    for none in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match=r"reply_s is .*; it must be positive and finite"):
            SimulatedCamera(surroundings, reply_s=none)


def test_a_cancelled_picture_is_not_computed(surroundings):
    with (
        SimulatedCamera(surroundings) as camera,
        pytest.raises(DeviceError, match=r"capture: it was cancelled\. Take it again"),
    ):
        camera.capture(lambda: True)


def test_a_cancelled_exposure_ends_early():
    w = world(clock=VirtualClock(1.0))
    with SimulatedCamera(Surroundings(w.clock, w)) as camera:
        camera.set_exposure(30.0)
        w.electron_rates(30.0)
        camera.capture(lambda: w.clock.now() > 0)
    assert w.clock.now() < 30.0


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
        assert targets.current_target == "card"
        with pytest.raises(DeviceError, match=r"place moon: no such target. Choose one of dark"):
            targets.place("moon")
        assert targets.current_target == "card"


def test_stages_that_are_off_are_not_called(monkeypatch):
    """With both noises off, no random number is drawn."""

    def refuse(*args, **kwargs):
        raise AssertionError("a stage that is off was called")

    monkeypatch.setattr(torch, "poisson", refuse)
    monkeypatch.setattr(torch.Tensor, "normal_", refuse)
    w = world(forced={"shot noise": "off", "read noise": False, "dark current": False})
    w.target = "star"
    quiet = photograph(Surroundings(w.clock, w))
    assert np.array_equal(quiet, photograph(Surroundings(w.clock, w), seed=(9, 9, 9)))


@pytest.mark.parametrize("effect", ["shot noise", "read noise"])
def test_forced_noises_reach_the_frames(effect):
    """The variance of a pixel is what is left of shot noise, read noise and rounding."""
    off = dict.fromkeys(("shot noise", "read noise", "dark current"), False)
    w = world(forced={**off, effect: True})
    w.target = "card"
    frames = [
        photograph(Surroundings(w.clock, w), seed=(1, 2, n), exposure=0.5).astype(float)
        for n in range(60)
    ]
    electrons = w.electron_rates(0.5)[0].numpy() * 0.5
    expected = {"shot noise": electrons.mean(), "read noise": CAMERA.sensor.read_noise**2}[effect]
    found = np.var(frames, axis=0, ddof=1).mean() * CAMERA.sensor.gain**2
    assert found == pytest.approx(expected + CAMERA.sensor.gain**2 / 12, rel=0.03)


def test_a_frame_follows_from_its_number_whatever_was_taken_before():
    """Other frames, other settings, or nothing at all; what is kept in between changes nothing."""

    def taken(frames):
        w = world(tol=0.1)
        with SimulatedCamera(Surroundings(w.clock, w)) as camera:
            for number, target, exposure in frames:
                w.begin_frame(7, 1, number)
                w.target = target
                camera.set_exposure(exposure)
                image = camera.capture(never).image
        return image

    last = (5, "star", 0.02)
    alone = taken([last])
    assert alone.dtype == np.uint16
    kept = [(n, "star", 0.02) for n in range(3)]
    others = [(0, "card", 0.02), (1, "near star", 0.01), (2, "star", 0.01), (3, "dark", 0.5)]
    for before in (kept, others, [*kept, *others], [last]):
        assert np.array_equal(taken([*before, last]), alone)
    assert not np.array_equal(taken([(6, "star", 0.02)]), alone)


def test_unchanged_frames_only_draw_noise(surroundings):
    w = surroundings.world
    photograph(surroundings, seed=(1, 2, 3))
    once = w.imaging.ledger.operations
    for n in range(4, 7):
        photograph(surroundings, seed=(1, 2, n))
    assert w.imaging.ledger.operations == once


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


def test_the_spectroradiometer_sees_the_band_through_its_slit(surroundings):
    """Against the integral over a triangle of 5 nm of a Gaussian of 7 nm, on a fine grid."""
    w = surroundings.world
    w.target, w.band = "card", Band(600e-9, 7e-9)
    with SimulatedSpectroradiometer(surroundings) as meter:
        told = meter.measure(never)
        assert np.array_equal(told.wavelengths, meter.wavelengths)
    away = np.linspace(-5, 5, 20001)
    slit = (5 - np.abs(away)) / 25
    light = w.scene.targets["card"].reflected_radiance().at(np.asarray([600e-9]))[0]
    for nm in (585, 596, 600, 603):
        band = 2.0 ** (-(((nm + away - 600) / 3.5) ** 2))
        expected = light * np.trapezoid(slit * band, away)
        assert told.radiance[nm - 380] == pytest.approx(expected, rel=5e-4, abs=1e-5 * light)
    assert told.radiance[450 - 380] < 1e-9 * light


def test_dim_light_takes_the_spectroradiometer_long(surroundings):
    """Its data sheet: 5 ms to 120 s in normal mode; the bench's time passes meanwhile."""
    w = surroundings.world
    w.target = "dark"
    with SimulatedSpectroradiometer(surroundings) as meter:
        began = w.clock.now()
        told = meter.measure(never)
        assert (told.integration_time, told.time) == (120.0, began)
        assert w.clock.now() == pytest.approx(began + 120)
        assert not told.radiance.any()
        with pytest.raises(DeviceError, match=r"measure: it was cancelled. Measure again"):
            meter.measure(lambda: True)


@pytest.mark.parametrize("slit", [-1, 2.5, 1000])
def test_a_slit_that_is_none_is_refused(slit, surroundings):
    with pytest.raises(ValueError, match=r"slit_nm is .*; it must be a whole number from 0 to 20"):
        SimulatedSpectroradiometer(surroundings, slit)


def test_too_much_light_for_the_spectroradiometer_is_told(surroundings):
    w = surroundings.world
    bright = replace(w.scene.targets["card"], radiance=1e18)
    w.scene.targets["glare"] = bright
    w.target = "glare"
    with (
        SimulatedSpectroradiometer(surroundings) as meter,
        pytest.raises(DeviceError, match=r"measure: the light is too bright. Dim the lamp"),
    ):
        meter.measure(never)
