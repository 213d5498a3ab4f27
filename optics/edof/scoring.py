"""Score restored pictures, compare patterns on the same ones, and say what can't be believed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import torch

from optics.edof.decoders import Restore
from optics.edof.dioptres import find_undrawn
from optics.edof.protocol import EdofProtocol, LightScale, encode_srgb
from optics.edof.protocol_psfs import DepthPSFs
from optics.metrics import psnr, ssim
from optics.plane import centred_crop

Part = Literal["frame", "centre"]
"""Part of the capture that is scored: all of it, or its centre, far from the border."""

PARTS: tuple[Part, ...] = ("frame", "centre")
"""All parts of a capture that are scored."""


def score_picture(
    restored: torch.Tensor,
    reference: torch.Tensor,
    protocol: EdofProtocol,
    scored_in: LightScale,
    part: Part = "frame",
    *,
    with_ssim: bool = True,
) -> tuple[float, float | None]:
    """Compute the PSNR in dB and the SSIM of a restored picture as the protocol says.

    restored, reference: pictures in the light in which the protocol simulates, (crop, crop).
    scored_in: the scale in which they are compared. Pictures in linear light are encoded, and
        clipped to 0 to 1, for "srgb".
    with_ssim: whether the SSIM is computed; it is None otherwise.
    """
    if part == "centre":
        shape = (protocol.centre, protocol.centre)
        restored, reference = centred_crop(restored, shape), centred_crop(reference, shape)
    if protocol.light == "linear" and scored_in == "srgb":
        restored, reference = encode_srgb(restored), encode_srgb(reference)
    found = psnr(restored, reference, protocol.peak)
    return found, ssim(restored, reference, protocol.peak) if with_ssim else None


@dataclass(frozen=True, eq=False)
class CaptureScores:
    """The scores of restored captures by picture and depth.

    dioptres: depths, those on the grid first.
    on_grid_count: number of depths on the grid.
    psnr: dB, (pictures, depths), float64.
    ssim: (pictures, depths), float64; empty, (pictures, 0), if it wasn't computed.
    """

    dioptres: tuple[float, ...]
    on_grid_count: int
    psnr: torch.Tensor
    ssim: torch.Tensor

    @property
    def psnr_by_depth(self) -> tuple[float, ...]:
        """PSNR at each depth in dB, the mean over pictures."""
        return tuple(self.psnr.mean(0).tolist())

    @property
    def mean(self) -> float:
        """Mean PSNR over pictures and all depths, in dB."""
        return float(self.psnr.mean())

    @property
    def on_grid(self) -> float:
        """Mean PSNR over pictures and the depths on the grid, in dB."""
        return float(self.psnr[:, : self.on_grid_count].mean())

    @property
    def off_grid(self) -> float:
        """Mean PSNR over pictures and the depths off the grid, in dB."""
        return float(self.psnr[:, self.on_grid_count :].mean())

    @property
    def worst(self) -> tuple[float, float]:
        """Depth in dioptres at which captures are restored worst, and its PSNR in dB."""
        by_depth = self.psnr_by_depth
        depth = min(range(len(by_depth)), key=by_depth.__getitem__)
        return self.dioptres[depth], by_depth[depth]

    @property
    def mean_ssim(self) -> float | None:
        """Mean SSIM over pictures and depths; None if it wasn't computed."""
        return float(self.ssim.mean()) if self.ssim.numel() else None


@dataclass(frozen=True)
class PairedDifference:
    """How much better one pattern's captures are restored than another's, on several pictures.

    mean: mean over pictures of the difference of their mean PSNRs, dB.
    standard_error: of that mean, dB: the differences' standard deviation over sqrt(pictures).
    """

    mean: float
    standard_error: float
    pictures: int


def compare_scores(first: CaptureScores, second: CaptureScores) -> PairedDifference:
    """Compute how much better captures are restored in one evaluation than in another.

    Pictures differ by several dB, but the difference between two patterns varies far less from
    picture to picture, if both saw the same pictures, depths and noise. The difference is `first`
    minus `second`. Raises ValueError if pictures or depths differ, or there are fewer than two
    pictures.
    """
    if first.psnr.shape != second.psnr.shape or first.dioptres != second.dioptres:
        raise ValueError(
            f"second has {tuple(second.psnr.shape)} pictures and depths and first "
            f"{tuple(first.psnr.shape)}; only scores of the same pictures and depths can be paired"
        )
    count = first.psnr.shape[0]
    if count < 2:
        raise ValueError(f"first has {count} picture; a standard error needs 2 at least")
    differences = first.psnr.mean(1) - second.psnr.mean(1)
    spread = float(differences.std(correction=1))
    return PairedDifference(float(differences.mean()), spread / math.sqrt(count), count)


