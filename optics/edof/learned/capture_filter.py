"""Filter captures of any size, whose scene goes on beyond the frame, by a decoder's front."""

from __future__ import annotations

import torch

from optics.edof.capture_border import extend_antisymmetrically
from optics.edof.detector_psf import compute_transfer
from optics.edof.learned.wiener_front import WienerFront
from optics.fourier import fast_fft_length, irfft2, rfft2
from optics.plane import centred_crop, centred_pad, origin_to_centre

_LARGEST_PERIOD = 2048
"""Most pixels along a side of one transform; larger captures are filtered in parts.

Chosen: transforms of this size take 35 MB, and little of their result is thrown away."""


class CaptureFilter:
    """Filters captures of any size by the front of a decoder, for one noise level.

    Parameters
    ----------
    front : WienerFront
        The front, on a grid of n x n. Its filter reaches n / 2 pixels to each side.
    noise : float
        Standard deviation of the captures' noise, where white is 1.
    """

    def __init__(self, front: WienerFront, noise: float) -> None:
        self._noise = noise
        response = front.response(torch.tensor([noise]))[0]
        side = int(response.shape[-2])
        self._kernel = origin_to_centre(irfft2(response, (side, side)))
        self._reach = side // 2
        self._kept: dict[tuple[int, int], torch.Tensor] = {}

    @torch.no_grad()
    def __call__(self, capture: torch.Tensor) -> torch.Tensor:
        """Filter a capture (rows, columns), as if its scene went on beyond the frame.

        The capture is extended antisymmetrically, by the filter's reach or its own size.
        """
        shape = (int(capture.shape[0]), int(capture.shape[1]))
        period = tuple(self._extended(n) for n in shape)
        mean = capture.mean()
        whole = extend_antisymmetrically(capture, (period[0], period[1]), self._noise)
        if max(period) <= _LARGEST_PERIOD:
            return centred_crop(self._filter(whole), shape)
        # Beyond the extension is the mean, to which it fades.
        more = (period[0] + 2 * self._reach, period[1] + 2 * self._reach)
        return centred_crop(self._filter_in_parts(centred_pad(whole - mean, more)), shape) + mean

    def _extended(self, length: int) -> int:
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
        """Filter a large picture in overlapping parts, whose outermost pixels are dropped.

        This is the overlap-save method. What lies nearer to the picture's border than the kernel's
        reach isn't computed; it stays 0.
        """
        side, reach = _LARGEST_PERIOD, self._reach
        step = side - 2 * reach
        found = torch.zeros_like(picture)
        rows, columns = picture.shape
        for top in range(0, rows - 2 * reach, step):
            for left in range(0, columns - 2 * reach, step):
                part = picture[top : top + side, left : left + side]
                height, width = part.shape
                padded = torch.nn.functional.pad(part, (0, side - width, 0, side - height))
                middle = self._filter(padded)[reach : height - reach, reach : width - reach]
                found[top + reach : top + height - reach, left + reach : left + width - reach] = (
                    middle
                )
        return found
