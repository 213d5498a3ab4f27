"""A camera as data: panel, lens with its errors, and sensor."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from optics.camera.field_aberrations import FieldAberrations
from optics.camera.ghost import Ghost, require_ghosts
from optics.camera.stop import Circle, Stop
from optics.quantity_ranges import RANGES, ask_about_unit
from optics.sensor.sensor import Sensor
from optics.slm.panel import Panel
from optics.validation import (
    as_number,
    require_positive,
    require_share,
    require_size,
    require_wavelength,
)
from optics.zernike import require_zernike_indices

Array = NDArray[np.float64]

# Points from which the inverse begins, and steps of Newton's method that it takes. Chosen: the
# first are right to 1e-6, and each step squares that.
_TABLE, _STEPS = 1025, 4


class RadialDistortion:
    """Brown's model: a point at height r is imaged at r (1 + k1 t² + k2 t⁴), t = r / distance.

    coefficients: k1 and k2.
    distance: from the lens to the sensor in metres, so that k1 and k2 are those that OpenCV's
        calibration finds.

    Beyond the height at which the image would fold back, it stays there. Brown 1971, Close-range
    camera calibration.
    """

    def __init__(self, coefficients: Sequence[float], distance: float) -> None:
        self.k1, self.k2 = coefficients
        self.distance = distance
        roots = np.roots([5 * self.k2, 3 * self.k1, 1.0])
        folds = [float(one.real) for one in roots if abs(one.imag) < 1e-12 and one.real > 0]
        self.fold = distance * math.sqrt(min(folds)) if folds else math.inf
        """Height in metres of the undistorted point from which on the image folds back."""

    def distorted(self, height: Array) -> Array:
        """Return the heights at which points of undistorted heights are imaged, metres."""
        height = np.minimum(height, self.fold)
        u = (height / self.distance) ** 2
        return np.asarray(height * (1 + self.k1 * u + self.k2 * u**2))

    def undistorted(self, height: Array) -> Array:
        """Return the undistorted heights of points that are imaged at heights in metres."""
        most = float(np.max(height, initial=0.0))
        end = most
        while end < self.fold and self.distorted(np.array(end)) < most:
            end = min(2 * end, self.fold)
        table = np.linspace(0, end, _TABLE)
        found = np.interp(height, self.distorted(table), table)
        for _ in range(_STEPS):
            u = (found / self.distance) ** 2
            slope = np.maximum(1 + 3 * self.k1 * u + 5 * self.k2 * u**2, 1e-3)
            found = np.clip(found - (self.distorted(found) - height) / slope, 0, end)
        return found

    def area_gain(self, height: Array) -> Array:
        """Return by how much areas at undistorted heights, metres, are enlarged."""
        u = (np.minimum(height, self.fold) / self.distance) ** 2
        radial = 1 + 3 * self.k1 * u + 5 * self.k2 * u**2
        return np.asarray((1 + self.k1 * u + self.k2 * u**2) * np.maximum(radial, 0))


ColourCurve = Sequence[tuple[float, float]]
"""Pairs (wavelength in metres, value) of rising wavelengths. Values between two are interpolated
linearly; beyond the ends the curve goes on as straight as between its last two pairs."""


def require_colour_curve(name: str, curve: ColourCurve, most: float, unit: str) -> None:
    """Raise ValueError unless a curve is empty, or its wavelengths rise and its values are finite.

    most: largest size of a value. unit: of the values, for the message.
    """
    if not curve:
        return
    if len(curve) < 2:
        raise ValueError(
            f"{name} is {list(curve)}; give two pairs or more, [wavelength, value], or none"
        )
    for wavelength, value in curve:
        require_wavelength(f"a wavelength of {name}", wavelength)
        if not math.isfinite(value) or abs(value) > most:
            raise ValueError(
                f"{name} is {value:g}{unit} at {wavelength * 1e9:g} nm; it is between "
                f"{-most:g} and {most:g}{unit}"
            )
    for (low, _), (high, _) in itertools.pairwise(curve):
        if not low < high:
            raise ValueError(
                f"{name} has {high * 1e9:g} nm after {low * 1e9:g} nm; wavelengths rise"
            )


def colour_curve_at(name: str, curve: ColourCurve, wavelength: float, most: float) -> float:
    """Return a curve's value at a wavelength in metres; 0 for an empty curve.

    Raises ValueError where a curve that goes on beyond its ends exceeds `most` in size.
    """
    if not curve:
        return 0.0
    x, y = np.array(curve).T
    first = int(np.clip(np.searchsorted(x, wavelength) - 1, 0, len(x) - 2))
    slope = (y[first + 1] - y[first]) / (x[first + 1] - x[first])
    value = float(y[first] + slope * (wavelength - x[first]))
    if abs(value) > most * (1 + 1e-9):
        raise ValueError(
            f"{name} goes on to {value:.3g} at {wavelength * 1e9:.4g} nm, more than {most:.3g}; "
            "give its curve up to that wavelength"
        )
    return value


def wavelengths_between(curve: ColourCurve, low: float, high: float) -> list[float]:
    """Return both ends of a range in metres, and where the curve bends between them.

    The least and the largest of its values in the range are at these wavelengths.
    """
    return [low, *(one for one, _ in curve if low < one < high), high]


MAX_SCALE_CHANGE = 0.1
"""Largest change of the image's scale by the wavelength, as a share of it. Chosen: no lens has so
much."""

MAX_FOCUS_SHIFT_SHARE = 0.1
"""Largest shift of a lens' focus, as a share of its image distance. Chosen: beyond it, the scale of
the image changes, too."""


@dataclass(frozen=True)
class Lens:
    """A lens with its stop.

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
    relative_illumination : tuple of (float, float), optional
        Pairs (image height in metres, light over that on the axis), from (0, 1) outwards, as a data
        sheet's curve gives them. None by default: cos⁴ of the field angle. Only the simulator uses
        them.
    distortion : tuple of (float, float), optional
        Brown's radial coefficients k1 and k2, for heights in units of the image distance, as
        OpenCV has them: barrel below 0, pincushion above. Only the simulator uses them.
    axial_colour : tuple of (float, float), optional
        Pairs (wavelength, metres by which its image lies farther from the lens than the sensor) of
        rising wavelengths, for a point at `focus_distance`. Straight lines join them and go on
        beyond the ends. None by default: one focus for all. Only the simulator uses them.
    field_aberrations : FieldAberrations, optional
        Coma, astigmatism and field curvature, which grow with the image height, in addition to
        `aberrations`. None by default. Only the simulator uses them.
    lateral_colour : tuple of (float, float), optional
        Pairs (wavelength in metres, share by which its image is larger) in the same way. None by
        default: one scale for all. Only the simulator uses them.

    Raises
    ------
    ValueError
        If a length, an aberration, the kind or a pair is invalid.

    References
    ----------
    Thesis Eq. 2.14; ISO 13653, relative illuminance in the image field; Brown 1971;
    Kingslake, Lens Design Fundamentals, chapter 4, chromatic aberration.
    """

    focal_length: float = 0.125
    f_number: float = 5.0
    focus_distance: float = 2.0
    stop: Stop = Stop()  # noqa: RUF009 (frozen)
    aberrations: tuple[tuple[int, int, float], ...] = ()
    kind: Literal["thin", "stigmatic"] = "thin"
    relative_illumination: tuple[tuple[float, float], ...] = ()
    distortion: tuple[float, float] = (0.0, 0.0)
    axial_colour: tuple[tuple[float, float], ...] = ()
    field_aberrations: FieldAberrations | None = None
    lateral_colour: tuple[tuple[float, float], ...] = ()

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
        self._require_relative_illumination()
        if not all(math.isfinite(one) for one in self.distortion):
            raise ValueError(f"distortion is {list(self.distortion)}; give two finite numbers")
        most = MAX_FOCUS_SHIFT_SHARE * as_number(self.image_distance)
        require_colour_curve("axial_colour", self.axial_colour, most, " m")
        require_colour_curve("lateral_colour", self.lateral_colour, MAX_SCALE_CHANGE, "")

    def _require_relative_illumination(self) -> None:
        """Raise ValueError if the relative illumination doesn't go outwards from (0, 1)."""
        pairs = self.relative_illumination
        if not pairs:
            return
        if len(pairs) < 2 or tuple(pairs[0]) != (0.0, 1.0):
            raise ValueError(
                f"relative_illumination is {list(pairs)}; give two pairs or more, the first of "
                "them [0, 1] for the axis"
            )
        for (inner, _), (height, share) in itertools.pairwise(pairs):
            if not inner < height < math.inf:
                raise ValueError(
                    f"relative_illumination has the image height {height * 1e3:g} mm after "
                    f"{inner * 1e3:g} mm; heights rise from the axis outwards"
                )
            if not 0 < share <= 1:
                raise ValueError(
                    f"relative_illumination is {share:g} at {height * 1e3:g} mm; it is a share of "
                    "the light on the axis: more than 0, and 1 at most"
                )

    @property
    def radial_distortion(self) -> RadialDistortion | None:
        """How image heights are distorted; None without distortion."""
        if not any(self.distortion):
            return None
        return RadialDistortion(self.distortion, as_number(self.image_distance))

    def focus_shift(self, wavelength: float) -> float:
        """Return how far behind the sensor the lens forms the image of a wavelength, metres."""
        most = MAX_FOCUS_SHIFT_SHARE * as_number(self.image_distance)
        return colour_curve_at("axial_colour", self.axial_colour, wavelength, most)

    def image_scale(self, wavelength: float) -> float:
        """Return how much larger than by `magnification` light of a wavelength is imaged."""
        curve = self.lateral_colour
        return 1 + colour_curve_at("lateral_colour", curve, wavelength, MAX_SCALE_CHANGE)

    def defocused(self, shift: float) -> Lens:
        """Return the lens with its image `shift` metres farther from it, the sensor where it is.

        The lens has another focal length, and the plane in focus lies elsewhere. If that would be
        beyond infinity, the pupil gets the same quadratic path as the Zernike polynomial (2, 0).
        """
        if not shift:
            return self
        z, diameter = as_number(self.image_distance), as_number(self.stop_diameter)
        power = shift / (z * (z + shift))
        nearest = 1 / as_number(self.focus_distance) - power
        if nearest < 0:
            path = (diameter / 2) ** 2 * power / (4 * math.sqrt(3))
            return replace(self, aberrations=(*self.aberrations, (2, 0, path)))
        focal = 1 / (1 / as_number(self.focal_length) - power)
        sharp = 1 / nearest if nearest else math.inf
        return replace(self, focal_length=focal, f_number=focal / diameter, focus_distance=sharp)

    @property
    def stop_diameter(self) -> float:
        """The stop's diameter in metres: focal length over f-number."""
        return self.focal_length / self.f_number

    @property
    def image_distance(self) -> float:
        """The distance in metres from lens to sensor, by the thin-lens equation."""
        return 1 / (1 / self.focal_length - 1 / self.focus_distance)

    @property
    def image_numerical_aperture(self) -> float:
        """The numerical aperture on the image side: the sine of the steepest ray's angle.

        For a thin lens it is the tangent, which is the same to paraxial order.
        """
        return 0.5 * self.stop_diameter / self.image_distance

    @property
    def has_quadratic_phase(self) -> bool:
        """Whether the phase is quadratic: a thin lens without aberrations."""
        return self.kind == "thin" and not self.aberrations

    @property
    def has_clear_stop(self) -> bool:
        """Whether the stop is an unobstructed circle."""
        return self.stop == Stop(Circle())


