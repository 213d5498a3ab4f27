"""Find frames that have no noise, or the noise of an earlier frame.

Every light has shot noise: with a full well of W electrons and a full scale of F, a number v has a
standard deviation of at least √(v F / W) (EMVA 1288, release 4.0, eq. 17).
"""

from __future__ import annotations

import hashlib
import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.arrivals import BadFrame
from drivers.aravis.byte_checks import proven_step
from drivers.aravis.pixel_formats import PixelFormat


@dataclass(frozen=True)
class NoiseLimits:
    """Set from when on a frame has too little noise.

    side: rows and columns in the middle of a frame whose noise is looked at. Chosen, for 3 ms a
    frame.
    compared_side: the same for the comparison with earlier frames. Chosen, for 1 ms a frame.
    full_well: electrons of the largest pixels that are expected. Chosen; those of industrial
    cameras have up to 1e5.
    black: share of the full scale up to which a number may be a black level. Chosen.
    bright: share of the full scale from which on a number may be clipped. Chosen.
    quiet: standard deviation from which on noise changes a number in one of 14 cases at least.
    Chosen.
    awaited: pixels that noise must change, from which on none is missed by chance. Chosen.
    missing: share of these pixels up to which noise counts as missing. Chosen.
    loud: standard deviation from which on noise of ±1 can't be rounding. Chosen.
    edge: share of the full scale by which noise hardly bends a line through three pixels. Chosen.
    smooth: share of pixels on a line up to rounding, from which on louder noise is missing. Chosen.
    even: share of pixels on a straight ramp from which on a picture is one. Chosen: a ramp may
    begin again after some 25 pixels, and rounding makes the ramps of dim light uneven.
    lit_pixels: pixels with light that must be there to judge their noise. Chosen.
    noisy_pixels: pixels whose noise is seen in a frame, from which on it can't come twice. Chosen.
    remembered: frames among which a frame must not come again. Chosen; cameras have some buffers.
    """

    side: int = 256
    compared_side: int = 512
    full_well: float = 2e5
    black: float = 0.1
    bright: float = 0.95
    quiet: float = 0.28
    awaited: float = 20.0
    missing: float = 0.1
    loud: float = 1.0
    edge: float = 1 / 16
    smooth: float = 0.95
    even: float = 0.8
    lit_pixels: int = 64
    noisy_pixels: int = 256
    remembered: int = 8


_LIMITS = NoiseLimits()

_REMEDY = "Turn the camera's test patterns off"


