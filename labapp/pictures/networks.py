"""Read and write the weights of the denoising network for plug-and-play restoration."""

from __future__ import annotations

import functools
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from labapp.common.errors import UserError
from labapp.files.array_file import read_npz
from labapp.files.reading import bundled_path
from optics.inverse.method import Denoise
from optics.inverse.plug_and_play import load_denoiser

BUNDLED_WEIGHTS = bundled_path("denoiser.npz")
"""Weights of the bundled denoiser, trained by `labapp train denoiser`; see SOURCES.txt."""


@functools.cache
def bundled_denoiser() -> Denoise:
    """Return the bundled denoising network."""
    return read_denoiser(BUNDLED_WEIGHTS)


def read_denoiser(path: Path) -> Denoise:
    """Read a denoising network from a file of weights; UserError if it is damaged."""
    try:
        weights = {name: torch.from_numpy(value) for name, value in read_npz(path).items()}
        return load_denoiser(weights).denoise
    except (ValueError, TypeError) as error:
        raise UserError(
            f"{path}: not a denoiser's weights: {error} Write some with labapp train denoiser."
        ) from None


def weights_file(weights: Mapping[str, torch.Tensor]) -> bytes:
    """Return an .npz file that holds each weight under its name, in half precision."""
    buffer = io.BytesIO()
    halves = {name: value.to(torch.float16).numpy() for name, value in weights.items()}
    np.savez_compressed(buffer, **halves)  # type: ignore[arg-type]
    return buffer.getvalue()
