import os
import select
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.hosted import HostedDevice
from drivers.interfaces import Identity, Setting, Surroundings

HEAVY = ["torch", "PySide6", "serial", "usb", "libusb_package", "h5py", "optics", "simulator",
         "labapp", "pydantic"]  # fmt: skip

PATIENCE = 60
"""Seconds after which a test that should have ended long ago is given up."""


def never():
    return False


def opened(kind="Modest", open_timeout=60.0, clock=None, **options):
    surroundings = Surroundings(clock or RealClock())
    return HostedDevice(
        surroundings, "camera", f"hosted_devices:{kind}", options, open_timeout=open_timeout
    )


def wait_for(path: Path, word: str) -> None:
    late = time.monotonic() + PATIENCE
    while not path.exists() or word not in path.read_text().split():
        assert time.monotonic() < late, f"{word} was never written"
        time.sleep(0.01)


def has_ended(process: int) -> bool:
    """Whether a process ends, or has ended, while we wait for it."""
    try:
        watch = os.pidfd_open(process)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([watch], [], [], PATIENCE)[0])
    finally:
        os.close(watch)


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


# What works.


def test_a_hosted_device_answers_from_another_process():
    with opened() as device:
        assert device.identity == Identity("modest", "7", simulated=False)
        assert device.process != os.getpid()
        assert device.in_main_thread()


def test_properties_and_attributes_are_read_and_methods_are_called():
    with opened() as device:
        assert device.shape == (3, 4)
        assert device.full_scale == 4095
        assert device.Kind is Identity
        assert device.entered is True
        assert device.twice(21) == 42
        assert device.twice(number=21) == 42
        assert device.called() == "Modest"
        assert {"shape", "capture", "kill"} <= set(dir(device))


def test_what_a_device_is_only_once_it_is_entered_is_found():
    device = opened()
    assert not hasattr(device, "entered")
    with device:
        assert hasattr(device, "entered")


def test_what_is_entered_may_be_another_than_what_was_made():
    with opened("Another") as device:
        assert device.word == "entered"
        assert not hasattr(device, "capture")


def test_asking_for_a_method_does_not_read_properties():
    """One of them raises."""
    with opened() as device:
        assert callable(device.capture)


def test_both_processes_show_the_same_time():
    clock = RealClock()
    with opened(clock=clock) as device:
        before = clock.now()
        there = device.now()
        assert before <= there <= clock.now()


def test_a_device_is_entered_and_left(tmp_path):
    notes = tmp_path / "notes"
    with opened(notes=str(notes)) as device:
        process = device.process
    assert notes.read_text().split() == ["entered", "left"]
    assert has_ended(process)


def test_the_device_does_not_see_our_command_line_but_our_path():
    with opened() as device:
        arguments, path = device.line()
    assert len(arguments) == 1
    assert path == sys.path


def test_what_a_device_prints_goes_to_stderr(capfd):
    with opened() as device:
        device.speak("a library's chatter")
    out, err = capfd.readouterr()
    assert out == ""
    assert "a library's chatter" in err


# Arrays.


def test_large_frames_arrive_intact_and_are_our_own():
    import hosted_devices

    here = hosted_devices.Modest(Surroundings(RealClock()), shape=hosted_devices.FULL)
    with opened(shape=hosted_devices.FULL) as device:
        first, second = device.capture(never), device.capture(never)
    assert (first.number, second.number) == (1, 2)
    assert first.image.dtype == np.uint16
    assert np.array_equal(first.image, here.image(1))
    assert np.array_equal(second.image, here.image(2))
    assert not np.shares_memory(first.image, second.image)
    first.image[:] = 0
    assert np.array_equal(second.image, here.image(2))


def test_an_argument_stays_with_the_device_whatever_comes_after_it():
    grey = np.arange(6_000_000, dtype=np.uint32).view(np.uint8).reshape(6000, 4000)
    with opened(shape=(3000, 4000)) as device:
        assert device.show("ramp", grey) == Setting("ramp", "ramp", 0.0)
        device.capture(never)
        assert np.array_equal(device.shown(), grey)


