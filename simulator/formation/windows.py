"""The windows of PSFs, and the size that a picture needs for them.

No light goes farther than from the target's outermost point to the outermost pixel: a PSF up to
that distance is as good as a larger one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from optics.camera import Panel
from optics.camera.ghost import ghost_field
from optics.validation import as_number
from simulator.formation.distorting import moved_frame
from simulator.situation import Situation

_FIELD_OPERATIONS = 60.0  # operations per panel pixel from a grey level to a field


def transform_operations(rows: int, columns: int) -> float:
    """Return the operations of one real two-dimensional Fourier transform."""
    samples = rows * columns
    return 2.5 * samples * math.log2(max(samples, 2))


def psf_operations(panel: Panel, down: int, across: int) -> float:
    """Return the operations of one PSF on `down` x `across` samples.

    It takes chirped Fourier transforms of the panel along both axes.
    """
    rows, columns = panel.shape
    along = rows * (columns + across) * math.log2(columns + across)
    upright = across * (rows + down) * math.log2(rows + down)
    return 3 * 5 * (along + upright) + _FIELD_OPERATIONS * rows * columns


def ray_operations(panel: Panel, down: int, across: int) -> float:
    """Return the operations of one geometric PSF on `down` x `across` samples."""
    # 80 operations per ray.
    return (80.0 + _FIELD_OPERATIONS) * panel.shape[0] * panel.shape[1] + down * across


# Pixels beyond the outermost light: detail finer than the samples causes ringing beside it.
_SPARE = 32

# Margin of all pictures whose PSFs need less, as a share of the frame's side. Chosen.
_SHARED_MARGIN = 0.125

# Samples of a picture from which on it may not be larger for the sake of ghosts, which show what
# lies beside the frame, and by how much. Chosen: a larger one takes more memory than it is worth,
# and such ghosts look like veiling glare.
_GHOSTS_LARGE, _GHOSTS_LARGER = 1 << 25, 16.0

# Samples of a picture from which on it may not be larger for the sake of PSFs with all orders,
# and by how much: what is kept of it for other patterns is as much larger. Chosen.
_LARGE, _LARGER = 1 << 22, 2.5

ORDER_FADE_PIXELS = 4.0
"""Sensor pixels over which one diffraction order of the panel fades into the next."""


def light_extent(s: Situation) -> tuple[float, float]:
    """Return how far from the axis a scene's light reaches on the sensor, (y, x) metres.

    It holds for any time of the exposure, and is infinite for endless light.
    """
    y, x = (side + s.image_motion for side in s.picture_probe.extent)
    return y, x


def _field_of_ghosts(s: Situation) -> tuple[float, float]:
    """Return from how far beside the frame ghosts bring light, metres."""
    sensor = s.camera.sensor
    return ghost_field(s.camera.ghosts, [n * sensor.pitch / 2 for n in sensor.shape])


def max_blur_distance(s: Situation) -> tuple[float, float]:
    """Return the largest distance from any light's image to any pixel.

    It is (y, x) metres on the sensor, along the panel's axes.
    """
    sensor, moved = s.camera.sensor, moved_frame(s).reach
    y, x = (
        side + n * sensor.pitch / 2 + max(moved, beside)
        for side, n, beside in zip(light_extent(s), sensor.shape, _field_of_ghosts(s), strict=True)
    )
    if s.mount.is_aligned:
        return y, x
    whole = math.hypot(y, x)
    return whole, whole


@dataclass(frozen=True)
class Windows:
    """Sizes in sensor pixels, (rows, columns).

    psf, side_order: of the PSF around a point's image, and around each side order's centre.
    picture: with its margin. merged_orders: side orders on each side that the PSF around the image
    includes; 0 if they have windows of their own.
    """

    psf: tuple[int, int]
    side_order: tuple[int, int]
    picture: tuple[int, int]
    merged_orders: int = 0


def rendering_windows(
    s: Situation,
    window: int,
    *,
    orders: int = 0,
    wave: bool = True,
    samples: tuple[int, int] = (1, 1),
    ghosts: bool = False,
) -> Windows:
    """Return the windows of PSFs, and the size that the picture needs for them.

    No window is larger than light can go, or than the diffraction orders that it holds. Where the
    panel's orders lie close together, one PSF with all of them takes less work than one for each.
    Raises ValueError for ghosts of so wide a field that the picture would be many times as large.

    window: largest side of a PSF's window, sensor pixels. orders: of the panel on each side. wave:
    whether light is a wave; rays have no orders. samples: of PSFs, and of light, along each axis of
    a pixel, for the work. ghosts: whether the lens' ghosts count, which may bring light from beside
    the frame.
    """
    found = _windows_with(s, window, orders, wave, samples, ghosts)
    if ghosts and any(_field_of_ghosts(s)):
        without = _windows_with(s, window, orders, wave, samples, False)
        larger = math.prod(found.picture) / math.prod(without.picture)
        is_large = samples[1] ** 2 * math.prod(found.picture) > _GHOSTS_LARGE
        if is_large and larger > _GHOSTS_LARGER:
            raise ValueError(
                "ghosts show so much of what lies beside the frame that the picture is "
                f"{larger:.3g} times as large; the virtual bench renders {_GHOSTS_LARGER:g}: give "
                "them a larger magnification or less blur, or count their light as veiling glare"
            )
    return found


def _windows_with(
    s: Situation, window: int, orders: int, wave: bool, samples: tuple[int, int], ghosts: bool
) -> Windows:
    """Return rendering_windows(), whether or not ghosts are too wide."""

    def within_reach(side: int) -> tuple[int, int]:
        """Return a PSF's window of a side: smaller where no light goes so far."""
        pitch = s.camera.sensor.pitch
        # min() comes first, as an infinite distance has no ceil().
        reach = (2 * math.ceil(min(one / pitch, side)) + _SPARE for one in max_blur_distance(s))
        rows, columns = (min(side, one) for one in reach)
        return rows, columns

    def around_image(side: int, merged: int = 0) -> Windows:
        psf = within_reach(side)
        return Windows(psf, psf, _picture_shape(s, psf, ghosts=ghosts), merged)

    if not wave:
        return around_image(window)
    one = min(window, _order_side(s, 0))
    if not orders:
        return around_image(one)
    picture = _picture_shape(s, (one, one), ghosts=ghosts, endless=True)
    apart = Windows(within_reach(one), (one, one), picture)
    merged = around_image(_order_side(s, orders), orders)
    together, each = (samples[1] ** 2 * math.prod(one.picture) for one in (merged, apart))
    if s.camera.separation or together > max(_LARGE, _LARGER * each):
        return apart
    less = _work(s, merged, 0, samples) <= _work(s, apart, orders, samples)
    return merged if less else apart


