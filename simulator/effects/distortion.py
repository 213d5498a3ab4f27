"""The effect of distortion: the lens' magnification changes over the field."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from simulator.effects.moved_light import MovedLight, moved_light_bound
from simulator.effects.rendering_work import LATERAL_COLOUR
from simulator.formation.distorting import distorted_frame
from simulator.situation import Situation


class Distortion(MovedLight):
    name = "distortion"
    recipe_field = "distortion"
    physics = "the lens' magnification changes with the image height: straight lines bend"
    source = "Brown 1971, Close-range camera calibration"

    def is_present(self, s: Situation) -> bool:
        return any(s.camera.lens.distortion) and not s.picture_probe.is_dark

    def lookups(self, levels: Mapping[str, int]) -> int:
        # What scales each wavelength distorts it as well.
        return 0 if levels.get(LATERAL_COLOUR, 0) else 1

    def explain(self, s: Situation) -> str:
        frame = distorted_frame(s.camera)
        return (
            f"light moves by {frame.reach / s.camera.sensor.pitch:.3g} pixels at most, and areas "
            f"change by {max(frame.largest, 1 / frame.least) - 1:.2g}"
        )

    def change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that the distortion effect moves."""
        frame = distorted_frame(s.camera)
        gain = max(frame.largest, 1 / frame.least)
        return moved_light_bound(
            s, lambda rate, most: np.minimum(rate * frame.reach, most), gain - 1
        )
