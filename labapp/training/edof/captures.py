"""Draw scenes at random depths, and simulate their captures for a decoder to learn from."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.training.edof.config import EdofTrainingConfig
from labapp.training.manifest import Split
from labapp.training.procedural_scenes import ProceduralPictures
from labapp.training.scenes import PatchSource, Scene, draw_scene
from labapp.training.task import sample_generator
from optics.edof.layered_capture import composite_layers, flatten_layers
from optics.edof.protocol import decode_srgb, encode_srgb


@dataclass(frozen=True, eq=False)
class DrawnScene:
    """A scene at its depths, before it is captured.

    depths: random numbers from 0 to below 1 that decide the depths, (layers,), falling: 0 is the
    farthest.
    noise: standard deviation of the capture's noise, where white is 1.
    unmodulated: share of the light that the panel leaves unmodulated.
    grain: the noise with a standard deviation of 1, (side, side).
    """

    scene: Scene
    depths: NDArray[np.float64]
    noise: float
    unmodulated: float
    grain: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Captures:
    """Simulated captures with their truth.

    pictures: the captures, (captures, 1, side, side).
    truth: the sharp scenes, (captures, 1, side, side), in the scale in which decoders are compared.
    noise: standard deviation of each, (captures,).
    """

    pictures: torch.Tensor
    truth: torch.Tensor
    noise: torch.Tensor


class MixedPictures:
    """Patches from photographs, some of them drawn instead.

    photographs: where photographs come from; None draws all patches.
    procedural_share: share of patches that are drawn.
    """

    def __init__(self, photographs: PatchSource | None, procedural_share: float) -> None:
        self._photographs, self._share = photographs, procedural_share
        self._procedural = ProceduralPictures()

    def patch(
        self, generator: np.random.Generator, side: int, split: Split = "training"
    ) -> NDArray[np.float32]:
        """Return a random grey patch, (side, side), sRGB values from 0 to 1."""
        if self._photographs is None or generator.random() < self._share:
            return self._procedural.patch(generator, side, split)
        return self._photographs.patch(generator, side, split)


class SceneSampler:
    """Draws the scenes of a step, each from its own random numbers.

    ahead: steps of which scenes are drawn beforehand by threads of their own, while another device
    trains; 0 draws them when they're needed. The scenes are the same.
    """

    def __init__(self, pictures: PatchSource, config: EdofTrainingConfig, ahead: int = 0) -> None:
        self._pictures, self._config, self._ahead = pictures, config, ahead
        self._pool = ThreadPoolExecutor(min(8, os.cpu_count() or 1)) if ahead else None
        self._pending: dict[tuple[int, int], Future[DrawnScene]] = {}

    def draw(
        self, step: int, samples: Sequence[int], split: Split = "training"
    ) -> list[DrawnScene]:
        """Draw scenes of a step with their depths and noise."""
        if self._pool is None or split != "training":
            return [self._draw_scene(step, one, split) for one in samples]
        for later in range(step, step + 1 + self._ahead):
            for one in samples:
                if (later, one) not in self._pending:
                    self._pending[later, one] = self._pool.submit(
                        self._draw_scene, later, one, split
                    )
        return [self._pending.pop((step, one)).result() for one in samples]

    def _draw_scene(self, step: int, sample: int, split: Split) -> DrawnScene:
        generator = sample_generator(self._config.seed, step, sample)
        side = self._config.training.side
        scene = draw_scene(self._pictures, generator, side, self._config.scenes.settings, split)
        depths = np.sort(generator.random(len(scene.pictures)))[::-1].copy()
        low, high = self._config.capture.noise
        if self._config.capture.spread == "logarithmic":
            noise = math.exp(generator.uniform(math.log(low), math.log(high)))
        else:
            noise = generator.uniform(low, high)
        unmodulated = generator.uniform(*self._config.capture.unmodulated)
        grain = generator.standard_normal((side, side), dtype=np.float32)
        return DrawnScene(scene, depths, noise, unmodulated, grain)


def unmodulated_shares(drawn: Sequence[DrawnScene]) -> torch.Tensor:
    """Return the share of unmodulated light in each scene's capture, (scenes,)."""
    return torch.tensor([one.unmodulated for one in drawn], dtype=torch.float32)


def capture_scenes(
    drawn: Sequence[DrawnScene], transfers: Sequence[torch.Tensor], *, linear: bool
) -> Captures:
    """Simulate the captures of scenes, in their order; differentiable in the optics.

    The captures are on the device of the transfer functions.
    transfers: transfer function of each layer's depth, each (layers, side, side // 2 + 1).
    linear: whether pictures are decoded to linear light; decoders are then compared in sRGB.
    """
    device = transfers[0].device
    images: dict[int, torch.Tensor] = {}
    truths: dict[int, torch.Tensor] = {}
    # Scenes with as many layers are computed together.
    for layers in sorted({len(one.depths) for one in drawn}):
        group = [k for k, one in enumerate(drawn) if len(one.depths) == layers]
        values = torch.from_numpy(np.stack([drawn[k].scene.pictures for k in group])).to(device)
        mattes = torch.from_numpy(np.stack([drawn[k].scene.mattes for k in group])).to(device)
        light = decode_srgb(values) if linear else values
        blurred = composite_layers(light, mattes, torch.stack([transfers[k] for k in group]))
        sharp = flatten_layers(light, mattes)
        for place, k in enumerate(group):
            images[k], truths[k] = blurred[place], sharp[place]
    noise = torch.tensor([one.noise for one in drawn], dtype=torch.float32, device=device)
    grain = torch.from_numpy(np.stack([one.grain for one in drawn])).to(device)
    image, truth = (torch.stack([one[k] for k in sorted(one)]) for one in (images, truths))
    captured = image + noise[:, None, None] * grain
    shown = encode_srgb(truth) if linear else truth
    return Captures(captured[:, None], shown[:, None], noise)
