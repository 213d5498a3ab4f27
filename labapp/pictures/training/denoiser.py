"""Train the denoiser of plug-and-play restoration on photographs."""

from __future__ import annotations

import math
import os
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labapp.common.errors import UserError
from labapp.pictures.training.patches import Colours, grey_patches
from optics.deconvolution.denoiser import Denoiser
from optics.progress import Progress


@dataclass(frozen=True)
class DenoiserTrainingSettings:
    """Tune the training of the denoiser.

    Attributes
    ----------
    noise_levels : tuple of float
        Lowest and highest standard deviation of the noise, relative to white; the logarithm is
        drawn evenly between them. Chosen.
    patches : int
        Patches of a step. Chosen.
    side : int
        Side of a patch in pixels. Chosen.
    first_rate, last_rate : float
        Learning rates of the first and the last step; they are joined by half a cosine. Chosen.
    average_decay : float
        Decay of the running mean of the weights. The mean is the result, because it varies less
        than the last weights. Chosen.
    checkpoint_interval : int
        Steps between checkpoints. Chosen.
    """

    noise_levels: tuple[float, float] = (0.004, 0.25)
    patches: int = 16
    side: int = 64
    first_rate: float = 1e-3
    last_rate: float = 2e-6
    average_decay: float = 0.999
    checkpoint_interval: int = 200


SETTINGS = DenoiserTrainingSettings()


@dataclass
class _TrainingState:
    """Network, running mean, optimiser and step count, from which training continues."""

    network: Denoiser
    mean: dict[str, torch.Tensor]
    optimiser: torch.optim.Adam
    step: int = 0

    @classmethod
    def initial(cls, seed: int) -> _TrainingState:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            network = Denoiser()
        mean = {name: value.clone() for name, value in network.state_dict().items()}
        return cls(network, mean, torch.optim.Adam(network.parameters(), lr=SETTINGS.first_rate))

    @classmethod
    def load_or_create(cls, file: Path, plan: dict[str, int]) -> _TrainingState:
        """Load the state of training on pictures from its checkpoint, or create the initial state.

        The initial state is created if there is no file. Raises UserError if the file can't be
        read, or belongs to other training.
        """
        state = cls.initial(plan["seed"])
        if not file.exists():
            return state
        try:
            data = torch.load(file, weights_only=True)
            own = data["plan"]
            state.load_data(data)
        except (OSError, LookupError, RuntimeError, ValueError, pickle.UnpicklingError) as error:
            raise UserError(f"{file}: not what training kept: {error} Delete it.") from None
        if own != plan:
            told = ", ".join(f"{name} {value}" for name, value in own.items())
            raise UserError(f"{file}: was kept for {told}. Delete it, or ask for the same again.")
        return state

    def as_data(self) -> dict[str, Any]:
        return {
            "network": self.network.state_dict(),
            "mean": self.mean,
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
        }

    def load_data(self, data: dict[str, Any]) -> None:
        self.network.load_state_dict(data["network"])
        self.mean = data["mean"]
        self.optimiser.load_state_dict(data["optimiser"])
        self.step = data["step"]


def train_weights(
    pictures: Sequence[Colours], steps: int, seed: int, checkpoint: Path, progress: Progress
) -> dict[str, torch.Tensor]:
    """Train the denoising network on pictures; return the running mean of its weights, by name.

    A step takes 16 patches of 64 x 64 pixels. The loss is the mean absolute error, divided by the
    noise level to the power of 0.7, about as the error of a good denoiser grows; so all levels
    count alike. The random numbers of a step follow from seed and step alone, and the file
    `checkpoint` keeps the state every 200 steps. Interrupted training therefore continues from
    there, and ends in the same weights. Raises UserError for a checkpoint of other training.
    """
    plan = {"steps": steps, "seed": seed, "pixels": sum(picture.size for picture in pictures)}
    state = _TrainingState.load_or_create(checkpoint, plan)
    while state.step < steps:
        error = _step(state, pictures, steps, seed)
        if state.step % SETTINGS.checkpoint_interval == 0:
            _save_checkpoint(state.as_data() | {"plan": plan}, checkpoint)
        message = f"step {state.step}/{steps}, error {error:.4f}"
        progress.report(state.step / steps, message)
    return state.mean


def _step(state: _TrainingState, pictures: Sequence[Colours], steps: int, seed: int) -> float:
    """Take one step of training the denoising network on pictures, and return its loss."""
    rng = np.random.default_rng((seed, state.step))
    count, first, last = SETTINGS.patches, SETTINGS.first_rate, SETTINGS.last_rate
    clean = grey_patches(pictures, count, SETTINGS.side, rng)
    low, high = map(math.log, SETTINGS.noise_levels)
    level = torch.from_numpy(np.exp(rng.uniform(low, high, count)).astype(np.float32))
    noise = torch.from_numpy(rng.standard_normal(clean.shape, dtype=np.float32))
    across = level[:, None, None, None]
    rate = last + (first - last) * (1 + math.cos(math.pi * state.step / steps)) / 2
    for group in state.optimiser.param_groups:
        group["lr"] = rate
    state.optimiser.zero_grad(set_to_none=True)
    restored = state.network(clean + across * noise, level)
    error = ((restored - clean).abs() / across**0.7).mean()
    error.backward()
    state.optimiser.step()
    state.step += 1
    memory = min(SETTINGS.average_decay, state.step / (state.step + 10))
    for name, value in state.network.state_dict().items():
        state.mean[name].lerp_(value, 1 - memory)
    return float(error.detach())


def _save_checkpoint(data: dict[str, Any], checkpoint: Path) -> None:
    """Replace the checkpoint of training on pictures atomically; a crash leaves the one before."""
    fresh = checkpoint.with_suffix(".new")
    torch.save(data, fresh)
    os.replace(fresh, checkpoint)