@pytest.mark.parametrize(
    "array",
    [
        np.empty((0, 3), np.uint16),
        np.array(2.5),
        np.arange(24.0).reshape(4, 6).T,
        np.arange(24, dtype=np.uint16).reshape(4, 6)[:, ::2],
        np.arange(24, dtype=np.uint16).reshape(4, 6)[::-1],
        np.arange(6, dtype=">i4"),
        np.exp(1j * np.arange(5)),
        np.array(["a", "bc"]),
        np.broadcast_to(np.uint8(3), (4, 5)),
    ],
    ids=["empty", "scalar", "fortran", "strided", "reversed", "big-endian", "complex", "words",
         "broadcast"],
)  # fmt: skip
def test_arrays_of_every_kind_go_there_and_back(array):
    with opened() as device:
        device.show("odd", array)
        back = device.shown()
        assert back.dtype == array.dtype
        assert back.shape == array.shape
        assert np.array_equal(back, array)


def test_many_arrays_go_at_once():
    """A video as a list of its frames."""
    video = [np.full((2, 3), n) for n in range(5000)]
    with opened() as device:
        device.show("video", video)
        back = device.shown()
    assert all(np.array_equal(a, b) for a, b in zip(back, video, strict=True))


# Cancelling.


def test_a_device_hears_that_its_capture_is_cancelled(tmp_path):
    notes, stop = tmp_path / "notes", threading.Event()
    with opened(notes=str(notes)) as device:
        caller = Caller(lambda: device.keep_exposing(stop.is_set))
        wait_for(notes, "exposing")
        assert caller.is_alive()
        stop.set()
        assert caller.ended()
        assert caller.error is None


def test_what_was_cancelled_before_is_heard_and_the_next_call_is_not_cancelled():
    with opened() as device:
        assert device.keep_exposing(lambda: True) is False
        calls = iter([False, False, True])
        assert device.keep_exposing(lambda: next(calls)) is False
        assert next(calls, "all asked") == "all asked"


def test_every_callable_is_heard_by_itself():
    with opened() as device:
        assert device.keep_exposing(lambda: True, paused=never) is False
        assert device.keep_exposing(paused=lambda: True, cancelled=lambda: True) is True


def test_a_device_that_asks_after_its_call_is_told_to_stop():
    with opened() as device:
        device.keep_exposing(lambda: True)
        assert device.heard_afterwards() is True


def test_a_class_is_a_value_and_not_asked():
    with opened() as device:
        assert device.type_of(np.uint16) == str(np.uint16)


def test_a_call_that_is_broken_off_is_cancelled_and_its_answer_is_nobodys():
    def interrupted():
        raise KeyboardInterrupt

    with opened() as device:
        with pytest.raises(KeyboardInterrupt):
            device.keep_exposing(interrupted)
        assert device.twice(4) == 8
        assert device.twice(5) == 10


def test_more_callables_than_there_is_room_for_are_refused():
    with opened() as device:
        with pytest.raises(ValueError, match="65 callables"):
            device.type_of(*[never] * 65)
        assert device.twice(1) == 2


# Errors.


def test_a_device_error_comes_through_with_all_its_words():
    with opened("Unwilling") as device:
        with pytest.raises(DeviceError) as caught:
            device.capture(never)
        assert str(caught.value) == "unwilling: capture: no. Ask nicely"
        assert "hosted_devices.py" in caught.value.__notes__[0]


def test_an_error_of_a_property_comes_through():
    with opened() as device, pytest.raises(DeviceError, match="frame time: not known"):
        _ = device.frame_time


def test_a_value_error_comes_through_and_the_device_goes_on():
    with opened("Unwilling") as device:
        with pytest.raises(ValueError, match="exposure is -1"):
            device.set_exposure(-1)
        assert device.twice(1) == 2


@pytest.mark.parametrize(
    ("method", "said"),
    [
        ("refuse", r"Refusal\('no'"),
        ("lambdas", "RuntimeError"),
        ("quit", r"SystemExit\(3\)"),
        ("fail_with_a_stranger", r"Problem\('odd'\)"),
        ("answer_with_a_lock", "can't leave its process: TypeError"),
        ("answer_with_a_stranger", "can't be read in this process: RuntimeError"),
    ],
)
def test_what_cannot_travel_is_told_as_a_device_error(method, said):
    with opened("Unwilling") as device:
        with pytest.raises(DeviceError, match=f"camera: {method}: .*{said}"):
            getattr(device, method)()
        assert device.twice(1) == 2


