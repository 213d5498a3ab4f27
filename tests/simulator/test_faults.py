"""What goes wrong on the virtual bench, as whoever uses the devices sees it."""

import math
import threading
import time
import zlib
from dataclasses import replace

import numpy as np
import pytest
from small_bench.world import CAMERA, NEUTRAL, ring_pattern, world

from drivers import supervised
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from drivers.supervised import SupervisedDevice
from labapp.common.errors import UserError
from labapp.files.fault_file import read_faults
from simulator.clock import VirtualClock
from simulator.devices import (
    SimulatedCamera,
    SimulatedFilter,
    SimulatedSLM,
    SimulatedTargets,
    SimulatedWheel,
)
from simulator.faults import FRAME_KINDS, Fault, FaultScript

PATIENCE = 60
"""Seconds after which a test that should have ended long ago is given up."""

RING = ring_pattern(100e-6)
QUIET = dict.fromkeys(("shot noise", "read noise", "dark current"), False)


def never():
    return False


def bench(*faults, **options):
    """Surroundings in which these things go wrong; pictures have no noise."""
    w = world(faults=faults, forced=QUIET, **options)
    w.target = "star"
    return Surroundings(w.clock, w)


def state(surroundings):
    """What calls change."""
    w = surroundings.world
    return w.grey.tobytes(), w.wavelength, w.target


class Call:
    """One kind of device, and a call that changes the world."""

    def __init__(self, role, kind, name, *arguments, words):
        self.role, self.kind, self.words = role, kind, words
        self._name, self._arguments = name, arguments

    def __call__(self, device):
        return getattr(device, self._name)(*self._arguments)

    def __repr__(self):
        return f"{self.kind.__name__}.{self._name}"


SETTINGS = [
    Call("slm", SimulatedSLM, "show", "ring", RING, words="simulated SLM: show ring"),
    Call("slm", SimulatedSLM, "play", "turn", np.stack([RING, NEUTRAL]),
         words="simulated SLM: play turn"),
    Call("filter", SimulatedFilter, "set_wavelength", 600e-9,
         words="simulated tunable filter: tune to 600.0 nm"),
    Call("filter", SimulatedWheel, "set_slot", 2, words="simulated filter wheel: turn to slot 2"),
    Call("filter", SimulatedWheel, "set_wavelength", 532e-9,
         words="simulated filter wheel: turn to slot 2"),
    Call("targets", SimulatedTargets, "place", "card",
         words="simulated target changer: place card"),
    Call("camera", SimulatedCamera, "set_exposure", 0.02, words="simulated camera: expose 20 ms"),
]  # fmt: skip
CAPTURE = Call("camera", SimulatedCamera, "capture", never, words="simulated camera: capture")
CALLS = [*SETTINGS, CAPTURE]


@pytest.fixture(params=CALLS, ids=repr)
def call(request):
    return request.param


def changes(call):
    """Whether a call changes what the world looks like; a camera only looks at it."""
    return call.role != "camera"


class Caller(threading.Thread):
    """A thread that waits for a call, and keeps its error."""

    def __init__(self, call):
        super().__init__(daemon=True)
        self._call, self.error = call, None
        self.start()

    def run(self):
        try:
            self._call()
        except DeviceError as error:
            self.error = error

    def ended(self):
        self.join(PATIENCE)
        return not self.is_alive()


# Kinds that every device has.


def test_without_a_fault_a_call_does_what_it_is_for(call):
    surroundings = bench()
    with call.kind(surroundings) as device:
        before = state(surroundings)
        call(device)
        assert (state(surroundings) != before) == changes(call)


def test_an_error_says_so_and_changes_nothing(call):
    surroundings = bench(Fault(call.role, "error"))
    with call.kind(surroundings) as device:
        before = state(surroundings), surroundings.clock.now()
        with pytest.raises(DeviceError, match=rf"^{call.words}: the device answers ERROR\. Switch"):
            call(device)
        assert (state(surroundings), surroundings.clock.now()) == before
        call(device)
        assert (state(surroundings) != before[0]) == changes(call)


