"""Compute OTFs of patterns of a quarter or the whole panel, or as an imperfect panel shows them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from optics.edof.field_maps import CosineMatrixMap, CosineTransformMap, FoldedMap, chirp_map
from optics.edof.pattern_transfer import PatternTransfer, binned_phasors
from optics.edof.picture_spectrum import FrequencyGrid
from optics.edof.transfer_design import TransferDesign
from optics.fourier import unit_phasor
from optics.quarter_symmetry import crop_quarter, mirror_quarter, quarter_distances, quarter_shape
from optics.slm.coupling import fringing_field_mean
from optics.validation import require_positive


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

    def __init__(self, design: TransferDesign, dtype: torch.dtype = torch.complex64) -> None:
        panel = design.camera.panel
        if panel.shape[0] % 2 or panel.shape[1] % 2:
            raise ValueError(
                f"the panel has {panel.shape[0]} x {panel.shape[1]} pixels; a quarter needs even "
                "numbers: design a pattern of the whole panel"
            )
        shares, shape = design.open_shares(), quarter_shape(panel.shape)
        quarters = (shares, shares.flip(0), shares.flip(1), shares.flip(0, 1))
        reach, length = design.sample_reach, design.transform_length
        super().__init__(
            design,
            FrequencyGrid(design.size, quarter=True),
            [one.flatten() for one in quarter_distances(panel.shape, (panel.pitch, panel.pitch))],
            torch.stack([crop_quarter(one) for one in quarters]).mean(0),
            CosineTransformMap(shape, reach, length // 2)
            if length
            else CosineMatrixMap(shape, reach, design.step, dtype),
            dtype,
        )
        # The matrix of a symmetric PSF's Fourier sum along an axis, (frequencies, samples). As it
        # is over samples at the pixels' centres, it has all orders that the pixels fold. The
        # imaginary parts of a sample and of its mirror image cancel; a sample beside the middle
        # counts for both.
        _, frequencies = self.grid.frequencies()
        kernel = binned_phasors(frequencies[0], design.sample_positions(), design.binning).real
        kernel[:, 1:] *= 2
        self._cosines = (kernel * design.envelope() * math.sqrt(self._norm)).to(dtype.to_real())

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

        The result is (depths, size, size // 2 + 1), complex, on ``FrequencyGrid(size)``.

        transfer: real OTFs on the quarter of frequencies, (depths, size // 2 + 1, size // 2 + 1).
        dioptres: their depths.
        """
        half = FrequencyGrid(self.design.size)
        fy, fx = half.frequencies()
        rows = torch.arange(half.size)
        mirrored = transfer[..., torch.minimum(rows, half.size - rows), :]
        moved = torch.tensor([self.design.sampled_shift(one) for one in dioptres])
        turns = -(fy + fx) * moved.double()[:, None, None] / self.design.binning
        return mirrored * unit_phasor(turns, self._dtype).to(transfer.device)

    def transfer(self, light: torch.Tensor) -> torch.Tensor:
        kernel = self._cosines.to(light.device)
        return kernel @ light @ kernel.T

    def transfer_adjoint(self, gradient: torch.Tensor) -> torch.Tensor:
        kernel = self._cosines.to(gradient.device)
        return kernel.T @ gradient @ kernel


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
        panel, reach, length = design.camera.panel, design.sample_reach, design.transform_length
        super().__init__(
            design,
            FrequencyGrid(design.size),
            [panel.plane.coordinates(axis) for axis in (0, 1)],
            design.open_shares(),
            FoldedMap(panel.shape, reach, length)
            if length
            else chirp_map(panel.shape, reach, design.step, dtype),
            dtype,
        )
        # The cosine and sine matrices of a PSF's Fourier sum, (frequencies, samples), for those
        # that aren't negative. A sample beside the middle counts for its mirror image too.
        frequencies = torch.fft.rfftfreq(design.size, dtype=torch.float64)
        phasors = binned_phasors(frequencies, design.sample_positions(), design.binning)
        kernel = phasors * design.envelope() * math.sqrt(self._norm)
        kernel[:, 1:] *= 2
        real = dtype.to_real()
        self._kernels = kernel.real.to(real), -kernel.imag.to(real)

    def transfer(self, light: torch.Tensor) -> torch.Tensor:
        # Split into parts that are even or odd along each axis, the sum needs real products of a
        # quarter of the samples and of the frequencies: a third of the work.
        cosine, sine = (one.to(light.device) for one in self._kernels)
        (ee, eo), (oe, oo) = (_parity_parts(part.mT) for part in _parity_parts(light))
        cc, ss = cosine @ ee.mT @ cosine.T, sine @ oo.mT @ sine.T
        sc, cs = sine @ oe.mT @ cosine.T, cosine @ eo.mT @ sine.T
        positive = torch.complex(cc - ss, -(sc + cs))
        negative = torch.complex(cc + ss, sc - cs)
        return torch.cat((positive[:-1], negative[1:].flip(0)))

    def transfer_adjoint(self, gradient: torch.Tensor) -> torch.Tensor:
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
    """Return the even and the odd part along the first axis, from the middle on."""
    reach = len(light) // 2
    after, before = light[reach:], light[: reach + 1].flip(0)
    return (after + before) / 2, (after - before) / 2


