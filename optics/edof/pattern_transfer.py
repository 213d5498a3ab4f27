"""Compute OTFs of patterns at many depths, with gradients, at the memory of one wave at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Protocol

import torch

from optics.edof.dioptres import require_dioptres
from optics.edof.field_maps import FieldMap
from optics.edof.picture_spectrum import FrequencyGrid
from optics.edof.transfer_design import TransferDesign
from optics.fourier import unit_phasor
from optics.fourier.differentiation import apply_function, differentiate_once
from optics.psf.phase_factor import phase_factor
from optics.threads import in_full_precision


class DepthTransfer(Protocol):
    """Anything that computes OTFs at depths on a grid of frequencies."""

    @property
    def grid(self) -> FrequencyGrid:
        """The frequencies of the OTFs."""

    def __call__(self, phase: torch.Tensor, dioptres: Sequence[float]) -> torch.Tensor:
        """Compute the OTFs (depths, rows, columns) of a phase at depths in dioptres."""


class PatternTransfer(ABC):
    """The OTFs of patterns of one kind, at any depths.

    The light is relative to all light that leaves the panel through the stop, so that an OTF at
    zero frequency is the share of light in the window. Light beyond the window is lost. The light's
    density at the samples stands for that on whole pixels; where its fringes are finer than pixels,
    the samples' sum may exceed 1 a little (.1 % was seen).
    """

    design: TransferDesign
    grid: FrequencyGrid
    """The frequencies of the OTFs, for criteria and spectra."""
    shape: tuple[int, int]
    """(rows, columns) of a pattern."""

    def __init__(
        self,
        design: TransferDesign,
        grid: FrequencyGrid,
        positions: Sequence[torch.Tensor],
        open_shares: torch.Tensor,
        field_map: FieldMap,
        dtype: torch.dtype,
    ) -> None:
        """Take what is the same for all depths.

        positions: those of a pattern's pixels along both axes, metres, float64.
        open_shares: open share of each of a pattern's pixels.
        field_map: the map from the panel's wave to the sensor's.
        """
        self.design, self.grid, self._dtype = design, grid, dtype
        self.shape = (open_shares.shape[0], open_shares.shape[1])
        self._positions, self._map = positions, field_map
        whole = bool((open_shares == 1).all())
        self._amplitude = None if whole else open_shares.to(dtype.to_real())
        copies = 4 if grid.quarter else 1
        self._norm = design.step**2 / (float(open_shares.square().sum()) * copies)

    @abstractmethod
    def transfer(self, light: torch.Tensor) -> torch.Tensor:
        """Compute the OTF from the light ``|wave|²`` at the samples."""

    @abstractmethod
    def transfer_adjoint(self, gradient: torch.Tensor) -> torch.Tensor:
        """Compute the gradient by the light at the samples from that by the OTF."""

    @in_full_precision
    def __call__(self, phase: torch.Tensor, dioptres: Sequence[float]) -> torch.Tensor:
        """Compute the OTFs of a pattern at depths.

        They are (depths, rows, columns), on the frequencies of `grid`. Raises ValueError if the
        pattern has another shape, a depth is negative or isn't finite, or there is none.

        phase: radians on the panel's pixels, unwrapped or wrapped. The result is differentiable in
            it, once. Where it isn't finite, neither are the OTFs, so that a search can skip a
            broken step.
        """
        self._require_suitable("phase", phase, dioptres)
        return apply_function(_DepthTransfer, phase, False, self, tuple(dioptres))

    @in_full_precision
    def of_field(self, field: torch.Tensor, dioptres: Sequence[float]) -> torch.Tensor:
        """Compute the OTFs at depths behind pixels whose field is known, as a call does.

        field: field of each pixel where light of amplitude 1 falls on it, without the stop; (rows,
            columns), complex. The result is differentiable in it, once.
        """
        self._require_suitable("field", field, dioptres)
        open_field = field.to(self._dtype)
        if self._amplitude is not None:
            open_field = open_field * self._amplitude.to(field.device)
        return apply_function(_DepthTransfer, open_field, True, self, tuple(dioptres))

    def _require_suitable(self, name: str, pixels: torch.Tensor, dioptres: Sequence[float]) -> None:
        """Raise ValueError unless a pattern has the right shape and the depths are valid."""
        require_dioptres("dioptres", dioptres)
        if tuple(pixels.shape) != self.shape:
            raise ValueError(
                f"{name} is {tuple(pixels.shape)}; this pattern has {self.shape} pixels"
            )

    def modulation(self, phase: torch.Tensor) -> torch.Tensor:
        """Compute the complex modulation of the pixels, with the stop's open shares."""
        phasor = phase_factor(phase, self._dtype)
        return phasor if self._amplitude is None else phasor * self._amplitude.to(phasor.device)

    def _defocus(self, dioptre: float, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
        """Compute the defocus phasors of an object's depth along both axes."""
        column, row = (
            unit_phasor(self.design.defocus_turns(dioptre, one), self._dtype).to(device)
            for one in self._positions
        )
        return column[:, None], row[None, :]

    def wave(self, modulation: torch.Tensor, dioptre: float) -> torch.Tensor:
        """Compute the wave on the sensor's samples behind a modulation at one depth."""
        column, row = self._defocus(dioptre, modulation.device)
        return self._map((modulation * row).mul_(column))

    def wave_adjoint(self, wave: torch.Tensor, dioptre: float) -> torch.Tensor:
        """Apply the conjugate transpose of `wave`."""
        column, row = self._defocus(dioptre, wave.device)
        return (self._map.adjoint(wave) * row.conj()).mul_(column.conj())


class _DepthTransfer(torch.autograd.Function):
    """The autograd function of the OTFs of a phase, or of a panel's field, at depths.

    Of each depth the wave in the window is kept for the gradient, which is a tenth of the memory
    that automatic differentiation would keep. The gradients of all depths by the modulation are
    added up before they become one by the phase.
    """

    @staticmethod
    def forward(
        ctx: Any,
        pixels: torch.Tensor,
        is_field: bool,
        transfer: PatternTransfer,
        dioptres: tuple[float, ...],
    ) -> torch.Tensor:
        modulation = pixels.detach() if is_field else transfer.modulation(pixels.detach())
        ctx.is_field, ctx.transfer, ctx.dioptres, ctx.waves = is_field, transfer, dioptres, []
        ctx.save_for_backward(pixels, modulation)
        found = []
        for one in dioptres:
            wave = transfer.wave(modulation, one)
            found.append(transfer.transfer(wave.real.square() + wave.imag.square()))
            if ctx.needs_input_grad[0]:
                ctx.waves.append(wave)
        return torch.stack(found)

    @staticmethod
    # torch runs this with the precision of whoever asks for gradients, inside autocast or not.
    @in_full_precision
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        pixels, modulation = ctx.saved_tensors
        total: torch.Tensor | None = None
        for one, wave, by_transfer in zip(ctx.dioptres, ctx.waves, gradient.detach(), strict=True):
            by_wave = 2 * ctx.transfer.transfer_adjoint(by_transfer) * wave
            found = ctx.transfer.wave_adjoint(by_wave, one)
            total = found if total is None else total.add_(found)
        assert total is not None
        if not ctx.is_field:
            by_phase = total.imag * modulation.real - total.real * modulation.imag
            total = by_phase.to(pixels.dtype)
        what = "the OTFs of a pattern"
        return differentiate_once(what, total, (pixels, gradient)), None, None, None


def binned_phasors(
    frequencies: torch.Tensor, positions: torch.Tensor, binning: int
) -> torch.Tensor:
    """Compute the Fourier kernel of a PSF on binned pixels, (frequencies, positions), complex128.

    A scene that is constant over binned pixels, blurred by a point at a position and averaged over
    binned pixels, is shared by the two pixels next to the position: linear interpolation. Without
    binning the position itself counts.

    frequencies: cycles per binned pixel.
    positions: sensor pixels from the middle.
    """
    if binning == 1:
        return unit_phasor(-torch.outer(frequencies, positions), torch.complex128)
    place = positions / binning
    before = torch.floor(place)
    share = (place - before).to(torch.complex128)
    first = unit_phasor(-torch.outer(frequencies, before), torch.complex128)
    second = unit_phasor(-torch.outer(frequencies, before + 1), torch.complex128)
    return (1 - share) * first + share * second
