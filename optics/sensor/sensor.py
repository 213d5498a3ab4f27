"""The sensor as data: its pixels, and what they make of light."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from optics.light.spectrum import Spectrum
from optics.plane import Plane
from optics.sensor.mosaic import Mosaic
from optics.validation import require_positive, require_share

_FULL_WELL_NOISE = 5.0
"""Standard deviations of read noise by which a full well may read too low."""

_MOST_PRNU = 0.2
"""Beyond it a pixel might answer to light with less than nothing."""


@dataclass(frozen=True)
class Sensor:
    """A sensor, in the quantities of EMVA 1288.

    shape: (rows, columns). pitch: metres. bits: of the digital number. full_well:
    electrons. gain: electrons per digital number. read_noise: electrons, standard
    deviation. dark_current: electrons per second. black_level: digital number of no
    light. quantum_efficiency: electrons per photon. exposure_range: seconds.
    The defaults are those of a 3.45 µm machine-vision sensor.

    spectral_efficiency: electrons per photon by wavelength; None: quantum_efficiency at all.
    colour: filters on the pixels, whose curves count instead; None: a monochrome sensor.
    prnu: standard deviation of the pixels' response, relative. dsnu: of what they read without
    light, electrons. dead, hot: shares of pixels that see nothing, and that have hot_current
    electrons per second more. fixed_seed: of the maps of these four, one for each camera.
    shutter: "global", or "rolling" by line_time seconds from row to row. model: its name.
    """

    shape: tuple[int, int] = (512, 768)
    pitch: float = 3.45e-6
    bits: int = 12
    full_well: float = 10500.0
    gain: float = 2.6
    read_noise: float = 2.4
    dark_current: float = 1.0
    black_level: float = 64.0
    quantum_efficiency: float = 0.62
    exposure_range: tuple[float, float] = (20e-6, 30.0)
    spectral_efficiency: Spectrum | None = None
    colour: Mosaic | None = None
    prnu: float = 0.0
    dsnu: float = 0.0
    dead: float = 0.0
    hot: float = 0.0
    hot_current: float = 0.0
    fixed_seed: int = 0
    shutter: Literal["global", "rolling"] = "global"
    line_time: float = 0.0
    model: str = ""

    def __post_init__(self) -> None:
        for name in ("pitch", "full_well", "gain", "quantum_efficiency"):
            require_positive(name, getattr(self, name), "")
        for name in (
            "read_noise", "dark_current", "black_level", "prnu", "dsnu", "hot_current", "line_time"
        ):  # fmt: skip
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name):g}; it can't be negative")
        self._require_sound_pixels()
        if not 1 <= self.bits <= 16:
            raise ValueError(f"bits is {self.bits}; a sensor has 1 to 16")
        if self.black_level >= self.full_scale:
            raise ValueError(
                f"black_level is {self.black_level:g}; it must lie below the full scale, "
                f"{self.full_scale}"
            )
        low, high = self.exposure_range
        if not 0 < low <= high < math.inf:
            raise ValueError(f"exposure_range is {low:g} to {high:g} s; give the shorter first")
        Plane(self.shape, (self.pitch, self.pitch))

    def _require_sound_pixels(self) -> None:
        if self.prnu > _MOST_PRNU:
            raise ValueError(
                f"prnu is {self.prnu:g}; it is a share of the response, {_MOST_PRNU:g} at most"
            )
        for name in ("dead", "hot"):
            require_share(name, getattr(self, name))
        if self.dead + self.hot > 1:
            raise ValueError(
                f"dead is {self.dead:g} and hot {self.hot:g}; no more than all pixels can be either"
            )
        if self.shutter not in ("global", "rolling"):
            raise ValueError(f"shutter is {self.shutter!r}; choose global or rolling")
        if self.shutter == "rolling" and not self.line_time:
            raise ValueError("a rolling shutter needs its line_time, more than 0 s")

    @property
    def plane(self) -> Plane:
        return Plane(self.shape, (self.pitch, self.pitch))

    def window_plane(
        self, shape: tuple[int, int], centre: tuple[float, float] = (0.0, 0.0)
    ) -> Plane:
        """Some of the sensor's pixels, (rows, columns) around a centre (y, x) in metres."""
        return Plane(shape, (self.pitch, self.pitch), centre)

    @property
    def full_scale(self) -> int:
        """The digital number from which a pixel counts as clipped.

        Where the well is full before the converter ends, read noise must not make it
        look unclipped.
        """
        well = self.full_well - _FULL_WELL_NOISE * self.read_noise
        return int(min(2**self.bits - 1, math.floor(self.black_level + well / self.gain)))