class NoiseChecks:
    """Check the noise of one open camera's frames.

    binned: pixels that the camera combines in one, each with a full well of its own.
    """

    def __init__(self, form: PixelFormat, binned: int) -> None:
        self._full, self._binned = form.full_scale, binned
        self._taken: deque[bytes] = deque(maxlen=_LIMITS.remembered)

    def require_noise(self, image: NDArray[np.uint16]) -> None:
        """Raise BadFrame if a frame has less noise than light has."""
        middle = _middle(image, _LIMITS.side)
        words = _ramp(middle) or self._lack_of_noise(middle)
        if words:
            raise BadFrame("impossible", words, _REMEDY)

    def require_new(self, image: NDArray[np.uint16]) -> None:
        """Raise BadFrame if a frame that is to be taken was taken before, noise and all."""
        middle = _middle(image, _LIMITS.compared_side)
        digest = hashlib.blake2b(np.ascontiguousarray(middle).tobytes(), digest_size=16).digest()
        again = digest in self._taken
        self._taken.append(digest)
        if again and self._has_noise(middle):
            raise BadFrame("repeated", "an earlier frame came again, noise and all")

    def _has_noise(self, middle: NDArray[np.uint16]) -> bool:
        lit = self._lit(middle, self._full, _LIMITS.quiet)
        seen = max(np.count_nonzero(bend) for bend in _bends(middle))
        return bool(np.count_nonzero(lit) >= _LIMITS.lit_pixels or seen >= _LIMITS.noisy_pixels)

    def _lit(self, middle: NDArray[np.uint16], full: int, noise: float) -> NDArray[np.bool_]:
        """Return where numbers have at least this standard deviation."""
        least = noise**2 * _LIMITS.full_well * self._binned / full
        return (middle > least + _LIMITS.black * full) & _below_clipping(middle, full)

    def _lack_of_noise(self, middle: NDArray[np.uint16]) -> str:
        """Say that the brighter pixels have no noise; empty if they have."""
        # A converter of fewer bits has larger steps, in which noise is smaller.
        step = min(proven_step(middle), max((self._full + 1) // 256, 1))
        coarse, full = middle // step, self._full // step
        expected = _changing_share(full, self._binned)[coarse] * _below_clipping(coarse, full)
        loud = self._lit(coarse, full, _LIMITS.loud)
        for axis, bend in enumerate(_bends(coarse)):
            inner = np.s_[2:-2] if axis == 0 else np.s_[:, 2:-2]
            # Larger ones are the edges of what is seen.
            small = bend <= _LIMITS.edge * full
            awaited = float(expected[inner][small].sum())
            seen = np.count_nonzero(bend[small & (expected[inner] > 0)])
            straight = bend[small & loud[inner]] <= 1
            if (awaited >= _LIMITS.awaited and seen <= _LIMITS.missing * awaited) or (
                straight.size >= _LIMITS.lit_pixels and straight.mean() >= _LIMITS.smooth
            ):
                words = "its brighter pixels have no noise, and light has: this is a test pattern"
                return f"{words} or a computed picture"
        return ""


def _below_clipping(middle: NDArray[np.uint16], full: int) -> NDArray[np.bool_]:
    """Return where a frame isn't clipped, at the full scale or at a level that isn't told.

    Such a level is the brightest number of a colour.
    """
    below = middle < _LIMITS.bright * full
    for row, column in np.ndindex(2, 2):
        one = (slice(row, None, 2), slice(column, None, 2))
        below[one] &= middle[one] < middle[one].max(initial=0)
    return below


@lru_cache(maxsize=8)
def _changing_share(full: int, binned: int) -> NDArray[np.float32]:
    """Return for each number how often noise changes it at least, by an even light."""
    number = np.arange(full + 1)
    variance = np.maximum(number - _LIMITS.black * full, 0) * full
    noise = np.sqrt(variance / (_LIMITS.full_well * binned))
    # In the middle of a step, it takes half a step: 2 Φ(-0.5 / noise).
    few = np.flatnonzero((noise > 0.1) & (noise < 1))
    share = (noise >= 1) * np.float32(0.6)
    share[few] = [math.erfc(0.5 / (one * math.sqrt(2))) for one in noise[few]]
    return share


def _ramp(middle: NDArray[np.uint16]) -> str:
    """Say that numbers rise evenly from pixel to pixel; empty if they don't."""
    m = middle.astype(np.int32)
    for bend, rise in zip(_bends(middle), (m[2:-2] - m[:-4], m[:, 2:-2] - m[:, :-4]), strict=True):
        even = np.count_nonzero((bend == 0) & (rise != 0))
        if even >= max(_LIMITS.lit_pixels, _LIMITS.even * bend.size):
            return "its numbers rise evenly, without any noise: this is a test pattern"
    return ""


def _middle(image: NDArray[np.uint16], side: int) -> NDArray[np.uint16]:
    """Return the middle of a frame; its first row and column keep a mosaic's colour."""
    rows, columns = (max(0, size - side) // 4 * 2 for size in image.shape)
    return image[rows : rows + side, columns : columns + side]


def _bends(middle: NDArray[np.uint16]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the second differences down and across, without their signs.

    They are between pixels of one colour, and zero along a straight ramp.
    """
    m = middle.astype(np.int32)
    down = np.abs(m[4:] - 2 * m[2:-2] + m[:-4])
    return down, np.abs(m[:, 4:] - 2 * m[:, 2:-2] + m[:, :-4])