def on_grid_advantage(scores: CaptureScores) -> float:
    """Return by how many dB captures on the depth grid are restored better than those beside it.

    Each depth on the grid is compared with the interpolation, in dioptres, of the two depths off
    the grid that enclose it, because PSNR changes with depth anyway. A depth beyond all others is
    compared with the nearest. The median over the grid is returned: an ordinary lens is sharper in
    focus than beside it, even if that depth lies on the grid by chance. It is negative if depths on
    the grid are restored worse. With 40 depths off the grid in 2 dioptres, interpolation adds
    little; with 10, the ripple of ten foci was seen as an advantage of 0.35 dB.

    Raises ValueError if there are no depths on the grid, or none off it.
    """
    count, by_depth = scores.on_grid_count, scores.psnr_by_depth
    if not 0 < count < len(by_depth):
        raise ValueError(
            f"scores has {count} depths on the grid of {len(by_depth)}; both kinds are needed"
        )
    beside = sorted(zip(scores.dioptres[count:], by_depth[count:], strict=True))
    gains = [by_depth[k] - _interpolate(scores.dioptres[k], beside) for k in range(count)]
    return float(torch.tensor(gains, dtype=torch.float64).quantile(0.5))


def _interpolate(at: float, points: list[tuple[float, float]]) -> float:
    """Interpolate a PSNR linearly between depths in dioptres; constant beyond the outermost."""
    if at <= points[0][0]:
        return points[0][1]
    for (left, low), (right, high) in itertools.pairwise(points):
        if left <= at <= right:
            share = (at - left) / (right - left) if right > left else 0.5
            return low + share * (high - low)
    return points[-1][1]


AlarmKind = Literal["renormalised", "off-grid", "undrawn", "stateful"]

OFF_GRID_LIMIT = 0.3
"""dB by which depths on the grid may be restored better than those beside them.

Measured with 40 depths off the grid in 2 dioptres: 1.4 dB for a pattern that was optimised for the
ten published depths, whose mean was 2.8 dB higher on the grid than off it; 0.1 dB for multi-focus
rings, and less for round stops.
"""

# Difference of a PSF's energy from that expected, as a share of the collected light, that raises
# an alarm. Chosen: far below the light that a narrow window loses, far above errors of sampling.
_ENERGY_LIMIT = 0.02

# Width of a PSF window's rim, as a share of its side, from which lost light is estimated. Chosen.
_RIM = 0.05

# Least share of a PSF's light in the rim from which lost light is estimated. Chosen: with less,
# little can be lost.
_RIM_LIGHT = 0.01


@dataclass(frozen=True)
class Alarm:
    """Why a row can't be believed: what is wrong, and a sentence for a person with the numbers."""

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
    for depth, energy, kernel in zip(psfs.dioptres, psfs.energies, psfs.kernels, strict=True):
        rows, columns = (max(1, round(_RIM * n)) for n in kernel.shape)
        total = float(kernel.sum())
        rim = (total - float(kernel[rows:-rows, columns:-columns].sum())) / total
        # A PSF that reaches the rim goes on beyond it, with half as much light at least.
        if rim > _RIM_LIGHT and 1 - energy < 0.5 * rim:
            return Alarm(
                "renormalised",
                f"the PSF at {depth:.3g} dioptres holds {energy:.1%} of the light although "
                f"{rim:.1%} lies in the rim of its window; it seems to be cropped and normalised",
            )
    return None


def check_off_grid(scores: CaptureScores) -> Alarm | None:
    """Return an alarm if depths on the grid are restored better than beside it by OFF_GRID_LIMIT.

    A pattern that was designed for the few depths of a test isn't in focus between them.
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

    draw_index: draws the index of one of the depths; called without arguments.
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

    It then uses something else than the capture, for instance the order of captures. `capture` was
    restored to `before`.
    """
    if torch.allclose(restore(capture.clone()), before, rtol=1e-4, atol=1e-5):
        return None
    return Alarm("stateful", "the decoder restores the same capture differently a second time")


@dataclass(frozen=True, eq=False)
class ScoreRow:
    """The scores of one pattern with one decoder, and what they depend on.

    is_blind: whether the decoder gets the capture alone, without its depth or PSF.
    collected: share of the open pupil's light that the pattern collects; the noise grows with its
        inverse.
    energies: least and largest share of the collected light in the PSFs' window.
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
        wanted = (pattern, decoder, scale, part)
        for row in self.rows:
            if (row.pattern, row.decoder, row.scored_in, row.part) == wanted:
                return row
        known = sorted({f"{row.pattern} with {row.decoder}" for row in self.rows})
        raise ValueError(
            f"pattern {pattern!r} with decoder {decoder!r}, {scale}, {part}, isn't in the table; "
            f"it has {'; '.join(known)}"
        )
