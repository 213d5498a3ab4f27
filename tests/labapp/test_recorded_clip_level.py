"""A record keeps the number at which pixels were seen to clip, and all that reads it uses it."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from plans import block, plan_of

import labapp.bench.driver_loading
from drivers.interfaces import Frame, Identity, Setting
from labapp.bench.driver_loading import DRIVER_GROUP
from labapp.bench.opening import BenchFiles, open_bench
from labapp.pictures.merging.bracket_record import RecordedFrames, read_recorded_bracket
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import bench_setup_of
from labapp.runs.state import State
from optics.progress import Progress

CLIPS = 3000
CAMERA = EntryPoint("early-camera", "test_recorded_clip_level:EarlyCamera", DRIVER_GROUP)


class EarlyCamera:
    """Sends numbers of 12 bits, of which its pixels reach 3000: a full well, as real ones have."""

    full_scale, exposure_range, frame_time, settling = 4095, (1e-5, 1.0), 0.001, 0.0
    reply_time = 0.01
    identity = Identity("early camera", "7", simulated=False)

    def __init__(self, surroundings):
        self.shape, self._clock = (64, 96), surroundings.clock
        self._exposure, self._number = 0.01, 0
        self._rng = np.random.default_rng(4)
        # Electrons per second: a lamp of 60 pixels over a ramp.
        self._light = np.tile(np.linspace(2e3, 2e5, 96), (64, 1))
        self._light[30:36, 40:50] = 4e6

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def make_safe(self):
        pass

    def set_exposure(self, exposure):
        self._exposure = exposure
        return Setting(exposure, exposure, self._clock.now())

    def capture(self, cancelled):
        began = self._clock.now()
        self._number += 1
        electrons = self._rng.poisson(self._light * self._exposure) + self._rng.normal(
            0, 3, (64, 96)
        )
        image = np.clip(np.rint(64 + electrons / 2.6), 0, CLIPS).astype(np.uint16)
        return Frame(image, self._exposure, 2.6, began, self._number)


@pytest.fixture
def files(small, monkeypatch):
    known = labapp.bench.driver_loading.installed_drivers()
    monkeypatch.setattr(
        labapp.bench.driver_loading, "installed_drivers", lambda: known | {CAMERA.name: CAMERA}
    )
    text = small.bench.read_text().replace('"simulated-camera"', f'"{CAMERA.name}"')
    small.bench.write_text(text)
    return small.bench_files


PLAN = plan_of(
    block(
        targets=["photograph"], exposures_ms=None, repeats=2, bracket={"snr_db": 30, "decades": 2}
    )
)


def test_frames_are_judged_and_kept_with_the_clip_level_that_was_metered(labapp, files, tmp_path):
    path, progress = tmp_path / "run.h5", Progress()
    with open_bench(files) as bench:
        told = bench.file
        assert told.sensor.clip_level_dn is None
        outcome = run_plan(
            bench, PLAN, path, Attendance(progress=progress, on_frame=lambda *_: progress.cancel())
        )
    assert outcome.state is State.CANCELLED
    with Record(path) as record:
        assert record.bench_as_opened == told
        assert record.bench.sensor.clip_level_dn == CLIPS
        own = bench_setup_of(record)
    # Resuming is on the bench as it was, by its file or the record's own.
    with open_bench(own) as bench:
        assert resume_run(bench, path).state is State.COMPLETE
    assert f"pixels clip at {CLIPS} DN: seen in metering photograph" in shown(labapp, path)
    frames = read_recorded_bracket(path, RecordedFrames(wavelength=532e-9))
    assert frames.sensor.full_scale == CLIPS
    assert f"clip at {CLIPS} DN" in frames.sensor_source


def test_a_bench_file_that_tells_the_clip_level_is_believed(labapp, files, tmp_path):
    bench_file = Path(files.bench)
    bench_file.write_text(
        bench_file.read_text().replace("bits = 12", "bits = 12\nclip_level_dn = 3000", 1)
    )
    with open_bench(BenchFiles(bench_file, files.scene)) as bench:
        assert run_plan(bench, PLAN, tmp_path / "told.h5").state is State.COMPLETE
    assert "clip at 3000 DN: by the bench file" in shown(labapp, tmp_path / "told.h5")


def shown(labapp, path):
    code, printed, said = labapp("show", path)
    assert (code, said) == (0, "")
    return " ".join(printed.split())
