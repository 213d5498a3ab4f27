"""Say in words what metering found of where a camera's pixels clip, if nobody had told it."""

from __future__ import annotations

from optics.camera import Sensor
from optics.hdr import MeteredRange


def clip_remark(metered: MeteredRange, sensor: Sensor) -> str:
    """Return what a person must know of the clip level of a run's camera; empty for nothing."""
    remedy = "`labapp devices test camera` measures it, and says what the bench file should say"
    if metered.clip_level is not None:
        return (
            f"pixels clip at {metered.clip_level}, and by the bench file at {sensor.full_scale}: "
            f"{metered.clip_level} was used. Write clip_level_dn = {metered.clip_level} in "
            "[sensor], or merges take clipped pixels for light"
        )
    if metered.may_be_clipped:
        return (
            "the clip level is unknown: the bench file doesn't tell it, and no other exposure "
            f"proves that the brightest pixels aren't clipped; they may be brighter. {remedy}"
        )
    return ""
