"""Take a panel before a lens as if it stood in the lens, where the error is small enough.

Pixels that the stop's shadow cuts count as dimmer whole ones, whose error is estimated.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import (
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    unreachable_tolerance_error,
)
from optics.camera import Camera, Lens
from optics.camera.pupil import (
    MIN_RAY_MATRIX_B_SHARE,
    Scalar,
    numeric_camera,
    open_area,
    pupil_amplitude,
    vergence_error,
)
from optics.camera.stop import Circle, Point, Polygon, Shape, Stop
from optics.plane import Plane
from optics.psf.chain_engine import search_seconds
from optics.psf.chain_grid import GridEngine
from optics.psf.dim_windows import (
    UNKNOWN_LIGHT,
    AddedLight,
    LowLightCorrection,
    allowed_own_error,
    largest_ratio,
    window_norm,
)
from optics.psf.edge_scatter import window_frequencies
from optics.psf.engine import BehindPanelEngine
from optics.psf.lens_grid import LensGridSearch
from optics.psf.panel_engine import PanelEngine
from optics.psf.request import PSFRequest
from optics.quarter_symmetry import mirror_quarter
from optics.validation import as_number, rounded_up


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
    """Return the radius around the axis of a stop after a shift, and the stop scaled to 1."""
    reach = 1 + (shift[0] ** 2 + shift[1] ** 2) ** 0.5
    if reach == 1:
        return 1.0, stop

    def moved(point: Point) -> Point:
        return (point[0] + shift[0]) / reach, (point[1] + shift[1]) / reach

    shapes: list[Shape] = [
        Circle(shape.radius / reach, moved(shape.centre))
        if isinstance(shape, Circle)
        else Polygon(tuple(map(moved, shape.corners)))
        for shape in (stop.opening, *stop.obscurations)
    ]
    return reach, Stop(shapes[0], tuple(shapes[1:]))


Array = NDArray[np.float64]


_SAMPLES_ACROSS = 12  # across a pixel, at which the stop's shadow is evaluated; chosen
_MOST_PIXELS = 1024  # cut ones that are evaluated, evenly spaced along the edge, for all; chosen


def cut_pixel_error_share(request: PSFRequest, camera: Camera, direct_area: float) -> float:
    """Estimate the share of the window's light that is wrong because of cut panel pixels.

    The shadow leaves the part chi(s) of a pixel of side a open. The pixel then sends the amplitude

        c(g) = 1/a² integral of chi(s) exp(-2 pi i g s) ds

    to the frequency g. The model takes its open area times the envelope sinc(a g) instead. Over all
    frequencies, the energy of the difference is the variance of chi, which is the open share times
    the closed share (Parseval's theorem). Both amplitudes are equal for g = 0, so the difference is
    small in a window at low frequencies: there it is the shift of the light's centre, 2 pi g times
    the first moment of chi. It grows toward the pixel's first zero. Therefore c(g) is computed for
    each pixel at the frequencies that the lens turns from that pixel into the window. The pixels'
    phases are unknown, so their differences add in intensity, as their light does. With a fill
    factor below 1, the open area is that of the whole pixel, gaps included.

    request, camera: of a thin lens in the panel's plane, whose stop is the shadow.
    direct_area: square metres of the panel from which the window is lit, weighted by the light.
    """
    pixel, panel = _find_cut_pixels(camera), camera.panel
    if not len(pixel):
        return 0.0
    q = request.numeric
    some = pixel[:: math.ceil(len(pixel) / _MOST_PIXELS)]
    whole = len(pixel) / len(some) * panel.pitch**2
    place = [panel.plane.coordinates(axis).numpy()[some[:, axis]] for axis in (0, 1)]
    middle = np.stack(place, axis=-1)
    turned = vergence_error(q.lens, q.distance) / q.wavelength * middle
    frequency = window_frequencies(q) - turned[:, None]
    side = panel.active_side
    within = _open_area_transform(camera, middle, side, frequency)
    # With a fill factor of 1, the same samples as in `within` make the difference exactly 0 at
    # frequency 0.
    whole_side = side if panel.fill_factor == 1 else panel.pitch
    open_area = _open_area_transform(camera, middle, whole_side, 0 * frequency).real
    # For a sum over samples, the sinc of an integral over the pixel is divided by that of a sample.
    turns = frequency * side
    envelope = (np.sinc(turns) / np.sinc(turns / _SAMPLES_ACROSS)).prod(axis=-1)
    error = float((np.abs(within - open_area * envelope) ** 2).mean(axis=1).sum()) * whole
    light = float((np.abs(within) ** 2).mean(axis=1).sum()) * whole
    dimmed = float((open_area * envelope**2).mean(axis=1).sum()) * whole
    total = max(direct_area - dimmed, 0.0) + light
    return error / total if total > 0 else math.inf


def _find_cut_pixels(camera: Camera) -> NDArray[np.int64]:
    """Find the row and column of panel pixels that the stop's shadow cuts, (pixels, 2)."""
    panel, radius, half = camera.panel, camera.lens.stop_diameter / 2, camera.panel.pitch / 2
    centres = [panel.plane.coordinates(axis).numpy() for axis in (0, 1)]
    # The boundaries between pixels, in stop radii.
    lines = [np.append(line - half, line[-1] + half) / radius for line in centres]
    found = []
    for piece in (piece for loop in camera.lens.stop.loops for piece in loop.pieces):
        cuts = [piece.crossings(axis, lines[axis]) for axis in (0, 1)]
        t = np.unique(np.concatenate([[0.0], *cuts, [1.0]]))
        at = np.broadcast_arrays(*piece.points((t[1:] + t[:-1]) / 2))
        numbers = [np.searchsorted(line, p) - 1 for line, p in zip(lines, at, strict=True)]
        found.append(np.stack(numbers, axis=-1))
    pixels = np.unique(np.concatenate(found), axis=0)
    inside = (pixels >= 0) & (pixels < np.array(panel.shape))
    return np.asarray(pixels[inside.all(-1)])


def _open_area_transform(
    camera: Camera, middle: Array, side: float, frequency: Array
) -> NDArray[np.complex128]:
    """Average chi(s) exp(-2 pi i f s) over panel pixels, (pixels, frequencies).

    chi is 1 where the stop's shadow leaves the panel open, and 0 elsewhere.

    middle: the pixels' centres, (pixels, 2), metres.
    frequency: (pixels, frequencies, 2), cycles per metre.
    """
    count = _SAMPLES_ACROSS
    inside = ((np.arange(count) + 0.5) / count - 0.5) * side
    y, x = (middle[:, axis, None] + inside for axis in (0, 1))
    radius, stop = camera.lens.stop_diameter / 2, camera.lens.stop
    y, x = y[:, :, None] / radius, x[:, None, :] / radius
    is_open = stop.opening.contains(y, x)
    for shape in stop.obscurations:
        is_open = is_open & ~shape.contains(y, x)
    turns = np.exp(-2j * math.pi * frequency[..., None] * inside)
    light = np.einsum("pyx,pfy,pfx->pf", is_open * 1.0, turns[:, :, 0], turns[:, :, 1])
    return np.asarray(light / count**2)


class CollapsedEngine(BehindPanelEngine):
    """Computes the PSF by one Fourier integral from the panel, with the stop's shadow on it.

    See `collapse_to_thin_camera` for the model. It has two errors. First, it neglects the
    diffraction between the panel and the stop's edge. Second, a panel pixel that the shadow covers
    in part passes light in proportion to its open area, while the real stop cuts the pixel. Both
    errors are estimated (see `StopEdgeScatter` and `cut_pixel_error_share`), and the engine raises
    ToleranceError where they exceed the tolerance. They are added, because both may have the same
    sign.

    mirrored: whether a quarter of a mirrored pattern is given; only where the panel is open.
    """

    name = "collapsed"

    def __init__(
        self,
        request: PSFRequest,
        camera: Camera,
        search: LensGridSearch,
        transform: str | None = None,
        *,
        mirrored: bool = False,
    ) -> None:
        self._request, self._camera, self._search = request, camera, search
        self._mirrored = mirrored
        n, plain = request.numeric, numeric_camera(camera)
        nearest = MIN_RAY_MATRIX_B_SHARE * plain.lens.image_distance
        if not (plain.lens.has_quadratic_phase and plain.ray_matrix_b >= nearest):
            raise ValueError(
                "method is 'collapsed'; it serves thin lenses without aberrations only, whose "
                'panel isn\'t near to the plane in focus; take method="chain"'
            )
        thin = collapse_to_thin_camera(plain, n.distance, n.field)
        if not open_area(thin) > 0:
            raise ToleranceError(
                "the shadow of the stop misses the panel, and light that is bent there doesn't go "
                'through a collapsed camera; take method="chain"'
            )
        is_cut = (request.differentiable or mirrored) and float(pupil_amplitude(thin).min()) < 1
        if is_cut and request.differentiable:
            # The collapsed camera has no derivative of the area that the shadow leaves open.
            raise ToleranceError(
                "the derivatives of a stop whose shadow cuts the panel can't be kept by a "
                'collapsed camera; take method="chain"'
            )
        if is_cut:
            raise ToleranceError("the stop's shadow cuts the panel; the light isn't mirrored")
        edge, self._cut_pixel_error = search.edge_scatter, 0.0
        self._edge_error, self._passing_share = edge.collapse_error()
        inner = _thin_lens_request(request, camera)
        if self._edge_error < n.tol:
            area = edge.direct_area / edge.shadow_magnification**2
            wrong = cut_pixel_error_share(inner, thin, area)
            self._cut_pixel_error = edge.safety_factor * math.sqrt(wrong)
        neglected = self._edge_error + self._cut_pixel_error
        left = n.tol - neglected
        if not left > 0:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept by a collapsed camera: what the stop's edge does to "
                f'the light is worth about {rounded_up(neglected)}; take method="chain"'
            )
        inner = replace(inner, tol=left)
        engine = PanelEngine(inner, thin, transform=transform, mirrored=mirrored)
        self._panel_engine, self.sampling = engine, engine.sampling
        self.precision, self.arithmetic = engine.precision, engine.arithmetic
        self._open_area_ratio = open_area(thin) / open_area(plain)
        self.error = ErrorEstimate(
            engine.error.value + neglected,
            f"{engine.error.how}, and an estimate of the stop's edge for an evenly lit panel",
        )

    @property
    def bytes(self) -> int:
        return self._panel_engine.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._panel_engine.cpu_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return search_seconds(speed) + self._panel_engine.planning_seconds(speed)

    def prepare(self) -> None:
        self._panel_engine.prepare()

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._panel_engine.points()

    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        ratio, beside = self._open_area_ratio, None
        if added is not None and added is not UNKNOWN_LIGHT:
            # Its error isn't the panel engine's, and isn't judged there. Beside light that isn't
            # known yet, the panel engine keeps its tolerance by itself, which costs it little.
            norm = added.norm / ratio
            beside = AddedLight(norm, torch.zeros_like(norm))
        light = self._panel_engine.intensity(phase, amplitude, beside) * ratio
        edge, window = self._search.edge_scatter, self._request.window_slices
        dimness = LowLightCorrection(
            edge,
            window,
            light,
            amplitude,
            lambda: edge.passing_brightness(self._panel_field(phase, amplitude)),
        )
        lost = (
            self._edge_error / dimness.error_divisor(self._passing_share)
            + self._cut_pixel_error / dimness.uniform_error_divisor
        )
        used = self._panel_engine.used_engine
        norm = window_norm(light.detach(), window)
        inner = used.error.value + used.arithmetic
        if beside is not None:
            inner = largest_ratio(inner * torch.hypot(norm, ratio * beside.norm.to(norm)), norm)
        how = "estimate for the light in the window"
        error = self.tell_error(lost + inner, norm, added, used.arithmetic, how)
        self._stand_in = None
        if error <= self._request.tol:
            return light
        allowed_own_error(self._request.tol, norm, added)
        self._stand_in = self._fallback_engine
        return self._stand_in.intensity(phase, amplitude, added)

    def _panel_field(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> torch.Tensor:
        shape = self._camera.panel.shape
        if self._mirrored and phase is not None:
            phase = mirror_quarter(phase, shape)
        factor = self.modulation_factor(phase, amplitude, shape, torch.complex64)
        return torch.ones(shape, dtype=torch.complex64) if factor is None else factor

    @cached_property
    def _fallback_engine(self) -> GridEngine:
        """The engine for windows so dim that light scattered at the stop's edge matters."""
        if self._mirrored:
            raise unreachable_tolerance_error(self._request.tol, self.error.value)
        chain = GridEngine(self._request, self._camera, self._search)
        chain.prepare()
        return chain


def _thin_lens_request(request: PSFRequest, camera: Camera) -> PSFRequest:
    """Convert a request into one for the thin lens at the panel.

    If the point is out of focus, its image moves, because the stop moves to the panel. The ray
    through the panel's middle meets the sensor at the distance -field z1 (1 + z1/d) (1/(d + z1) -
    1/F) from the ray through the middle of the lens.
    """
    thin = collapse_to_thin_camera(camera, request.distance, request.numeric.field)
    # V (1 + z1/d) z1, and 1 + z1/d = (d + z1) / d.
    moved = vergence_error(request.lens, request.object_to_lens_distance)
    moved = moved * request.shadow_magnification * request.separation
    centre = tuple(
        c - f * moved if as_number(f) or isinstance(f, torch.Tensor) else c
        for c, f in zip(request.samples.centre, request.field, strict=True)
    )
    samples = request.samples
    plane = Plane(samples.shape, samples.pitch, (centre[0], centre[1]))
    nothing = (0.0, 0.0)
    return replace(request, lens=thin.lens, samples=plane, separation=0.0, field=nothing)