@dataclass(frozen=True)
class Camera:
    """A programmable camera: a panel in front of a lens in front of a sensor.

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
    vibration : float, optional
        Metres by which the image trembles on the sensor along each axis, root mean square. Only the
        simulator uses it and the next.
    vibration_frequency : float, optional
        Hertz; exposures of less than a period are blurred less. By default, every exposure has
        many periods.
    ghosts : tuple of Ghost, optional
        Copies of the picture that reflections within the lens make. Only the simulator uses them.
    focus_drift : float, optional
        Metres by which the image comes to lie farther from the lens than the sensor while lens and
        mount warm up. Only the simulator uses it and the next.
    focus_drift_time : float, optional
        Seconds in which the drift comes within 1/e of its end.

    Raises
    ------
    ValueError
        If a share is outside 0 to 1, ghosts have more than all of the light, the separation is
        negative or infinite, or the lens' relative illumination or distortion isn't known up to the
        sensor's corner.

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
    vibration: float = 0.0
    vibration_frequency: float = math.inf
    ghosts: tuple[Ghost, ...] = ()
    focus_drift: float = 0.0
    focus_drift_time: float = 1800.0

    def __post_init__(self) -> None:
        require_share("transmission", self.transmission)
        require_share("glare", self.glare)
        require_ghosts(self.ghosts)
        if not 0 <= self.vibration < math.inf:
            raise ValueError(f"vibration is {self.vibration:g} m; it is 0 or more, and finite")
        if not self.vibration_frequency > 0:
            raise ValueError(
                f"vibration_frequency is {self.vibration_frequency:g} Hz; it is more than 0 (inf "
                "for many periods in every exposure)"
            )
        self._require_focus_drift()
        separation = as_number(self.separation)
        if not 0 <= separation < math.inf:
            raise ValueError(
                f"separation is {separation:g} m; the panel stands before the lens, 0 m or more"
            )
        require_size("separation", "separation", separation)
        self._require_field_of_lens()

    def _require_focus_drift(self) -> None:
        """Raise ValueError if the focus drifts farther than a lens' can, or in no time."""
        most = MAX_FOCUS_SHIFT_SHARE * as_number(self.lens.image_distance)
        if not abs(self.focus_drift) <= most:
            raise ValueError(
                f"focus_drift is {self.focus_drift:g} m; it is between {-most:.3g} and {most:.3g} m"
            )
        if not 0 < self.focus_drift_time < math.inf:
            raise ValueError(
                f"focus_drift_time is {self.focus_drift_time:g} s; it is more than 0, and finite"
            )

    def _require_field_of_lens(self) -> None:
        """Raise ValueError if the lens' data end within the sensor."""
        corner = math.hypot(*self.sensor.shape) * self.sensor.pitch / 2
        curve = self.lens.relative_illumination
        if curve and curve[-1][0] < corner * (1 - 1e-3):
            raise ValueError(
                f"relative_illumination ends at {curve[-1][0] * 1e3:g} mm, and the sensor's corner "
                f"is {corner * 1e3:.4g} mm from the axis; give the curve up to there"
            )
        by = self.lens.radial_distortion
        if by is not None:
            most = float(by.distorted(np.array(by.fold))) if math.isfinite(by.fold) else math.inf
            if most < corner * 1.02:
                raise ValueError(
                    f"distortion is {list(self.lens.distortion)}; with it the image folds back "
                    f"{most * 1e3:.4g} mm from the axis, and the sensor's corner is at "
                    f"{corner * 1e3:.4g} mm: give k1 and k2 for heights over the image distance"
                )

    def focus_at(self, time: float) -> float:
        """Return how far behind the sensor the image lies `time` seconds after the start, metres.

        A body that warms up comes to its temperature exponentially (Newton's law of cooling), and
        its focus with it. Before the start there is no drift.
        """
        return -self.focus_drift * math.expm1(-max(time, 0.0) / self.focus_drift_time)

    @property
    def ray_matrix_b(self) -> float:
        """The ray-matrix element B: metres on the sensor per unit slope at the panel.

        It is z1 + z2 - z1 z2 / f from panel to sensor (thesis Fig. 5.2), which with the thin-lens
        equation is z2 (1 - z1 / focus_distance): the image distance for a panel at the lens, and
        zero or negative for one in the plane in focus or beyond it.
        """
        lens = self.lens
        return lens.image_distance * (1 - self.separation / lens.focus_distance)

    def magnification(self, distance: float) -> float:
        """Compute the magnification, metres on the sensor per metre at an object.

        It is that along the chief ray, for an object `distance` metres from the panel; 0 for
        ``math.inf``. The image is inverted, but the number is positive.
        """
        return self.lens.image_distance / (distance + self.separation)