def test_silence_lasts_as_long_as_a_reply_may_take(call):
    surroundings = bench(Fault(call.role, "silence"))
    with call.kind(surroundings) as device:
        before, began = state(surroundings), surroundings.clock.now()
        with pytest.raises(DeviceError, match=rf"^{call.words}: no reply within .* s\. Check the"):
            call(device)
        assert surroundings.clock.now() - began == pytest.approx(device.reply_time)
        assert state(surroundings) == before
        call(device)


def test_a_slow_call_does_what_it_should_but_later(call):
    punctual, late = bench(), bench(Fault(call.role, "slow", seconds=2.5))
    with call.kind(punctual) as device:
        expected = call(device)
        settled = state(punctual)
    with call.kind(late) as device:
        got = call(device)
        assert state(late) == settled
        if call is CAPTURE:
            assert got.time - expected.time == pytest.approx(2.5)
        else:
            assert got.actual == expected.actual
            assert got.ready_at - expected.ready_at == pytest.approx(2.5)


def test_a_slow_call_may_take_no_time_at_all(call):
    surroundings = bench(Fault(call.role, "slow", seconds=0.0))
    with call.kind(surroundings) as device:
        call(device)


def test_a_hung_call_ends_when_the_device_is_killed(call):
    surroundings = bench(Fault(call.role, "hung"))
    device = call.kind(surroundings).__enter__()
    before = state(surroundings)
    hung = Caller(lambda: call(device))
    hung.join(0.1)
    assert hung.is_alive()
    device.kill()
    assert hung.ended()
    assert str(hung.error) == f"{call.words}: the device was killed. Open it again"
    assert state(surroundings) == before


def test_a_killed_device_does_nothing_any_more(call):
    """Whoever killed it has opened another one, and would not know who moved what."""
    surroundings = bench()
    device = call.kind(surroundings).__enter__()
    before = state(surroundings)
    device.kill()
    device.kill()
    with pytest.raises(DeviceError, match=f"^{call.words}: the device was killed"):
        call(device)
    assert state(surroundings) == before
    with call.kind(surroundings) as another:
        call(another)


@pytest.mark.parametrize("kind", ["slow", "silence"])
def test_a_killed_device_waits_no_longer_and_does_nothing(kind, call):
    """In real time, where the wait would last for days."""
    surroundings = bench(Fault(call.role, kind, seconds=1e6), clock=VirtualClock(1.0))
    device = call.kind(surroundings).__enter__()
    device.reply_time = 1e6
    before = state(surroundings)
    waiting = Caller(lambda: call(device))
    while surroundings.clock.now() == 0:
        time.sleep(0.001)
    device.kill()
    assert waiting.ended()
    assert "the device was killed" in str(waiting.error)
    assert state(surroundings) == before


def test_a_killed_camera_exposes_no_longer():
    surroundings = bench(clock=VirtualClock(1.0))
    camera = SimulatedCamera(surroundings).__enter__()
    camera.set_exposure(30.0)
    surroundings.world.electron_rates(30.0)
    exposing = Caller(lambda: camera.capture(never))
    while surroundings.clock.now() == 0:
        time.sleep(0.001)
    camera.kill()
    assert exposing.ended()
    assert "capture: the device was killed" in str(exposing.error)
    assert surroundings.clock.now() < 30.0


def test_a_killed_camera_leaves_chance_alone(monkeypatch):
    """What it computes when it is killed must not change the frame that is taken instead."""
    surroundings = bench()
    camera, w = SimulatedCamera(surroundings).__enter__(), surroundings.world
    monkeypatch.setattr(w, "random_generator", lambda: pytest.fail("a random number was drawn"))
    stream = w.stream

    def killing(exposure, check):
        result = stream(exposure, check)
        camera.kill()
        return result

    monkeypatch.setattr(w, "stream", killing)
    with pytest.raises(DeviceError, match="capture: the device was killed"):
        camera.capture(never)


def test_a_killed_camera_stops_computing(monkeypatch):
    surroundings = bench()
    camera, w = SimulatedCamera(surroundings).__enter__(), surroundings.world
    formed = w.stream

    def killing(exposure, check):
        camera.kill()
        check()
        return formed(exposure, check)

    monkeypatch.setattr(w, "stream", killing)
    with pytest.raises(DeviceError, match="capture: the device was killed"):
        camera.capture(never)


