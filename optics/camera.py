"""Describe a programmable camera: its panel (SLM), its lens with the stop, its sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from optics.quantity_ranges import RANGES, ask_about_unit
from optics.sensor.sensor import Sensor as Sensor
from optics.slm.panel import Panel as Panel
from optics.stop.aperture import Circle, Stop
from optics.validation import as_number, require_positive, require_share, require_size
from optics.zernike import require_zernike_indices


@dataclass(frozen=True)
class Lens:
    """Describe a lens with its stop.

    Lengths and aberrations may be 0-d tensors: a PSF is differentiable in them.

    Parameters
    ----------
    focal_length : float or 0-d torch.Tensor, optional
        Metres.
    f_number : float or 0-d torch.Tensor, optional
        Focal length over the stop's diameter.
    focus_distance : float or 0-d torch.Tensor, optional
        Metres from the lens to the plane in focus; ``math.inf`` is allowed.
    stop : Stop, optional
        The shape of the opening, in units of the stop's radius; a clear circle by default.
    aberrations : tuple of (int, int, float), optional
        Triples (n, m, root-mean-square optical path over the disc in metres) of Zernike
        polynomials. None by default.
    kind : {"thin", "stigmatic"}, optional
        "thin" is a paraxial lens with a quadratic phase (thesis Eq. 2.14). "stigmatic" is a lens
        that unites all rays of the point in focus and obeys the sine condition, so that its
        pupil coordinate is the sine of a ray's angle.

    Raises
    ------
    ValueError
        If a length, an aberration or the kind is invalid.

    References
    ----------
    Thesis Eq. 2.14.
    """

    focal_length: float = 0.125
    f_number: float = 5.0
    focus_distance: float = 2.0
    stop: Stop = Stop()  # noqa: RUF009 (frozen)
    aberrations: tuple[tuple[int, int, float], ...] = ()
    kind: Literal["thin", "stigmatic"] = "thin"

    def __post_init__(self) -> None:
        for name in ("focal_length", "f_number"):
            require_positive(name, getattr(self, name), RANGES[name].unit)
            require_size(name, name, getattr(self, name))
        if not self.focus_distance > self.focal_length:
            raise ValueError(
                f"focus_distance is {self.focus_distance:g} m; it must be longer than the "
                f"focal length, {self.focal_length:g} m (inf focuses at infinity)"
                f"{ask_about_unit('focal_length', as_number(self.focal_length))}"
            )
        for n, m, path in self.aberrations:
            require_zernike_indices(n, m)
            if not math.isfinite(as_number(path)):
                raise ValueError(
                    f"the aberration ({n}, {m}) is {as_number(path):g} m; it must be finite"
                )
            require_size("aberration", f"the aberration ({n}, {m})", path)
        if self.kind not in ("thin", "stigmatic"):
            raise ValueError(f"kind is {self.kind!r}; choose thin or stigmatic")
        if self.kind == "stigmatic" and self.image_numerical_aperture >= 1:
            raise ValueError(
                f"f_number is {self.f_number:g}; no ray of a lens that obeys the sine condition "
                "is that steep: give 0.5 or more"
            )

    @property
    def stop_diameter(self) -> float:
        """The diameter in metres of the lens model's stop: focal length over f-number."""
        return self.focal_length / self.f_number

    @property
    def image_distance(self) -> float:
        """The distance in metres from the camera's lens to its sensor.

        It follows from the thin-lens equation at `focus_distance`.
        """
        return 1 / (1 / self.focal_length - 1 / self.focus_distance)

    @property
    def image_numerical_aperture(self) -> float:
        """The lens' numerical aperture on the image side, from the steepest ray behind it.

        It is the sine of that ray's angle to the axis. For a thin lens it is the tangent, which is
        the same to paraxial order.
        """
        return 0.5 * self.stop_diameter / self.image_distance

    @property
    def has_quadratic_phase(self) -> bool:
        """Whether the lens model's phase is quadratic: a thin lens without aberrations."""
        return self.kind == "thin" and not self.aberrations

    @property
    def has_clear_stop(self) -> bool:
        """Whether the lens model has an unobstructed, circular stop."""
        return self.stop == Stop(Circle())


@dataclass(frozen=True)
class Camera:
    """Describe a programmable camera: a panel in front of a lens in front of a sensor.

    Parameters
    ----------
    panel : Panel, optional
        The spatial light modulator.
    lens : Lens, optional
        The lens and its stop.
    sensor : Sensor, optional
        The image sensor.
    transmission : float, optional
        Share of the light, 0 to 1, that all parts other than the panel transmit.
    separation : float or 0-d torch.Tensor, optional
        Metres from the panel to the lens and its stop (thesis z₁, §5.3). The default, 0, puts
        them in one plane.
    glare : float, optional
        Share of the light that reflections and scatter spread evenly over the sensor, the veiling
        glare index of ISO 9358. Only the simulator uses it.

    Raises
    ------
    ValueError
        If a share is outside 0 to 1, or the separation is negative or infinite.

    References
    ----------
    Thesis §5.3, Fig. 5.2; ISO 9358.
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
        require_size("separation", "separation", separation)

    @property
    def ray_matrix_b(self) -> float:
        """The camera's ray-matrix element B: metres on the sensor per unit slope at the panel.

        It is the element B of the ray matrix from panel to sensor, z1 + z2 - z1 z2 / f (thesis Fig.
        5.2), which with the thin-lens equation is z2 (1 - z1 / focus_distance). It equals
        the image distance if the panel stands at the lens. It is zero or negative if the panel
        stands in the plane in focus or beyond it.
        """
        lens = self.lens
        return lens.image_distance * (1 - self.separation / lens.focus_distance)

    def magnification(self, distance: float) -> float:
        """Compute the camera lens' magnification, metres on the sensor per metre at an object.

        The object is `distance` metres from the panel; for ``math.inf`` the magnification is 0. It
        is the magnification along the chief ray, through the middle of the lens. The image is
        inverted, but the number is positive.
        """
        return self.lens.image_distance / (distance + self.separation)
