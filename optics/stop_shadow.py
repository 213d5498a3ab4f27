"""Compute the lens stop's shadow on a panel that stands before the lens."""

from __future__ import annotations

from dataclasses import replace

from optics.camera import Camera
from optics.plane import Plane
from optics.pupil import open_area
from optics.stop.coverage import coverage
from optics.validation import as_number


def panel_to_focus_distance(camera: Camera) -> float:
    """Return the distance from the camera's panel to the plane in focus, in metres.

    Raises ValueError for a panel in that plane or beyond it: the lens then images the panel's
    pixels, and the light of an object in focus doesn't reach the panel as a spreading wave.
    """
    distance = camera.lens.focus_distance - camera.separation
    if not distance > 0:
        raise ValueError(
            f"separation is {camera.separation:g} m; the panel must stand between the lens and "
            f"the plane in focus, {camera.lens.focus_distance:g} m before it"
        )
    return distance


def with_stop_shadow_on_panel(camera: Camera) -> Camera:
    """Return a camera model whose lens pupil lies on the panel, as large as the stop's shadow.

    Light of a point in focus, d metres before the panel, spreads by the factor
    1 + separation / d on its way to the stop. The light that passes therefore comes from an area
    on the panel that is smaller by this factor. This is geometric optics; diffraction blurs the
    shadow's rim over sqrt(wavelength separation). The returned camera is valid for its panel, its
    stop and their open area, but not for lengths behind the lens. It is the given camera if panel
    and lens are in one plane.

    Raises ValueError under the same conditions as panel_to_focus_distance().
    """
    if not camera.separation:
        return camera
    spread = 1 + camera.separation / panel_to_focus_distance(camera)
    lens = replace(camera.lens, f_number=camera.lens.f_number * spread)
    return replace(camera, lens=lens, separation=0.0)


def share_through_stop(camera: Camera, distance: float, field: tuple[float, float]) -> float:
    """Compute the share of a point's light on the camera's panel that passes the lens.

    This is geometric optics. distance: metres from the point to the panel, math.inf allowed. field:
    metres (y, x) on the sensor from the axis to the point's image. As in a PSF, the share is
    relative to the light that panel and stop would both pass if they stood in one plane.

    The ray through the middle of the lens has the slope field / image distance and meets the
    panel at -separation times this slope, in the middle of the stop's shadow. Light that a
    pattern deflects isn't considered. Raises ValueError for a stop and a panel without common
    area.
    """
    whole = open_area(camera)
    if not whole:
        raise ValueError("the panel and the stop have no area in common; no light passes")
    panel, lens, z1 = camera.panel, camera.lens, as_number(camera.separation)
    radius = as_number(lens.stop_diameter) / 2 / (1 + z1 / distance)
    sides = tuple(n * panel.pitch for n in panel.shape)
    # The origin is at n // 2, so that an even number of pixels isn't centred on it.
    centre = tuple(
        (n % 2 - 1) * panel.pitch / 2 + z1 * f / as_number(lens.image_distance)
        for n, f in zip(panel.shape, field, strict=True)
    )
    one = Plane((1, 1), (sides[0], sides[1]), (centre[0], centre[1]))
    return float(coverage(lens.stop, radius, one)) * sides[0] * sides[1] / whole
