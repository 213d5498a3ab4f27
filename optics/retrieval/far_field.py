"""Transform fields between a panel's pixels and a window of their far field, and back."""

from __future__ import annotations

import torch

from optics.fourier.fft import fft

# Samples of spectra that a round trip processes at once, so that they fit in the cache.
_AT_A_TIME = 1 << 17


def unit_modulus(field: torch.Tensor) -> torch.Tensor:
    """Return a field with its phase and an amplitude of one; zero stays zero."""
    return torch.sgn(field)


def field_intensity(field: torch.Tensor) -> torch.Tensor:
    """Return the intensity ``|u|²`` of a field."""
    return field.real**2 + field.imag**2


class FarField:
    """Transform fields from a panel to a window of its far field of `length` x `length` samples.

    Fields are (…, rows, columns), complex. The window has its origin at n // 2, and the panel at
    the first sample, which doesn't change any modulus. Every FFT runs along contiguous memory, and
    an iteration that only needs the window never stores the panel's field.
    """

    def __init__(self, shape: tuple[int, int], length: int, window: tuple[int, int]) -> None:
        if max(*shape, *window) > length:
            raise ValueError(f"length is {length}; it must hold {shape} and {window} samples")
        self.shape, self.length, self.window = shape, length, window

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        """Transform a field on the panel, (…, rows, columns), to the far-field window."""
        along = self._crop_window(fft(field, self.length, -1), 1)
        return self._crop_window(fft(along.mT.contiguous(), self.length, -1), 0).mT

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Transform a field back from the window to the panel; the adjoint of forward()."""
        along = self._columns_back(field)
        return self._inverse(self._embed_window(along, 1))[..., : self.shape[1]]

    def round_trip(
        self, field: torch.Tensor, amplitude: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Transform a field from the window to the panel, and back with the panel's amplitude.

        The result is forward(amplitude * unit_modulus(adjoint(field))). amplitude: real, (rows,
        columns) of the panel; None is one everywhere.
        """
        frames = field.reshape(-1, *self.window)
        answers = [self._bounce(frame, amplitude) for frame in frames]
        return torch.stack(answers).reshape(field.shape)

    def _bounce(self, field: torch.Tensor, amplitude: torch.Tensor | None) -> torch.Tensor:
        """Do the round trip of one frame, in blocks of panel rows."""
        along = self._columns_back(field)
        rows, columns = self.shape
        picked = along.new_empty(rows, self.window[1])
        step = max(1, _AT_A_TIME // self.length)
        memory = along.new_empty(min(step, rows), self.length)
        for first in range(0, rows, step):
            part = slice(first, min(first + step, rows))
            spectrum = memory[: part.stop - part.start]
            self._embed_window(along[part], 1, spectrum)
            pupil = self._inverse(spectrum)
            modulated = pupil[:, :columns].sgn_()
            if amplitude is not None:
                modulated *= amplitude[part]
            pupil[:, columns:] = 0
            self._crop_window(fft(pupil, self.length, -1, overwrite=True), 1, picked[part])
        return self._crop_window(fft(picked.mT.contiguous(), self.length, -1), 0).mT

    def _columns_back(self, field: torch.Tensor) -> torch.Tensor:
        """Transform the window's field back along its columns, (…, panel rows, window columns)."""
        back = self._inverse(self._embed_window(field.mT.contiguous(), 0))
        return back[..., : self.shape[0]].mT.contiguous()

    def _inverse(self, spectrum: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of the FFT along the last axis of a spectrum."""
        return fft(spectrum, self.length, -1, inverse=True, scaled=False, overwrite=True)

    def _crop_window(
        self, spectrum: torch.Tensor, axis: int, window: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Crop the window from a spectrum's last axis; move its origin to n // 2.

        window: existing memory for the result; None allocates it.
        """
        below, above = self._halves(axis)
        parts = (spectrum[..., self.length - below :], spectrum[..., :above])
        return torch.cat(parts, dim=-1, out=window)

    def _embed_window(
        self, window: torch.Tensor, axis: int, spectrum: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Embed the window in a spectrum of zeros.

        This is the adjoint of _crop_window(). spectrum: existing memory for the result; None
        allocates it.
        """
        below, above = self._halves(axis)
        if spectrum is None:
            spectrum = window.new_empty(*window.shape[:-1], self.length)
        spectrum[..., :above] = window[..., below:]
        spectrum[..., above : self.length - below] = 0
        spectrum[..., self.length - below :] = window[..., :below]
        return spectrum

    def _halves(self, axis: int) -> tuple[int, int]:
        """Count the samples of the window below its origin and from the origin on."""
        below = self.window[axis] // 2
        return below, self.window[axis] - below

    def intensity(self, field: torch.Tensor) -> torch.Tensor:
        """Return the intensity ``|forward(field)|²`` on the window.

        The intensity of a complete far field sums to length² times the sum of |field|².
        """
        return field_intensity(self.forward(field))

    @property
    def samples(self) -> float:
        """Return the number of samples in all FFTs of one round trip."""
        return 2.0 * self.length * (self.shape[0] + self.window[1])