def test_a_disconnected_device_is_away_until_it_is_opened_again_after_a_while(call):
    surroundings = bench(Fault(call.role, "disconnect", seconds=3.0))
    clock = surroundings.clock
    device = call.kind(surroundings).__enter__()
    before = state(surroundings)
    with pytest.raises(DeviceError, match=rf"^{call.words}: the device was disconnected\. Plug"):
        call(device)
    with pytest.raises(DeviceError, match="the device is disconnected"):
        call(device)
    assert state(surroundings) == before
    clock.wait_until(2.9, never)
    with pytest.raises(DeviceError, match=r"open: there is no such device\. Plug it in"):
        call.kind(surroundings).__enter__()
    assert state(surroundings) == before
    clock.wait_until(3.0, never)
    # It is there again, but this is still the handle of before.
    with pytest.raises(DeviceError, match="the device is disconnected"):
        call(device)
    with call.kind(surroundings) as again:
        call(again)
        assert (state(surroundings) != before) == changes(call)


def test_a_device_that_is_away_leaves_the_others_alone():
    surroundings = bench(Fault("slm", "disconnect"))
    with SimulatedFilter(surroundings) as tuned:
        slm = SimulatedSLM(surroundings).__enter__()
        with pytest.raises(DeviceError, match="was disconnected"):
            slm.show("ring", RING)
        tuned.set_wavelength(600e-9)
        with SimulatedTargets(surroundings) as targets:
            targets.place("card")


def test_a_device_may_be_back_at_once():
    surroundings = bench(Fault("slm", "disconnect", seconds=0.0))
    slm = SimulatedSLM(surroundings).__enter__()
    with pytest.raises(DeviceError, match="was disconnected"):
        slm.show("ring", RING)
    with SimulatedSLM(surroundings) as again:
        again.show("ring", RING)


@pytest.mark.parametrize(
    ("kind", "role", "words"),
    [
        (SimulatedSLM, "slm", "simulated SLM: show neutral"),
        (SimulatedFilter, "filter", "simulated tunable filter: tune to 420.0 nm"),
        (SimulatedWheel, "filter", "simulated filter wheel: turn to slot 1"),
    ],
)
def test_making_safe_may_go_wrong_too(kind, role, words):
    with kind(bench(Fault(role, "error"))) as device:
        with pytest.raises(DeviceError, match=f"^{words}: the device answers ERROR"):
            device.make_safe()
        device.make_safe()


def test_a_hung_device_under_watch_is_killed_and_opened_again(monkeypatch):
    monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, timeout_margin=0.1))
    surroundings = bench(Fault("filter", "hung"))
    with SupervisedDevice("filter", lambda: SimulatedFilter(surroundings)) as tuned:
        with pytest.raises(DeviceError, match=r"tunable filter: set_wavelength: hangs.*was killed"):
            tuned.set_wavelength(600e-9)
        assert surroundings.world.wavelength == 550e-9
        tuned.revive()
        tuned.set_wavelength(600e-9)
        assert surroundings.world.wavelength == 600e-9


def test_a_disconnected_device_under_watch_is_opened_again_once_it_is_back():
    surroundings = bench(Fault("slm", "disconnect", seconds=3.0))
    with SupervisedDevice("slm", lambda: SimulatedSLM(surroundings)) as slm:
        with pytest.raises(DeviceError, match="was disconnected"):
            slm.show("ring", RING)
        with pytest.raises(DeviceError, match="there is no such device"):
            slm.revive()
        surroundings.clock.wait_until(3.0, never)
        slm.revive()
        slm.show("ring", RING)
        assert np.array_equal(surroundings.world.grey, RING)


# When they strike.


def test_a_fault_waits_for_its_frame(call):
    surroundings = bench(Fault(call.role, "error", frame=3))
    with call.kind(surroundings) as device:
        for index in (0, 1, 2):
            surroundings.world.begin_frame(1, index, 0, index=index)
            call(device)
        surroundings.world.begin_frame(1, 3, 0, index=3)
        with pytest.raises(DeviceError, match="ERROR"):
            call(device)
        call(device)


