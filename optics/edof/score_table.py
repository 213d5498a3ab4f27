"""Hold the rows of an evaluation of extended depth of field: scores, and what they depend on."""

from __future__ import annotations

from dataclasses import dataclass

from optics.edof.alarms import Alarm
from optics.edof.picture_preparation import LightScale
from optics.edof.protocol import Border, EdofProtocol
from optics.edof.scoring import CaptureScores, PairedDifference, Part, compare_scores


@dataclass(frozen=True, eq=False)
class ScoreRow:
    """Hold the scores of one pattern with one decoder, and what they depend on.

    Parameters
    ----------
    pattern, decoder : str
        Names.
    is_blind : bool
        Whether the decoder gets the capture alone, without its depth or PSF.
    protocol : EdofProtocol
        The protocol.
    scored_in : {"linear", "srgb"}
        The scale in which pictures were compared.
    part : {"frame", "centre"}
        The part of the capture that was compared.
    collected : float
        Share of the open pupil's light that the pattern collects; the noise grows with its inverse.
    energies : tuple of (float, float)
        Least and largest share of the collected light in the PSFs' window.
    scores : CaptureScores
        Scores by picture and depth.
    alarms : tuple of Alarm
        Why the row can't be believed; empty for one that can.
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
        """The border with which the row's captures were made."""
        return self.protocol.border


@dataclass(frozen=True, eq=False)
class EvaluationTable:
    """Hold the rows of an evaluation of patterns.

    Parameters
    ----------
    protocol : EdofProtocol
        The protocol of all rows.
    rows : tuple of ScoreRow
        Rows in the order of patterns, decoders, scales and parts. Stops come last.
    """

    protocol: EdofProtocol
    rows: tuple[ScoreRow, ...]

    def find(
        self,
        pattern: str,
        decoder: str,
        scored_in: LightScale | None = None,
        part: Part = "frame",
    ) -> ScoreRow:
        """Find the row of a pattern and a decoder in an evaluation.

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
        """Compute how much better a pattern does than another on the evaluation's pictures."""
        rows = [self.find(name, decoder, scored_in, part) for name in (first, second)]
        return compare_scores(rows[0].scores, rows[1].scores)
