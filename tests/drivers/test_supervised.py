import gc
import logging
import subprocess
import sys
import threading
import time
import weakref
from concurrent.futures import CancelledError, wait
from dataclasses import replace

import numpy as np
import pytest

from drivers import supervised
from drivers.errors import DeviceError
from drivers.interfaces import Frame, Identity, Setting
from drivers.supervised import SupervisedCamera, SupervisedDevice, SupervisionTiming
from drivers.worker import Worker

PATIENCE = 60
"""Seconds after which a test that should have ended long ago is given up."""

AGES = 1e6
"""Seconds that nobody waits for."""


class Modest:
    """A camera that writes down what it is asked, by whom, and hangs where it is told to.

    hangs: names of calls, for which nobody waits long. It goes on when it is released.
    """

    reply_time = PATIENCE
    frame_time = 0.0
    levels = 256

    def __init__(self, hangs=()):
        self.calls, self.threads = [], []
        self.hangs = set(hangs)
        if hangs:
            self.reply_time = 0.2
        self.hanging, self.released, self.safe = (threading.Event() for _ in range(3))
        self.note("make")

    def note(self, call):
        self.calls.append(call)
        self.threads.append(threading.current_thread())
        if call in self.hangs:
            self.hanging.set()
            self.released.wait()

    def __enter__(self):
        self.note("enter")
        return self

    def __exit__(self, *error):
        self.note("exit")

    @property
    def identity(self):
        self.note("identity")
        return Identity("modest", "7", simulated=False)

    @property
    def temperature(self):
        self.note("temperature")
        return 21.5

    def make_safe(self):
        self.note("make_safe")
        self.safe.set()

    def show(self, identifier, grey):
        self.note("show")
        return Setting(identifier, f"{identifier} {grey}", 3.0)

    def fail(self, error):
        self.note("fail")
        raise error

    def set_exposure(self, exposure):
        self.note("set_exposure")
        return Setting(exposure, exposure, 0.0)

    def capture(self, cancelled):
        self.note("capture")
        return Frame(np.zeros((2, 3), np.uint16), 0.5, 2.0, 0.0, 1)


class Killable(Modest):
    """One whose hanging calls end when it is killed."""

    def kill(self):
        self.calls.append("kill")
        self.released.set()


class Polling(Modest):
    """One that looks whether its exposure is cancelled, and exposes until then."""

    def capture(self, cancelled):
        self.hanging.set()
        while not cancelled():
            time.sleep(0.001)
        self.released.set()
        return super().capture(cancelled)


class Maker:
    """What makes the devices of a test, one after the other.

    Each has its kind, or is the error with which it can't be made.
    """

    def __init__(self):
        self.devices = []
        self._next = []

    def then(self, kind=Modest, hangs=()):
        self._next.append((kind, hangs))
        return self

    def __call__(self):
        kind, hangs = self._next.pop(0) if len(self._next) > 1 else self._next[0]
        if isinstance(kind, Exception):
            raise kind
        # Before it is made, for it may hang then.
        device = kind.__new__(kind)
        self.devices.append(device)
        device.__init__(hangs)
        return device


@pytest.fixture(autouse=True)
def short_times(monkeypatch):
    short = SupervisionTiming(
        open_timeout=PATIENCE, timeout_margin=0.2, cancel_grace=0.2, kill_timeout=PATIENCE
    )
    monkeypatch.setattr(supervised, "SETTINGS", short)


@pytest.fixture
def make():
    maker = Maker()
    yield maker
    for device in maker.devices:
        device.released.set()


class Caller(threading.Thread):
    """A thread that waits for a call, and keeps what came of it."""

    def __init__(self, call):
        super().__init__(daemon=True)
        self._call = call
        self.answer = self.error = None
        self.start()

    def run(self):
        try:
            self.answer = self._call()
        except Exception as error:
            self.error = error

    def ended(self):
        self.join(PATIENCE)
        return not self.is_alive()


def has_ended(thread):
    thread.join(PATIENCE)
    return not thread.is_alive()


def never():
    return False


def killed(device, call="show"):
    """Have a device hang at a call and be found dead."""
    arguments = ("ring", 0) if call == "show" else ()
    with pytest.raises(DeviceError, match="hangs"):
        getattr(device, call)(*arguments)


# What works.


