"""A pattern with the decoder that was trained for it, as a design file holds them."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.files.bench_file import BenchFile
from labapp.files.design_file import DecoderContents, bundled_trained_design, read_design
from labapp.files.reading import validate
from optics.camera import Camera
from optics.edof.learned import DecoderNetwork, DecoderSettings
from optics.edof.picture_spectrum import FrequencyGrid, SpectrumModel
from optics.slm import grey_to_phase

BUNDLED_PATTERN = bundled_trained_design()
"""The pattern and decoder that come with the application; SOURCES.txt says how they were made."""


@dataclass(frozen=True, eq=False)
class TrainedPattern:
    """A pattern that extends the depth of field, with the network that decodes its photographs.

    path: the design file.
    camera: the one that it was trained for.
    wavelength: metres.
    grey: (rows, columns), uint8, the pattern as the panel shows it.
    spectrum: power spectrum of the pictures that the filter before the network takes to be there.
    config: the configuration of the training, as plain data.
    account: steps, scores and data of the training, as plain data.
    """

    path: Path
    camera: Camera
    wavelength: float
    grey: np.ndarray
    network: DecoderNetwork
    spectrum: SpectrumModel
    config: Mapping[str, Any]
    account: Mapping[str, Any]

    @property
    def phase(self) -> torch.Tensor:
        """The phase that the panel of the training's camera shows, (rows, columns), radians."""
        return grey_to_phase(self.camera.panel, torch.from_numpy(self.grey), self.wavelength)

    @property
    def depth_range(self) -> tuple[float, float]:
        """The farthest and the nearest depth of the training, dioptres."""
        return float(self.config["far_dioptre"]), float(self.config["near_dioptre"])

    @property
    def binning(self) -> int:
        """Sensor pixels along a side of the squares that are averaged into a pixel."""
        return int(self.config["scenes"]["binning"])

    def spectrum_on_grid(self, side: int) -> torch.Tensor:
        """Return the power spectrum of pictures on the grid of rfft2 for side x side pixels."""
        return self.spectrum.on_grid(FrequencyGrid(side))


@functools.cache
def bundled_trained_pattern() -> TrainedPattern:
    """Return the pattern with decoder that comes with the application."""
    return read_trained_pattern(BUNDLED_PATTERN)


def read_trained_pattern(path: Path) -> TrainedPattern:
    """Read a pattern with its decoder from a design file.

    Raises UserError if the file is no design file, has no decoder, or is damaged.
    """
    contents = read_design(path)
    if contents.decoder is None:
        raise UserError(
            f"{path}: holds a pattern without a decoder. Train one: labapp train edof, with "
            f'start = "{shell_word(path.name)}" in its [pattern] table.'
        )
    stored = contents.decoder.settings
    try:
        network = DecoderNetwork(DecoderSettings.from_data(stored["decoder"]))
        weights = contents.decoder.weights.items()
        network.load_state_dict(
            {name: torch.from_numpy(value.astype(np.float32)) for name, value in weights}
        )
        spectrum = SpectrumModel(
            tuple(tuple(row) for row in stored["spectrum"]["coefficients"]),
            stored["spectrum"]["source"],
        )
        config, account = stored["config"], stored["account"]
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise UserError(f"{path}: its decoder is damaged: {reason}. Train it again.") from error
    bench = validate(dict(contents.bench), BenchFile, str(path))
    return TrainedPattern(
        path,
        bench.build_camera(),
        contents.wavelength,
        contents.grey[0],
        network.requires_grad_(False).eval(),
        spectrum,
        config,
        account,
    )


def decoder_contents(
    network: DecoderNetwork,
    spectrum: SpectrumModel,
    config: Mapping[str, Any],
    account: Mapping[str, Any],
) -> DecoderContents:
    """Return what a design file holds of a trained decoder; `read_trained_pattern` reads it.

    The weights are rounded to half precision.
    """
    settings = {
        "decoder": network.settings.as_data(),
        "spectrum": {
            "coefficients": [list(row) for row in spectrum.coefficients],
            "source": spectrum.source,
        },
        "config": dict(config),
        "account": dict(account),
    }
    weights = {
        name: value.detach().cpu().to(torch.float16).numpy()
        for name, value in network.state_dict().items()
    }
    return DecoderContents(settings, weights)


BUNDLED = "edof"
"""The word for the decoder that comes with the application."""


def find_trained_pattern(name: str) -> TrainedPattern:
    """Read the trained pattern of a design file, or the bundled one for the word edof.

    Raises UserError if there is no such file, it has no decoder, or it is damaged.
    """
    pattern = bundled_trained_pattern() if name == BUNDLED else read_trained_pattern(Path(name))
    try:
        _ = pattern.depth_range, pattern.binning, training_noise(pattern)
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(
            f"{pattern.path}: its decoder is damaged: the configuration of its training lacks "
            f"{error}. Train it again."
        ) from error
    return pattern


def name_decoder(pattern: TrainedPattern) -> str:
    """Name a decoder's file, its knowledge and its size in a few words."""
    network = pattern.network
    knowledge, count = network.settings.knowledge, network.weight_count
    return f"decoder {pattern.path.name}, {knowledge}, {count:,} weights"


def describe_decoder(pattern: TrainedPattern) -> str:
    """Say in a line what a decoder is, and what it was trained on and for."""
    far, near = pattern.depth_range
    low, high = training_noise(pattern)
    digest = str(pattern.account.get("data", ""))
    data = "drawn pictures" if digest in ("", "drawn") else f"photographs (list {digest[:8]})"
    return (
        f"{name_decoder(pattern)}, trained on {data} for {far:g} to {near:g} "
        f"dioptres at {1e9 * pattern.wavelength:g} nm, noise {low:g} to {high:g} of white"
    )


def decoder_data(pattern: TrainedPattern) -> dict[str, Any]:
    """Return what a decoder is as plain data, for JSON."""
    account = pattern.account
    return {
        "file": str(pattern.path),
        "blind": pattern.network.settings.is_blind,
        "weights": pattern.network.weight_count,
        "light": pattern.network.settings.light,
        "dioptres": list(pattern.depth_range),
        "wavelength_nm": 1e9 * pattern.wavelength,
        "binning": pattern.binning,
        "trained_noise": list(training_noise(pattern)),
        "trained_on": account.get("data"),
        "steps": account.get("decoder_steps"),
        "joint_steps": account.get("joint_steps"),
    }


def training_noise(pattern: TrainedPattern) -> tuple[float, float]:
    """Return the least and the largest noise of the training, where white is 1."""
    low, high = pattern.config["capture"]["noise"]
    return float(low), float(high)
