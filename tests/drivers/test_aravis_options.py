"""Options of Aravis' cameras, and what is said where there is no Aravis."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from drivers.aravis import AravisCamera, library_process
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("address", 3),
        ("pixel_format", "RGB8"),
        ("gain_db", float("nan")),
        ("gain_db", "high"),
        ("roi", [0, 0, 10]),
        ("roi", [0, 0, 0, 10]),
        ("roi", [-1, 0, 10, 10]),
        ("roi", "abcd"),
        ("binning", [0, 1]),
        ("binning", [2]),
        ("trigger", "sometimes"),
        ("frame_rate", -1.0),
        ("packet_size", 100),
        ("packet_size", 70000),
        ("buffers", 1),
        ("latency_frames", -1),
        ("latency_frames", 1.5),
        ("frame_timeout_ms", 0.0),
        ("trigger_wait_s", float("inf")),
        ("electrons_per_number", 0.0),
        ("byte_order", "middle"),
        ("justification", "centre"),
        ("keep_features", "ReverseX"),
    ],
)
def test_a_bad_option_is_named(option: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"{option} is .*; it must be"):
        AravisCamera(Surroundings(RealClock()), **{option: value})


def test_without_aravis_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    # This Python without its packages has no gi.
    monkeypatch.setattr(library_process, "SYSTEM_PYTHON", "/nonexistent/python3")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DeviceError, match=r"apt-get install .*gir1.2-aravis-0.8 python3-gi"):
        AravisCamera(Surroundings(RealClock())).__enter__()


def test_a_python_without_gi_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    bare = [sys.executable, "-I", "-S"]
    done = subprocess.run([*bare, "-c", "import gi"], capture_output=True, check=False)
    if done.returncode == 0:
        pytest.skip("this Python has gi in its standard library")
    monkeypatch.setattr(library_process, "python_with_gi", lambda: bare)
    with pytest.raises(DeviceError, match=r"Aravis isn't there: .*apt-get install"):
        AravisCamera(Surroundings(RealClock())).__enter__()


def test_before_it_is_open_it_says_so() -> None:
    with pytest.raises(DeviceError, match="it is not open"):
        AravisCamera(Surroundings(RealClock())).shape  # noqa: B018


def test_importing_it_loads_no_vendor_package() -> None:
    code = "import sys, drivers.aravis; print({'gi', 'torch', 'PySide6'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_frames_are_counted_on_where_the_cameras_count_begins_anew() -> None:
    """GigE Vision counts to 65535; a camera that was switched off counts from 1."""
    device = AravisCamera(Surroundings(RealClock()))
    numbers = [65534, 65535, 1, 2, 5, 1]
    counted = [device._unwrap_number(number) for number in numbers]
    assert counted == [65534, 65535, 65536, 65537, 65540, 65541]