def test_an_error_of_an_unknown_library_does_not_load_that_library():
    sys.modules.pop("hosted_stranger", None)
    with opened("Unwilling") as device, pytest.raises(DeviceError):
        device.fail_with_a_stranger()
    assert "hosted_stranger" not in sys.modules


def test_an_argument_that_cannot_be_sent_is_refused_and_the_device_goes_on():
    with opened() as device:
        with pytest.raises(TypeError, match="pickle"):
            device.show("lock", threading.Lock())
        assert device.twice(1) == 2


def test_unknown_and_private_names_raise_attribute_error():
    with opened() as device:
        with pytest.raises(AttributeError, match="camera has no 'focus'"):
            _ = device.focus
        with pytest.raises(AttributeError):
            _ = device._number
    with pytest.raises(AttributeError):
        _ = HostedDevice.__new__(HostedDevice).anything


def test_an_attribute_cannot_be_set_by_mistake():
    with opened() as device, pytest.raises(AttributeError, match="can't be set"):
        device.shape = (1, 1)


def test_a_call_from_within_a_call_is_refused_and_does_not_wait_for_ever():
    with opened() as device:
        with pytest.raises(RuntimeError, match="camera: twice from within another call"):
            device.keep_exposing(lambda: device.twice(1))
        assert device.twice(1) == 2


def test_several_threads_get_their_own_answers():
    with opened() as device:
        callers = [
            Caller(lambda n=n: [device.twice(n * 1000 + i) for i in range(100)]) for n in range(4)
        ]
        assert all(caller.ended() for caller in callers)
    for n, caller in enumerate(callers):
        assert caller.answer == [2 * (n * 1000 + i) for i in range(100)]


# Opening.


def test_a_virtual_bench_is_refused():
    with pytest.raises(ValueError, match="Open it in this process"):
        HostedDevice(
            Surroundings(RealClock(), world=object()), "camera", "hosted_devices:Modest", {}
        )


def test_a_clock_that_is_not_the_walls_is_refused():
    class Other:
        def now(self):
            return 0.0

    with pytest.raises(ValueError, match="its time"):
        opened(clock=Other())


@pytest.mark.parametrize("factory", ["", "hosted_devices", ":Modest", "hosted_devices:"])
def test_a_factory_that_is_no_name_is_refused(factory):
    with pytest.raises(ValueError, match="write it as 'module:attribute'"):
        HostedDevice(Surroundings(RealClock()), "camera", factory, {})


def test_a_device_goes_on_between_calls():
    with opened("Busy") as device:
        late = time.monotonic() + PATIENCE
        before = device.done
        while device.done < before + 5:
            assert time.monotonic() < late
            time.sleep(0.02)


def test_a_device_that_is_busy_between_calls_is_left_when_its_owner_is_gone(tmp_path):
    notes = tmp_path / "notes"
    device = opened("Busy", notes=str(notes)).__enter__()
    device._channel.line.close()
    wait_for(notes, "left")
    assert notes.read_text().split() == ["entered", "safe", "left"]
    device._release()


def test_a_call_that_takes_longer_than_it_may_kills_the_process():
    surroundings = Surroundings(RealClock())
    device = HostedDevice(
        surroundings, "camera", "hosted_devices:Hung", {}, open_timeout=PATIENCE, reply_timeout=1.5
    )
    with device:
        assert not device.is_dead
        assert device.twice(21) == 42
        with pytest.raises(DeviceError, match=r"no answer within 1.5 s; its process was killed"):
            device.capture(never)
        assert device.is_dead


def test_no_time_to_reply_is_refused():
    with pytest.raises(ValueError, match="reply_timeout is 0 s; it must be positive"):
        HostedDevice(
            Surroundings(RealClock()), "camera", "hosted_devices:Modest", {}, reply_timeout=0
        )


@pytest.mark.parametrize("open_timeout", [0.0, -1.0, float("nan")])
def test_no_time_to_open_is_refused(open_timeout):
    with pytest.raises(ValueError, match="must be positive"):
        opened(open_timeout=open_timeout)


@pytest.mark.parametrize(
    ("factory", "error"),
    [
        ("no_such_module:Camera", ModuleNotFoundError),
        ("hosted_devices:NoSuchCamera", AttributeError),
        ("hosted_devices:number", TypeError),
    ],
)
def test_a_factory_that_does_not_load_is_told_by_the_constructor(factory, error):
    with pytest.raises(error):
        HostedDevice(Surroundings(RealClock()), "camera", factory, {})


