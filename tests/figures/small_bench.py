"""A bench that photographs in a millisecond, and random plans for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from labapp.bench import BenchSetup
from labapp.files.bench_file import BenchFile
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled, read_file
from labapp.files.scene_file import SceneFile
from simulator.faults import Fault

_REPLY_S = 0.5
"""Seconds that a small picture may take: a camera that hangs is found out soon."""


def small_setup(
    shape: tuple[int, int] = (64, 96), faults: Sequence[Fault] = (), reply_s: float = _REPLY_S
) -> BenchSetup:
    """The bundled bench with a coarser panel and a sensor of (rows, columns) before a star."""
    data = read_file(bundled("bench.toml"), BenchFile).model_dump(mode="json")
    data["panel"] |= {"width": 192, "height": 108, "pitch_um": 80.0}
    data["sensor"] |= {"height": shape[0], "width": shape[1]}
    data["devices"]["camera"]["options"] = {"readout_ms": 8.0, "reply_s": reply_s}
    scene = {
        "version": 1,
        "title": "A star",
        "targets": {
            "dark": {"kind": "dark"},
            "star": {"kind": "star", "diameter_um": 70.0, "distance_m": 2.0, "radiance": 5.0},
        },
    }
    return BenchSetup(
        BenchFile.model_validate(data),
        SceneFile.model_validate(scene),
        "bench",
        "scene",
        (*faults,),
    )


def random_plan(rng: np.random.Generator) -> PlanFile:
    """A plan of 8 to some 60 frames: axes, their order, darks and repeats by chance."""
    wavelengths = rng.choice(np.arange(450, 700, 10), rng.integers(1, 3), replace=False)
    exposures = rng.choice([1, 2, 4, 8, 16, 32, 64], rng.integers(2, 4), replace=False)
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