def test_every_call_runs_in_the_devices_own_thread(make):
    with SupervisedDevice("slm", make.then()) as slm:
        assert slm.temperature == 21.5
        slm.show("ring", 7)
        slm.make_safe()
    device = make.devices[0]
    assert device.calls == [
        "make", "enter", "identity", "temperature", "show", "make_safe", "exit"
    ]  # fmt: skip
    own = device.threads[0]
    assert set(device.threads) == {own}
    assert own is not threading.current_thread()
    assert own.name == "slm"
    assert own.daemon
    assert has_ended(own)


def test_what_a_device_holds_is_told_as_it_is_now_until_it_is_given_up(make):
    with SupervisedDevice("slm", make.then(Modest, ["show"])) as slm:
        device = make.devices[0]
        assert slm.calls is device.calls
        device.shown = "ring"
        assert slm.shown == "ring"
        device.shown = "lens"
        assert slm.shown == "lens"
        killed(slm)
        with pytest.raises(DeviceError, match="the device hung at show"):
            _ = slm.shown
        device.released.set()


def test_two_devices_have_two_threads(make):
    with SupervisedDevice("slm", make.then()), SupervisedDevice("filter", make):
        one, other = (device.threads[0] for device in make.devices)
        assert one is not other


def test_results_come_through(make):
    with SupervisedDevice("slm", make.then()) as slm:
        assert slm.identity == Identity("modest", "7", simulated=False)
        assert slm.levels == 256
        assert slm.show("ring", 7) == Setting("ring", "ring 7", 3.0)
        assert slm.show("ring", grey=8) == Setting("ring", "ring 8", 3.0)
        assert slm.failure_reason == ""


@pytest.mark.parametrize("error", [ValueError("out of range"), KeyError("ring"), OSError(5, "x")])
def test_errors_come_through_and_the_device_lives(error, make):
    with SupervisedDevice("slm", make.then()) as slm:
        with pytest.raises(type(error)) as caught:
            slm.fail(error)
        assert caught.value is error
        assert slm.failure_reason == ""
        assert slm.temperature == 21.5


def test_a_device_error_comes_through_and_says_which_of_the_bench_it_is(make):
    with SupervisedDevice("filter", make.then()) as tuned:
        with pytest.raises(
            DeviceError, match=r"modest: W 900: out of range. Choose less"
        ) as caught:
            tuned.fail(DeviceError("modest", "W 900", "out of range", "Choose less"))
        assert caught.value.role == "filter"
        assert tuned.failure_reason == ""


def test_an_unknown_name_is_an_attribute_error(make):
    with SupervisedDevice("filter", make.then()) as tuned:
        assert not hasattr(tuned, "set_slot")
        assert hasattr(tuned, "show")
        with pytest.raises(AttributeError, match="set_slot"):
            _ = tuned.set_slot
        with pytest.raises(AttributeError, match="filter has no _secret"):
            _ = tuned._secret
    with pytest.raises(AttributeError):
        _ = SupervisedDevice.__new__(SupervisedDevice).anything


def test_a_device_that_is_not_open_says_so(make):
    slm = SupervisedDevice("slm", make.then())
    for words in ("is not open", "is closed"):
        for call in (
            lambda: slm.temperature,
            slm.make_safe,
            slm.begin_make_safe(),
        ):
            with pytest.raises(DeviceError, match=words) as caught:
                call()
            assert caught.value.role == "slm"
        with slm:
            assert slm.temperature == 21.5
    # Not even to make it safe is it opened by itself.
    assert len(make.devices) == 2


def test_what_is_entered_may_be_another_than_what_was_made(make):
    class Door(Modest):
        def __enter__(self):
            inside = Maker().then()()
            make.devices.append(inside)
            return inside

    with SupervisedDevice("slm", make.then(Door)) as slm:
        slm.show("ring", 7)
    door, inside = make.devices
    assert door.calls == ["make"]
    assert inside.calls == ["make", "identity", "show", "exit"]


# Hanging.


def test_a_call_that_never_ends_is_a_device_error_that_names_it(make):
    with SupervisedDevice("slm", make.then(Modest, ["show"])) as slm:
        with pytest.raises(
            DeviceError,
            match=r"^modest: show: hangs: no answer within 0\.4 s; it was given up\. Look at the",
        ) as caught:
            slm.show("ring", 0)
        error = caught.value
        assert (error.device, error.command, error.role) == ("modest", "show", "slm")
        assert slm.failure_reason == "hung at show, and it was given up"


