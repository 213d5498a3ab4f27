"""`labapp train`: train the weights of the denoiser on folders of pictures."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import torch

from labapp.common.console import out, terminal_progress
from labapp.files.writing import write_atomically
from labapp.pictures.networks import weights_file
from labapp.pictures.training.denoiser import train_weights
from labapp.pictures.training.patches import read_training_pictures
from optics.threads import single_threaded


@single_threaded
def train_denoiser(folders: Sequence[Path], weights: Path, *, steps: int, seed: int) -> None:
    """Train the denoising network on pictures, and write its weights.

    A checkpoint beside the weights lets interrupted training continue. Raises UserError for
    pictures that can't be used.
    """
    pictures = read_training_pictures(folders)
    kept = weights.with_suffix(".training")
    many = sum(picture[0].size for picture in pictures) / 1e6
    out.print(f"{len(pictures)} pictures, {many:.0f} million pixels; kept so far in {kept}")
    started = time.process_time()
    with terminal_progress() as progress, _flush_denormals():
        trained = train_weights(pictures, steps, seed, kept, progress)
    write_atomically(weights, weights_file(trained))
    kept.unlink(missing_ok=True)
    hours = (time.process_time() - started) / 3600
    out.print(f"wrote {weights} after {hours:.2f} processor hours")


@contextmanager
def _flush_denormals() -> Iterator[None]:
    """Round denormal numbers to 0 while a network trains on pictures; they slow processors.

    Other code in the process needs denormal numbers: without them SciPy's KDTree recurses forever.
    """
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
