"""Capture scenes behind one pattern as the evaluation protocol says, and score decoders."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.edof.alarms import Alarm, check_off_grid, check_repeatability
from optics.edof.capture import SceneBlur, add_noise
from optics.edof.decoders import (
    BlindDecoder,
    Decoder,
    Restore,
    decoding_period,
    decoding_transfers,
)
from optics.edof.detector_psf import compute_transfer
from optics.edof.picture_preparation import LightScale
from optics.edof.protocol import EdofProtocol
from optics.edof.protocol_psfs import DepthPSFs
from optics.edof.score_table import ScoreRow
from optics.edof.scoring import PARTS, CaptureScores, Part, score_picture
from optics.edof.spectral_criterion import noise_at_light
from optics.plane import centred_crop
from optics.progress import Progress


class PatternEvaluation:
    """Captures all scenes behind one pattern at all depths, and scores what decoders restore.

    Parameters
    ----------
    design : DepthPSFs
        The pattern's PSFs at the protocol's depths of design.
    test : DepthPSFs
        The pattern's PSFs at the protocol's depths of test.
    scenes : sequence of torch.Tensor
        Scenes of the protocol's size and light.
    protocol : EdofProtocol
        The protocol.
    with_ssim : bool
        Whether the SSIM is computed.
    """

    def __init__(
        self,
        design: DepthPSFs,
        test: DepthPSFs,
        scenes: Sequence[torch.Tensor],
        protocol: EdofProtocol,
        with_ssim: bool,
    ) -> None:
        self._test, self._scenes, self._protocol = test, scenes, protocol
        self._with_ssim = with_ssim
        crop = (protocol.crop, protocol.crop)
        self._references = [centred_crop(one, crop) for one in scenes]
        self._design = decoding_transfers(design, protocol)
        self._period = decoding_period(protocol)
        self._levels = [
            noise_at_light(one, test.collected, protocol.noise.shot_share)
            for one in protocol.noise.deviations
        ]
        self._energies = min(test.energies), max(test.energies)

    def rows(
        self, pattern: str, decoder: Decoder, alarms: Sequence[Alarm], progress: Progress
    ) -> list[ScoreRow]:
        """Restore all captures of a pattern by a decoder, and return the rows of their scores."""
        protocol = self._protocol
        kinds = [(scale, part) for scale in protocol.scored_in for part in PARTS]
        found, more = self._score(decoder, kinds, progress)
        return [
            ScoreRow(
                pattern,
                decoder.name,
                isinstance(decoder, BlindDecoder),
                protocol,
                scale,
                part,
                self._test.collected,
                self._energies,
                scores,
                (*alarms, *more, *_as_list(check_off_grid(scores))),
            )
            for (scale, part), scores in zip(kinds, found, strict=True)
        ]

    def _score(
        self, decoder: Decoder, kinds: Sequence[tuple[LightScale, Part]], progress: Progress
    ) -> tuple[list[CaptureScores], list[Alarm]]:
        """Score a decoder's pictures in scales and parts, and check that it is repeatable."""
        shape = (len(kinds), len(self._scenes), len(self._test.dioptres))
        psnr = torch.zeros(shape, dtype=torch.float64)
        ssim = psnr.new_zeros(shape if self._with_ssim else (*shape[:2], 0))
        blind = self._build_blind(decoder)
        first: tuple[Restore, torch.Tensor, torch.Tensor] | None = None
        for depth in self._shuffled_depths():
            progress.raise_if_cancelled()
            blur = SceneBlur(self._test.kernels[depth], self._protocol)
            built = blind or self._build_for_depth(decoder, depth)
            for picture, reference in enumerate(self._references):
                restore = built[self._level(picture)]
                capture = self._capture(blur, picture, depth)
                restored = restore(capture.clone())
                first = first or (restore, capture, restored.clone())
                for kind, (scale, part) in enumerate(kinds):
                    found = self._score_picture(restored, reference, scale, part)
                    psnr[kind, picture, depth] = found[0]
                    if found[1] is not None:
                        ssim[kind, picture, depth] = found[1]
        assert first is not None
        count = len(self._protocol.on_grid)
        scores = [
            CaptureScores(self._test.dioptres, count, one, other)
            for one, other in zip(psnr, ssim, strict=True)
        ]
        return scores, _as_list(check_repeatability(*first))

    def _score_picture(
        self, restored: torch.Tensor, reference: torch.Tensor, scale: LightScale, part: Part
    ) -> tuple[float, float | None]:
        """Compute the PSNR and SSIM of a part of a restored picture in a scale."""
        return score_picture(
            restored, reference, self._protocol, scale, part, with_ssim=self._with_ssim
        )

    def _build_blind(self, decoder: Decoder) -> list[Restore]:
        """Build a blind decoder for each noise level, before anything is captured."""
        if not isinstance(decoder, BlindDecoder):
            return []
        return [decoder.build(self._design, level) for level in self._levels]

    def _build_for_depth(self, decoder: Decoder, depth: int) -> list[Restore]:
        """Build a decoder that knows the depth for each noise level."""
        transfer = compute_transfer(self._test.kernels[depth], self._period)
        return [decoder.build(transfer, level) for level in self._levels]

    def _capture(self, blur: SceneBlur, picture: int, depth: int) -> torch.Tensor:
        """Capture a scene at a depth, with noise that is the same for every pattern."""
        noise = self._protocol.noise
        seed = (self._protocol.seed * 10_007 + picture) * 10_007 + depth
        return add_noise(
            blur(self._scenes[picture]),
            noise.deviations[self._level(picture)],
            self._test.collected,
            torch.Generator().manual_seed(seed),
            noise.shot_share,
        )

    def _level(self, picture: int) -> int:
        """Return the noise level of a picture's captures, the same at all depths.

        If levels changed from depth to depth, depths couldn't be compared.
        """
        return picture % len(self._levels)

    def _shuffled_depths(self) -> list[int]:
        """Return the indices of the test depths in random order, which tells a decoder nothing."""
        generator = torch.Generator().manual_seed(self._protocol.seed)
        return torch.randperm(len(self._test.dioptres), generator=generator).tolist()


def _as_list(alarm: Alarm | None) -> list[Alarm]:
    """Return a list of the alarm of an evaluation, empty if there is none."""
    return [] if alarm is None else [alarm]
