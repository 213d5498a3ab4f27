"""Transfer functions of a pattern over depth, computed once for all steps of its decoder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch

from labapp.edof.design_problem import EdofProblem
from labapp.training.edof.config import EdofTrainingConfig
from labapp.training.edof.depth_choice import depth_chances
from optics.edof.dioptres import dioptres_from_metres, midpoint_dioptres
from optics.edof.learned.wiener_front import DepthStatistics
from optics.edof.panel_transfer import ConditionTransfer, PanelCondition, QuarterTransfer
from optics.edof.pattern_transfer import PatternTransfer


@dataclass(frozen=True, eq=False)
class OpticsTable:
    """Transfer functions of a pattern at many depths, and how often each depth is drawn.

    transfers: about the optical axis, on the grid of rfft2, complex64,
    (depths, side, side // 2 + 1).
    flat: those of a flat pattern, for unmodulated light, of the same shape.
    chances: probability of each depth, (depths,).
    spectrum: power spectrum of the pictures, (side, side // 2 + 1).
    """

    dioptres: tuple[float, ...]
    transfers: torch.Tensor
    flat: torch.Tensor
    chances: torch.Tensor
    spectrum: torch.Tensor

    @cached_property
    def statistics(self) -> DepthStatistics:
        """What the filter for all depths follows from."""
        return DepthStatistics.of_transfers(self.transfers, self.flat, self.spectrum)

    def to(self, device: torch.device) -> OpticsTable:
        """Return the table with its transfer functions on a device."""
        transfers, flat = self.transfers.to(device), self.flat.to(device)
        return OpticsTable(self.dioptres, transfers, flat, self.chances, self.spectrum)


@torch.no_grad()
def tabulate_optics(
    problem: EdofProblem, parameters: torch.Tensor, config: EdofTrainingConfig
) -> OpticsTable:
    """Compute the transfer functions of a pattern at all depths of the configuration.

    The table is on the processor.
    problem: the optics, for scenes of the training's side.
    """
    transfer = problem.transfer(problem.request.wavelengths[0])
    phase = problem.phase(parameters)
    dioptres = training_dioptres(config)
    transfers = compute_transfers(transfer, phase, dioptres)
    flat = compute_transfers(transfer, torch.zeros_like(phase), dioptres)
    chances = depth_chances(transfers, config)
    return OpticsTable(dioptres, transfers, flat, chances, problem.spectrum)


def compute_transfers(
    transfer: PatternTransfer, phase: torch.Tensor, dioptres: Sequence[float]
) -> torch.Tensor:
    """Compute a pattern's transfer functions at many depths, one after the other.

    Returns (depths, side, side // 2 + 1), complex64.
    """
    return torch.stack([transfer_on_axis(transfer, phase, (one,))[0] for one in dioptres])


def transfer_on_axis(
    transfer: PatternTransfer,
    phase: torch.Tensor,
    dioptres: Sequence[float],
    condition: PanelCondition | None = None,
) -> torch.Tensor:
    """Compute a pattern's transfer functions about the optical axis; differentiable.

    Returns (depths, side, side // 2 + 1), complex64.
    condition: of the panel; as it should be by default.
    """
    seen = transfer if condition is None else ConditionTransfer(transfer, condition)
    found = seen(phase, tuple(dioptres))
    if isinstance(transfer, QuarterTransfer):
        found = transfer.on_axis(found, dioptres)
    return found.to(torch.complex64)


def training_dioptres(config: EdofTrainingConfig, count: int | None = None) -> tuple[float, ...]:
    """Return the depths in dioptres at which the optics are tabulated, farthest first.

    count: parts of the range of depths, if no distances are given; the configuration's by default.
    """
    if config.depths.distances_m:
        return tuple(sorted(dioptres_from_metres(config.depths.distances_m)))
    depth_range = (config.far_dioptre, config.near_dioptre)
    return midpoint_dioptres(count or config.depths.count, depth_range)
