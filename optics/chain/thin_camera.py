"""Replace a camera whose panel stands before the lens by one with a thin lens at the panel."""

from __future__ import annotations

from dataclasses import replace

from optics.camera import Camera, Lens
from optics.pupil import Scalar
from optics.stop.aperture import Circle, Point, Polygon, Shape, Stop


def collapse_to_thin_camera(
    camera: Camera, distance: Scalar, field: tuple[Scalar, Scalar] = (0.0, 0.0)
) -> Camera:
    """Return a camera with a thin lens at the panel that gives the same intensity as the chain.

    distance: metres from the object to the panel. field: metres (y, x) on the sensor from the
    axis to its image.

    The ray matrix from panel to sensor is

        (1 z2; 0 1) (1 0; -1/f 1) (1 z1; 0 1) = (A B; C D),
        A = 1 - z2/f,    B = z1 + z2 - z1 z2 / f,

    and the whole propagation is one Fresnel integral from the panel (Collins 1970,
    10.1364/JOSA.60.001168),

        U(u) = 1 / (i lambda B) integral of U0(s) exp(i pi (A s² - 2 s u + D u²) / (lambda B)) ds.

    A thin lens at the panel with the image distance B has A' = 1 - B/f'. It gives the same
    intensity if A' = A, so 1/f' = (1 - A) / B. With the thin-lens equation z2/f = 1 + z2/F, for the
    focus distance F from the lens, it follows that

        B = z2 (1 - z1/F),    F' = -B/A = F - z1.

    So the plane in focus stays where it is. The stop becomes its geometric shadow on the panel, for
    light from the object: narrower by the factor 1 + z1/distance, and moved by -field z1 / z2.

    The thesis' equations have slips: the modulations in Eq. 5.3 and 5.5 are exp(i phase), the
    lens' phase in Eq. 5.5 is -pi (x'² + y'²) / (lambda f), and the distance in Eq. 5.6 is z2.

    Raises ValueError for a lens with aberrations or a stigmatic lens, because their waves aren't
    parabolas, and for a panel in the plane in focus or beyond it.
    """
    lens, z1 = camera.lens, camera.separation
    if not lens.has_quadratic_phase:
        raise ValueError(
            f"the lens is {lens.kind} with {len(lens.aberrations)} aberrations; only a thin lens "
            "without any collapses with the space before it"
        )
    if not camera.ray_matrix_b > 0:
        raise ValueError(
            f"separation is {float(z1):g} m and the lens is focused {float(lens.focus_distance):g} "
            "m before it; a panel in the plane in focus or beyond it has no thin lens' place"
        )
    if not z1:
        return camera
    image, focus = camera.ray_matrix_b, lens.focus_distance - z1
    focal_length = 1 / (1 / image + 1 / focus)
    radius = lens.stop_diameter / 2 / (1 + z1 / distance)
    shift = tuple(float(-f * z1 / lens.image_distance / radius) for f in field)
    reach, stop = _shift_stop(lens.stop, (shift[0], shift[1]))
    thin = Lens(focal_length, focal_length / (2 * radius * reach), focus, stop)
    return replace(camera, lens=thin, separation=0.0)


def _shift_stop(stop: Stop, shift: Point) -> tuple[float, Stop]:
    """Shift the stop of a collapsed chain, and scale it to a radius of 1 around the axis.

    Returns the radius before scaling, and the stop. Lengths are in stop radii.
    """
    reach = 1 + (shift[0] ** 2 + shift[1] ** 2) ** 0.5
    if reach == 1:
        return 1.0, stop
    opening = _shift_and_scale_shape(stop.opening, shift, reach)
    return reach, Stop(
        opening, tuple(_shift_and_scale_shape(shape, shift, reach) for shape in stop.obscurations)
    )


def _shift_and_scale_shape(shape: Shape, shift: Point, scale: float) -> Shape:
    if isinstance(shape, Circle):
        centre = tuple((c + s) / scale for c, s in zip(shape.centre, shift, strict=True))
        return Circle(shape.radius / scale, (centre[0], centre[1]))
    return Polygon(
        tuple(((y + shift[0]) / scale, (x + shift[1]) / scale) for y, x in shape.corners)
    )
