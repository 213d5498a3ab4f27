"""Compute OTFs of patterns that are mirrored about the middle of the panel, from a quarter."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.edof.field_maps import CosineMatrixMap, CosineTransformMap, FieldMap
from optics.edof.frequency_grid import FrequencyGrid
from optics.edof.pattern_transfer import PatternTransfer, binned_phasors
from optics.edof.transfer_design import TransferDesign
from optics.fourier import unit_phasor
from optics.quarter_symmetry import (
    crop_quarter,
    mirror_quarter,
    quarter_distances,
    quarter_shape,
)


class QuarterTransfer(PatternTransfer):
    """Computes OTFs of patterns that are mirrored about the middle of the panel, from a quarter.

    The pattern is the quarter of the panel with positive coordinates, from the middle outwards:
    [0, 0] is next to the middle, which lies between pixels. The PSF is symmetric, and its OTF about
    its own middle is real. The middle moves a little with depth; see `on_axis`.

    Parameters
    ----------
    design : TransferDesign
        The optics. The panel has even numbers of rows and columns. The stop is taken to be
        symmetric about its middle, and the four quarters' open shares are averaged.
    dtype : torch.dtype, optional
        complex64 (the default) or complex128.

    Raises
    ------
    ValueError
        If the panel has an odd number of rows or columns.
    """

    _copies = 4

    def __init__(self, design: TransferDesign, dtype: torch.dtype = torch.complex64) -> None:
        rows, columns = design.camera.panel.shape
        if rows % 2 or columns % 2:
            raise ValueError(
                f"the panel has {rows} x {columns} pixels; a quarter needs even numbers: design a "
                "pattern of the whole panel"
            )
        self.shape = quarter_shape(design.camera.panel.shape)
        self.grid = FrequencyGrid(design.size, quarter=True)
        super().__init__(design, dtype)
        self._cosines = self._plan_cosines()

    def mirror(self, quarter: torch.Tensor) -> torch.Tensor:
        """Return the pattern of the whole panel, (rows, columns), from its quarter."""
        return mirror_quarter(quarter, self.design.camera.panel.shape)

    def on_axis(self, transfer: torch.Tensor, dioptres: Sequence[float]) -> torch.Tensor:
        """Return OTFs about the optical axis from those about the PSF's own middle.

        An object's point in the middle of the scene is imaged on the axis, while the middle of the
        panel lies half a pixel beside it, so that the PSF moves with defocus. The factor is exact
        where the pixels fold no order of the OTF onto another; folded orders move by another phase.
        Measured for the thesis' camera and rings of ten foci, whose OTFs are folded: the relative
        L2 error is .03 at .2 dioptres and .4 at 1.9, most of it near the Nyquist frequency; yet
        the criteria of 16 depths differ by .01 dB from those of `FullTransfer`.

        Parameters
        ----------
        transfer : torch.Tensor, (depths, size // 2 + 1, size // 2 + 1)
            Real OTFs on the quarter of frequencies.
        dioptres : sequence of float
            Their depths.

        Returns
        -------
        torch.Tensor, (depths, size, size // 2 + 1), complex
            The OTFs on the frequencies of ``FrequencyGrid(size)``.
        """
        half = FrequencyGrid(self.design.size)
        fy, fx = half.frequencies()
        rows = torch.arange(half.size)
        mirrored = transfer[..., torch.minimum(rows, half.size - rows), :]
        moved = torch.tensor([self.design.sampled_shift(one) for one in dioptres])
        turns = -(fy + fx) * moved.double()[:, None, None] / self.design.binning
        return mirrored * unit_phasor(turns, self._dtype).to(transfer.device)

    def light(self, phase: torch.Tensor, dioptre: float) -> torch.Tensor:
        """Compute a quarter of the PSF about its own middle, of a pattern at one depth.

        Returns
        -------
        torch.Tensor, (samples, samples)
            Light on the samples of `design`, whose [0, 0] is the middle, relative to all light.
        """
        wave = self.wave(self.modulation(phase), dioptre)
        envelope = self.design.envelope().to(wave.real)
        share = self._norm * envelope[:, None] * envelope[None, :]
        return (wave.real.square() + wave.imag.square()) * share

    def _panel_positions(self, axis: int) -> torch.Tensor:
        panel = self.design.camera.panel
        return quarter_distances(panel.shape, (panel.pitch, panel.pitch))[axis].flatten()

    def _open_shares(self) -> torch.Tensor:
        shares = self.design.open_shares()
        quarters = (shares, shares.flip(0), shares.flip(1), shares.flip(0, 1))
        return torch.stack([crop_quarter(one) for one in quarters]).mean(0)

    def _plan_map(self) -> FieldMap:
        design, length = self.design, self.design.transform_length
        if length:
            return CosineTransformMap(self.shape, design.sample_reach, length // 2)
        return CosineMatrixMap(self.shape, design.sample_reach, design.step, self._dtype)

    def _plan_cosines(self) -> torch.Tensor:
        """Return the matrix of a symmetric PSF's Fourier sum along an axis, (frequencies, samples).

        A sample beside the middle counts for its mirror image too. As the sum is over samples at
        the pixels' centres, it has all orders that the pixels fold. For binned pixels each sample
        is shared by the two pixels next to it in the proportion in which squares overlap.
        """
        design = self.design
        _, frequencies = self.grid.frequencies()
        positions = design.sample_positions()
        # The imaginary parts of a sample and of its mirror image cancel.
        kernel = binned_phasors(frequencies[0], positions, design.binning).real
        kernel[:, 1:] *= 2
        return (kernel * design.envelope() * math.sqrt(self._norm)).to(self._dtype.to_real())

    def _transfer(self, light: torch.Tensor) -> torch.Tensor:
        kernel = self._cosines.to(light.device)
        return kernel @ light @ kernel.T

    def _transfer_adjoint(self, gradient: torch.Tensor) -> torch.Tensor:
        kernel = self._cosines.to(gradient.device)
        return kernel.T @ gradient @ kernel
