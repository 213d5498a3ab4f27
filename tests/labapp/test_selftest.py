"""`labapp devices test` and `labapp bench check`: what is well, and what isn't."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Frame, Setting
from drivers.ports import Port
from labapp.bench import device_listing
from labapp.bench import driver_loading as bench_module
from labapp.bench.selftest.checks import run_checks
from labapp.bench.selftest.role_checks import device_checks
from labapp.cli import app
from labapp.common.errors import UserError
from labapp.files.reading import bundled_path
from optics.progress import Cancelled, Progress

ROLES = ["slm", "filter", "camera", "targets", "spectroradiometer"]


def labapp(*words):
    done = CliRunner().invoke(app, [str(word) for word in words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


@pytest.mark.parametrize("role", ROLES)
def test_the_virtual_benchs_devices_do_what_they_say(role, tmp_path):
    report = tmp_path / "report.json"
    done = labapp("devices", "test", role, "--out", report)
    assert done.exit_code == 0
    assert "passed" in done.output
    kept = json.loads(report.read_text())
    assert (kept["device"], kept["well"]) == (role, True)
    assert "SIMULATED" in kept["checks"][0]["detail"]
    assert len(kept["checks"]) > 5


def test_a_report_that_is_there_already_is_kept(tmp_path):
    report = tmp_path / "report.json"
    report.write_text("mine")
    with pytest.raises(UserError, match=r"report\.json"):
        labapp("devices", "test", "slm", "--out", report)
    assert report.read_text() == "mine"


def test_a_device_that_the_bench_does_not_have():
    with pytest.raises(UserError, match="Choose one of slm, filter, camera, targets"):
        labapp("devices", "test", "laser")


class LyingCamera:
    """Exposes twice as long as it says, and repeats itself."""

    identity = None
    shape, full_scale, exposure_range, reply_time = (4, 6), 4095, (1e-3, 1e-2), 0.5

    def __init__(self, **lies):
        self._lies = lies
        self._exposure, self._number = 0.0, 0

    def set_exposure(self, exposure):
        if exposure > self.exposure_range[1]:
            raise DeviceError("camera", "expose", "too long", "Choose less")
        self._exposure = exposure
        return Setting(exposure, exposure, 0.0)

    def capture(self, cancelled):
        self._number += 1
        frame = Frame(np.zeros(self.shape, np.uint16), self._exposure, 1.0, 0.0, self._number, None)
        return replace(frame, **self._lies)

    def make_safe(self):
        pass


@pytest.mark.parametrize(
    ("lies", "said"),
    [
        ({"exposure": 0.5}, "exposed 500 ms instead of"),
        ({"number": 7}, "frame 7 came after frame 7"),
        ({"image": np.zeros((6, 4), np.uint16)}, "a frame is"),
    ],
)
def test_a_camera_that_lies_is_found_out(lies, said):
    checks = device_checks("camera", LyingCamera(**lies), RealClock())
    found = run_checks(checks[2:], Progress())
    wrong = [one for one in found if not one.passed]
    assert wrong
    assert all(said in one.detail for one in wrong)
    honest = run_checks(device_checks("camera", LyingCamera(), RealClock())[2:], Progress())
    assert all(one.passed for one in honest)


def test_a_filter_that_goes_elsewhere_or_anywhere_is_found_out():
    class LyingFilter:
        wavelength_range, bandwidth, settling, wavelength = (4e-7, 7e-7), 1e-8, 0.0, 5e-7

        def set_wavelength(self, wavelength):
            return Setting(wavelength, wavelength, 0.0)

        def make_safe(self):
            pass

    found = run_checks(device_checks("filter", LyingFilter(), RealClock())[2:-1], Progress())
    assert [one.passed for one in found] == [True, False, False, False, False, False, False]
    assert "550.00 nm were asked for, and 500.00 are set" in found[3].detail
    assert "taken without a word" in found[-1].detail


class BrokenCamera(LyingCamera):
    def set_exposure(self, exposure):
        raise KeyError("exposure")

    @property
    def exposure_range(self):
        raise DeviceError("camera", "exposure range", "no reply", "Check the cable")


def test_a_driver_that_breaks_is_reported_and_the_rest_is_looked_at():
    found = run_checks(device_checks("camera", BrokenCamera(), RealClock()), Progress())
    said = {one.check: (one.passed, one.detail) for one in found}
    assert said["identity"] == (
        False,
        "its driver broke: AttributeError: 'NoneType' object has no attribute 'simulated'",
    )
    assert said["what it can do"] == (
        False, "camera: exposure range: no reply. Check the cable"
    )  # fmt: skip
    assert said["safe"][0]

    camera = BrokenCamera()
    type(camera).exposure_range = (1e-3, 1e-2)
    found = run_checks(device_checks("camera", camera, RealClock()), Progress())
    broken = [one for one in found if "its driver broke: KeyError: 'exposure'" in one.detail]
    assert len(broken) == 5


def test_a_device_that_does_not_open_has_a_report_for_support(tmp_path):
    old = '"simulated-filter"\noptions = { range_nm = [420.0, 720.0], bandwidth_nm = 7.0, '
    old += "settling_ms = 50.0 }"
    new = '"varispec"\noptions = { port = "/dev/no-such-port" }'
    bench, report = broken_bench(tmp_path, old, new), tmp_path / "report.json"
    done = labapp("devices", "test", "filter", "--bench", bench, "--out", report)
    assert done.exit_code == 1
    assert "1 of 1 checks FAILED" in done.output
    (kept,) = json.loads(report.read_text())["checks"]
    assert (kept["check"], kept["passed"]) == ("open", False)
    assert "port /dev/no-such-port: there is no such port" in kept["detail"]


class Exploding:
    """Somebody else's driver that raises what no driver may."""

    def __init__(self, surroundings):
        pass

    def __enter__(self):
        raise KeyError("no such register")