def test_what_the_factory_raises_comes_from_the_constructor():
    with pytest.raises(ValueError, match="it must have rows"):
        opened(shape=(0, 4))
    with pytest.raises(TypeError, match="colour"):
        opened(colour=True)


def test_options_that_cannot_be_sent_are_refused():
    with pytest.raises(TypeError, match="pickle"):
        opened(shape=threading.Lock())


def test_what_entering_raises_comes_from_entering_and_the_process_ends():
    device = opened("UnwillingToOpen")
    process = device.process
    with pytest.raises(DeviceError, match="no such camera"):
        device.__enter__()
    assert has_ended(process)
    with pytest.raises(DeviceError, match="camera: enter: it is closed"):
        device.__enter__()


def test_a_device_that_is_not_made_in_time_is_killed():
    with pytest.raises(DeviceError, match=r"camera: open: no answer within 0\.3 s"):
        HostedDevice(
            Surroundings(RealClock()), "camera", "hosted_devices:slow", {}, open_timeout=0.3
        )


def test_a_device_that_is_not_entered_in_time_is_killed():
    device = opened("HungOnTheWayIn")
    process = device.process
    device._open_timeout = 0.3
    with pytest.raises(DeviceError, match=r"camera: enter: no answer within 0\.3 s"):
        device.__enter__()
    assert has_ended(process)


# Closing.


def test_closing_twice_closes_once(tmp_path):
    notes = tmp_path / "notes"
    with opened(notes=str(notes)) as device:
        pass
    device.__exit__(None, None, None)
    device.kill()
    assert notes.read_text().split() == ["entered", "left"]
    with pytest.raises(DeviceError, match="camera: twice: it is closed"):
        device.twice(1)


def test_what_leaving_raises_comes_through_and_the_process_ends():
    device = opened("UnwillingToClose").__enter__()
    process = device.process
    with pytest.raises(DeviceError, match="close: stuck"):
        device.__exit__(None, None, None)
    assert has_ended(process)
    device.__exit__(None, None, None)


def test_a_process_that_does_not_end_after_its_device_was_left_is_killed(monkeypatch):
    monkeypatch.setattr("drivers.hosted.child_process._EXIT_GRACE", 0.5)
    with opened("HungOnTheWayOut") as device:
        process = device.process
    assert has_ended(process)


def test_a_device_that_was_never_entered_ends_with_the_last_word_of_it():
    device = opened()
    process = device.process
    del device
    assert has_ended(process)


def test_nothing_is_left_behind():
    def held():
        return len(os.listdir("/proc/self/fd")), sorted(os.listdir("/dev/shm"))

    before = held()
    for killed in (False, True):
        with opened(shape=(300, 400)) as device:
            device.capture(never)
            if killed:
                device.kill()
    with pytest.raises(ValueError):
        opened(shape=(0, 4))
    assert held() == before


# Killing.


def test_a_hung_device_is_killed_and_named(tmp_path):
    notes = tmp_path / "notes"
    with opened("Hung", notes=str(notes)) as device:
        process = device.process
        caller = Caller(lambda: device.capture(never))
        wait_for(notes, "hung")
        device.kill()
        assert caller.ended()
        assert str(caller.error).startswith("camera: capture: its process ended (signal 9). ")
        assert has_ended(process)
        device.kill()
        with pytest.raises(DeviceError, match=r"camera: shape: its process ended \(signal 9\)"):
            _ = device.shape
    assert notes.read_text().split() == ["entered", "hung"]


def test_a_library_that_keeps_the_interpreters_lock_is_killed_as_well(tmp_path):
    notes = tmp_path / "notes"
    with opened("Hung", notes=str(notes)) as device:
        caller = Caller(device.capture_with_the_lock)
        wait_for(notes, "hung")
        device.kill()
        assert caller.ended()
        assert isinstance(caller.error, DeviceError)


def test_the_call_that_was_cancelled_may_kill():
    with opened("Hung") as device:
        with pytest.raises(DeviceError, match="signal 9"):
            device.capture(device.kill)
        with pytest.raises(DeviceError, match="signal 9"):
            device.make_safe()


