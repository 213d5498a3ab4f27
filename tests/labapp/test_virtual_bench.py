"""The virtual bench served behind its wires, and the real drivers before it."""

from __future__ import annotations

import re
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import forked
import numpy as np
import pytest

from drivers.errors import DeviceError
from drivers.x11 import XConnection, XError
from labapp.bench.opening import BenchFiles, open_bench, open_device
from labapp.files.bench_file import read_bench
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record

pytestmark = pytest.mark.xvfb

PATIENCE = 60.0

SCENE = """
version = 1
title = "Small scene"
[targets.dark]
kind = "dark"
[targets.star]
kind = "star"
diameter_um = 70.0
distance_m = 2.0
radiance = 5.0
[targets.flat]
kind = "flat"
distance_m = 2.0
radiance = 0.5
"""

PLAN = {
    "version": 1,
    "title": "Behind wires",
    "patterns": {"neutral": {"kind": "constant"}, "lens": {"kind": "lens", "focal_length_m": 50}},
    "acquire": [
        {
            "targets": ["dark", "star"],
            "patterns": ["neutral", "lens"],
            "wavelengths_nm": [540, 560],
            "exposures_ms": [2],
        }
    ],
}


class Served:
    """A process of `labapp virtual-bench serve`, what it has said, and a line to it."""

    def __init__(self, process: forked.Popen, bench: Path) -> None:
        self.process, self.bench = process, bench
        self.said: list[str] = []
        self._more = threading.Condition()
        self._hearing = threading.Thread(target=self._hear, daemon=True)
        self._hearing.start()

    def close(self) -> None:
        self._hearing.join()
        self.process.stdin.close()
        self.process.stderr.close()

    def _hear(self) -> None:
        for line in self.process.stderr:
            with self._more:
                self.said.append(line.rstrip("\n"))
                self._more.notify_all()

    def wait_for(self, words: str, since: int = 0) -> str:
        """The line with these words."""
        late = time.monotonic() + PATIENCE
        with self._more:
            while True:
                if found := [line for line in self.said[since:] if re.search(words, line)]:
                    return found[0]
                assert time.monotonic() < late, f"never {words!r}: {self.said}"
                # Whatever it said before it ended has been heard by then.
                assert self.process.poll() is None or self._hearing.is_alive(), self.said
                self._more.wait(0.2)

    def tell(self, line: str, answer: str) -> str:
        """Type a line, and wait for its answer."""
        since = len(self.said)
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()
        return self.wait_for(answer, since)


@contextmanager
def serving(small, *options: str) -> Iterator[Served]:
    small.scene.write_text(SCENE)
    out = small.folder / "served.toml"
    command = [sys.executable, "-m", "labapp", "virtual-bench", "serve", *small.arguments()]
    process = forked.Popen(
        [*command, "--out", str(out), *options],
        stdin=forked.PIPE,
        stdout=forked.DEVNULL,
        stderr=forked.PIPE,
        text=True,
    )
    served = Served(process, out)
    try:
        served.wait_for("Type `target NAME`")
        yield served
    finally:
        process.terminate()
        try:
            process.wait(PATIENCE)
        finally:
            process.kill()
            served.close()


def opened(served: Served, small):
    return open_bench(BenchFiles(served.bench, small.scene))


def ready(bench, setting) -> None:
    bench.clock.wait_until(setting.ready_at, never)


def never() -> bool:
    return False


def picture(bench, exposure: float):
    ready(bench, bench.camera.set_exposure(exposure))
    return bench.camera.capture(never).image.astype(float)