def _join_parity(even: torch.Tensor, odd: torch.Tensor) -> torch.Tensor:
    """Apply the transpose of `_parity_parts` to gradients by the even and the odd part."""
    reach = len(even) - 1
    joined = even.new_zeros(2 * reach + 1, even.shape[1])
    joined[reach:] += (even + odd) / 2
    joined[: reach + 1] += (even - odd).flip(0) / 2
    return joined


# Points along a pixel's side at which the blurred phase is taken. Measured for rings of ten foci,
# .6 pixels and jumps of a wave: OTFs are wrong by .4 %; by 4.5 % with one point, and by .02 %
# with three.
_NODES = 2


@dataclass(frozen=True)
class PanelCondition:
    """A condition of a panel in which it shows a pattern.

    coupling: standard deviation by which fringing fields blur the displayed phase, metres; 0 or
        more, and at most the panel's pitch.
    response: factor of the displayed phase, above 0; 1 for a panel that shows what it should.
    """

    coupling: float = 0.0
    response: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.coupling < math.inf:
            raise ValueError(f"coupling is {self.coupling:g} m; choose 0 or more")
        require_positive("response", self.response, "")


class ConditionTransfer:
    """Computes OTFs of displayed patterns on a panel in a condition, for a search.

    It is a `DepthTransfer` of the phase as it is displayed: wrapped as the panel wraps. Raises
    ValueError if the coupling is more than the panel's pitch.

    transfer: computes the OTFs of the panel as it should be.
    """

    def __init__(self, transfer: PatternTransfer, condition: PanelCondition) -> None:
        panel = transfer.design.camera.panel
        if condition.coupling > panel.pitch:
            raise ValueError(
                f"coupling is {condition.coupling:g} m; choose at most the panel's pitch, "
                f"{panel.pitch:g} m"
            )
        self._transfer, self._condition, self.grid = transfer, condition, transfer.grid
        self._sigma = condition.coupling / panel.pitch
        self._side = math.sqrt(panel.fill_factor)
        mirrored = isinstance(transfer, QuarterTransfer)
        # The blur ends within five standard deviations of a pixel's border.
        self._margin = math.ceil(1 + 5 * self._sigma) if mirrored and self._sigma else 0

    def __call__(self, phase: torch.Tensor, dioptres: Sequence[float]) -> torch.Tensor:
        """Compute the OTFs (depths, rows, columns) of a displayed phase, as a `PatternTransfer`."""
        shown = self._condition.response * phase
        if not self._sigma:
            return self._transfer(shown, dioptres)
        return self._transfer.of_field(self.field(shown), dioptres)

    def field(self, shown: torch.Tensor) -> torch.Tensor:
        """Compute the field of each pixel of a shown phase that fringing fields blur, complex."""
        n = self._margin
        wide = shown.to(torch.float32)
        if n:
            wide = torch.cat([wide[:n].flip(0), wide])
            wide = torch.cat([wide[:, :n].flip(1), wide], dim=1)
        return fringing_field_mean(wide, self._sigma, self._side, _NODES)[n:, n:]


def fold_into_range(phase: torch.Tensor, top: float) -> torch.Tensor:
    """Fold a phase back at both ends of a panel's range, so that it is continuous there.

    It stays where it is from 0 to `top`, radians; elsewhere it becomes its mirror image at the
    nearest end. Raises ValueError if `top` isn't positive.
    """
    require_positive("top", top, "rad")
    return top - (torch.remainder(phase, 2 * top) - top).abs()
