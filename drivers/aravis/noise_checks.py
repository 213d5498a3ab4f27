"""Find frames of a camera that have no noise, or the noise of an earlier frame.

Every light has shot noise: with a full well of W electrons and a full scale of F, a number v has a
standard deviation of at least √(v F / W) (EMVA 1288, release 4.0, eq. 17).
"""

from __future__ import annotations

import hashlib
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.arrivals import BadFrame
from drivers.aravis.byte_checks import proven_step
from drivers.aravis.pixel_formats import PixelFormat


@dataclass(frozen=True)
class NoiseLimits:
    """Set from when on a frame has too little noise.

    Attributes
    ----------
    side : int
        Rows and columns in the middle of a frame that are looked at. Chosen, for 2 ms a frame.
    full_well : float
        Electrons of the largest pixels that are expected. Chosen; those of industrial cameras have
        up to 1e5.
    black : float
        Share of the full scale up to which a number may be a black level. Chosen.
    bright : float
        Share of the full scale from which on a number may be clipped. Chosen.
    quiet : float
        Standard deviation from which on noise shows: a number that lies in the middle of a step
        changes with a probability of 2 Φ(-0.5 / 0.28) = 7 %.
    loud : float
        Standard deviation from which on noise of ±1 can't be rounding. Chosen.
    edge : float
        Share of the full scale by which noise hardly bends a line through three pixels. Chosen.
    smooth : float
        Share of pixels without noise from which on a picture has none. Chosen; noise of `quiet`
        leaves 80 %.
    even : float
        Share of pixels on a straight ramp from which on a picture is one. Chosen: a ramp may begin
        again after some 25 pixels, and rounding makes the ramps of dim light uneven.
    lit_pixels : int
        Pixels with light that must be there to judge their noise. Chosen.
    noisy_pixels : int
        Pixels whose noise is seen in a frame, from which on it can't come twice. Chosen.
    remembered : int
        Number of frames among which a frame must not come again. Chosen; cameras have some buffers.
    """

    side: int = 512
    full_well: float = 2e5
    black: float = 0.1
    bright: float = 0.95
    quiet: float = 0.28
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
    """Check the noise of one open Aravis camera's frames.

    binned: pixels that the camera combines in one, each with a full well of its own.
    """

    def __init__(self, form: PixelFormat, binned: int) -> None:
        self._full, self._binned = form.full_scale, binned
        self._seen: deque[bytes] = deque(maxlen=_LIMITS.remembered)

    def require_noise(self, image: NDArray[np.uint16]) -> None:
        """Raise BadFrame if an Aravis frame has no noise, or that of one of the last frames."""
        middle = _middle(image)
        words = _ramp(middle) or self._lack_of_noise(middle)
        if words:
            raise BadFrame("impossible", words, _REMEDY)
        digest = hashlib.blake2b(np.ascontiguousarray(middle).tobytes(), digest_size=16).digest()
        again = digest in self._seen
        self._seen.append(digest)
        if again and self._has_noise(middle):
            raise BadFrame("repeated", "an earlier frame came again, noise and all")

    def _has_noise(self, middle: NDArray[np.uint16]) -> bool:
        lit = self._lit(middle, self._full, _LIMITS.quiet)
        seen = max(np.count_nonzero(bend) for bend in _bends(middle))
        return bool(np.count_nonzero(lit) >= _LIMITS.lit_pixels or seen >= _LIMITS.noisy_pixels)

    def _lit(self, middle: NDArray[np.uint16], full: int, noise: float) -> NDArray[np.bool_]:
        """Return where an Aravis frame's numbers have at least this standard deviation."""
        least = noise**2 * _LIMITS.full_well * self._binned / full
        return (middle > least + _LIMITS.black * full) & (middle < _LIMITS.bright * full)

    def _lack_of_noise(self, middle: NDArray[np.uint16]) -> str:
        """Return that the brighter pixels of an Aravis frame have no noise; or nothing."""
        # A converter of fewer bits has larger steps, in which noise is smaller.
        step = min(proven_step(middle), max((self._full + 1) // 256, 1))
        coarse, full = middle // step, self._full // step
        for noise, most in ((_LIMITS.quiet, 0), (_LIMITS.loud, 1)):
            lit = self._lit(coarse, full, noise)
            inner = (lit[4:] & lit[:-4], lit[:, 4:] & lit[:, :-4])
            for bend, both in zip(_bends(coarse), inner, strict=True):
                # Larger ones are the edges of what is seen.
                judged = bend[both & (bend <= _LIMITS.edge * full)]
                count = judged.size
                if count < _LIMITS.lit_pixels:
                    continue
                if np.count_nonzero(judged <= most) >= _LIMITS.smooth * count:
                    return (
                        f"its {count} brighter pixels have no noise, and light has: this is a test "
                        "pattern or a computed picture"
                    )
        return ""


def _ramp(middle: NDArray[np.uint16]) -> str:
    """Return that an Aravis frame rises evenly from pixel to pixel; or nothing."""
    m = middle.astype(np.int32)
    for bend, rise in zip(_bends(middle), (m[2:-2] - m[:-4], m[:, 2:-2] - m[:, :-4]), strict=True):
        even = np.count_nonzero((bend == 0) & (rise != 0))
        if even >= max(_LIMITS.lit_pixels, _LIMITS.even * bend.size):
            return "its numbers rise evenly, without any noise: this is a test pattern"
    return ""


def _middle(image: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return the middle of an Aravis frame; its first row and column keep a mosaic's colour."""
    rows, columns = (max(0, size - _LIMITS.side) // 4 * 2 for size in image.shape)
    return image[rows : rows + _LIMITS.side, columns : columns + _LIMITS.side]


def _bends(middle: NDArray[np.uint16]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the second differences of an Aravis frame down and across, without their signs.

    They are between pixels of one colour, and zero along a straight ramp.
    """
    m = middle.astype(np.int32)
    down = np.abs(m[4:] - 2 * m[2:-2] + m[:-4])
    return down, np.abs(m[:, 4:] - 2 * m[:, 2:-2] + m[:, :-4])