def _order_side(s: Situation, most: int) -> int:
    """Return the side in pixels of the square that holds a PSF's orders up to `most`."""
    longest, pitch = s.band.whole_support[1], s.camera.sensor.pitch
    period = longest * as_number(s.camera.ray_matrix_b) / s.camera.panel.pitch / pitch
    half = (most + 0.5) * period + ORDER_FADE_PIXELS / 2
    turned = abs(math.cos(s.mount.rotation)) + abs(math.sin(s.mount.rotation))
    return 2 * math.ceil(half * turned) + 2


def _work(s: Situation, windows: Windows, orders: int, samples: tuple[int, int]) -> float:
    """Return the operations of one PSF with its side orders, and of their transforms."""

    def one(sides: tuple[int, int]) -> float:
        return psf_operations(s.camera.panel, *(n * samples[0] for n in sides))

    # Each side order takes a picture that is drawn and transformed, and a transform of its PSF.
    transform = transform_operations(*(n * samples[1] for n in windows.picture))
    others = (2 * orders + 1) ** 2 - 1
    return one(windows.psf) + others * (one(windows.side_order) + 2 * transform) + transform


def _picture_shape(
    s: Situation, sides: tuple[int, int], *, ghosts: bool, endless: bool = False
) -> tuple[int, int]:
    """Return the size of a picture with its margin, (rows, columns) of sensor pixels.

    Light carried periodically around the edges doesn't reach the sensor. sides: of the PSF's
    window. endless: whether light goes on for ever, since a side order may bring any of it.
    """
    sensor, moved = s.camera.sensor, moved_frame(s).reach
    beside = _field_of_ghosts(s) if ghosts else (0.0, 0.0)
    found = []
    for n, side, lit, field in zip(sensor.shape, sides, light_extent(s), beside, strict=True):
        # Distortion, colours and ghosts bring light into the frame from so far beside it.
        frame = n + 2 * math.ceil(max(moved, field) / sensor.pitch)
        # Small windows share a margin, so that other patterns find what is kept of the scene.
        shared = 2 ** math.ceil(math.log2(max(frame * _SHARED_MARGIN, 1)))
        around = (frame + max(side, shared)) / 2
        far = around if endless else min(lit / sensor.pitch, around)
        found.append(max(math.ceil(around + far) + _SPARE, frame, side))
    return found[0], found[1]