def test_a_value_that_is_never_told_is_a_hang_too(make):
    with SupervisedDevice("slm", make.then(Modest, ["temperature"])) as slm:
        with pytest.raises(DeviceError, match="modest: temperature: hangs"):
            _ = slm.temperature
        assert slm.failure_reason


def test_later_calls_to_a_dead_device_fail_at_once(make, monkeypatch):
    with SupervisedDevice("slm", make.then(Modest, ["show"])) as slm:
        show = slm.show
        killed(slm)
        # Whoever waited now would wait for days.
        patient = replace(supervised.SETTINGS, timeout_margin=AGES)
        monkeypatch.setattr(supervised, "SETTINGS", patient)
        device = make.devices[0]
        before = list(device.calls)
        for call in (lambda: slm.temperature, lambda: show("x", 0), lambda: slm.unheard_of):
            with pytest.raises(DeviceError, match="the device hung at show, and it was given up"):
                call()
        assert device.calls == before


def test_a_hung_device_that_can_be_killed_is_killed_and_left(make):
    with SupervisedDevice("slm", make.then(Killable, ["show"])) as slm:
        with pytest.raises(DeviceError, match=r"hangs: no answer within .*; it was killed"):
            slm.show("ring", 0)
        assert slm.failure_reason == "hung at show, and it was killed"
        device = make.devices[0]
        assert device.calls[-3:] == ["show", "kill", "exit"]
        assert has_ended(device.threads[0])


def test_a_killed_device_that_hangs_when_it_is_left_is_no_hindrance(make, monkeypatch):
    class Stubborn(Killable):
        def __exit__(self, *error):
            super().__exit__()
            threading.Event().wait(PATIENCE if self.released.is_set() else 0)

    monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, kill_timeout=1.0))
    with (
        SupervisedDevice("slm", make.then(Stubborn, ["show"])) as slm,
        pytest.raises(DeviceError, match="it was killed"),
    ):
        slm.show("ring", 0)


def test_a_kill_that_does_not_help_is_told_as_it_is(make, monkeypatch):
    class Undead(Modest):
        def kill(self):
            raise OSError("no such process")

    monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, kill_timeout=0.1))
    with (
        SupervisedDevice("slm", make.then(Undead, ["show"])) as slm,
        pytest.raises(DeviceError, match="it was given up"),
    ):
        slm.show("ring", 0)


def test_a_kill_that_hangs_is_not_waited_for(make, monkeypatch):
    class Undead(Modest):
        def kill(self):
            self.released.wait()

    monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, kill_timeout=0.1))
    with (
        SupervisedDevice("slm", make.then(Undead, ["show"])) as slm,
        pytest.raises(DeviceError, match="it was given up"),
    ):
        slm.show("ring", 0)


def test_a_process_ends_though_a_device_hangs():
    code = f"""
import sys; sys.path[:] = {sys.path!r}
import threading
from dataclasses import replace
from drivers import supervised
from drivers.errors import DeviceError
from drivers.interfaces import Identity
supervised.SETTINGS = replace(supervised.SETTINGS, timeout_margin=0.1)

class Hung:
    reply_time = 0.1
    identity = Identity("hung", "", False)
    def __enter__(self): return self
    def __exit__(self, *error): pass
    def show(self): threading.Event().wait()

with supervised.SupervisedDevice("slm", Hung) as slm:
    try:
        slm.show()
    except DeviceError as error:
        print(error.reply)
"""
    answer = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, timeout=120
    )
    assert (answer.returncode, answer.stderr) == (0, "")
    assert answer.stdout == "hangs: no answer within 0.2 s; it was given up\n"


def test_a_call_behind_a_longer_one_waits_for_its_turn(make):
    """It would be late if it were counted from when it was asked."""
    with SupervisedCamera("camera", make.then(Modest, ["capture"])) as camera:
        camera.set_exposure(AGES)
        device = make.devices[0]
        capturing = Caller(lambda: camera.capture(never))
        assert device.hanging.wait(PATIENCE)
        asking = Caller(lambda: camera.temperature)
        asking.join(1.0)
        assert asking.is_alive()
        device.released.set()
        assert capturing.ended()
        assert asking.ended()
        assert (capturing.error, asking.error) == (None, None)
        assert asking.answer == 21.5


