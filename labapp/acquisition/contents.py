"""What a record holds before its first frame: plan, bench, patterns, as this run has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.acquisition.abilities import Abilities
from labapp.acquisition.steps import Shot
from labapp.bench import Bench
from labapp.files.plan_file import PlanFile
from labapp.record.making import Contents
from labapp.record.reader import digest
from simulator.world import World


def contents_of(
    bench: Bench,
    plan: PlanFile,
    patterns: Mapping[str, NDArray[np.uint8]],
    listed: Sequence[Shot],
    abilities: Abilities,
) -> Contents:
    """patterns: grey levels by name. listed: every frame of the plan."""
    scene = bench.scene_file
    return Contents(
        title=plan.title,
        seed=plan.seed,
        plan=plan.model_dump(mode="json"),
        bench=bench.file.model_dump(mode="json"),
        scene=scene.model_dump(mode="json") if scene else None,
        effect_plan=_effect_plans(bench.world, listed, patterns) if bench.world else None,
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


def _effect_plans(
    world: World, listed: Sequence[Shot], patterns: Mapping[str, NDArray[np.uint8]]
) -> dict[str, Any]:
    """What the simulator decides for each pattern and wavelength of a plan."""
    plans = {}
    for shot in listed:
        key = f"{shot.pattern}, {shot.wavelength * 1e9:g} nm"
        if key not in plans:
            decided = world.effect_plan(patterns[shot.pattern], shot.wavelength)
            plans[key] = decided.as_data()
    return plans
