"""Networks that come with the project, and files of their weights."""

from __future__ import annotations

import functools
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from labapp.common.errors import UserError
from labapp.files.reading import bundled_path
from optics.deconvolution.denoiser import load_denoiser
from optics.deconvolution.method import Denoise

BUNDLED_WEIGHTS = bundled_path("denoiser.npz")
"""Trained by `labapp train`; see SOURCES.txt beside it."""


@functools.cache
def bundled_denoiser() -> Denoise:
    """The denoiser behind plug-and-play restoration."""
    return read_denoiser(BUNDLED_WEIGHTS)


def read_denoiser(path: Path) -> Denoise:
    """The denoiser of a file of weights. UserError says what is wrong with a file."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            weights = {name: torch.from_numpy(stored[name]) for name in stored.files}
        return load_denoiser(weights).denoise
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise UserError(
            f"{path}: not a denoiser's weights: {error} Write some with labapp train."
        ) from None


def weights_file(weights: Mapping[str, torch.Tensor]) -> bytes:
    """Weights in half precision, by their names, as a .npz file's bytes."""
    buffer = io.BytesIO()
    halves = {name: value.to(torch.float16).numpy() for name, value in weights.items()}
    np.savez_compressed(buffer, **halves)  # type: ignore[arg-type]
    return buffer.getvalue()
