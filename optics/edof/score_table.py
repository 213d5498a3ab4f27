"""The rows of an evaluation, and the alarms where it's doubtful."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import torch

from optics.edof.decoders import Restore
from optics.edof.dioptres import find_undrawn
from optics.edof.protocol import Border, EdofProtocol, LightScale
from optics.edof.protocol_psfs import DepthPSFs
from optics.edof.scoring import (
    CaptureScores,
    PairedDifference,
    Part,
    compare_scores,
    on_grid_advantage,
)

AlarmKind = Literal["renormalised", "off-grid", "undrawn", "stateful"]

OFF_GRID_LIMIT = 0.3
"""dB by which depths on the grid may be restored better than those beside them.

Measured with 40 depths off the grid in 2 dioptres: 1.4 dB for a pattern that was optimised for the
ten published depths, whose mean was 2.8 dB higher on the grid than off it; 0.1 dB for multi-focus
rings, and less for round stops.
"""

_ENERGY_LIMIT = 0.02
"""Difference of a PSF's energy from that expected, as a share of the collected light, that raises
an alarm. Chosen: far below the light that a narrow window loses, far above errors of sampling."""

_RIM = 0.05
"""Width of a PSF window's rim, as a share of its side, from which lost light is estimated.
Chosen."""

_RIM_LIGHT = 0.01
"""Least share of a PSF's light in the rim of its window from which lost light is estimated.
Chosen: with less, little can be lost."""


@dataclass(frozen=True)
class Alarm:
    """Why a row can't be believed.

    kind: what is wrong.
    message: a sentence for a person, with the numbers.
    """

    kind: AlarmKind
    message: str


def check_energy(psfs: DepthPSFs) -> Alarm | None:
    """Return an alarm if PSFs hold another share of the light than they should.

    A window that cuts off light and is then normalised to a sum of 1 makes the PSF, and all that is
    restored with it, look better than it is. Where the energy to expect is known, it is compared.
    Otherwise, for PSFs that were handed in, the light in the rim of the window tells whether some
    must lie beyond it; that is an estimate.
    """
    if psfs.expected_energies is not None:
        pairs = list(zip(psfs.energies, psfs.expected_energies, strict=True))
        energy, expected = max(pairs, key=lambda pair: abs(pair[0] - pair[1]))
        if abs(energy - expected) <= _ENERGY_LIMIT:
            return None
        return Alarm(
            "renormalised",
            f"a PSF holds {energy:.1%} of the light; {expected:.1%} is expected in its window",
        )
    if not psfs.are_measured:
        return None
    rims = [_rim_share(kernel) for kernel in psfs.kernels]
    for depth, energy, rim in zip(psfs.dioptres, psfs.energies, rims, strict=True):
        # A PSF that reaches the rim goes on beyond it, with half as much light at least.
        if rim > _RIM_LIGHT and 1 - energy < 0.5 * rim:
            return Alarm(
                "renormalised",
                f"the PSF at {depth:.3g} dioptres holds {energy:.1%} of the light although "
                f"{rim:.1%} lies in the rim of its window; it seems to be cropped and normalised",
            )
    return None


def check_off_grid(scores: CaptureScores) -> Alarm | None:
    """Return an alarm if captures on the grid of depths are restored better than those beside it.

    A pattern that was designed for the few depths of a test isn't in focus between them. An
    advantage within OFF_GRID_LIMIT gives None.
    """
    gain = on_grid_advantage(scores)
    if gain <= OFF_GRID_LIMIT:
        return None
    return Alarm(
        "off-grid",
        f"depths on the grid are restored {gain:.2f} dB better than depths beside them "
        f"({scores.on_grid:.2f} dB on the grid, {scores.off_grid:.2f} dB off it)",
    )


def check_sampler(draw_index: Callable[[], int], dioptres: Sequence[float]) -> Alarm | None:
    """Return an alarm if a sampler of depths, for training or testing, leaves out some of them.

    draw_index: draws the index of a depth; called without arguments.
    dioptres: the depths that it draws from.
    """
    missing = find_undrawn(draw_index, len(dioptres))
    if not missing:
        return None
    names = ", ".join(f"{dioptres[k]:.3g}" for k in missing)
    return Alarm("undrawn", f"depths that are never drawn: {names} dioptres")


def check_repeatability(
    restore: Restore, capture: torch.Tensor, before: torch.Tensor
) -> Alarm | None:
    """Return an alarm if a decoder restores a capture differently than it did before.

    It then uses something else than the capture, for instance the order of captures.

    capture: a capture that was restored before, (rows, columns).
    before: what it was restored to, (rows, columns).
    """
    if torch.allclose(restore(capture.clone()), before, rtol=1e-4, atol=1e-5):
        return None
    return Alarm("stateful", "the decoder restores the same capture differently a second time")


def _rim_share(kernel: torch.Tensor) -> float:
    """Return the share of a PSF's light that lies in the rim of its window."""
    rows, columns = (max(1, round(_RIM * n)) for n in kernel.shape)
    total = float(kernel.sum())
    inner = float(kernel[rows:-rows, columns:-columns].sum())
    return (total - inner) / total


@dataclass(frozen=True, eq=False)
class ScoreRow:
    """The scores of one pattern with one decoder, and what they depend on.

    is_blind: whether the decoder gets the capture alone, without its depth or PSF.
    scored_in: the scale in which pictures were compared.
    part: the part of the capture that was compared.
    collected: share of the open pupil's light that the pattern collects; the noise grows with its
        inverse.
    energies: least and largest share of the collected light in the PSFs' window.
    scores: scores by picture and depth.
    alarms: why the row can't be believed; empty for one that can.
    """

    pattern: str
    decoder: str
    is_blind: bool
    protocol: EdofProtocol
    scored_in: LightScale
    part: Part
    collected: float
    energies: tuple[float, float]
    scores: CaptureScores
    alarms: tuple[Alarm, ...] = ()

    @property
    def border(self) -> Border:
        """Border with which captures were made."""
        return self.protocol.border


@dataclass(frozen=True, eq=False)
class EvaluationTable:
    """All rows, in the order of patterns, decoders, scales and parts; stops come last."""

    protocol: EdofProtocol
    rows: tuple[ScoreRow, ...]

    def find(
        self,
        pattern: str,
        decoder: str,
        scored_in: LightScale | None = None,
        part: Part = "frame",
    ) -> ScoreRow:
        """Find the row of a pattern and a decoder.

        The scale is the first of the protocol's by default. Raises ValueError if there is none.
        """
        scale = scored_in or self.protocol.scored_in[0]
        for row in self.rows:
            if (row.pattern, row.decoder, row.scored_in, row.part) == (
                pattern, decoder, scale, part,
            ):  # fmt: skip
                return row
        known = sorted({f"{row.pattern} with {row.decoder}" for row in self.rows})
        raise ValueError(
            f"pattern {pattern!r} with decoder {decoder!r}, {scale}, {part}, isn't in the table; "
            f"it has {'; '.join(known)}"
        )

    def compare(
        self,
        first: str,
        second: str,
        decoder: str,
        scored_in: LightScale | None = None,
        part: Part = "frame",
    ) -> PairedDifference:
        """Compute how much better a pattern does than another on the same pictures."""
        rows = [self.find(name, decoder, scored_in, part) for name in (first, second)]
        return compare_scores(rows[0].scores, rows[1].scores)