def test_a_fault_whose_frame_went_by_strikes_the_next_call():
    surroundings = bench(Fault("targets", "error", frame=3))
    with SimulatedTargets(surroundings) as targets:
        surroundings.world.begin_frame(1, 7, 0, index=7)
        with pytest.raises(DeviceError, match="ERROR"):
            targets.place("card")


@pytest.mark.parametrize("times", [1, 2, 5])
def test_a_fault_strikes_as_often_as_it_says(times, call):
    surroundings = bench(Fault(call.role, "error", times=times))
    with call.kind(surroundings) as device:
        for _ in range(times):
            with pytest.raises(DeviceError, match="ERROR"):
                call(device)
        for _ in range(3):
            call(device)


def test_a_fault_strikes_whichever_opening_of_the_device_it_is():
    surroundings = bench(Fault("targets", "error", times=2))
    for _ in range(2):
        with (
            SimulatedTargets(surroundings) as targets,
            pytest.raises(DeviceError, match="ERROR"),
        ):
            targets.place("card")
    with SimulatedTargets(surroundings) as targets:
        targets.place("card")


@pytest.mark.parametrize("struck", ["slm", "filter", "camera", "targets"])
def test_a_fault_strikes_only_its_device(struck):
    surroundings = bench(Fault(struck, "error", times=9))
    for call in CALLS:
        with SupervisedDevice(call.role, lambda call=call: call.kind(surroundings)) as device:
            if call.role == struck:
                with pytest.raises(DeviceError, match="ERROR"):
                    call(device)
            else:
                call(device)


def test_faults_of_one_device_strike_one_after_the_other():
    surroundings = bench(
        Fault("targets", "error", frame=1), Fault("targets", "silence"), Fault("targets", "error")
    )
    with SimulatedTargets(surroundings) as targets:
        for words in ("no reply", "ERROR"):
            with pytest.raises(DeviceError, match=words):
                targets.place("card")
        targets.place("star")
        surroundings.world.begin_frame(1, 1, 0, index=1)
        with pytest.raises(DeviceError, match="ERROR"):
            targets.place("card")


@pytest.mark.parametrize("kind", FRAME_KINDS)
def test_a_fault_of_a_frame_waits_for_a_frame(kind):
    surroundings = bench(Fault("camera", kind))
    with SimulatedCamera(surroundings) as camera:
        for _ in range(3):
            assert camera.set_exposure(0.02).actual == 0.02


def test_a_script_keeps_what_it_was_given():
    faults = (Fault("slm", "error"), Fault("camera", "hung", frame=2, times=3))
    script = FaultScript(iter(faults))
    assert script.take_fault("slm", frame=False) == faults[0]
    assert script.take_fault("slm", frame=False) is None
    assert script.script == faults
    assert FaultScript().script == ()


# Kinds that only frames have.


def checked(frame):
    """Whether a frame's checksum is that of its bytes."""
    return frame.checksum == zlib.crc32(frame.image.tobytes())


def test_a_late_frame_makes_all_that_follow_stale_until_the_camera_is_opened_again():
    """It lies in the host's queue, and every picture that is fetched is the one before."""
    surroundings = bench(Fault("camera", "late frame", frame=1))
    with SimulatedCamera(surroundings) as camera:
        assert camera.capture(never).number == 1
        surroundings.world.begin_frame(1, 1, 0, index=1)
        with pytest.raises(DeviceError, match=r"camera: capture: frame 2 is late\. Check the net"):
            camera.capture(never)
        asked = []
        got = []
        for _ in range(3):
            asked.append(surroundings.clock.now())
            got.append(camera.capture(never))
        assert [frame.number for frame in got] == [2, 3, 4]
        # Each was begun before it was asked for.
        assert all(frame.time < moment for frame, moment in zip(got, asked, strict=True))
        assert all(checked(frame) for frame in got)
    with SimulatedCamera(surroundings) as camera:
        asked = surroundings.clock.now()
        frame = camera.capture(never)
        assert frame.number == 1
        assert frame.time >= asked