def test_what_waits_behind_a_hung_call_is_never_done(make):
    """A setting that reaches a device long after everybody gave it up would be a surprise."""
    with SupervisedDevice("slm", make.then(Modest, ["show"])) as slm:
        device = make.devices[0]
        showing = Caller(lambda: slm.show("ring", 0))
        assert device.hanging.wait(PATIENCE)
        finish = slm.begin_make_safe()
        assert showing.ended()
        with pytest.raises(DeviceError, match="modest: make safe: the device hung at show") as it:
            finish()
        assert it.value.role == "slm"
        device.released.set()
        assert has_ended(device.threads[0])
        assert device.calls[-1] == "show"


# Opening again.


def test_a_dead_device_is_replaced_by_a_new_one(make):
    with SupervisedDevice("slm", make.then(Killable, ["show"]).then()) as slm:
        show = slm.show
        killed(slm)
        slm.revive()
        assert slm.failure_reason == ""
        # What was looked up before is the new device's, too.
        assert show("ring", 1).actual == "ring 1"
    old, new = make.devices
    assert new.calls == ["make", "enter", "identity", "show", "exit"]
    assert old.calls.count("show") == 1
    assert new.threads[0] is not old.threads[0]


def test_a_living_device_is_closed_before_it_is_opened_again(make):
    with SupervisedDevice("slm", make.then()) as slm:
        slm.revive()
        old, new = make.devices
        assert old.calls == ["make", "enter", "identity", "exit"]
        assert has_ended(old.threads[0])
        assert slm.temperature == 21.5
    assert new.calls[-2:] == ["temperature", "exit"]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (DeviceError("modest", "open", "no such device", "Plug it in"), "modest: open: no such"),
        (OSError(19, "No such device"), "modest: open: OSError: .*No such device"),
        (ValueError("port is 9"), "modest: open: ValueError: port is 9"),
    ],
)
def test_what_fails_to_open_again_stays_dead_and_may_be_tried_again(error, words, make):
    with SupervisedDevice("slm", make.then(Killable, ["show"]).then(error).then()) as slm:
        killed(slm)
        with pytest.raises(DeviceError, match=words) as caught:
            slm.revive()
        assert caught.value.role == "slm"
        assert slm.failure_reason.startswith("could not be opened: ")
        with pytest.raises(DeviceError, match="modest: temperature: the device could not be open"):
            _ = slm.temperature
        slm.revive()
        assert slm.temperature == 21.5


def test_an_unknown_device_does_not_open(make):
    """What the bench file has wrong is told as it is."""
    error = ValueError("port is 9")
    with pytest.raises(ValueError) as caught, SupervisedDevice("slm", make.then(error)):
        pass
    assert caught.value is error


def test_a_device_that_hangs_when_it_is_made_is_given_up(make, monkeypatch):
    monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, open_timeout=0.2))
    slm = SupervisedDevice("slm", make.then(Modest, ["make"]))
    with pytest.raises(DeviceError, match=r"slm: open: hangs: no answer within 0\.2 s") as caught:
        slm.__enter__()
    assert caught.value.role == "slm"
    assert slm.failure_reason == "hung at open, and it was given up"
    device = make.devices[0]
    device.released.set()
    assert has_ended(device.threads[0])
    assert device.calls == ["make"]


def test_a_device_that_opens_too_late_is_closed_again(make, monkeypatch):
    """Its port would be in use for whoever tries again."""
    monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, open_timeout=0.2))
    slm = SupervisedDevice("slm", make.then(Modest, ["enter"]))
    with pytest.raises(DeviceError, match=r"slm: open: hangs: .* it was given up"):
        slm.__enter__()
    device = make.devices[0]
    device.released.set()
    assert has_ended(device.threads[0])
    assert device.calls == ["make", "enter", "exit"]


def test_a_device_that_hangs_when_it_is_entered_is_killed(make, monkeypatch):
    monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, open_timeout=0.2))
    slm = SupervisedDevice("slm", make.then(Killable, ["enter"]))
    with pytest.raises(DeviceError, match=r"slm: open: hangs: .* it was killed"):
        slm.__enter__()
    device = make.devices[0]
    assert device.calls[:3] == ["make", "enter", "kill"]
    assert has_ended(device.threads[0])


