"""The denoiser behind plug-and-play restoration, learned from photographs."""

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

_LEVELS = (0.004, 0.25)
"""Standard deviations of the noise, relative to white; their logarithms are drawn evenly."""

_PATCHES, _SIDE = 16, 64
_FASTEST, _SLOWEST = 1e-3, 2e-6
"""Learning rates, from the first step to the last along half a cosine."""

_AVERAGE_DECAY = 0.999
"""Of the running mean of the weights, which is what is kept: it varies less than the last."""

_CHECKPOINT_INTERVAL = 200


@dataclass
class _TrainingState:
    """What a step goes on from."""

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
        return cls(network, mean, torch.optim.Adam(network.parameters(), lr=_FASTEST))

    @classmethod
    def load_or_create(cls, file: Path, plan: dict[str, int]) -> _TrainingState:
        """What a file has, if it was kept for this; UserError if it wasn't."""
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
    """The weights after so many steps of 16 patches of 64 x 64.

    The absolute error is made small, of every level alike: it is divided by the level to the power
    of .7, about as the error of a good denoiser grows. What a step draws follows from seed and
    step alone, and the state is kept in the file `checkpoint` every 200 steps: training that was
    interrupted goes on from there, and ends in the same weights. Raises UserError for a file of
    other training.
    """
    plan = {"steps": steps, "seed": seed, "pixels": sum(picture.size for picture in pictures)}
    state = _TrainingState.load_or_create(checkpoint, plan)
    while state.step < steps:
        error = _step(state, pictures, steps, seed)
        if state.step % _CHECKPOINT_INTERVAL == 0:
            _save_checkpoint(state.as_data() | {"plan": plan}, checkpoint)
        message = f"step {state.step}/{steps}, error {error:.4f}"
        progress.report(state.step / steps, message)
    return state.mean


def _step(state: _TrainingState, pictures: Sequence[Colours], steps: int, seed: int) -> float:
    rng = np.random.default_rng((seed, state.step))
    clean = grey_patches(pictures, _PATCHES, _SIDE, rng)
    low, high = map(math.log, _LEVELS)
    level = torch.from_numpy(np.exp(rng.uniform(low, high, _PATCHES)).astype(np.float32))
    noise = torch.from_numpy(rng.standard_normal(clean.shape, dtype=np.float32))
    across = level[:, None, None, None]
    rate = _SLOWEST + (_FASTEST - _SLOWEST) * (1 + math.cos(math.pi * state.step / steps)) / 2
    for group in state.optimiser.param_groups:
        group["lr"] = rate
    state.optimiser.zero_grad(set_to_none=True)
    restored = state.network(clean + across * noise, level)
    error = ((restored - clean).abs() / across**0.7).mean()
    error.backward()
    state.optimiser.step()
    state.step += 1
    memory = min(_AVERAGE_DECAY, state.step / (state.step + 10))
    for name, value in state.network.state_dict().items():
        state.mean[name].lerp_(value, 1 - memory)
    return float(error.detach())


def _save_checkpoint(data: dict[str, Any], checkpoint: Path) -> None:
    """Replace the file at once: a crash leaves the one before."""
    fresh = checkpoint.with_suffix(".new")
    torch.save(data, fresh)
    os.replace(fresh, checkpoint)
