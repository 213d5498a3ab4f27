"""Between a panel's pixels and a window of their far field, there and back, without waste."""

from __future__ import annotations

import torch

from optics.fourier.fft import fft

_AT_A_TIME = 1 << 17
"""Samples of spectra that are bounced at a time: they stay in the processor's cache."""


def unit_modulus(field: torch.Tensor) -> torch.Tensor:
    """The field's phase on amplitude one; zero stays zero."""
    return torch.sgn(field)


class FarField:
    """The Fourier transform from (rows, columns) samples to a window of `length` x `length`.

    The same sums as optics.fourier's pruned FFT, with the first pupil sample as origin instead
    of the middle one, which no modulus sees; arranged so that every FFT runs along contiguous
    memory, and so that an iteration which only wants the window never stores the panel's field.

    Fields are (…, rows, columns), complex64 or complex128. window: (rows, columns), its origin
    at n // 2.
    """

    def __init__(self, shape: tuple[int, int], length: int, window: tuple[int, int]) -> None:
        if max(*shape, *window) > length:
            raise ValueError(f"length is {length}; it must hold {shape} and {window} samples")
        self.shape, self.length, self.window = shape, length, window

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        """From the panel (…, rows, columns) to the window."""
        along = self._crop_window(fft(field, self.length, -1), 1)
        return self._crop_window(fft(along.mT.contiguous(), self.length, -1), 0).mT

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """From the window to the panel: the adjoint of forward()."""
        along = self._columns_back(field)
        return self._inverse(self._embed_window(along, 1))[..., : self.shape[1]]

    def round_trip(
        self, field: torch.Tensor, amplitude: torch.Tensor | None = None
    ) -> torch.Tensor:
        """forward(amplitude * unit(back(field))): what a phase-only panel makes of a field.

        amplitude: real, (rows, columns) of the panel; None is one everywhere.
        """
        frames = field.reshape(-1, *self.window)
        answers = [self._bounce(frame, amplitude) for frame in frames]
        return torch.stack(answers).reshape(field.shape)

    def _bounce(self, field: torch.Tensor, amplitude: torch.Tensor | None) -> torch.Tensor:
        along = self._columns_back(field)
        rows, columns = self.shape
        picked = along.new_empty(rows, self.window[1])
        step = max(1, _AT_A_TIME // self.length)
        memory = along.new_empty(min(step, rows), self.length)
        for first in range(0, rows, step):
            part = slice(first, min(first + step, rows))
            spectrum = memory[: part.stop - part.start]
            self._embed_window(along[part], 1, spectrum)
            pupil = fft(spectrum, self.length, -1, inverse=True, scaled=False, overwrite=True)
            modulated = pupil[:, :columns].sgn_()
            if amplitude is not None:
                modulated *= amplitude[part]
            pupil[:, columns:] = 0
            self._crop_window_into(fft(pupil, self.length, -1, overwrite=True), 1, picked[part])
        return self._crop_window(fft(picked.mT.contiguous(), self.length, -1), 0).mT

    def _columns_back(self, field: torch.Tensor) -> torch.Tensor:
        """From the window to (…, panel rows, window columns), contiguous."""
        back = self._inverse(self._embed_window(field.mT.contiguous(), 0))
        return back[..., : self.shape[0]].mT.contiguous()

    def _inverse(self, spectrum: torch.Tensor) -> torch.Tensor:
        """The adjoint of the FFT along the last axis."""
        return fft(spectrum, self.length, -1, inverse=True, scaled=False, overwrite=True)

    def _crop_window(self, spectrum: torch.Tensor, axis: int) -> torch.Tensor:
        """The window's part of a spectrum's last axis, origin from index 0 to n // 2."""
        below, above = self._halves(axis)
        return torch.cat([spectrum[..., self.length - below :], spectrum[..., :above]], dim=-1)

    def _crop_window_into(self, spectrum: torch.Tensor, axis: int, window: torch.Tensor) -> None:
        """_crop_window() into memory that is there."""
        below, above = self._halves(axis)
        window[..., :below] = spectrum[..., self.length - below :]
        window[..., below:] = spectrum[..., :above]

    def _embed_window(
        self, window: torch.Tensor, axis: int, spectrum: torch.Tensor | None = None
    ) -> torch.Tensor:
        """The spectrum that is zero but for the window, in memory that is there, or new: the
        adjoint of _crop_window()."""
        below, above = self._halves(axis)
        if spectrum is None:
            spectrum = window.new_empty(*window.shape[:-1], self.length)
        spectrum[..., :above] = window[..., below:]
        spectrum[..., above : self.length - below] = 0
        spectrum[..., self.length - below :] = window[..., :below]
        return spectrum

    def _halves(self, axis: int) -> tuple[int, int]:
        """Samples of the window below its origin, and from it on."""
        below = self.window[axis] // 2
        return below, self.window[axis] - below

    def intensity(self, field: torch.Tensor) -> torch.Tensor:
        """|forward(field)|²; over a whole far field its sum is length² times the field's."""
        far = self.forward(field)
        return far.real**2 + far.imag**2

    @property
    def samples(self) -> float:
        """Samples of all the FFTs of one bounce."""
        return 2.0 * self.length * (self.shape[0] + self.window[1])
