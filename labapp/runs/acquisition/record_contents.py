"""Collect what the record holds before the first frame, with the simulator's effect plans."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.runs.bench_interface import Bench
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.readouts import largest_shape
from labapp.runs.record.creation import RecordContents
from labapp.runs.record.reader import file_sha256
from labapp.runs.shots import Shot, ShotList

if TYPE_CHECKING:
    from simulator.planning import EffectPlan


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


_RECORDED_KEYS = ("effect", "level", "on", "relative", "estimate", "work", "why", "forced")
"""Keys of a decision that each effect plan records; the record holds common facts once."""


def effect_plans(
    bench: Bench,
    shots: Sequence[Shot],
    patterns: Mapping[str, NDArray[np.uint8]],
    check_cancelled: Callable[[], None] = lambda: None,
) -> dict[str, Any] | None:
    """Return the effect plans, one for each setting of the shots.

    A setting is a target, pattern, wavelength, exposure and gain. The result is plain data,
    {"effects": descriptions by name, "plans": [...]}; it is None if the bench has no simulated
    devices. Nothing is rendered. Raises UserError for a picture that can't be simulated.

    check_cancelled: is called before each plan, and may raise.
    """
    if bench.world is None:
        return None
    effects: dict[str, Any] = {}
    plans: list[dict[str, Any]] = []
    for shot in ShotList.of(shots).distinct_pictures():
        check_cancelled()
        try:
            plan = bench.world.effect_plan(
                patterns[shot.pattern],
                shot.wavelength,
                shot.exposure,
                shot.place or shot.target,
                _bandwidth(bench, shot),
                shot.readout.amplification_db,
            )
        except ValueError as error:
            raise UserError(
                f"{shot.target} with {shot.pattern} at {shot.wavelength * 1e9:g} nm can't be "
                f"simulated: {error}."
            ) from error
        for one in plan.decisions:
            effects[one.effect] = {"kind": one.kind, "physics": one.physics, "source": one.source}
        plans.append(_plan_data(shot, plan))
    return {"effects": effects, "plans": plans}


def _bandwidth(bench: Bench, shot: Shot) -> float | None:
    """Return the filter wheel's bandwidth for a shot, in metres; None for a tunable filter."""
    slots = bench.wheel.slots if bench.wheel else ()
    if shot.slot:
        return slots[shot.slot - 1].bandwidth
    near = (slot.bandwidth for slot in slots if abs(slot.wavelength - shot.wavelength) < 1e-12)
    return next(near, None)


def _plan_data(shot: Shot, plan: EffectPlan) -> dict[str, Any]:
    data = plan.as_data()
    data["decisions"] = [
        {name: told[name] for name in _RECORDED_KEYS}
        | {"finest": one.levels[-1], "how": one.error.how}
        for one, told in zip(plan.decisions, data["decisions"], strict=True)
    ]
    gain = {} if shot.readout.gain_db is None else {"gain_db": shot.readout.gain_db}
    return {
        "target": shot.target,
        "pattern": shot.pattern,
        "wavelength_nm": round(shot.wavelength * 1e9, 3),
        "exposure_ms": shot.exposure * 1e3,
        **gain,
        **data,
    }