def test_a_dropped_frame_is_missing_and_its_number_is_too():
    surroundings = bench(Fault("camera", "dropped frame", times=2))
    with SimulatedCamera(surroundings) as camera:
        for number in (1, 2):
            words = rf"camera: capture: frame {number} was lost\. Check the network"
            with pytest.raises(DeviceError, match=words):
                camera.capture(never)
        asked = surroundings.clock.now()
        frame = camera.capture(never)
        assert frame.number == 3
        assert frame.time >= asked


def test_a_stale_frame_is_the_last_one_again():
    surroundings = bench(Fault("camera", "stale frame", frame=1, times=2))
    with SimulatedCamera(surroundings) as camera:
        camera.set_exposure(0.01)
        first = camera.capture(never)
        surroundings.world.begin_frame(1, 1, 0, index=1)
        camera.set_exposure(0.02)
        for _ in range(2):
            stale = camera.capture(never)
            assert (stale.number, stale.time) == (first.number, first.time)
            assert stale.exposure == 0.01
            assert np.array_equal(stale.image, first.image)
            assert checked(stale)
        fresh = camera.capture(never)
        assert fresh.number == first.number + 1
        assert fresh.exposure == 0.02


def test_a_first_frame_cannot_be_stale_and_the_next_one_is_instead():
    surroundings = bench(Fault("camera", "stale frame"))
    with SimulatedCamera(surroundings) as camera:
        assert [camera.capture(never).number for _ in range(4)] == [1, 1, 2, 3]


def test_a_wrong_exposure_is_one_and_says_which():
    black = CAMERA.sensor.black_level
    surroundings = bench(Fault("camera", "wrong exposure", frame=1))
    with SimulatedCamera(surroundings) as camera:
        camera.set_exposure(0.01)
        right = camera.capture(never)
        surroundings.world.begin_frame(1, 1, 0, index=1)
        wrong, again = camera.capture(never), camera.capture(never)
    assert right.exposure == again.exposure == 0.01
    assert wrong.exposure == 0.02
    assert [frame.number for frame in (right, wrong, again)] == [1, 2, 3]
    # Twice the time, twice the light; half a digital number is lost to rounding.
    light = right.image.astype(float) - black
    assert light.max() > 20
    assert np.abs(wrong.image.astype(float) - black - 2 * light).max() <= 1.5
    assert np.array_equal(again.image, right.image)


def test_a_wrong_exposure_is_one_that_the_camera_can_make():
    low, high = CAMERA.sensor.exposure_range
    surroundings = bench(Fault("camera", "wrong exposure", times=2))
    with SimulatedCamera(surroundings) as camera:
        for exposure in (low, high):
            camera.set_exposure(exposure)
            wrong = camera.capture(never).exposure
            assert wrong != exposure
            assert low <= wrong <= high


@pytest.mark.parametrize("target", ["star", "dark"])
@pytest.mark.parametrize("black", [64.0, 0.0])
def test_a_corrupt_frame_does_not_fit_its_checksum(target, black):
    sensor = replace(CAMERA.sensor, black_level=black)
    surroundings = bench(
        Fault("camera", "corrupt frame", frame=1), camera=replace(CAMERA, sensor=sensor)
    )
    surroundings.world.target = target
    with SimulatedCamera(surroundings) as camera:
        before = camera.capture(never)
        surroundings.world.begin_frame(1, 1, 0, index=1)
        corrupt, after = camera.capture(never), camera.capture(never)
    assert checked(before)
    assert checked(after)
    assert not checked(corrupt)
    assert corrupt.checksum == zlib.crc32(before.image.tobytes())
    # A packet is missing; what came arrived well.
    assert np.array_equal(corrupt.image[:20], before.image[:20])
    assert [frame.number for frame in (before, corrupt, after)] == [1, 2, 3]