@pytest.mark.aravis
def test_the_real_drivers_take_a_run_on_it(small, tmp_path):
    with serving(small) as served, opened(served, small) as bench:
        assert bench.world is None
        served.tell("target flat", "target flat")
        levels = {}
        for nm in (450, 700):
            ready(bench, bench.filter.set_wavelength(nm * 1e-9))
            levels[nm] = picture(bench, 1e-3).mean()
        with open_bench(small.bench_files) as simulated:
            simulated.world.target = "flat"
            for nm, level in levels.items():
                simulated.filter.set_wavelength(nm * 1e-9)
                assert level == pytest.approx(picture(simulated, 1e-3).mean(), rel=0.01)
        # The same power by wavelength is more photons at longer ones. 64 is black.
        assert (levels[700] - 64) / (levels[450] - 64) == pytest.approx(700 / 450, rel=0.05)

        served.tell("target star", "target star")
        ready(bench, bench.filter.set_wavelength(550e-9))
        sharp = picture(bench, 2e-3)
        columns = np.indices(bench.slm.shape)[1]
        stripes = np.where(columns % 4 < 2, 0, 128).astype(np.uint8)
        ready(bench, bench.slm.show("stripes", stripes))
        assert picture(bench, 2e-3).max() < 0.7 * sharp.max()
        bench.slm.make_safe()
        assert picture(bench, 2e-3).max() == pytest.approx(sharp.max(), rel=0.1)

        def ask(prompt, *_):
            name = re.search(r"Place (\S+),", prompt)[1]
            served.tell(f"target {name}", f"target {name}")

        path = tmp_path / "run.h5"
        outcome = run_plan(bench, PlanFile.model_validate(PLAN), path, Attendance(ask=ask))
        assert outcome.state == "COMPLETE"
        with Record(path) as record:
            brightest = [int(record.image(i).max()) for i in range(record.frame_count)]
        dark, neutral, lens = brightest[:4], brightest[4:6], brightest[6:]
        # The pattern's lens blurs the star.
        assert max(dark) < min(lens)
        assert max(lens) < 0.5 * min(neutral)


def test_filter_and_screen_set_the_world_and_nothing_is_left(small, tmp_path):
    folder = tmp_path / "ports"
    with serving(small, "--camera", "none", "--folder", str(folder)) as served:
        file = read_bench(served.bench)
        assert file.devices.filter.simulated
        assert file.devices.slm.simulated
        assert file.devices.camera.driver == "simulated-camera"
        with opened(served, small) as bench:
            ready(bench, bench.filter.set_wavelength(612.34e-9))
            columns = np.indices(bench.slm.shape)[1]
            ready(bench, bench.slm.show("ramp", columns.astype(np.uint8)))
            assert bench.slm.shape == (108, 192)
            told = served.tell("state", "^filter ")
            assert "612.34 nm, 7 nm wide; SLM grey 0 to 191, mean 95.50; target dark" in told

            served.tell("fault filter silence", "filter: silence")
            with pytest.raises(DeviceError):
                bench.filter.set_wavelength(500e-9)
            served.tell("mend filter", "filter is mended")
            ready(bench, bench.filter.set_wavelength(500e-9))
            served.tell("unplug filter", "filter is unplugged")
            with pytest.raises(DeviceError):
                bench.filter.set_wavelength(510e-9)
            served.tell("plug filter", "filter is plugged in")
            ready(bench, bench.filter.set_wavelength(600e-9))
            assert "600.00 nm" in served.tell("state", "^filter ")

        served.tell("target flat", "target flat")
        # The bench parked its filter when it was left.
        low = float(re.search(r"filter (\S+) nm", served.tell("state", "^filter "))[1])
        assert file.devices.spectroradiometer.options["port"] == str(folder / "cs2000")
        files = BenchFiles(served.bench, small.scene)
        with open_device(files, "spectroradiometer") as alone:
            spectrum = alone.device.measure(never)
            assert alone.device.identity.simulated
        peak = spectrum.wavelengths[np.argmax(spectrum.radiance)]
        assert peak == pytest.approx(low * 1e-9, abs=1e-9)

        served.tell("target nowhere", "no target 'nowhere'; choose dark, star, flat")
        served.tell("fault filter bogus", "kind is 'bogus'; choose one of silence")
        served.tell("fault filter silence -1", "must be more than 0")
        served.tell("fault slm silence", "no instrument 'slm' that can fail; choose filter, sp")
        served.tell("dance", "'dance' isn't understood; type help")
        served.tell("help", "faults of spectroradiometer: silence")
        display = file.devices.slm.options["display"]
        served.tell("quit", "ending")
        assert served.process.wait(PATIENCE) == 0
    assert not list(folder.iterdir())
    with pytest.raises(XError):
        XConnection(display)


