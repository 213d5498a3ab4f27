"""Crafted files end in an error that names them: nothing hangs, fills the memory or opens others.

A twelfth of the commands is tried with every change of labapp, all of them in two sweeps.
"""

from __future__ import annotations

import random
import warnings

import pytest
from hostile.running import run_crafted
from hostile.text_formats import TextFormat, read_damaged, text_formats

SECONDS, MEMORY = 5.0, 150e6
"""Most processor time and memory beyond those of the start-up, which takes 350 MB of 500."""

FORMATS = (
    "plan.toml", "plan.json", "bench.toml", "scene.toml", "scene2.toml", "panel.toml",
    "sensor.toml", "faults.toml", "lut.csv", "spectra.csv", "cube.hdr", "training.toml",
)  # fmt: skip


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("part", "parts"),
    [(0, 12), *(pytest.param(half, 2, marks=pytest.mark.sweep) for half in (0, 1))],
)
def test_a_crafted_file_is_named_and_nothing_else_is_opened(tmp_path, part, parts):
    found = run_crafted(tmp_path, part, parts)
    assert len(found) > 20
    assert [one for one in found if not one.is_named] == []
    assert [one for one in found if one.seconds > SECONDS or one.memory > MEMORY] == []


@pytest.fixture(scope="module")
def formats(tmp_path_factory) -> dict[str, TextFormat]:
    return dict(text_formats(tmp_path_factory.mktemp("formats")))


def test_every_format_is_tried(formats):
    assert sorted(formats) == sorted(FORMATS)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("count", [100, pytest.param(2500, marks=pytest.mark.sweep)])
@pytest.mark.parametrize("name", FORMATS)
def test_a_damaged_text_is_read_or_named(formats, tmp_path, name, count):
    form = formats[name]
    folder = tmp_path
    (folder / "cube.raw").write_bytes(bytes(48))
    path = folder / name
    path.write_text(form.text)
    form.read(path)
    with warnings.catch_warnings():
        # Numbers at the ends of their ranges make NumPy warn, which isn't the question here.
        warnings.simplefilter("ignore")
        found = read_damaged(form, count, random.Random(name).randrange(1000), folder)
    assert found.unexpected == {}
    assert found.longest < SECONDS
    assert found.named > count / 4
