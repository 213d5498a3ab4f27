"""Train the decoder behind a pattern that stays as it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from labapp.training.edof.captures import (
    Captures,
    DrawnScene,
    SceneSampler,
    capture_scenes,
    unmodulated_shares,
)
from labapp.training.edof.config import EdofTrainingConfig
from labapp.training.edof.depth_choice import depth_indices
from labapp.training.edof.optics_table import OpticsTable
from labapp.training.state import TrainingSchedule
from labapp.training.task import VALIDATION_STEP
from optics.edof.learned import DecoderNetwork, WienerFront
from optics.edof.learned.decoder_network import encode_screen, fit_psf
from optics.edof.learned.wiener_front import add_unmodulated_light
from optics.fourier import irfft2
from optics.metrics import structural_similarity
from optics.plane import origin_to_centre

_LEAST_ERROR = 1e-5
"""Mean squared error that is added before its logarithm, 50 dB: constant scenes, whose error can
vanish, mustn't decide the training. Chosen."""


def decoder_schedule(config: EdofTrainingConfig, steps: int) -> TrainingSchedule:
    """Return the schedule of a decoder behind a pattern that stays as it is."""
    table = config.training
    return TrainingSchedule(
        steps,
        table.first_rate,
        table.last_rate,
        min(table.warm_up, steps - 1),
        table.average_decay,
        table.clip,
        table.validation_interval,
        config.seed,
    )


class DecoderTask:
    """A decoder that learns from captures behind a pattern, whose optics are tabulated.

    network: on the device of the training.
    optics: the pattern's transfer functions, on the same device.
    settings: everything that the result depends on, as plain data.
    """

    def __init__(
        self,
        network: DecoderNetwork,
        optics: OpticsTable,
        sampler: SceneSampler,
        config: EdofTrainingConfig,
        settings: Mapping[str, Any],
    ) -> None:
        self.module, self._optics, self._sampler = network, optics, sampler
        self._config, self.settings, self.samples = config, settings, config.training.samples

    def parameter_groups(self) -> list[dict[str, Any]]:
        """Return all weights of the network, as one group."""
        return [{"params": list(self.module.parameters()), "rate": 1.0}]

    def losses(self, step: int, samples: Sequence[int]) -> torch.Tensor:
        """Return the losses of decoded scenes of a step."""
        drawn = self._sampler.draw(step, samples)
        return scene_losses(self._decode(drawn), self._config)

    @torch.no_grad()
    def validate(self) -> float:
        """Return the mean PSNR in dB of decoded validation scenes, planes and layered ones."""
        return validation_score(self._sampler, self._config, self._decode)

    @torch.no_grad()
    def decode_scene(self, scene: DrawnScene) -> tuple[torch.Tensor, ...]:
        """Capture a scene, and return it as captured, as filtered, as decoded, and as it is.

        Each is (side, side), in the scale in which decoders are compared. The filter is the one for
        all depths, whatever the decoder has.
        """
        decoded, captures = self._decode([scene])
        shares = unmodulated_shares([scene]).to(captures.pictures.device)
        filtered = self._optics.statistics.front(shares)(captures.pictures, captures.noise)
        shown = [captures.pictures, filtered]
        if self._config.scenes.light == "linear":
            shown = [encode_screen(one) for one in shown]
        return tuple(one[0, 0] for one in (*shown, decoded, captures.truth))

    def _decode(self, drawn: Sequence[DrawnScene]) -> tuple[torch.Tensor, Captures]:
        """Capture scenes behind the pattern, and decode them."""
        optics = self._optics
        places = [depth_indices(optics.chances, one.depths) for one in drawn]
        shares = unmodulated_shares(drawn)
        transfers = [
            add_unmodulated_light(optics.transfers[one], optics.flat[one], float(share))
            for one, share in zip(places, shares, strict=True)
        ]
        captures = capture_scenes(drawn, transfers, linear=self._config.scenes.light == "linear")
        front = optics.statistics.front(shares.to(captures.pictures.device))
        return decode_captures(self.module, captures, front, transfers), captures


def decode_captures(
    network: DecoderNetwork,
    captures: Captures,
    front: WienerFront,
    transfers: Sequence[torch.Tensor],
) -> torch.Tensor:
    """Decode captures with what the decoder's settings let it have.

    transfers: of each capture's layers, the nearest first. A decoder that is told the depth is told
    that of the farthest layer.
    """
    settings = network.settings
    filtered = psfs = None
    if settings.front == "blind":
        filtered = front(captures.pictures, captures.noise)
    if settings.front == "known" or settings.psf_channel:
        own = torch.stack([one[-1] for one in transfers])
        if settings.front == "known":
            known = WienerFront.of_known_depths(own, front.spectrum)
            filtered = known(captures.pictures, captures.noise)
        if settings.psf_channel:
            side = int(own.shape[-2])
            psf = origin_to_centre(irfft2(own, (side, side)))
            psfs = fit_psf(psf, (side, side))[:, None]
    decoded: torch.Tensor = network(captures.pictures, captures.noise, filtered, psfs)
    return decoded


def scene_losses(
    decoded: tuple[torch.Tensor, Captures], config: EdofTrainingConfig
) -> torch.Tensor:
    """Return the loss of each decoded scene, (scenes,)."""
    pictures, captures = decoded
    errors = (pictures - captures.truth).square().mean((1, 2, 3))
    if config.training.loss == "squared":
        return errors
    levels = (errors + _LEAST_ERROR).log()
    if not config.training.structure_weight:
        return levels
    alike = structural_similarity(pictures[:, 0], captures.truth[:, 0])
    return levels + config.training.structure_weight * (1 - alike)


def validation_score(sampler: SceneSampler, config: EdofTrainingConfig, decode: Any) -> float:
    """Return the mean PSNR in dB of decoded validation scenes.

    decode: takes scenes, and gives their decoded pictures and captures.
    """
    levels = []
    count, most = config.training.validation_scenes, config.training.samples
    for start in range(0, count, most):
        chosen = range(start, min(start + most, count))
        drawn = sampler.draw(VALIDATION_STEP, chosen, "validation")
        pictures, captures = decode(drawn)
        errors = (pictures - captures.truth).square().mean((1, 2, 3)).double()
        levels.append(-10 * torch.log10(errors + 1e-10))
    return float(torch.cat(levels).mean())