def test_ports_are_listed_where_a_device_of_the_bench_is_not_there(tmp_path, monkeypatch):
    there = [Port("serial", "/dev/ttyUSB3", "a [red]plug")]
    monkeypatch.setattr(device_listing, "_ports", lambda: (there, ["screens can't be listed: why"]))
    old = '"simulated-filter"\noptions = { range_nm = [420.0, 720.0], bandwidth_nm = 7.0, '
    old += "settling_ms = 50.0 }"
    new = '"varispec"\noptions = { port = "/dev/no-such-port" }'
    bench = broken_bench(tmp_path, old, new)
    said = " ".join(labapp("devices", "--bench", bench).output.split())
    assert "/dev/ttyUSB3 a [red]plug" in said
    assert "screens can't be listed: why" in said
    told = json.loads(labapp("devices", "--bench", bench, "--json").output)
    assert "there is no such port" in told["devices"][1]["limits"]
    assert told["ports"][0]["address"] == "/dev/ttyUSB3"
    assert told["unlisted"] == ["screens can't be listed: why"]


def test_a_driver_that_breaks_hides_no_other_device(tmp_path, monkeypatch):
    entry = EntryPoint("exploding", f"{__name__}:Exploding", "labapp.devices")
    installed = bench_module.installed_drivers()
    monkeypatch.setattr(
        bench_module, "installed_drivers", lambda: {**installed, "exploding": entry}
    )
    path = broken_bench(tmp_path, "simulated-targets", "exploding")
    done = labapp("bench", "check", path, "--json")
    rows = {row["check"]: row for row in json.loads(done.output)["checks"]}
    assert [name for name, row in rows.items() if not row["well"]] == ["targets"]
    seen = "targets: open: KeyError: 'no such register'. Look at the device and its cable"
    assert rows["targets"]["seen"] == seen
    done = labapp("devices", "test", "targets", "--bench", path, "--json")
    assert done.exit_code == 1
    assert "no such register" in json.loads(done.output)["checks"][0]["detail"]


def test_a_self_test_can_be_cancelled():
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        run_checks([("first", lambda: "never seen")], progress)


def broken_bench(tmp_path, old, new):
    path = tmp_path / "bench.toml"
    path.write_text(bundled_path("bench.toml").read_text().replace(old, new))
    return path


def test_a_good_bench_file_is_told_well():
    done = labapp("bench", "check", bundled_path("bench.toml"))
    assert (done.exit_code, done.output.count("ok")) == (0, 6)
    assert "SIMULATED" in done.output
    without = labapp("bench", "check", "--no-open", bundled_path("bench.toml"))
    assert "weren't opened" in without.output


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('driver = "simulated-slm"', 'driver = "nothing"', "'nothing', which is unknown. Choose"),
        ('driver = "simulated-slm"', 'driver = "simulated_slm"', "Did you mean 'simulated-slm'?"),
        ("settling_ms = 50.0 }", "settling = 1 }",
         "has 'settling', which is unknown. Did you mean 'settling_ms'? simulated-filter takes"),
        ("settling_ms = 50.0 }", "x = 1 }", "has 'x', which is unknown. simulated-filter takes"),
        ('"simulated-filter"\noptions = { range_nm = [420.0, 720.0], bandwidth_nm = 7.0, '
         'settling_ms = 50.0 }', '"thorlabs-wheel"',
         "is wrong: missing a required argument: 'port'. thorlabs-wheel takes port, slots_nm"),
        ('"simulated-camera"\noptions = { readout_ms = 8.0 }', '"thorlabs-wheel"',
         "is a driver for the role filter, not for camera. Name another driver"),
        ('"simulated-camera"\noptions = { readout_ms = 8.0 }',
         '"aravis-camera"\noptions = { pixel_format = "Mono99" }', "Mono99"),
        ('"simulated-filter"\noptions = { range_nm = [420.0, 720.0], bandwidth_nm = 7.0, '
         'settling_ms = 50.0 }', '"varispec"\noptions = { port = "/dev/no-such-port" }',
         "/dev/no-such-port"),
    ],
)  # fmt: skip
def test_one_device_that_is_wrong_hides_no_other(tmp_path, old, new, said):
    path = broken_bench(tmp_path, old, new)
    done = labapp("bench", "check", path, "--json")
    rows = json.loads(done.output)["checks"]
    assert done.exit_code == 1
    assert [row["well"] for row in rows].count(False) == 1
    wrong = next(row for row in rows if not row["well"])
    assert said in wrong["seen"]


def test_what_is_behind_a_wire_may_be_said_to_be_simulated(tmp_path):
    path = broken_bench(
        tmp_path,
        '[devices.targets]\ndriver = "simulated-targets"',
        '[devices.targets]\ndriver = "manual-targets"\noptions = { names = ["star"] }\n'
        "simulated = true",
    )
    done = labapp("devices", "test", "targets", "--bench", path, "--json")
    checks = json.loads(done.output)["checks"]
    assert "SIMULATED" in checks[0]["detail"]
