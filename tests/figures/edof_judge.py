"""Score PSFs by the strict protocol, with the decoder for a bench as it should be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from optics.edof.decoders import BlindDecoder
from optics.edof.evaluation import PatternEvaluation
from optics.edof.protocol import EdofProtocol
from optics.edof.protocol_psfs import DepthPSFs
from optics.progress import Progress


@dataclass(frozen=True, eq=False)
class PSFJudge:
    """Scores PSFs by the photographs and the decoder of a bench as it should be."""

    design: DepthPSFs
    scenes: Sequence[torch.Tensor]
    protocol: EdofProtocol
    decoder: BlindDecoder

    def levels(self, test: DepthPSFs) -> np.ndarray:
        """PSNR in dB at the depths on the grid, means over photographs."""
        run = PatternEvaluation(self.design, test, self.scenes, self.protocol, False)
        rows = run.rows("pattern", self.decoder, [], Progress())
        scores = next(row for row in rows if row.part == "frame").scores
        return scores.psnr.mean(0)[: len(self.protocol.on_grid)].numpy()
