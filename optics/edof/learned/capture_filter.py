"""Filter captures of any size, whose scene goes on beyond the frame, by a decoder's front."""

from __future__ import annotations

import torch

from optics.edof.capture_border import extend_antisymmetrically
from optics.edof.detector_psf import compute_transfer
from optics.edof.learned.wiener_front import WienerFront
from optics.edof.spectral_criterion import noise_variance
from optics.fourier import fast_fft_length, irfft2, rfft2
from optics.plane import centred_crop, origin_to_centre
from optics.validation import require_finite

_LARGEST_PERIOD = 6144
"""Most pixels along a side of one transform; larger captures are filtered in parts.

Chosen: transforms of this size take 600 MB. Measured on 3000 x 4096 pixels: one transform takes
0.7 s, and parts of 2048 pixels 1.6 s, with as much memory."""


class CaptureFilter:
    """Filters captures of any size by the front of a decoder, for one noise level.

    Parameters
    ----------
    front : WienerFront
        The front, on a grid of n x n. Its filter reaches n / 2 pixels to each side.
    noise : float
        Standard deviation of the captures' noise, where white is 1.

    Raises
    ------
    ValueError
        If the noise is negative or isn't finite.
    """

    def __init__(self, front: WienerFront, noise: float) -> None:
        noise_variance(noise)
        self._noise = noise
        response = front.response(torch.tensor([noise]))[0]
        side = int(response.shape[-2])
        self._kernel = origin_to_centre(irfft2(response, (side, side)))
        self._reach = side // 2
        self._kept: dict[tuple[int, int], torch.Tensor] = {}

    @torch.no_grad()
    def __call__(self, capture: torch.Tensor) -> torch.Tensor:
        """Filter a capture (rows, columns), as if its scene went on beyond the frame.

        The capture is extended antisymmetrically, by the filter's reach or its own size. Raises
        ValueError if it isn't finite.
        """
        require_finite("capture", capture)
        shape = (int(capture.shape[0]), int(capture.shape[1]))
        period = (self._extended_length(shape[0]), self._extended_length(shape[1]))
        whole = extend_antisymmetrically(capture, period, self._noise)
        if max(period) <= _LARGEST_PERIOD:
            return centred_crop(self._filter(whole), shape)
        return centred_crop(self._filter_in_parts(whole), shape)

    def _extended_length(self, length: int) -> int:
        """Return the pixels of a side of the extension of a capture with `length` pixels."""
        least = min(2 * length - 2, length + self._reach)
        side = min(fast_fft_length(max(least, length)), 2 * length)
        return max(side - side % 2, length)

    def _filter(self, picture: torch.Tensor) -> torch.Tensor:
        """Filter a periodic picture by the front's kernel."""
        shape = (int(picture.shape[0]), int(picture.shape[1]))
        if shape not in self._kept:
            self._kept = {shape: compute_transfer(self._kernel, shape)}
        return irfft2(rfft2(picture) * self._kept[shape], shape)

    def _filter_in_parts(self, picture: torch.Tensor) -> torch.Tensor:
        """Filter a large periodic picture in overlapping parts, whose outermost pixels are dropped.

        This is the overlap-save method. The result is that of one transform, apart from rounding.
        """
        rows, columns = (self._parts(n) for n in picture.shape)
        found = torch.empty_like(picture)
        for above, own_rows, inner_rows in rows:
            for beside, own_columns, inner_columns in columns:
                filtered = self._filter(picture[above[:, None], beside])
                found[own_rows, own_columns] = filtered[inner_rows, inner_columns]
        return found

    def _parts(self, length: int) -> list[tuple[torch.Tensor, slice, slice]]:
        """Return the parts of an axis of a large picture: all that fits one transform is one part.

        Of each part: the pixels that are transformed, those of the picture that it gives, and where
        they lie in it.
        """
        side, reach = _LARGEST_PERIOD, self._reach
        if length <= side:
            return [(torch.arange(length), slice(0, length), slice(0, length))]
        step, found = side - 2 * reach, []
        for start in range(0, length, step):
            count = min(step, length - start)
            pixels = torch.arange(start - reach, start - reach + side) % length
            found.append((pixels, slice(start, start + count), slice(reach, reach + count)))
        return found
