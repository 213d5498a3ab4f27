"""Tell while frames are taken whether the scene has changed since the brackets were metered."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drivers.interfaces import Frame
from labapp.files.bracket_table import MeteredLight
from labapp.files.plan_file import PlanFile
from labapp.runs.shots import Shot

if TYPE_CHECKING:
    from optics.camera import Sensor

_Setting = tuple[str, str, float]


class SceneWatch:
    """Compares the frames of chosen brackets with what was metered.

    Each target, pattern and wavelength is told once.
    """

    def __init__(self, plan: PlanFile, sensor: Sensor) -> None:
        self._sensor = sensor
        self._metered: dict[_Setting, MeteredLight] = {}
        for block in plan.acquire:
            for one in block.chosen.metered if block.chosen else ():
                setting = one.target, one.pattern, one.wavelength_nm
                self._metered[setting] = one

    def compare(self, shot: Shot, frame: Frame) -> str:
        """Return how a frame's scene differs from the metered one; "" if it doesn't."""
        setting = shot.target, shot.pattern, round(shot.wavelength * 1e9, 3)
        metered = self._metered.get(setting)
        if shot.role != "light" or metered is None:
            return ""
        # It is loaded only for runs that were metered.
        from optics.hdr import SceneLight, scene_change, scene_light

        before = SceneLight(
            np.array(metered.blocks, dtype=np.float64),
            np.array(metered.quantiles, dtype=np.float64),
        )
        sensor = shot.readout.read_sensor(self._sensor)
        after = scene_light([(frame.exposure, frame.image)], sensor)
        change = scene_change(before, after)
        if not change.is_notable:
            return ""
        del self._metered[setting]
        return (
            f"{shot.target} with {shot.pattern} at {setting[2]:g} nm: {change.explain()}, so that "
            "its bracket may miss what it was chosen for. Run the plan again"
        )
