"""`labapp train denoiser`: train the weights of the denoiser on folders of pictures."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from labapp.common.console import out
from labapp.files.writing import write_atomically
from labapp.pictures.networks import weights_file
from labapp.training.command import train_for_command
from labapp.training.denoiser import STEPS, DenoiserTask, denoiser_schedule
from labapp.training.denoiser_patches import read_training_pictures
from labapp.training.loop import TrainingResult
from labapp.training.processes import Processes, join_processes


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
            _write(result, processes, weights)
            kept.unlink(missing_ok=True)
            hours = (time.process_time() - started) / 3600
            out.print(f"wrote {weights} after {hours:.2f} processor hours")


def _write(result: TrainingResult, processes: Processes, weights: Path) -> None:
    """Write the denoiser's weights, and print what it reached."""
    own = {name: value.cpu() for name, value in result.weights.items()}
    write_atomically(weights, weights_file(own))
    shared = f", shared by {processes.count} processes" if processes.count > 1 else ""
    out.print(
        f"{result.steps} steps{shared}; PSNR on patches of these pictures "
        f"{result.history[-1][1]:.2f} dB"
    )
