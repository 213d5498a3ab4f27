"""The machine's speed: fitted to what was measured, kept, and measured anew when it must be."""

from __future__ import annotations

import json
from dataclasses import asdict, fields, replace

import pytest

import labapp.common.speed
from labapp.common.speed import (
    BenchmarkJob,
    benchmark_jobs,
    fit_speed,
    machine_speed,
    speed_file_path,
)
from optics.accuracy import MachineSpeed

KNOWN = MachineSpeed(call=2e-4, multiply_add=5e-11, fft=1e-10, double=2.5)


@pytest.fixture
def cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    one = BenchmarkJob("job", lambda speed: speed.call, lambda: None)
    monkeypatch.setattr(labapp.common.speed, "benchmark_jobs", lambda: [one])
    return tmp_path


def test_prices_are_fitted_to_the_times():
    """Jobs of known prices: the fit predicts jobs that it hasn't seen."""

    def job(products: float, transforms: float, double: bool) -> BenchmarkJob:
        def price(speed: MachineSpeed) -> float:
            seconds = products * speed.multiply_add + transforms * speed.fft
            return speed.call + seconds * (speed.double if double else 1.0)

        return BenchmarkJob("job", price, lambda: None)

    sizes = [(1e8, 0), (5e8, 1e6), (0, 1e8), (1e6, 4e8), (2e8, 2e8)]
    known = [job(*size, double) for size in sizes for double in (False, True)]
    speed = fit_speed([(one, one.cost(KNOWN)) for one in known])
    unseen = job(3e8, 7e7, True)
    assert unseen.cost(speed) == pytest.approx(unseen.cost(KNOWN), rel=0.02)


def test_a_speed_is_measured_once_and_kept(cache, monkeypatch):
    asked = []

    def measured(chosen, progress):
        asked.append(len(chosen))
        return [(job, 1e-3) for job in chosen]

    monkeypatch.setattr(labapp.common.speed, "time_jobs", measured)
    first, second = machine_speed(), machine_speed()
    assert first == second
    assert len(asked) == 1
    assert speed_file_path().is_relative_to(cache)


def test_a_speed_measured_on_a_busy_machine_is_measured_anew_on_a_quieter_one(cache, monkeypatch):
    load, asked = [4.0], []

    def measured(chosen, progress):
        asked.append(load[0])
        return [(job, 1e-3) for job in chosen]

    monkeypatch.setattr(labapp.common.speed, "time_jobs", measured)
    monkeypatch.setattr("os.getloadavg", lambda: (load[0], 0.0, 0.0))
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    for now in (4.0, 8.0, 2.5, 1.5, 4.0, 1.0, 0.0):
        load[0] = now
        machine_speed()
    # 2.5 is more than half of 4.0; 1.5 is less, and still busy for two processors; 1.0 is more than
    # half of that.
    assert asked == [4.0, 1.5, 0.0]


@pytest.mark.parametrize("spoil", ["text", "numpy", "speed"])
def test_a_kept_speed_that_does_not_fit_is_measured_anew(cache, monkeypatch, spoil):
    monkeypatch.setattr(
        labapp.common.speed, "time_jobs", lambda chosen, _: [(j, 1e-3) for j in chosen]
    )
    machine_speed()
    found = json.loads(speed_file_path().read_text())
    if spoil == "text":
        speed_file_path().write_text("not a speed")
    elif spoil == "numpy":
        found["circumstances"]["numpy"] = "0.1"
        speed_file_path().write_text(json.dumps(found))
    else:
        del found["seconds"]["call"]
        speed_file_path().write_text(json.dumps(found))
    assert machine_speed() == MachineSpeed(**json.loads(speed_file_path().read_text())["seconds"])


def test_a_folder_that_cannot_be_written_is_no_trouble(cache, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(
        labapp.common.speed, "time_jobs", lambda chosen, _: [(j, 1e-3) for j in chosen]
    )
    assert isinstance(machine_speed(), MachineSpeed)


def test_every_speed_has_a_job_that_tells_it():
    """A price that no job pays could be anything after the fit."""
    nothing = replace(
        MachineSpeed(), **(dict.fromkeys(asdict(MachineSpeed()), 0.0) | {"double": 1.0})
    )
    chosen = benchmark_jobs()
    for field in fields(MachineSpeed):
        if field.name != "double":
            one = replace(nothing, **{field.name: 1.0})
            assert any(job.cost(one) > 0 for job in chosen), field.name
