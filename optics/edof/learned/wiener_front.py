"""Linear filters before a network, for captures of any size and many noise levels."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.edof.decoders import extend_antisymmetrically
from optics.edof.protocol_psfs import compute_transfer
from optics.edof.spectral_criterion import LEAST_NOISE, mean_transfer, noise_variance
from optics.fourier import fast_fft_length, irfft2, rfft2
from optics.plane import centred_crop, origin_to_centre
from optics.validation import require_finite


class WienerFront:
    """Filters captures by the linear filter of least expected error over depths.

    The filter is that of `optics.edof.spectral_criterion.blind_filter`. What it takes from the
    transfer functions is computed once, for all noise levels.

    Parameters
    ----------
    mean : torch.Tensor, (..., n, n // 2 + 1), complex
        Mean transfer function over the depths.
    power : torch.Tensor, (..., n, n // 2 + 1)
        Mean of its squared modulus.
    spectrum : torch.Tensor, (n, n // 2 + 1)
        Power spectrum of the pictures.
    """

    def __init__(self, mean: torch.Tensor, power: torch.Tensor, spectrum: torch.Tensor) -> None:
        self.mean, self.power, self.spectrum = mean, power, spectrum.to(power)

    @classmethod
    def of_transfers(cls, transfer: torch.Tensor, spectrum: torch.Tensor) -> WienerFront:
        """Return one filter for all depths of transfer functions, (depths, n, n // 2 + 1)."""
        mean, power = mean_transfer(transfer)
        return cls(mean.to(torch.complex64), power.to(torch.float32), spectrum)

    @classmethod
    def of_known_depths(cls, transfer: torch.Tensor, spectrum: torch.Tensor) -> WienerFront:
        """Return a filter for each capture's transfer function, (captures, n, n // 2 + 1)."""
        return cls(transfer, transfer.real.square() + transfer.imag.square(), spectrum)

    def response(self, noise: torch.Tensor) -> torch.Tensor:
        """Return the filters (captures, n, n // 2 + 1) for captures of some noise levels.

        The noise levels, (captures,), are relative to white. The mean of a picture is kept.
        """
        variance = noise.to(self.power).clamp(min=LEAST_NOISE).square()[:, None, None]
        filters = self.spectrum * self.mean.conj() / (self.spectrum * self.power + variance)
        at_zero = torch.zeros_like(self.spectrum, dtype=torch.bool)
        at_zero[0, 0] = True
        inverse = 1 / torch.where(at_zero, self.mean, torch.ones_like(self.mean))
        return torch.where(at_zero, inverse, filters)

    def __call__(self, captures: torch.Tensor, noise: torch.Tensor) -> torch.Tensor:
        """Filter captures (captures, 1, n, n) of some noise levels, (captures,); periodic."""
        shape = (int(captures.shape[-2]), int(captures.shape[-1]))
        return irfft2(rfft2(captures) * self.response(noise)[:, None], shape)


# Most pixels along a side of one transform; larger captures are filtered in parts.
#
# Chosen: transforms of this size take 600 MB. Measured on 3000 x 4096 pixels: one transform takes
# 0.7 s, and parts of 2048 pixels 1.6 s, with as much memory.
_LARGEST_PERIOD = 6144


class CaptureFilter:
    """Filters captures of any size by a `WienerFront`, for one noise level.

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
        """Return the parts of an axis of a picture, one if all of it fits one transform.

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


@dataclass(frozen=True, eq=False)
class DepthStatistics:
    """Means over depth, of which a front follows for any share of unmodulated light.

    The unmodulated light adds to the modulated as if incoherent (thesis section 5.6): with a share
    u, a transfer function is (1 - u) H + u H0, where H0 is that of a flat pattern. Its mean and its
    mean squared modulus over depths follow from those of H and H0, and from the mean of Re(H H0*),
    the product. All are (n, n // 2 + 1), as the power spectrum of the pictures.
    """

    mean: torch.Tensor
    power: torch.Tensor
    flat_mean: torch.Tensor
    flat_power: torch.Tensor
    product: torch.Tensor
    spectrum: torch.Tensor

    @classmethod
    def of_transfers(
        cls, transfers: torch.Tensor, flat: torch.Tensor, spectrum: torch.Tensor
    ) -> DepthStatistics:
        """Compute the means over depths of a pattern's and a flat one's transfer functions."""
        mean, power = mean_transfer(transfers)
        flat_mean, flat_power = mean_transfer(flat)
        product = (transfers * flat.conj()).real.double().mean(0)
        return cls(
            mean.to(torch.complex64),
            power.float(),
            flat_mean.to(torch.complex64),
            flat_power.float(),
            product.float(),
            spectrum.to(product.device, torch.float32),
        )

    def front(self, shares: torch.Tensor) -> WienerFront:
        """Return the front for captures with some shares of unmodulated light, (captures,)."""
        kept, added = (one.to(self.power)[:, None, None] for one in (1 - shares, shares))
        return WienerFront(
            kept * self.mean + added * self.flat_mean,
            kept**2 * self.power + 2 * kept * added * self.product + added**2 * self.flat_power,
            self.spectrum,
        )


def add_unmodulated_light(
    transfers: torch.Tensor, flat: torch.Tensor, shares: torch.Tensor | float
) -> torch.Tensor:
    """Return transfer functions of a pattern with shares of unmodulated light added.

    transfers, flat: (..., n, n // 2 + 1), of the pattern and of a flat one at the same depths.
    shares: from 0 to 1, a number or (...).
    """
    if isinstance(shares, torch.Tensor):
        shares = shares.to(transfers.real)[..., None, None]
    return (1 - shares) * transfers + shares * flat
