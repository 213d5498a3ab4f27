"""Find a decoder by its file or its word, and say what it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from labapp.common.errors import UserError
from labapp.edof.trained_pattern import (
    TrainedPattern,
    bundled_trained_pattern,
    read_trained_pattern,
)

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
    return (
        f"{name_decoder(pattern)}, trained on {_describe_data(pattern)} for {far:g} to {near:g} "
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


def _describe_data(pattern: TrainedPattern) -> str:
    """Say what pictures the training saw: drawn ones, or photographs of a list."""
    digest = str(pattern.account.get("data", ""))
    if digest in ("", "drawn"):
        return "drawn pictures"
    return f"photographs (list {digest[:8]})"
