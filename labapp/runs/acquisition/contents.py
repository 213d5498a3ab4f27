"""What a record holds before its first frame: plan, bench, patterns, as this run has them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from labapp.files.plan_file import PlanFile
from labapp.runs.abilities import Abilities
from labapp.runs.acquisition.effects import effect_plans
from labapp.runs.bench import Bench
from labapp.runs.record.making import Contents
from labapp.runs.record.reader import digest
from labapp.runs.steps import Shot


def contents_of(
    bench: Bench,
    plan: PlanFile,
    patterns: Mapping[str, NDArray[np.uint8]],
    listed: Sequence[Shot],
    abilities: Abilities,
    check: Callable[[], None],
) -> Contents:
    """patterns: grey levels by name. listed: every frame of the plan. check: is called between
    the steps of a long computation, and may raise."""
    scene = bench.scene_file
    return Contents(
        title=plan.title,
        seed=plan.seed,
        plan=plan.model_dump(mode="json"),
        bench=bench.file.model_dump(mode="json"),
        scene=scene.model_dump(mode="json") if scene else None,
        effect_plan=effect_plans(bench, listed, patterns, check),
        identities={name: device.identity for name, device in bench.devices.items()},
        targets=list(dict.fromkeys(shot.target for shot in listed)),
        patterns=patterns,
        shots=listed,
        frame_shape=abilities.frame_shape,
        pixel_pitch=bench.description.sensor.pitch,
        video_frame=abilities.video_frame,
        pictures={str(path): digest(path) for path in scene.pictures} if scene else {},
        clock="real" if bench.file.is_real else "virtual",
        faults=[asdict(fault) for fault in bench.world.faults.script] if bench.world else (),
    )
