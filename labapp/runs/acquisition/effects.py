"""The simulator's effect plans for the frames of a run, as data for the record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.runs.bench_interface import Bench
from labapp.runs.shots import Shot, ShotList

if TYPE_CHECKING:
    from simulator.planning import Decision, EffectPlan
    from simulator.world import World

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
        plan = _plan_effects(bench, bench.world, shot, patterns[shot.pattern])
        effects |= {one.effect: _physics(one) for one in plan.decisions}
        plans.append(_plan_data(shot, plan))
    return {"effects": effects, "plans": plans}


def _plan_effects(bench: Bench, world: World, shot: Shot, shown: NDArray[np.uint8]) -> EffectPlan:
    place, bandwidth = shot.place or shot.target, _bandwidth(bench, shot)
    try:
        return world.effect_plan(
            shown,
            shot.wavelength,
            shot.exposure,
            place,
            bandwidth,
            shot.readout.amplification_db,
        )
    except ValueError as error:
        raise UserError(
            f"{shot.target} with {shot.pattern} at {shot.wavelength * 1e9:g} nm can't be "
            f"simulated: {error}."
        ) from error


def _bandwidth(bench: Bench, shot: Shot) -> float | None:
    """Return the filter wheel's bandwidth for a shot, in metres; None for a tunable filter."""
    slots = bench.wheel.slots if bench.wheel else ()
    if shot.slot:
        return slots[shot.slot - 1].bandwidth
    near = (slot.bandwidth for slot in slots if abs(slot.wavelength - shot.wavelength) < 1e-12)
    return next(near, None)


def _physics(one: Decision) -> dict[str, Any]:
    return {"kind": one.kind, "physics": one.physics, "source": one.source}


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
