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
from optics.fourier.differentiation import differentiate_once
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

    Call it with a pattern and depths; see `__call__`. The light is relative to all light that
    leaves the panel through the stop, so that an OTF at zero frequency is the share of light in the
    window. Light beyond the window is lost. The light's density at the samples stands for that on
    whole pixels; where its fringes are finer than pixels, the samples' sum may exceed 1 a little
    (.1 % was seen).

    grid: the frequencies of the OTFs, for criteria and spectra.
    shape: (rows, columns) of a pattern.
    """

    design: TransferDesign
    grid: FrequencyGrid
    shape: tuple[int, int]
    _copies: int = 1
    """How often the pattern's pixels appear on the panel."""

    def __init__(self, design: TransferDesign, dtype: torch.dtype = torch.complex64) -> None:
        self.design, self._dtype = design, dtype
        self._positions = tuple(self._panel_positions(axis) for axis in (0, 1))
        shares = self._open_shares()
        self._amplitude = None if bool((shares == 1).all()) else shares.to(dtype.to_real())
        open_area = float(shares.square().sum()) * self._copies
        self._norm = design.step**2 / open_area
        self._map = self._plan_map()

    @abstractmethod
    def _panel_positions(self, axis: int) -> torch.Tensor:
        """Return the positions of a pattern's pixels along an axis, metres, float64."""

    @abstractmethod
    def _open_shares(self) -> torch.Tensor:
        """Return the open share of each of a pattern's pixels."""

    @abstractmethod
    def _plan_map(self) -> FieldMap:
        """Choose the map from the panel's wave to the sensor's."""

    @abstractmethod
    def _transfer(self, light: torch.Tensor) -> torch.Tensor:
        """Compute the OTF from the light |wave|² at the samples."""

    @abstractmethod
    def _transfer_adjoint(self, gradient: torch.Tensor) -> torch.Tensor:
        """Compute the gradient by the light at the samples from that by the OTF."""

    @in_full_precision
    def __call__(self, phase: torch.Tensor, dioptres: Sequence[float]) -> torch.Tensor:
        """Compute the OTFs of a pattern at depths.

        Parameters
        ----------
        phase : torch.Tensor, (rows, columns)
            Phase in radians on the panel's pixels, unwrapped or wrapped. The result is
            differentiable in it, once. Where it isn't finite, neither are the OTFs, so that a
            search can skip a broken step.
        dioptres : sequence of float
            Depths, 0 (infinity) or more; at least one.

        Returns
        -------
        torch.Tensor, (depths, rows, columns)
            OTF at each depth on the frequencies of `grid`.

        Raises
        ------
        ValueError
            If the pattern has another shape, or a depth is negative or isn't finite, or there is
            none.
        """
        self._require_suitable("phase", phase, dioptres)
        answer: torch.Tensor = _DepthTransfer.apply(phase, self, tuple(dioptres))  # type: ignore[no-untyped-call]
        return answer

    @in_full_precision
    def of_field(self, field: torch.Tensor, dioptres: Sequence[float]) -> torch.Tensor:
        """Compute the OTFs at depths behind pixels whose field is known, as a call does.

        The result is (depths, rows, columns), on the frequencies of `grid`, and differentiable in
        the field, once. Raises ValueError if the field has another shape, or a depth is negative or
        isn't finite, or there is none.

        field: field of each pixel where light of amplitude 1 falls on it, without the stop; (rows,
            columns), complex.
        dioptres: depths, 0 (infinity) or more; at least one.
        """
        self._require_suitable("field", field, dioptres)
        open_field = field.to(self._dtype)
        if self._amplitude is not None:
            open_field = open_field * self._amplitude.to(field.device)
        answer: torch.Tensor = _FieldTransfer.apply(open_field, self, tuple(dioptres))  # type: ignore[no-untyped-call]
        return answer

    def _require_suitable(self, name: str, pixels: torch.Tensor, dioptres: Sequence[float]) -> None:
        """Raise ValueError unless a pattern has the right shape and the depths are valid."""
        require_dioptres("dioptres", dioptres)
        if tuple(pixels.shape) != self.shape:
            raise ValueError(
                f"{name} is {tuple(pixels.shape)}; this pattern has {self.shape} pixels"
            )

    def _depth_waves(
        self, modulation: torch.Tensor, dioptres: Sequence[float], *, keep: bool
    ) -> tuple[torch.Tensor, list[torch.Tensor]]:
        """Compute the OTFs of a modulated panel at depths, and its waves on the samples.

        keep: whether the waves are kept, for a gradient; there are none otherwise.
        """
        found, waves = [], []
        for one in dioptres:
            wave = self.wave(modulation, one)
            found.append(self._transfer(wave.real.square() + wave.imag.square()))
            if keep:
                waves.append(wave)
        return torch.stack(found), waves

    def _gradient_by_modulation(
        self, gradient: torch.Tensor, waves: Sequence[torch.Tensor], dioptres: Sequence[float]
    ) -> torch.Tensor:
        """Compute the gradient by a panel's modulation from that by its OTFs at depths, once."""
        gradient = gradient.detach()
        total: torch.Tensor | None = None
        for one, wave, by_transfer in zip(dioptres, waves, gradient, strict=True):
            found = self._wave_adjoint(2 * self._transfer_adjoint(by_transfer) * wave, one)
            total = found if total is None else total.add_(found)
        assert total is not None
        return total

    def modulation(self, phase: torch.Tensor) -> torch.Tensor:
        """Compute the complex modulation of the pixels, with the stop's open shares."""
        phasor = phase_factor(phase, self._dtype)
        return phasor if self._amplitude is None else phasor * self._amplitude.to(phasor.device)

    def defocus(self, dioptre: float, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
        """Compute the defocus phasors of an object's depth along both axes."""
        column, row = (
            unit_phasor(self.design.defocus_turns(axis, dioptre, p), self._dtype).to(device)
            for axis, p in enumerate(self._positions)
        )
        return column[:, None], row[None, :]

    def wave(self, modulation: torch.Tensor, dioptre: float) -> torch.Tensor:
        """Compute the wave on the sensor's samples behind a modulation at one depth."""
        column, row = self.defocus(dioptre, modulation.device)
        return self._map.forward((modulation * row).mul_(column))

    def _wave_adjoint(self, wave: torch.Tensor, dioptre: float) -> torch.Tensor:
        """Apply the conjugate transpose of `wave`."""
        column, row = self.defocus(dioptre, wave.device)
        return (self._map.adjoint(wave) * row.conj()).mul_(column.conj())


_OTF = "the OTFs of a pattern"


class _DepthTransfer(torch.autograd.Function):
    """The autograd function of a phase's OTFs at depths, one depth at a time.

    Of each depth the wave in the window is kept for the gradient, which is a tenth of the memory
    that automatic differentiation would keep. The gradients of all depths by the modulation are
    added up before they become one by the phase.
    """

    @staticmethod
    def forward(
        ctx: Any, phase: torch.Tensor, transfer: PatternTransfer, dioptres: tuple[float, ...]
    ) -> torch.Tensor:
        modulation = transfer.modulation(phase.detach())
        ctx.transfer, ctx.dioptres, ctx.phase_dtype = transfer, dioptres, phase.dtype
        ctx.save_for_backward(phase, modulation)
        keep = ctx.needs_input_grad[0]
        found, ctx.waves = transfer._depth_waves(modulation, dioptres, keep=keep)
        return found

    @staticmethod
    # torch runs this with the precision of whoever asks for gradients, inside autocast or not.
    @in_full_precision
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        phase, modulation = ctx.saved_tensors
        total = ctx.transfer._gradient_by_modulation(gradient, ctx.waves, ctx.dioptres)
        by_phase = total.imag * modulation.real - total.real * modulation.imag
        found = by_phase.to(ctx.phase_dtype)
        return differentiate_once(_OTF, found, (phase, gradient)), None, None


class _FieldTransfer(torch.autograd.Function):
    """The autograd function of the OTFs of a panel's field at depths, one depth at a time."""

    @staticmethod
    def forward(
        ctx: Any, field: torch.Tensor, transfer: PatternTransfer, dioptres: tuple[float, ...]
    ) -> torch.Tensor:
        ctx.transfer, ctx.dioptres = transfer, dioptres
        ctx.save_for_backward(field)
        keep = ctx.needs_input_grad[0]
        found, ctx.waves = transfer._depth_waves(field.detach(), dioptres, keep=keep)
        return found

    @staticmethod
    @in_full_precision
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        by_field = ctx.transfer._gradient_by_modulation(gradient, ctx.waves, ctx.dioptres)
        return differentiate_once(_OTF, by_field, (*ctx.saved_tensors, gradient)), None, None


def binned_phasors(
    frequencies: torch.Tensor, positions: torch.Tensor, binning: int
) -> torch.Tensor:
    """Compute the Fourier kernel of a PSF on binned pixels, (frequencies, positions), complex128.

    A scene that is constant over binned pixels, blurred by a point at a position and averaged over
    binned pixels, is shared by the two pixels next to the position: linear interpolation. Without
    binning the position itself counts.

    frequencies: cycles per binned pixel, (frequencies,).
    positions: sensor pixels from the middle, (positions,).
    binning: sensor pixels along each side of a binned pixel.
    """
    if binning == 1:
        return unit_phasor(-torch.outer(frequencies, positions), torch.complex128)
    place = positions / binning
    before = torch.floor(place)
    share = (place - before).to(torch.complex128)
    first = unit_phasor(-torch.outer(frequencies, before), torch.complex128)
    second = unit_phasor(-torch.outer(frequencies, before + 1), torch.complex128)
    return (1 - share) * first + share * second
