import pickle
import subprocess
import sys
import threading
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from wall import Wall

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Frame, Identity, Setting, Surroundings

LOOK = """
import importlib, sys
for line in sys.stdin:
    module, *heavy = line.split()
    importlib.import_module(module)
    print(module, *(name for name in heavy if name in sys.modules), flush=True)
"""


def loaded_by(modules: dict[str, list[str]]) -> dict[str, list[str]]:
    """Which heavy ones a fresh interpreter has loaded after it imported each module in turn."""
    asked = "".join(f"{module} {' '.join(heavy)}\n" for module, heavy in modules.items())
    command = [sys.executable, "-c", LOOK]
    answer = subprocess.run(
        command, input=asked, capture_output=True, text=True, check=True, timeout=120
    )
    words = [line.split() for line in answer.stdout.splitlines()]
    return {module: loaded for module, *loaded in words}


def test_importing_drivers_loads_no_tensors_and_no_vendor():
    heavy = ["torch", "PySide6", "serial", "usb", "libusb_package", "h5py", "optics", "simulator"]
    names = ["interfaces", "ports", "clock", "errors", "hosted", "supervised", "manual"]
    modules = ["drivers", *(f"drivers.{name}" for name in names)]
    assert not any(loaded_by(dict.fromkeys(modules, heavy)).values())


def test_importing_optics_and_the_simulator_loads_no_window_port_or_file_format():
    heavy = ["PySide6", "pyqtgraph", "serial", "usb", "h5py", "pydantic", "typer", "labapp"]
    asked = {"optics.psf": [*heavy, "drivers", "simulator"], "simulator.devices": heavy}
    assert loaded_by(asked) == {"optics.psf": [], "simulator.devices": []}


def test_a_device_error_tells_device_command_reply_and_remedy():
    error = DeviceError("filter", "W 900", "W! out of range", "Choose 420 to 720 nm")
    assert str(error) == "filter: W 900: W! out of range. Choose 420 to 720 nm"
    assert (error.device, error.command) == ("filter", "W 900")
    assert (error.reply, error.remedy) == ("W! out of range", "Choose 420 to 720 nm")


def test_a_device_error_survives_the_way_from_another_process():
    error = pickle.loads(pickle.dumps(DeviceError("a", "b", "c", "d")))
    assert isinstance(error, DeviceError)
    assert str(error) == "a: b: c. d"


def test_the_real_clock_waits_until_its_time(monkeypatch):
    wall = Wall()
    monkeypatch.setattr("drivers.clock.time", wall)
    clock = RealClock()
    clock.wait_until(0.03, lambda: False)
    assert clock.now() >= 0.03
    assert wall.now == pytest.approx(1000.03, abs=1e-4)


def test_the_real_clock_does_not_wait_for_what_is_past():
    asked = []
    RealClock().wait_until(-1.0, lambda: asked.append(1) or False)
    assert not asked


def test_cancelling_ends_a_wait_early():
    """The wait would last an hour; the thread has ended although nobody waited that long."""
    clock, stop = RealClock(), threading.Event()
    waiting = threading.Thread(
        target=clock.wait_until, args=(clock.now() + 3600, stop.is_set), daemon=True
    )
    waiting.start()
    stop.set()
    waiting.join(timeout=60)
    assert not waiting.is_alive()


def test_what_devices_report_cannot_be_changed_afterwards():
    frame = Frame(np.zeros((2, 2), dtype=np.uint16), 0.1, 2.6, 0.0, 1)
    for record, name in (
        (frame, "exposure"),
        (Setting("a", "b", 0.0), "actual"),
        (Identity("m", "s", True), "simulated"),
    ):
        with pytest.raises(FrozenInstanceError):
            setattr(record, name, 1)


def test_without_a_world_a_bench_is_real():
    assert Surroundings(RealClock()).world is None
