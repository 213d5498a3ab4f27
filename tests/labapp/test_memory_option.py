"""`--memory`: how much simulated pictures may keep for later ones."""

from __future__ import annotations

from dataclasses import replace

import pytest

from labapp.bench.opening import open_bench
from simulator.imaging import default_memory


def test_the_default_grows_with_the_sensor(small):
    with open_bench(small.bench_files) as bench:
        camera = bench.world.camera
        assert bench.world.imaging.memory == default_memory(camera)
    large = replace(camera, sensor=replace(camera.sensor, shape=(2048, 2448)))
    assert 0.5e9 < default_memory(camera) < default_memory(large) < 2e9


def test_pictures_keep_no_more_than_was_asked_for(small):
    with open_bench(replace(small.bench_files, memory=200_000)) as bench:
        imaging = bench.world.imaging
        assert imaging.memory == 200_000
        bench.targets.place("star")
        for number in range(4):
            bench.world.wavelength = (540 + 5 * number) * 1e-9
            bench.world.electron_rates()
            assert imaging.kept_bytes <= 200_000
        bench.world.forget()
        assert imaging.kept_bytes == 0


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("0", "give a positive number of GB"),
        ("-1", "give a positive number of GB"),
        ("nan", "isn't a number"),
        ("inf", "isn't a number"),
    ],
)
def test_no_memory_is_refused_in_words(small, labapp, tmp_path, value, words):
    asked = ["run", small.plan, "--bench", small.bench, "--scene", small.scene]
    code, _, complaint = labapp(*asked, "--out", tmp_path / "run.h5", "--memory", value)
    assert code == 1
    assert "--memory" in complaint
    assert words in complaint
    assert not (tmp_path / "run.h5").exists()
