"""`labapp train denoiser`: train the denoiser of plug-and-play restoration on photographs."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.console import out
from labapp.common.errors import UserError
from labapp.files.picture.colour_picture import read_screen_colours
from labapp.files.writing import write_atomically
from labapp.pictures.networks import weights_file
from labapp.training.command import train_for_command
from labapp.training.processes import join_processes
from labapp.training.state import TrainingSchedule
from labapp.training.task import VALIDATION_STEP, sample_generator
from optics.inverse.plug_and_play import Denoiser

_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}

Colours = NDArray[np.float32]


def read_training_pictures(folders: Sequence[Path]) -> list[Colours]:
    """Read every picture of folders and files, (3, rows, columns), 0 to 1.

    Each picture is returned at scales of 1, 0.8 and 0.6. The order is that of the file names,
    whatever the order of the folders. Raises UserError if there is no picture, or a file isn't one.
    """
    files = sorted(
        {
            file
            for folder in folders
            for file in ([folder] if folder.is_file() else folder.rglob("*"))
            if file.suffix.lower() in _SUFFIXES
        },
        key=lambda file: file.name,
    )
    if not files:
        raise UserError(f"{', '.join(map(str, folders))}: no picture to learn from. Name folders.")
    return [_resize(_read(file), scale) for file in files for scale in (1.0, 0.8, 0.6)]


def _read(file: Path) -> Colours:
    # Blue comes first, as it did when the bundled weights were trained: draws stay the same.
    picture = np.asarray(read_screen_colours(file)[::-1] / np.float32(255), dtype=np.float32)
    # A longer side of more than 1100 pixels is averaged down, which sharpens the picture and
    # removes traces of JPEG and demosaicing.
    return _resize(picture, min(1100 / max(picture.shape[1:]), 1.0))


def _resize(picture: Colours, scale: float) -> Colours:
    if scale == 1:
        return np.ascontiguousarray(picture)
    size = [round(n * scale) for n in picture.shape[1:]][::-1]
    return np.stack([cv2.resize(band, size, interpolation=cv2.INTER_AREA) for band in picture])


def grey_patches(
    pictures: Sequence[Colours], count: int, side: int, rng: np.random.Generator
) -> torch.Tensor:
    """Return random grey patches of pictures, (count, 1, side, side).

    They are cut, rotated by multiples of 90 degrees and mirrored at random, and their grey is a
    random mixture of the colours. The probability of a picture is proportional to its area. Raises
    UserError if no picture is larger than a patch.
    """
    areas = np.array([max(p.shape[1] - side, 0) * max(p.shape[2] - side, 0) for p in pictures])
    if not areas.any():
        raise UserError(f"no picture is larger than a patch, {side} x {side} pixels.")
    chosen = rng.choice(len(pictures), count, p=areas / areas.sum())
    patches = []
    for picture in (pictures[i] for i in chosen):
        y, x = (int(rng.integers(n - side + 1)) for n in picture.shape[1:])
        mixture = rng.dirichlet(np.ones(3)).astype(np.float32)
        grey = np.tensordot(mixture, picture[:, y : y + side, x : x + side], 1)
        turned = np.rot90(grey, int(rng.integers(4)))
        patches.append(np.ascontiguousarray(turned[:, ::-1] if rng.integers(2) else turned))
    return torch.from_numpy(np.stack(patches))[:, None]


STEPS = 24000
"""Steps unless others are asked for; the bundled weights have had as many. Chosen."""

_VALIDATED_PATCHES = 32
"""Patches whose PSNR is the score. Chosen: they take about as long as a step."""


_NOISE_LEVELS = (0.004, 0.25)
"""Lowest and highest standard deviation of the noise, relative to white; the logarithm is drawn
evenly between them. Chosen."""

_PATCHES, _SIDE = 16, 64
"""Patches of a step, and pixels along a side of each. Chosen."""

_LEVEL_POWER = 0.7
"""The error of a patch is divided by its noise level to this power. Chosen: about as the error of a
good denoiser grows, so that all levels count alike."""


def denoiser_schedule(steps: int, seed: int) -> TrainingSchedule:
    """Return the denoiser's schedule. Its rates and decay are chosen."""
    return TrainingSchedule(steps, 1e-3, 2e-6, average_decay=0.999, seed=seed)


