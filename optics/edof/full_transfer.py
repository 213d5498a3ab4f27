"""Compute OTFs of patterns of the whole panel, pixel by pixel."""

from __future__ import annotations

import math

import torch

from optics.edof.field_maps import ChirpMap, FieldMap, FoldedMap
from optics.edof.frequency_grid import FrequencyGrid
from optics.edof.pattern_transfer import PatternTransfer, binned_phasors
from optics.edof.transfer_design import TransferDesign


class FullTransfer(PatternTransfer):
    """Computes OTFs of any patterns, pixel by pixel.

    The OTF is about the optical axis, complex, on the frequencies of ``FrequencyGrid(size)``.

    Parameters
    ----------
    design : TransferDesign
        The optics.
    dtype : torch.dtype, optional
        complex64 (the default) or complex128.
    """

    def __init__(self, design: TransferDesign, dtype: torch.dtype = torch.complex64) -> None:
        self.shape = design.camera.panel.shape
        self.grid = FrequencyGrid(design.size)
        super().__init__(design, dtype)
        self._kernels = self._plan_kernels()

    def _panel_positions(self, axis: int) -> torch.Tensor:
        return self.design.camera.panel.plane.coordinates(axis)

    def _open_shares(self) -> torch.Tensor:
        return self.design.open_shares()

    def _plan_map(self) -> FieldMap:
        design, length = self.design, self.design.transform_length
        if length:
            return FoldedMap(self.shape, design.sample_reach, length)
        return ChirpMap(self.shape, design.sample_reach, design.step, self._dtype)

    def _plan_kernels(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the cosine and sine matrices of a PSF's Fourier sum, (frequencies, samples).

        They are for frequencies and samples that aren't negative. A sample beside the middle
        counts for its mirror image too.
        """
        design = self.design
        frequencies = torch.fft.rfftfreq(design.size, dtype=torch.float64)
        phasors = binned_phasors(frequencies, design.sample_positions(), design.binning)
        kernel = phasors * design.envelope() * math.sqrt(self._norm)
        kernel[:, 1:] *= 2
        real = self._dtype.to_real()
        return kernel.real.to(real), -kernel.imag.to(real)

    def _transfer(self, light: torch.Tensor) -> torch.Tensor:
        # Split into parts that are even or odd along each axis, the sum needs real products of a
        # quarter of the samples and of the frequencies: a third of the work.
        cosine, sine = (one.to(light.device) for one in self._kernels)
        (ee, eo), (oe, oo) = (_parity_parts(part.mT) for part in _parity_parts(light))
        cc, ss = cosine @ ee.mT @ cosine.T, sine @ oo.mT @ sine.T
        sc, cs = sine @ oe.mT @ cosine.T, cosine @ eo.mT @ sine.T
        positive = torch.complex(cc - ss, -(sc + cs))
        negative = torch.complex(cc + ss, sc - cs)
        return torch.cat((positive[:-1], negative[1:].flip(0)))

    def _transfer_adjoint(self, gradient: torch.Tensor) -> torch.Tensor:
        cosine, sine = (one.to(gradient.device) for one in self._kernels)
        half = self.design.size // 2
        none = gradient.new_zeros(1, gradient.shape[1])
        positive = torch.cat((gradient[:half], none))
        negative = torch.cat((none, gradient[half:].flip(0)))
        ee = cosine.T @ (positive + negative).real @ cosine
        oo = sine.T @ (negative - positive).real @ sine
        oe = sine.T @ (negative - positive).imag @ cosine
        eo = cosine.T @ -(negative + positive).imag @ sine
        even = _join_parity(ee.mT, eo.mT).mT
        odd = _join_parity(oe.mT, oo.mT).mT
        return _join_parity(even, odd)


def _parity_parts(light: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the even and the odd part of a PSF along the first axis, from its middle on."""
    reach = len(light) // 2
    after, before = light[reach:], light[: reach + 1].flip(0)
    return (after + before) / 2, (after - before) / 2


def _join_parity(even: torch.Tensor, odd: torch.Tensor) -> torch.Tensor:
    """Apply the transpose of `_parity_parts` to gradients by a PSF's even and odd part."""
    reach = len(even) - 1
    joined = even.new_zeros(2 * reach + 1, even.shape[1])
    joined[reach:] += (even + odd) / 2
    joined[: reach + 1] += (even - odd).flip(0) / 2
    return joined
