"""Train the denoiser of plug-and-play restoration on photographs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from labapp.training.denoiser_patches import Colours, grey_patches
from labapp.training.schedule import TrainingSchedule
from labapp.training.task import VALIDATION_STEP, sample_generator
from optics.inverse.plug_and_play import Denoiser

STEPS = 24000
"""Steps unless others are asked for; the bundled weights have had as many. Chosen."""

_VALIDATED_PATCHES = 32
"""Patches whose PSNR is the score. Chosen: they take about as long as a step."""


@dataclass(frozen=True)
class DenoiserTrainingSettings:
    """Tune what the denoiser is trained on.

    noise_levels: lowest and highest standard deviation of the noise, relative to white; the
    logarithm is drawn evenly between them. Chosen.
    patches: of a step. Chosen.
    side: of a patch, pixels. Chosen.
    level_power: the error of a patch is divided by its noise level to this power. Chosen: about as
    the error of a good denoiser grows, so that all levels count alike.
    """

    noise_levels: tuple[float, float] = (0.004, 0.25)
    patches: int = 16
    side: int = 64
    level_power: float = 0.7


def denoiser_schedule(steps: int, seed: int) -> TrainingSchedule:
    """Return the denoiser's schedule. Its rates and decay are chosen."""
    return TrainingSchedule(steps, 1e-3, 2e-6, average_decay=0.999, seed=seed)


class DenoiserTask:
    """The denoising network, learning from pictures.

    The loss of a patch is its mean absolute error, divided by a power of its noise level.
    pictures: sharp ones, each (3, rows, columns), 0 to 1.
    seed: of the first weights and of all random numbers.
    """

    def __init__(
        self,
        pictures: Sequence[Colours],
        seed: int,
        device: torch.device,
        settings: DenoiserTrainingSettings | None = None,
    ) -> None:
        self._pictures, self._seed, self._device = pictures, seed, device
        self._own = settings or DenoiserTrainingSettings()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self._network = Denoiser().to(device)
        self._settings = {
            "trained": "denoiser",
            "pictures": _checksum(pictures),
            "seed": seed,
            **asdict(self._own),
        }

    @property
    def settings(self) -> Mapping[str, Any]:
        """Seed, tuning and a checksum of the pictures."""
        return self._settings

    @property
    def module(self) -> torch.nn.Module:
        """The denoising network."""
        return self._network

    @property
    def samples(self) -> int:
        """Patches of a step."""
        return self._own.patches

    def parameter_groups(self) -> list[dict[str, Any]]:
        """Return all weights, as one group."""
        return [{"params": list(self._network.parameters()), "rate": 1.0}]

    def losses(self, step: int, samples: Sequence[int]) -> torch.Tensor:
        """Return the denoiser's error in each patch of a step, weighted by noise level."""
        clean, noisy, level = self._draw_patches(step, samples)
        errors = (self._network(noisy, level) - clean).abs().mean((1, 2, 3))
        return errors / level**self._own.level_power

    def validate(self) -> float:
        """Return the mean PSNR in dB of denoised patches, on which no step is trained.

        They are cut from the training pictures, with random numbers of their own. The score shows
        whether training goes well; it is no judgement of the denoiser on other pictures.
        """
        clean, noisy, level = self._draw_patches(VALIDATION_STEP, range(_VALIDATED_PATCHES))
        errors = (self._network(noisy, level) - clean).square().mean((1, 2, 3))
        return float(-10 * errors.log10().mean())

    def _draw_patches(
        self, step: int, samples: Sequence[int]
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Draw sharp patches of a step, the same with noise, and the noise levels."""
        drawn = [self._draw_patch(sample_generator(self._seed, step, one)) for one in samples]
        clean, noise, levels = zip(*drawn, strict=True)
        level = torch.tensor(levels, dtype=torch.float32, device=self._device)
        sharp = torch.cat(clean).to(self._device)
        return sharp, sharp + level[:, None, None, None] * torch.cat(noise).to(self._device), level

    def _draw_patch(self, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor, float]:
        """Draw a sharp patch, white noise of unit variance, and a noise level."""
        clean = grey_patches(self._pictures, 1, self._own.side, rng)
        low, high = map(math.log, self._own.noise_levels)
        level = math.exp(rng.uniform(low, high))
        noise = torch.from_numpy(rng.standard_normal(clean.shape, dtype=np.float32))
        return clean, noise, level


def _checksum(pictures: Sequence[Colours]) -> str:
    found = hashlib.sha256()
    for picture in pictures:
        found.update(repr(picture.shape).encode())
        found.update(np.ascontiguousarray(picture).data)
    return found.hexdigest()[:16]
