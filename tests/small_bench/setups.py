"""The small bench as read, before a star, and random plans for it."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from labapp.bench.opening import BenchSetup
from labapp.files.bench_file import BenchFile
from labapp.files.plan_file import PlanFile
from labapp.files.scene_file import SceneFile
from simulator.faults import Fault
from small_bench.files import SMALL, Size, bench_text

_REPLY_S = 0.5
"""Seconds that a small picture may take: a camera that hangs is found out soon."""


def bench_file(size: Size = SMALL, **options: str) -> BenchFile:
    return BenchFile.model_validate(tomllib.loads(bench_text(size, **options)))


def small_setup(
    shape: tuple[int, int] = SMALL.sensor, faults: Sequence[Fault] = (), reply_s: float = _REPLY_S
) -> BenchSetup:
    """The small bench with a sensor of (rows, columns) before a star."""
    camera = f"readout_ms = 8.0, reply_s = {reply_s}"
    bench = bench_file(replace(SMALL, sensor=shape), camera_options=camera)
    scene = {
        "version": 1,
        "title": "A star",
        "targets": {
            "dark": {"kind": "dark"},
            "star": {"kind": "star", "diameter_um": 70.0, "distance_m": 2.0, "radiance": 5.0},
        },
    }
    return BenchSetup(bench, SceneFile.model_validate(scene), "bench", "scene", (*faults,))


def random_plan(rng: np.random.Generator) -> PlanFile:
    """A plan of 8 to some 60 frames: axes, their order, darks and repeats by chance.

    Of few values, since what a picture calls for is decided for each, and takes longest.
    """
    wavelengths = rng.choice([470, 550, 640], rng.integers(1, 3), replace=False)
    exposures = rng.choice([1, 4, 16, 64], rng.integers(2, 4), replace=False)
    axes = rng.permutation(["target", "pattern", "wavelength", "exposure", "repeat"])
    block: dict[str, Any] = {
        "targets": ["star"] if rng.random() < 0.5 else ["dark", "star"],
        "patterns": ["neutral", "lens"],
        "wavelengths_nm": wavelengths.tolist(),
        "exposures_ms": exposures.tolist(),
        "repeats": int(rng.integers(2, 4)),
        "order": axes.tolist(),
    }
    if rng.random() < 0.5:
        every = int(rng.integers(3, 9))
        block["interleave"] = [{"role": "dark", "every": every, "frames": 1}]
    table = {
        "version": 1,
        "title": "By chance",
        "seed": int(rng.integers(1 << 31)),
        "patterns": {
            "neutral": {"kind": "constant"},
            "lens": {"kind": "lens", "focal_length_m": 50.0},
        },
        "acquire": [block],
    }
    return PlanFile.model_validate(table)