def test_a_device_that_does_not_say_who_it_is_is_closed_again(make):
    class Nameless(Modest):
        @property
        def identity(self):
            raise DeviceError("?", "*IDN?", "no reply", "Switch it on")

    with (
        pytest.raises(DeviceError, match=r"\*IDN\?: no reply"),
        SupervisedDevice("slm", make.then(Nameless)),
    ):
        pass
    device = make.devices[0]
    assert device.calls == ["make", "enter", "exit"]
    assert has_ended(device.threads[0])


# Closing.


def test_a_device_that_hangs_when_it_is_closed_is_given_up_and_logged(make, monkeypatch, caplog):
    with (
        caplog.at_level(logging.WARNING),
        SupervisedDevice("slm", make.then(Modest, ["exit"])) as slm,
    ):
        monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, open_timeout=0.2))
    assert "slm: closing: modest: close: hangs" in caplog.text
    assert slm.failure_reason == "hung at close, and it was given up"


def test_what_a_device_says_to_being_closed_is_logged(make, caplog):
    class Unwilling(Modest):
        def __exit__(self, *error):
            raise OSError(5, "stuck")

    with caplog.at_level(logging.WARNING), SupervisedDevice("slm", make.then(Unwilling)) as slm:
        pass
    assert "slm: closing: [Errno 5] stuck" in caplog.text
    assert slm.failure_reason == "is closed"
    assert has_ended(make.devices[0].threads[0])


def test_a_dead_device_is_not_closed(make):
    with SupervisedDevice("slm", make.then(Modest, ["show"])) as slm:
        killed(slm)
    make.devices[0].released.set()
    assert has_ended(make.devices[0].threads[0])
    assert make.devices[0].calls[-1] == "show"


def test_an_error_in_the_block_comes_through_a_device_that_fails_to_close(make):
    class Unwilling(Modest):
        def __exit__(self, *error):
            raise OSError(5, "stuck")

    with pytest.raises(ZeroDivisionError), SupervisedDevice("slm", make.then(Unwilling)):
        _ = 1 / 0


# Making safe.


def test_a_device_that_hangs_when_it_is_made_safe_is_named(make):
    with SupervisedDevice("slm", make.then(Killable, ["make_safe"])) as slm:
        with pytest.raises(DeviceError, match=r"modest: make safe: hangs: .* it was killed"):
            slm.make_safe()
        assert slm.failure_reason == "hung at make safe, and it was killed"


def test_whatever_a_device_says_to_being_made_safe_is_a_device_error(make):
    """Who makes a whole bench safe reckons with no other."""

    class Unwilling(Modest):
        def make_safe(self):
            raise OSError(5, "stuck")

    with SupervisedDevice("slm", make.then(Unwilling)) as slm:
        finish = slm.begin_make_safe()
        with pytest.raises(DeviceError, match=r"modest: make safe: OSError: .*stuck") as caught:
            finish()
        assert caught.value.role == "slm"


def test_a_device_without_the_means_to_be_made_safe_is_a_device_error(make):
    class Careless(Modest):
        make_safe = None

    with SupervisedDevice("slm", make.then(Careless)) as slm:
        finish = slm.begin_make_safe()
        with pytest.raises(DeviceError, match="modest: make safe: TypeError"):
            finish()


def test_a_hung_device_does_not_delay_the_others_safety(make):
    make.then(Modest, ["make_safe"]).then()
    with SupervisedDevice("slm", make) as hung, SupervisedDevice("filter", make) as well:
        finish = [device.begin_make_safe() for device in (hung, well)]
        # Nobody has waited for the first one yet.
        assert make.devices[0].hanging.wait(PATIENCE)
        assert make.devices[1].safe.wait(PATIENCE)
        with pytest.raises(DeviceError, match="make safe: hangs"):
            finish[0]()
        finish[1]()


def test_a_dead_device_is_opened_again_to_be_made_safe(make):
    with SupervisedDevice("slm", make.then(Killable, ["show"]).then()) as slm:
        killed(slm)
        slm.make_safe()
        assert make.devices[1].calls == ["make", "enter", "identity", "make_safe"]
        assert slm.failure_reason == ""


def test_a_dead_device_that_does_not_open_again_is_named_when_it_is_made_safe(make):
    error = OSError(19, "No such device")
    with SupervisedDevice("slm", make.then(Killable, ["show"]).then(error)) as slm:
        killed(slm)
        finish = slm.begin_make_safe()
        with pytest.raises(DeviceError, match=r"modest: open: OSError: .*No such device"):
            finish()


