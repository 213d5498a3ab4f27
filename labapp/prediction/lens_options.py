"""Parses the lens options of the command line into SI units.

The options are parsed before the slow modules are loaded, so that a mistyped one is reported at
once.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_number, parse_whole, split_list

if TYPE_CHECKING:
    from optics.camera import Camera, Lens
    from optics.camera.stop import Shape, Stop
    from optics.plane import Plane


@dataclass(frozen=True)
class LensCase:
    """A lens, a point object at a distance, and the samples of the PSF, in SI units.

    camera: the camera of the lens; None if the lens is alone.
    interference: strength of the interference of modulated and unmodulated light, which the sum of
    their irradiances leaves out (see optics.polarisation.PathEffect); None if their polarisation
    isn't known.
    """

    lens: Lens
    distance: float
    wavelength: float
    pixels: Plane
    camera: Camera | None = None
    interference: float | None = None

    @property
    def pitch(self) -> float:
        """The column pitch; rows have the same if `is_clear_thin_on_axis`."""
        return self.pixels.pitch[1]

    @property
    def size(self) -> int:
        return self.pixels.shape[1]

    @property
    def is_clear_thin_on_axis(self) -> bool:
        """Whether a clear, thin lens is seen in a square window on the axis."""
        (rows, columns), (py, px) = self.pixels.shape, self.pixels.pitch
        square = rows == columns and py == px and not any(self.pixels.centre)
        return self.lens.has_clear_stop and self.lens.has_quadratic_phase and square

    @property
    def name(self) -> str:
        """The lens, light, object and window in words."""
        lens, pixels = self.lens, self.pixels
        object_, focus = (
            "at infinity" if d == float("inf") else f"at {d:g} m"
            for d in (self.distance, lens.focus_distance)
        )
        rows, columns = pixels.shape
        window = f"{rows}²" if rows == columns else f"{columns}x{rows}"
        words = [
            f"{lens.focal_length * 1e3:g} mm f/{lens.f_number:g}",
            f"{self.wavelength * 1e9:g} nm",
            f"object {object_}",
            f"focus {focus}",
            f"{window} of {pixels.pitch[1] * 1e6:g} µm",
            *_unusual_features(lens),
        ]
        if any(pixels.centre):
            words.append("centre {:g}, {:g} µm".format(*(1e6 * c for c in pixels.centre)))
        return ", ".join(words)


def _unusual_features(lens: Lens) -> list[str]:
    """Name what a plain thin lens with a round stop doesn't have, such as blades or aberrations."""
    from optics.camera.stop import Circle

    words: list[str] = []
    if lens.kind != "thin":
        words.append(lens.kind)
    if not isinstance(lens.stop.opening, Circle):
        words.append(f"{len(lens.stop.opening.corners)} blades")
    if lens.stop.obscurations:
        words.append("obscured")
    words += [f"Z({n}, {m}) {path * 1e9:g} nm" for n, m, path in lens.aberrations]
    return words


def lens_option_defaults(camera: Camera) -> dict[str, float | str]:
    """Return the options that describe a camera's lens, by name and in the options' units."""
    lens = camera.lens
    return {
        "focal_length": lens.focal_length,
        "f_number": lens.f_number,
        "focus": lens.focus_distance,
        "pitch_um": camera.sensor.pitch * 1e6,
        "lens": lens.kind,
    }


def with_panel_in_front(case: LensCase, camera: Camera, given_options: Collection[str]) -> LensCase:
    """Put a camera's panel in front of the lens.

    Opening, obscuration and aberrations are those of the camera's lens, unless `given_options` sets
    them.
    """
    stop, lens = camera.lens.stop, case.lens
    if {"blades", "rectangle"} & set(given_options):
        stop = replace(stop, opening=lens.stop.opening)
    if "obscuration" in given_options:
        stop = replace(stop, obscurations=lens.stop.obscurations)
    bent = lens.aberrations if "zernike" in given_options else camera.lens.aberrations
    lens = replace(lens, stop=stop, aberrations=bent)
    return replace(case, lens=lens, camera=replace(camera, lens=lens))


def read_stop(blades: int, obscuration: float, rectangular: str | None) -> Stop:
    """Parse the options of the aperture stop.

    blades: straight ones; 0 for a round stop.
    obscuration: radius of the central disc that hides part of the stop, in stop radii.
    rectangular: "HEIGHTxWIDTH" in stop diameters.
    """
    if blades and rectangular:
        raise UserError("--blades and --rectangle: a stop is one or the other.")
    sides = _numbers("--rectangle", rectangular, "x", 2) if rectangular else []
    if sides and min(sides) <= 0:
        raise UserError(f"--rectangle {rectangular}: give two positive sides, as in 0.5x0.7.")
    if not 0 <= obscuration < 1:
        raise UserError(f"--obscuration {obscuration:g}: it must lie from 0 to below 1.")
    from optics.camera.stop import Circle, Stop, rectangle, regular_polygon

    opening: Shape = Circle()
    if blades:
        opening = regular_polygon(blades)
    if sides:
        height, width = sides
        opening = rectangle(2 * height, 2 * width)
    return Stop(opening, (Circle(obscuration),) if obscuration else ())


def read_aberrations(texts: Sequence[str]) -> tuple[tuple[int, int, float], ...]:
    """Parse Zernike polynomials with their root mean squares, each "N,M,NANOMETRES"."""
    found = []
    for text in texts:
        n, m, nanometres = _numbers("--zernike", text, ",", 3)
        if n != int(n) or m != int(m):
            raise UserError(f"--zernike {text}: N and M are whole numbers, as in 4,0,25.")
        found.append((int(n), int(m), nanometres * 1e-9))
    return tuple(found)


def read_centre(text: str) -> tuple[float, float]:
    """Parse a window's centre "Y,X" on the sensor, in micrometres; return it in metres."""
    y, x = _numbers("--centre", text, ",", 2)
    return y * 1e-6, x * 1e-6


def read_field(text: str) -> tuple[float, float]:
    """Parse the position "Y,X" of an image on the sensor, in millimetres; return it in metres."""
    y, x = _numbers("--field", text, ",", 2)
    return y * 1e-3, x * 1e-3


def _numbers(option: str, text: str, separator: str, count: int) -> list[float]:
    wanted = f"give {count} numbers with '{separator}' between them"
    try:
        parts = split_list(text) if separator == "," else text.split(separator)
        if len(parts) != count:
            raise UserError(f"{option} {text}: {wanted}.")
        return [parse_number(part) for part in parts]
    except ValueError as error:
        raise UserError(f"{option} {text}: {error}. There, {wanted}.") from error


def read_window(size: int, pitch: float, centre: str) -> Plane:
    """Return the square of `size` pixels around the sensor's point "Y,X" in micrometres."""
    if size < 1:
        raise UserError(f"--size {size}: a window has at least 1 pixel.")
    place = read_centre(centre)
    from optics.plane import Plane

    return Plane((size, size), (pitch, pitch), place)


def read_panel(text: str) -> tuple[tuple[int, int], float]:
    """Parse "ROWSxCOLUMNSxMICROMETRES" into a shape and a pitch in metres."""
    try:
        first, second, last = text.split("x")
        rows, columns, pitch = parse_whole(first), parse_whole(second), parse_number(last, "µm")
        if not (min(rows, columns) >= 1 and pitch > 0):
            raise ValueError
        return (rows, columns), pitch * 1e-6
    except ValueError as error:
        raise UserError(
            f"--panel {text}: give rows, columns and micrometres a pixel, as in 96x128x8."
        ) from error
