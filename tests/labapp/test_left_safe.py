"""Which devices of a bench a guard must make safe if the application is killed."""

from __future__ import annotations

import pytest

from labapp.bench.driver_loading import guarded_devices
from labapp.files.bench_file import DeviceTable


@pytest.mark.parametrize(
    ("driver", "more", "guarded"),
    [
        ("varispec", {"options": {"port": "/dev/ttyUSB0"}}, True),
        ("varispec", {}, True),
        ("zwo-wheel", {"options": {"backend": "simulated@/tmp/usb"}}, True),
        ("varispec", {"own_process": True}, False),
        ("varispec", {"options": {"port": "sim://varispec"}}, False),
        ("zwo-wheel", {"options": {"backend": "simulated-here@bus"}}, False),
        ("screen-slm", {}, False),
        ("aravis-camera", {}, False),
        ("uvc-camera", {}, False),
        ("simulated-filter", {}, False),
        ("manual-targets", {"options": {"names": ["star"]}}, False),
        ("nobodys-filter", {}, False),
    ],
)
def test_what_stays_as_it_is_when_the_application_is_killed_is_guarded(driver, more, guarded):
    """And not what has a process of its own, or is gone with the application."""
    found = guarded_devices({"it": DeviceTable(driver=driver, **more)})
    assert [(one.name, one.options) for one in found] == (
        [(f"it ({driver})", more.get("options", {}))] if guarded else []
    )