def test_dead_devices_are_opened_again_side_by_side(make):
    make.then(Killable, ["show"]).then(Killable, ["show"]).then(Modest, ["enter"]).then()
    with SupervisedDevice("slm", make) as one, SupervisedDevice("filter", make) as other:
        killed(one)
        killed(other)
        first = one.begin_make_safe()
        while len(make.devices) < 3:
            time.sleep(0.001)
        second = other.begin_make_safe()
        second()
        assert make.devices[3].safe.is_set()
        assert not make.devices[2].safe.is_set()
        make.devices[2].released.set()
        first()
        assert make.devices[2].safe.is_set()


# Cameras.


def test_an_exposure_longer_than_the_reply_time_is_waited_for(make):
    class Slow(Modest):
        reply_time = 0.2

        def capture(self, cancelled):
            time.sleep(1.0)
            return super().capture(cancelled)

    with SupervisedCamera("camera", make.then(Slow)) as camera:
        assert camera.set_exposure(AGES) == Setting(AGES, AGES, 0.0)
        assert camera.capture(never).number == 1


def test_the_readout_is_waited_for(make):
    class Slow(Modest):
        reply_time = 0.2
        frame_time = AGES

        def capture(self, cancelled):
            time.sleep(1.0)
            return super().capture(cancelled)

    with SupervisedCamera("camera", make.then(Slow)) as camera:
        camera.set_exposure(0.0)
        assert camera.capture(never).number == 1


def test_an_exposure_that_takes_longer_than_it_was_set_to_is_a_hang(make):
    with SupervisedCamera("camera", make.then(Killable, ["capture"])) as camera:
        camera.set_exposure(0.1)
        with pytest.raises(
            DeviceError, match=r"modest: capture: hangs: no answer within 0\.5 s; it was killed"
        ):
            camera.capture(never)
        with pytest.raises(DeviceError, match="set exposure: the device hung at capture"):
            camera.set_exposure(0.1)


@pytest.mark.parametrize(
    ("pace", "exposure", "allowed"), [(20.0, 0.01, 0.2 + 0.4), (0.05, 0.1, 0.1 + 0.4)]
)
def test_a_bench_whose_seconds_are_long_is_given_as_long(make, pace, exposure, allowed):
    """Twenty of the wall in one of its own; those of a quick one are no shorter."""
    make.then(Killable, ["capture"])
    with SupervisedCamera("camera", make, pace) as camera:
        camera.set_exposure(exposure)
        with pytest.raises(DeviceError, match=rf"no answer within {allowed:.1f} s"):
            camera.capture(never)


def test_a_camera_may_hang_when_its_exposure_is_set(make):
    with SupervisedCamera("camera", make.then(Killable, ["set_exposure"])) as camera:
        with pytest.raises(DeviceError, match="modest: set exposure: hangs"):
            camera.set_exposure(0.1)
        with pytest.raises(DeviceError, match="modest: capture: the device hung at set exposure"):
            camera.capture(never)


def test_a_camera_that_hears_of_its_cancelling_returns_by_itself(make, monkeypatch):
    monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, cancel_grace=PATIENCE))
    with SupervisedCamera("camera", make.then(Polling)) as camera:
        camera.set_exposure(AGES)
        stop = threading.Event()
        capturing = Caller(lambda: camera.capture(stop.is_set))
        assert make.devices[0].hanging.wait(PATIENCE)
        stop.set()
        assert capturing.ended()
        assert capturing.answer.number == 1
        assert camera.failure_reason == ""


def test_a_camera_that_does_not_hear_of_its_cancelling_is_killed(make):
    with SupervisedCamera("camera", make.then(Killable, ["capture"])) as camera:
        camera.set_exposure(AGES)
        device = make.devices[0]
        with pytest.raises(
            DeviceError,
            match=r"capture: hangs: no answer within 0\.2 s after it was cancelled; it was killed",
        ):
            camera.capture(device.hanging.is_set)
        assert device.calls[-3:] == ["capture", "kill", "exit"]


def test_a_capture_that_is_broken_off_is_cancelled(make):
    """By Ctrl-C, say, which only the thread that waits can hear."""
    here = threading.current_thread()

    def interrupted():
        if threading.current_thread() is here and make.devices[0].hanging.is_set():
            raise KeyboardInterrupt
        return False

    with SupervisedCamera("camera", make.then(Polling)) as camera:
        camera.set_exposure(AGES)
        with pytest.raises(KeyboardInterrupt):
            camera.capture(interrupted)
        assert make.devices[0].released.wait(PATIENCE)
        camera.make_safe()
        assert camera.failure_reason == ""


