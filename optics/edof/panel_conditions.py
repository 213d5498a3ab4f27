"""Compute OTFs of patterns as a panel shows them whose pixels couple, or whose response is wrong.

A design that doesn't know of fringing fields pays for it at the jumps by which the phase is wrapped
into the panel's range: the blurred phase takes all values between both sides there. The damage
can be lowered by gradients only if the search moves the phase as it is displayed, jumps included,
because a derivative of the wrapped phase knows nothing of a jump that comes or goes. A search for
such conditions therefore takes a displayed phase within the panel's range as its parameters, and
keeps it there by `fold_into_range`.

References
----------
As `optics.slm.coupling`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from optics.edof.frequency_grid import FrequencyGrid
from optics.edof.pattern_transfer import PatternTransfer
from optics.edof.quarter_transfer import QuarterTransfer
from optics.slm.coupling import fringing_field_mean
from optics.validation import require_positive

_NODES = 2
"""Points along a pixel's side at which the blurred phase is taken. Measured for rings of ten
foci, .6 pixels and jumps of a wave: OTFs are wrong by .4 %; by 4.5 % with one point, and by .02 %
with three."""


@dataclass(frozen=True)
class PanelCondition:
    """Describe a condition of a panel in which it shows a pattern.

    Attributes
    ----------
    coupling : float
        Standard deviation by which fringing fields blur the displayed phase, metres; 0 or more,
        and at most the panel's pitch.
    response : float
        Factor of the displayed phase; 1 for a panel that shows what it should.

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    coupling: float = 0.0
    response: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.coupling < math.inf:
            raise ValueError(f"coupling is {self.coupling:g} m; choose 0 or more")
        require_positive("response", self.response, "")


class ConditionTransfer:
    """Computes OTFs of displayed patterns on a panel in a condition, for a search.

    Call it as a `PatternTransfer`, with the phase as it is displayed: wrapped as the panel wraps.

    Parameters
    ----------
    transfer : PatternTransfer
        Computes the OTFs of the panel as it should be.
    condition : PanelCondition
        The condition.

    Raises
    ------
    ValueError
        If the coupling is more than the panel's pitch.
    """

    def __init__(self, transfer: PatternTransfer, condition: PanelCondition) -> None:
        panel = transfer.design.camera.panel
        if condition.coupling > panel.pitch:
            raise ValueError(
                f"coupling is {condition.coupling:g} m; choose at most the panel's pitch, "
                f"{panel.pitch:g} m"
            )
        self._transfer, self._condition = transfer, condition
        self._sigma = condition.coupling / panel.pitch
        self._side = math.sqrt(panel.fill_factor)
        mirrored = isinstance(transfer, QuarterTransfer)
        # The blur ends within five standard deviations of a pixel's border.
        self._margin = math.ceil(1 + 5 * self._sigma) if mirrored and self._sigma else 0

    @property
    def grid(self) -> FrequencyGrid:
        """The frequencies of the OTFs."""
        return self._transfer.grid

    def __call__(self, phase: torch.Tensor, dioptres: Sequence[float]) -> torch.Tensor:
        """Compute the OTFs of a displayed pattern at depths.

        Parameters
        ----------
        phase : torch.Tensor, (rows, columns)
            Displayed phase in radians, of the shape that the transfer takes. The result is
            differentiable in it, once.
        dioptres : sequence of float
            Depths, 0 (infinity) or more; at least one.

        Returns
        -------
        torch.Tensor, (depths, rows, columns)
            OTF at each depth on the frequencies of `grid`.
        """
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

    Parameters
    ----------
    phase : torch.Tensor
        Radians, of any shape; the result is differentiable in it.
    top : float
        Upper end of the range in radians; the lower one is 0.

    Returns
    -------
    torch.Tensor
        The phase where it is from 0 to `top`; elsewhere its mirror image at the nearest end.

    Raises
    ------
    ValueError
        If `top` isn't positive.
    """
    require_positive("top", top, "rad")
    return top - (torch.remainder(phase, 2 * top) - top).abs()