# Faults that are none.


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"device": "lamp"}, r"device is 'lamp'; choose slm, filter, camera, targets"),
        ({"kind": "gremlin"}, r"kind is 'gremlin'; choose error, silence, slow, hung"),
        ({"frame": -1}, r"frame is -1 and times 1; frame counts from 0"),
        ({"times": 0}, r"frame is 0 and times 0; .* a fault strikes once at least"),
        ({"seconds": -0.5}, r"seconds is -0\.5; it must be finite and not negative"),
        ({"seconds": math.inf}, r"seconds is inf; it must be finite"),
        ({"seconds": math.nan}, r"seconds is nan; it must be finite"),
    ],
)
def test_a_fault_that_is_none_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        Fault(**{"device": "slm", "kind": "error", **arguments})


@pytest.mark.parametrize("kind", FRAME_KINDS)
@pytest.mark.parametrize("device", ["slm", "filter", "targets"])
def test_only_the_camera_has_frames(device, kind):
    with pytest.raises(ValueError, match=f"kind is '{kind}' for the {device}; only the camera has"):
        Fault(device, kind)


# Fault files.


@pytest.fixture
def written(tmp_path):
    """Write a fault file; its path."""

    def write(text, name="faults.toml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def test_a_fault_file_holds_faults_in_order(written):
    path = written("""
version = 1
[[fault]]
device = "camera"
kind = "late frame"
frame = 3
times = 2
[[fault]]
device = "slm"
kind = "disconnect"
seconds = 5
[[fault]]
device = "filter"
kind = "hung"
""")
    assert read_faults(path) == (
        Fault("camera", "late frame", frame=3, times=2),
        Fault("slm", "disconnect", seconds=5.0),
        Fault("filter", "hung", frame=0, times=1, seconds=1.0),
    )


def test_a_fault_file_may_be_json(written):
    text = '{"version": 1, "fault": [{"device": "slm", "kind": "error"}]}'
    assert read_faults(written(text, "faults.json")) == (Fault("slm", "error"),)


FAULT = '[[fault]]\ndevice = "{device}"\nkind = "{kind}"\n{more}'


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kind": "gremlin"}, r"key 'fault\.0\.kind' is 'gremlin': .*'error'.*'corrupt frame'"),
        ({"device": "lamp"}, r"key 'fault\.0\.device' is 'lamp': .*'slm'.*'targets'"),
        ({"kind": "late frame"}, r"key 'fault\.0': kind is 'late frame' for the slm; only the ca"),
        ({"more": "frame = -1"}, r"key 'fault\.0\.frame' is -1: "),
        ({"more": "times = 0"}, r"key 'fault\.0\.times' is 0: "),
        ({"more": "seconds = -1"}, r"key 'fault\.0\.seconds' is -1: "),
        ({"more": "seconds = inf"}, r"key 'fault\.0\.seconds' is inf: "),
        ({"more": "second = 3"}, r"key 'fault\.0\.second' is unknown"),
    ],
)
def test_a_fault_file_that_is_wrong_names_its_key_and_value(changes, words, written):
    path = written("version = 1\n" + FAULT.format(**{"device": "slm", "kind": "error",
                                                    "more": "", **changes}))  # fmt: skip
    with pytest.raises(UserError, match=words) as caught:
        read_faults(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_the_second_fault_is_named_as_the_second(written):
    good = FAULT.format(device="camera", kind="late frame", more="")
    bad = FAULT.format(device="filter", kind="stale frame", more="")
    with pytest.raises(UserError, match=r"key 'fault\.1': kind is 'stale frame' for the filter"):
        read_faults(written(f"version = 1\n{good}{bad}"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"key 'version' is missing"),
        (
            "version = 2\n" + FAULT.format(device="slm", kind="error", more=""),
            r"key 'version' is 2",
        ),
        ("version = 1", r"key 'fault' is missing"),
        ("version = 1\nfault = []", r"key 'fault' is \[\]: "),
        ("version = ", r"is not valid TOML"),
    ],
)
def test_a_file_without_faults_is_refused(text, words, written):
    with pytest.raises(UserError, match=words):
        read_faults(written(text))


def test_a_fault_file_that_is_missing_is_named(tmp_path):
    with pytest.raises(UserError, match=r"nowhere\.toml: cannot be read: there is no such file"):
        read_faults(tmp_path / "nowhere.toml")
