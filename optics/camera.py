"""The description of a programmable camera: panel, lens and stop, sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from optics.sensor.sensor import Sensor as Sensor
from optics.slm.panel import Panel as Panel
from optics.stop.aperture import Circle, Stop
from optics.validation import as_number, require_positive, require_share
from optics.zernike import require_zernike_indices


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
            require_zernike_indices(n, m)
            if not math.isfinite(as_number(path)):
                raise ValueError(
                    f"the aberration ({n}, {m}) is {as_number(path):g} m; it must be finite"
                )
        if self.kind not in ("thin", "stigmatic"):
            raise ValueError(f"kind is {self.kind!r}; choose thin or stigmatic")
        if self.kind == "stigmatic" and self.image_numerical_aperture >= 1:
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
    def image_numerical_aperture(self) -> float:
        """Of the angle between the axis and the steepest ray behind the lens; a tangent where
        the lens is thin, which is the same to the paraxial order."""
        return 0.5 * self.stop_diameter / self.image_distance

    @property
    def has_quadratic_phase(self) -> bool:
        """Whether its wave is the parabola of defocus, and nothing else."""
        return self.kind == "thin" and not self.aberrations

    @property
    def has_clear_stop(self) -> bool:
        """Whether the stop is a whole circle."""
        return self.stop == Stop(Circle())


@dataclass(frozen=True)
class Camera:
    """A panel in front of a lens in front of a sensor.

    transmission: of everything else. glare: share of the light that reflections and scatter
    spread evenly over the sensor, the veiling glare index of ISO 9358; only the simulator
    knows of it. separation: metres from the panel to the lens and its
    stop (thesis z₁, §5.3); 0 where the two may count as one plane. It may be a 0-d tensor.
    """

    panel: Panel = field(default_factory=Panel)
    lens: Lens = field(default_factory=Lens)
    sensor: Sensor = field(default_factory=Sensor)
    transmission: float = 0.6
    separation: float = 0.0
    glare: float = 0.0

    def __post_init__(self) -> None:
        require_share("transmission", self.transmission)
        require_share("glare", self.glare)
        separation = as_number(self.separation)
        if not 0 <= separation < math.inf:
            raise ValueError(
                f"separation is {separation:g} m; the panel stands before the lens, 0 m or more"
            )

    @property
    def ray_matrix_b(self) -> float:
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