# The thread.


def test_a_thread_does_one_thing_after_the_other():
    worker, gate, order = Worker("it"), threading.Event(), []
    first = worker.submit(lambda: gate.wait(PATIENCE))
    rest = [worker.submit(lambda n=n: order.append(n)) for n in range(5)]
    assert not worker.has_ended
    worker.end()
    assert worker.has_ended
    assert not any(done.done() for done in (first, *rest))
    gate.set()
    assert len(wait(rest, PATIENCE).done) == 5
    assert order == list(range(5))


def test_a_thread_outlives_what_it_does():
    worker = Worker("it")
    failed = worker.submit(lambda: 1 // 0)
    assert isinstance(failed.exception(PATIENCE), ZeroDivisionError)
    assert isinstance(worker.submit(sys.exit).exception(PATIENCE), SystemExit)
    assert worker.submit(lambda: 3).result(PATIENCE) == 3
    worker.end()


def test_what_a_thread_is_given_after_its_end_is_cancelled():
    worker = Worker("it")
    worker.end()
    late = worker.submit(lambda: 3)
    assert len(wait([late], PATIENCE).done) == 1
    with pytest.raises(CancelledError):
        late.result(PATIENCE)
    worker.end()


def test_a_thread_that_is_given_up_does_nothing_more():
    worker, gate, did = Worker("it"), threading.Event(), []
    began = threading.Event()
    first = worker.submit(lambda: began.set() or gate.wait(PATIENCE))
    assert began.wait(PATIENCE)
    second = worker.submit(lambda: did.append(2))
    worker.give_up()
    worker.give_up()
    assert len(wait([second], PATIENCE).done) == 1
    assert second.cancelled()
    gate.set()
    assert first.result(PATIENCE) is True
    assert did == []


def test_what_somebody_cancels_is_left_out():
    worker, gate = Worker("it"), threading.Event()
    worker.submit(lambda: gate.wait(PATIENCE))
    unwanted = worker.submit(lambda: 2)
    assert unwanted.cancel()
    gate.set()
    assert worker.submit(lambda: 3).result(PATIENCE) == 3
    worker.end()


def test_a_thread_keeps_no_result():
    class Picture:
        pass

    worker = Worker("it")
    done = worker.submit(Picture)
    picture = weakref.ref(done.result(PATIENCE))
    # It has looked away when it does the next thing.
    worker.submit(lambda: None).result(PATIENCE)
    del done
    gc.collect()
    assert picture() is None
    worker.end()


def test_a_device_that_says_that_it_gets_on_is_waited_for(monkeypatch):
    """Its steps are each in time; all of them together take much longer than one may."""
    monkeypatch.setattr(supervised, "SETTINGS", replace(supervised.SETTINGS, timeout_margin=0.05))

    class Slow(Modest):
        reply_time = 0.5
        alive_at = 0.0

        def work(self):
            for _ in range(10):
                time.sleep(0.1)
                self.alive_at = time.monotonic()
            return "done"

    with SupervisedDevice("camera", Slow) as device:
        assert device.work() == "done"
        assert not device.failure_reason


class Leaving(Modest):
    """One that tells whether it is there."""

    why = ""

    def unplugged_reason(self):
        if self.why == "broken":
            raise RuntimeError("broken")
        return self.why


def test_whether_it_is_gone_is_told_while_a_call_lasts():
    device = Leaving()
    with SupervisedCamera("camera", lambda: device) as camera:
        assert camera.can_report_unplugging
        assert camera.unplugged_reason() == ""
        device.hangs.add("capture")
        worker = Worker("run")
        done = worker.submit(lambda: camera.capture(lambda: False))
        assert device.hanging.wait(PATIENCE)
        device.why = "its plug is out"
        assert camera.unplugged_reason() == f"{device.identity.model}: its plug is out"
        assert not done.done()
        device.released.set()
        done.result(PATIENCE)
        worker.end()
        device.why = "broken"
        assert camera.unplugged_reason() is None
    assert camera.unplugged_reason() is None


def test_a_device_that_cannot_tell_whether_it_is_gone_isnt_asked():
    with SupervisedDevice("camera", Modest) as camera:
        assert not camera.can_report_unplugging
        assert camera.unplugged_reason() is None
