"""The window opens on the virtual bench without any configuration."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from figures.where import PACKAGES
from PySide6.QtCore import QSize
from PySide6.QtGui import QColor

from labapp.common.errors import UserError
from labapp.window import theme
from labapp.window.app import main

_HEAVY = ("torch", "scipy", "pydantic", "h5py", "matplotlib", "labapp.bench.opening", "optics.psf")

_PROBE = Path(__file__).parents[1] / "figures" / "window_startup.py"

_CHILD = f"""
import runpy, sys
sys.argv = ["", "0"]
runpy.run_path({str(_PROBE)!r}, run_name="__main__")
print([name for name in {_HEAVY} if name in sys.modules])
"""


def test_badge_says_simulated_and_is_painted(bench, person):
    badge = bench.window.bar.badge
    assert badge.text() == "SIMULATED: slm, filter, camera, targets"
    colour = QColor(theme.SIMULATED)
    wanted = (colour.red(), colour.green(), colour.blue())
    person.waits(lambda: (person.looks_at(badge) == wanted).all(axis=2).mean() > 0.4)


def test_every_device_is_listed_as_simulated(bench):
    for name in ("slm", "filter", "camera", "targets"):
        assert "simulated" in bench.window.devices.text(name)
    assert "live" in bench.window.devices.text("camera")


def test_everything_fits_a_small_screen(bench):
    needed = bench.window.minimumSizeHint()
    assert needed.boundedTo(QSize(1280, 690)) == needed


def test_a_picture_is_on_the_screen(bench, person):
    view = bench.window.live_view.picture
    person.waits(lambda: len(np.unique(person.looks_at(view)[..., 0])) > 50)


def test_the_window_process_loads_nothing_heavy(display, tmp_path):
    """The only window here on the bundled bench, which is a large one."""
    child = subprocess.run(
        [sys.executable, "-c", _CHILD],
        env=os.environ
        | {"HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path), "PYTHONPATH": PACKAGES},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=110,
    )
    figures, loaded = child.stdout.strip().splitlines()
    assert set(json.loads(figures)) >= {"seconds_to_window", "seconds_to_picture", "rss_mb"}
    assert loaded == "[]"


def test_without_a_display_it_says_so(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(UserError, match="There is no display to open the window on"):
        main()


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="None is immortal and can't be lost")
def test_void_qt_calls_lose_no_reference_to_none(qapp):
    """PySide6 6.12.0 lost one a call on Python 3.11, and then aborted."""
    before = sys.getrefcount(None)
    for _ in range(10_000):
        qapp.processEvents()
        qapp.setProperty("count", 1)
    assert abs(sys.getrefcount(None) - before) < 1000