@pytest.mark.parametrize(
    ("kind", "end", "slots", "code"),
    [("thorlabs", "eof", 6, 0), ("starlight", "SIGTERM", 2, 0), ("zwo", "SIGINT", 2, 130)],
)
def test_wheels_turn_the_light(small, kind, end, slots, code):
    nm = [[480 + 20 * slot, 10] for slot in range(slots)]
    wheel = f'driver = "simulated-wheel"\noptions = {{ slots_nm = {nm} }}'
    text = small.bench.read_text()
    small.bench.write_text(text.replace('driver = "simulated-filter"', wheel))
    others = ["--camera", "none", "--slm", "none", "--spectroradiometer", "none", "--until-eof"]
    with serving(small, "--filter", kind, *others) as served:
        with opened(served, small) as bench:
            ready(bench, bench.wheel.set_slot(2))
            assert "500.00 nm, 10 nm wide" in served.tell("state", "^filter ")
        if end == "eof":
            served.process.stdin.close()
        else:
            served.process.send_signal(getattr(signal, end))
        assert served.process.wait(PATIENCE) == code
        port = read_bench(served.bench).devices.filter.options
        place = port.get("port") or port["backend"].partition("@")[2]
        assert not Path(place).parent.exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--filter", "lens"], "--filter is 'lens'. Choose one of varispec, thorlabs"),
        (["--camera", "usb"], "--camera is 'usb'. Choose one of gige, none"),
        (["--slm", "x"], "--slm is 'x'"),
        (["--spectroradiometer", "x"], "--spectroradiometer is 'x'"),
        (["--screen", "HDMI-1"], "--screen is given without --display"),
        (["--display", "nowhere"], "Write it as in DISPLAY, such as :0"),
        (["--display", ":987"], "987"),
        (["--out", "/nowhere/bench.toml"], "/nowhere"),
        (["--camera", "none", "--slm", "none", "--folder", "FILE"], "cannot be made"),
    ],
)
def test_bad_options_are_told(small, labapp, options, words):
    given = [str(small.bench) if word == "FILE" else word for word in options]
    code, _, told = labapp("virtual-bench", "serve", *small.arguments(), *given)
    assert code == 1
    assert words in told


def test_a_wheel_that_cannot_be_is_told(small, labapp):
    text = small.bench.read_text()
    wheel = 'driver = "simulated-wheel"\noptions = { slots_nm = [[500, 10]] }'
    small.bench.write_text(text.replace('driver = "simulated-filter"', wheel))
    given = [*small.arguments(), "--filter", "thorlabs", "--slm", "none"]
    code, _, told = labapp("virtual-bench", "serve", *given)
    assert code == 1
    assert "can't be a thorlabs: slots is 1; a wheel has 6 or 12" in told


def test_the_bench_file_keeps_what_it_cannot_say_in_json(small, tmp_path):
    from labapp.bench.virtual_bench.serving import bench_text

    text = small.bench.read_text().replace("focus_distance_m = 2.0", "focus_distance_m = inf")
    small.bench.write_text(text.replace('"Small bench"', "'Bänk \"7\" \U0001f52d'"))
    file = read_bench(small.bench)
    again = tmp_path / "again.toml"
    again.write_text(bench_text(file, {}, ["star"]))
    read = read_bench(again)
    assert read.panel == file.panel
    assert read.lens == file.lens
    assert read.sensor == file.sensor
    assert read.name == f"{file.name}, behind its wires"
