"""Comparison of a described sensor with the camera there: size, bits, clip level, colours."""

from __future__ import annotations

from typing import Any

from labapp.common.errors import UserError
from optics.camera import Sensor

_CLIP_TOLERANCE = 0.02
"""Share of the full scale by which a camera may say that it clips earlier than the file says.
Chosen: a measured full well isn't known better."""


def require_described_camera(camera: Any, sensor: Sensor, source: str) -> None:
    """Raise UserError unless a camera's frames are as the table [sensor] describes them.

    `source` names the bench file. The error says what the file should say.
    """
    require_described_size("camera", camera.shape, sensor.shape, "sensor", source)
    _require_described_numbers(camera, sensor, source)
    _require_described_colours(camera, sensor, source)


def require_described_size(
    role: str, there: tuple[int, int], described: tuple[int, int], part: str, source: str
) -> None:
    """Raise UserError if a device's pixel counts, (rows, columns), differ from those described."""
    if tuple(there) != tuple(described):
        raise UserError(
            f"{source}: [{part}] has {described[1]} x {described[0]} pixels, and the {role} has "
            f"{there[1]} x {there[0]}. Correct the file, or the device's options."
        )


def _require_described_numbers(camera: Any, sensor: Sensor, source: str) -> None:
    """Raise UserError if a camera's largest number isn't the one described."""
    most, described = int(camera.full_scale), 2**sensor.bits - 1
    if (1 - _CLIP_TOLERANCE) * sensor.full_scale <= most <= described:
        return
    bits = most.bit_length()
    if bits == sensor.bits:
        raise UserError(
            f"{source}: the camera's pixels clip at {most}, and by the file at "
            f"{sensor.full_scale}. Write clip_level_dn = {most} in [sensor]."
        )
    scale = 2.0 ** (sensor.bits - bits)
    sent = f" {name}" if (name := _pixel_format(camera)) else ""
    raise UserError(
        f"{source}: [sensor] has bits = {sensor.bits}, numbers up to {described}, and the camera "
        f"sends{sent} numbers up to {most}. Choose a pixel format of {sensor.bits} bits in the "
        f"camera's options; or write bits = {bits} in [sensor], with gain_electrons_per_dn = "
        f"{sensor.gain * scale:.4g} and black_level_dn = {sensor.black_level / scale:.4g} if the "
        "camera scales its numbers, and the old values if it doesn't: labapp devices test camera "
        "measures the black level and where pixels clip."
    )


def _require_described_colours(camera: Any, sensor: Sensor, source: str) -> None:
    """Raise UserError if a camera sends a mosaic that isn't described."""
    try:
        seen = str(camera.bayer)
    except AttributeError:
        return
    if seen and sensor.colour is None:
        raise UserError(
            f"{source}: the camera sends a colour mosaic, {_pixel_format(camera) or seen}, and "
            "[sensor] has no colour filters. Add a table [sensor.colour] with its pattern, or "
            "choose a Mono format in the camera's options."
        )


def _pixel_format(camera: Any) -> str:
    """Return the camera's pixel format, empty where its driver doesn't tell."""
    try:
        return str(camera.pixel_format)
    except AttributeError:
        return ""