def test_a_device_that_crashes_is_named_at_once(capfd):
    with opened("Brittle") as device:
        with pytest.raises(DeviceError, match=r"camera: capture: its process ended \(signal 11\)"):
            device.capture(never)
        with pytest.raises(DeviceError, match=r"camera: twice: its process ended \(signal 11\)"):
            device.twice(1)
    assert "Segmentation fault" in capfd.readouterr().err


def test_a_device_that_ends_its_process_is_named():
    with (
        opened("Brittle") as device,
        pytest.raises(DeviceError, match=r"its process ended \(exit status 3\)"),
    ):
        device.end(3)


def test_a_device_that_died_unseen_is_told_of_when_it_is_left():
    device = opened().__enter__()
    os.kill(device.process, signal.SIGKILL)
    with pytest.raises(DeviceError, match="camera: leave: its process ended"):
        device.__exit__(None, None, None)
    device.__exit__(None, None, None)


def test_death_is_seen_though_another_process_keeps_the_socket_open(tmp_path):
    notes = tmp_path / "notes"
    with opened("Brittle", notes=str(notes)) as device:
        process, left = device.process, device.leave_somebody()
        try:
            caller = Caller(lambda: device.keep_exposing(never))
            wait_for(notes, "exposing")
            os.kill(process, signal.SIGKILL)
            assert caller.ended()
            assert isinstance(caller.error, DeviceError)
        finally:
            os.kill(left, signal.SIGKILL)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_to_the_whole_group_do_not_end_a_device(number):
    with opened() as device:
        os.kill(device.process, number)
        assert device.twice(2) == 4


# The end of this process.


def parent(kind: str, call: str, notes: Path, grace: float) -> subprocess.Popen[bytes]:
    """A process that hosts a device, says so, and does something with it."""
    code = f"""
import sys; sys.path[:] = {sys.path!r}
from drivers.clock import RealClock
from drivers.hosted import HostedDevice, child_process
from drivers.interfaces import Surroundings
child_process._EXIT_GRACE = {grace}
device = HostedDevice(
    Surroundings(RealClock()), "camera", "hosted_devices:{kind}", {{"notes": {str(notes)!r}}}
)
device.__enter__()
{call}
"""
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def killed(process: subprocess.Popen[bytes]) -> None:
    """Kill it, and wait until everyone who writes to its terminal has ended, too."""
    process.kill()
    process.communicate(timeout=PATIENCE)


def test_a_device_makes_itself_safe_when_its_parent_is_killed(tmp_path):
    notes = tmp_path / "notes"
    process = parent("Modest", "sys.stdin.read()", notes, 60)
    wait_for(notes, "entered")
    killed(process)
    assert notes.read_text().split() == ["entered", "safe", "left"]


def test_a_capture_ends_and_the_device_makes_itself_safe_when_its_parent_is_killed(tmp_path):
    notes = tmp_path / "notes"
    process = parent("Modest", "device.keep_exposing(lambda: False)", notes, 60)
    wait_for(notes, "exposing")
    killed(process)
    assert notes.read_text().split() == ["entered", "exposing", "safe", "left"]


@pytest.mark.parametrize(
    "call", ["device.capture(lambda: False)", "device.capture_with_the_lock()"]
)
def test_a_hung_device_does_not_outlive_its_parent(call, tmp_path):
    notes = tmp_path / "notes"
    process = parent("Hung", call, notes, 0.5)
    wait_for(notes, "hung")
    killed(process)
    assert notes.read_text().split() == ["entered", "hung"]


def test_a_device_is_left_safe_when_its_parent_ends_without_leaving_it(tmp_path):
    notes = tmp_path / "notes"
    process = parent("Modest", "", notes, 60)
    _, said = process.communicate(timeout=PATIENCE)
    assert (process.returncode, said) == (0, b"")
    assert notes.read_text().split() == ["entered", "safe", "left"]


# Imports.


def test_importing_drivers_hosted_loads_nothing_heavy():
    heavy = [*HEAVY, "numpy"]
    code = f"import drivers.hosted, sys; print([m for m in {heavy!r} if m in sys.modules])"
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert answer.stdout.strip() == "[]"


def test_the_devices_process_loads_nothing_heavy():
    with opened() as device:
        assert device.loaded([*HEAVY, "pytest", "multiprocessing.resource_tracker"]) == []
