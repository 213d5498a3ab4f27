"""What metering found of where a camera's pixels clip, if nobody had told it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from labapp.files.bench_file import BenchFile
    from labapp.files.bracket_table import MeteredLight
    from labapp.files.plan_file import PlanFile
    from optics.camera import Sensor
    from optics.hdr import MeteredRange


def clip_remark(metered: MeteredRange, sensor: Sensor) -> str:
    """Return what a person must know of the camera's clip level; empty for nothing."""
    remedy = "`labapp devices test camera` measures it, and says what the bench file should say"
    if metered.clip_level is not None:
        return (
            f"pixels clip at {metered.clip_level}, and by the bench file at {sensor.full_scale}: "
            f"{metered.clip_level} was used, and a record keeps it. Write clip_level_dn = "
            f"{metered.clip_level} in [sensor], so that runs know it which meter nothing"
        )
    if metered.may_be_clipped:
        return (
            "the clip level is unknown: the bench file doesn't tell it, and no other exposure "
            f"proves that the brightest pixels aren't clipped; they may be brighter. {remedy}"
        )
    return ""


def metered_clip_level(plan: PlanFile) -> MeteredLight | None:
    """Return the metering that found where pixels clip, at the lowest number; or None."""
    every = [one for block in plan.acquire if block.chosen for one in block.chosen.metered]
    found = [one for one in every if one.clip_level_dn is not None]
    return min(found, key=lambda one: one.clip_level_dn or 0, default=None)


def bench_as_metered(bench: BenchFile, plan: PlanFile) -> BenchFile:
    """Return a bench file with the clip level that was metered, if it tells none itself."""
    found = metered_clip_level(plan)
    if found is None or bench.tells_clip_level:
        return bench
    sensor = bench.sensor.model_copy(update={"clip_level_dn": found.clip_level_dn})
    return bench.model_copy(update={"sensor": sensor})