class DenoiserTask:
    """The denoising network, learning from pictures.

    The loss of a patch is its mean absolute error, divided by a power of its noise level.
    pictures: sharp ones, each (3, rows, columns), 0 to 1.
    seed: of the first weights and of all random numbers.
    """

    def __init__(self, pictures: Sequence[Colours], seed: int, device: torch.device) -> None:
        self._pictures, self._seed, self._device = pictures, seed, device
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.module = Denoiser().to(device)
        self.samples = _PATCHES
        checksum = hashlib.sha256()
        for picture in pictures:
            checksum.update(repr(picture.shape).encode())
            checksum.update(np.ascontiguousarray(picture).data)
        self.settings: Mapping[str, Any] = {
            "trained": "denoiser",
            "pictures": checksum.hexdigest()[:16],
            "seed": seed,
            "noise_levels": _NOISE_LEVELS,
            "patches": _PATCHES,
            "side": _SIDE,
            "level_power": _LEVEL_POWER,
        }

    def parameter_groups(self) -> list[dict[str, Any]]:
        """Return all weights, as one group."""
        return [{"params": list(self.module.parameters()), "rate": 1.0}]

    def losses(self, step: int, samples: Sequence[int]) -> torch.Tensor:
        """Return the denoiser's error in each patch of a step, weighted by noise level."""
        clean, noisy, level = self._draw_patches(step, samples)
        errors = (self.module(noisy, level) - clean).abs().mean((1, 2, 3))
        return errors / level**_LEVEL_POWER

    def validate(self) -> float:
        """Return the mean PSNR in dB of denoised patches, on which no step is trained.

        They are cut from the training pictures, with random numbers of their own. The score shows
        whether training goes well; it is no judgement of the denoiser on other pictures.
        """
        clean, noisy, level = self._draw_patches(VALIDATION_STEP, range(_VALIDATED_PATCHES))
        errors = (self.module(noisy, level) - clean).square().mean((1, 2, 3))
        return float(-10 * errors.log10().mean())

    def _draw_patches(
        self, step: int, samples: Sequence[int]
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Draw sharp patches of a step, the same with white noise, and the noise levels."""
        low, high = map(math.log, _NOISE_LEVELS)
        clean, noise, levels = [], [], []
        for one in samples:
            rng = sample_generator(self._seed, step, one)
            clean.append(grey_patches(self._pictures, 1, _SIDE, rng))
            levels.append(math.exp(rng.uniform(low, high)))
            noise.append(torch.from_numpy(rng.standard_normal(clean[-1].shape, dtype=np.float32)))
        level = torch.tensor(levels, dtype=torch.float32, device=self._device)
        sharp = torch.cat(clean).to(self._device)
        return sharp, sharp + level[:, None, None, None] * torch.cat(noise).to(self._device), level


def train_denoiser(
    folders: Sequence[Path],
    weights: Path,
    *,
    steps: int | None,
    minutes: float | None,
    seed: int,
    device: str,
) -> None:
    """Train the denoising network on pictures, and write its weights.

    The state beside the weights lets interrupted training continue. Raises UserError if pictures,
    device or kept state can't be used.
    folders: folders of pictures, or picture files.
    weights: file to write.
    steps: in all.
    minutes: time of which the number of steps is made once, in the place of `steps`.
    seed: of all random numbers.
    device: "auto", "cpu" or "cuda".
    """
    started = time.process_time()
    with join_processes(device) as processes:
        pictures = read_training_pictures(folders)
        if processes.is_writer:
            many = sum(picture[0].size for picture in pictures) / 1e6
            out.print(f"{len(pictures)} pictures, {many:.0f} million pixels")
        task = DenoiserTask(pictures, seed, processes.device)
        kept = weights.with_suffix(".training")
        schedule = denoiser_schedule(STEPS, seed)
        result = train_for_command(task, schedule, kept, processes, steps=steps, minutes=minutes)
        if processes.is_writer:
            own = {name: value.cpu() for name, value in result.weights.items()}
            write_atomically(weights, weights_file(own))
            shared = f", shared by {processes.count} processes" if processes.count > 1 else ""
            out.print(
                f"{result.steps} steps{shared}; PSNR on patches of these pictures "
                f"{result.history[-1][1]:.2f} dB"
            )
            kept.unlink(missing_ok=True)
            hours = (time.process_time() - started) / 3600
            out.print(f"wrote {weights} after {hours:.2f} processor hours")
