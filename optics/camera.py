"""The description of a programmable camera: panel, lens and stop, sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from optics.edge import as_number, require_positive
from optics.plane import Plane
from optics.slm.panel import Panel as Panel
from optics.slm.panel import require_share
from optics.stop.aperture import Circle, Stop
from optics.zernike import require_zernike

if TYPE_CHECKING:
    from optics.light.spectrum import Spectrum
    from optics.sensor.mosaic import Mosaic

_FULL_WELL_NOISE = 5.0
"""Standard deviations of read noise by which a full well may read too low."""

_MOST_PRNU = 0.2
"""Beyond it a pixel might answer to light with less than nothing."""


@dataclass(frozen=True)
class Lens:
    """A lens with its stop.

    focal_length: metres. f_number: focal length over the stop's diameter.
    focus_distance: metres from the lens to the plane in focus; math.inf is allowed.
    stop: the opening's shape, in units of the stop's radius; a clear circle by default.
    aberrations: triples (n, m, metres of optical path, root mean square over the disc) of
    Zernike polynomials. kind: "thin" for a paraxial lens with a quadratic phase (thesis
    Eq. 2.14), or "stigmatic" for one that unites all rays of the point in focus and obeys
    the sine condition, so that its pupil's coordinate is the sine of a ray's angle.

    Lengths and aberrations may be 0-d tensors: a PSF is differentiable in them.
    """

    focal_length: float = 0.125
    f_number: float = 5.0
    focus_distance: float = 2.0
    stop: Stop = Stop()  # noqa: RUF009 (frozen)
    aberrations: tuple[tuple[int, int, float], ...] = ()
    kind: Literal["thin", "stigmatic"] = "thin"

    def __post_init__(self) -> None:
        require_positive("focal_length", self.focal_length, "m")
        require_positive("f_number", self.f_number, "")
        if not self.focus_distance > self.focal_length:
            raise ValueError(
                f"focus_distance is {self.focus_distance:g} m; it must be longer than the "
                f"focal length, {self.focal_length:g} m (inf focuses at infinity)"
            )
        for n, m, path in self.aberrations:
            require_zernike(n, m)
            if not math.isfinite(as_number(path)):
                raise ValueError(
                    f"the aberration ({n}, {m}) is {as_number(path):g} m; it must be finite"
                )
        if self.kind not in ("thin", "stigmatic"):
            raise ValueError(f"kind is {self.kind!r}; choose thin or stigmatic")
        if self.kind == "stigmatic" and self.sine >= 1:
            raise ValueError(
                f"f_number is {self.f_number:g}; no ray of a lens that obeys the sine condition "
                "is that steep: give 0.5 or more"
            )

    @property
    def stop_diameter(self) -> float:
        return self.focal_length / self.f_number

    @property
    def image_distance(self) -> float:
        """Metres from the lens to the sensor: the thin-lens equation at focus_distance."""
        return 1 / (1 / self.focal_length - 1 / self.focus_distance)

    @property
    def sine(self) -> float:
        """Of the angle between the axis and the steepest ray behind the lens; a tangent where
        the lens is thin, which is the same to the paraxial order."""
        return 0.5 * self.stop_diameter / self.image_distance

    @property
    def quadratic(self) -> bool:
        """Whether its wave is the parabola of defocus, and nothing else."""
        return self.kind == "thin" and not self.aberrations

    @property
    def clear(self) -> bool:
        """Whether the stop is a whole circle."""
        return self.stop == Stop(Circle())


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

    def window(self, shape: tuple[int, int], centre: tuple[float, float] = (0.0, 0.0)) -> Plane:
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


@dataclass(frozen=True)
class Camera:
    """A panel in front of a lens in front of a sensor.

    transmission: of everything else. separation: metres from the panel to the lens and its
    stop (thesis z₁, §5.3); 0 where the two may count as one plane. It may be a 0-d tensor.
    """

    panel: Panel = field(default_factory=Panel)
    lens: Lens = field(default_factory=Lens)
    sensor: Sensor = field(default_factory=Sensor)
    transmission: float = 0.6
    separation: float = 0.0

    def __post_init__(self) -> None:
        require_share("transmission", self.transmission)
        separation = as_number(self.separation)
        if not 0 <= separation < math.inf:
            raise ValueError(
                f"separation is {separation:g} m; the panel stands before the lens, 0 m or more"
            )

    @property
    def lever(self) -> float:
        """Metres by which light moves on the sensor for a unit slope at the panel.

        The element B of the ray matrix from panel to sensor, z1 + z2 - z1 z2 / f (thesis
        Fig. 5.2), which with the thin-lens equation is z2 (1 - z1 / focus_distance). The image
        distance where the panel stands at the lens; not positive where the panel stands in the
        plane in focus or beyond it.
        """
        lens = self.lens
        return lens.image_distance * (1 - self.separation / lens.focus_distance)

    def magnification(self, distance: float) -> float:
        """Metres on the sensor for a metre across the axis at an object, `distance` metres from
        the panel: the chief ray's, through the middle of the lens. 0 for math.inf. The image
        is inverted; the number is positive."""
        return self.lens.image_distance / (distance + self.separation)
