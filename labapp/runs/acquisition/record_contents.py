"""Collect what the record holds before the first frame: plan, bench, patterns and shots."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from labapp.files.plan_file import PlanFile
from labapp.runs.bench_interface import Bench
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.readouts import largest_shape
from labapp.runs.record.creation import RecordContents
from labapp.runs.record.reader import file_sha256
from labapp.runs.shots import Shot, ShotList


def build_record_contents(
    bench: Bench,
    plan: PlanFile,
    patterns: Mapping[str, NDArray[np.uint8]],
    shots: Sequence[Shot],
    capabilities: BenchCapabilities,
    check_cancelled: Callable[[], None],
) -> RecordContents:
    """Collect what is known before the first frame.

    patterns: grey levels by name.
    shots: all frames of the plan.
    check_cancelled: called between the steps of a long computation, and may raise.
    """
    scene, effects = bench.scene_file, None
    if bench.world is not None:
        # Real devices have no effects to be planned.
        from labapp.runs.acquisition.effects import effect_plans

        effects = effect_plans(bench, shots, patterns, check_cancelled)
    return RecordContents(
        title=plan.title,
        seed=plan.seed,
        plan=plan.model_dump(mode="json"),
        bench=bench.file.model_dump(mode="json"),
        scene=scene.model_dump(mode="json") if scene else None,
        effect_plan=effects,
        identities={name: device.identity for name, device in bench.devices.items()},
        targets=[shot.target for shot in ShotList.of(shots).distinct("target")],
        patterns=patterns,
        shots=shots,
        frame_shape=largest_shape(ShotList.of(shots).readouts, capabilities.frame_shape),
        pixel_pitch=bench.description.sensor.pitch,
        video_frame=capabilities.video_frame,
        pictures={str(path): file_sha256(path) for path in scene.input_files} if scene else {},
        clock="real" if bench.file.is_real else "virtual",
        capabilities=asdict(capabilities),
        faults=[asdict(fault) for fault in bench.world.faults.script] if bench.world else (),
    )
