"""A trained pattern for a small bench, whose decoder decodes in milliseconds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from labapp.edof.trained_pattern import decoder_contents
from labapp.files.bench_file import read_bench
from labapp.files.design_file import DesignContents, Grid, write_design
from labapp.training.edof.config import EdofTrainingConfig
from optics.edof.learned import DecoderNetwork, DecoderSettings, NetworkShape
from optics.edof.picture_spectrum import NATURAL_SPECTRUM

WAVELENGTH = 550e-9

SHAPE = NetworkShape(channels=4, levels=1, fold=2, convolutions=2)


def pattern_levels(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    """Grey levels at random, of less than a wave."""
    return np.random.default_rng(seed).integers(0, 60, shape).astype(np.uint8)


def write_trained(
    path: Path,
    bench: Path,
    *,
    seed: int | None = None,
    settings: DecoderSettings | None = None,
    grey: np.ndarray | None = None,
    scenes: dict[str, Any] | None = None,
    wavelength: float = WAVELENGTH,
    has_decoder: bool = True,
) -> Path:
    """Write a design file with a decoder; seed: of the last layer, which is 0 without one."""
    described = read_bench(bench)
    panel = described.build_camera().panel
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed or 0)
        network = DecoderNetwork(settings or DecoderSettings(SHAPE))
        if seed is not None:
            torch.nn.init.normal_(network.refining.tail.weight, std=0.05)
    config = EdofTrainingConfig.model_validate({"scenes": scenes or {}}).as_data()
    decoder = decoder_contents(network, NATURAL_SPECTRUM, config, {"data": "drawn"})
    levels = pattern_levels(panel.shape) if grey is None else grey
    axis = np.arange(3.0)
    contents = DesignContents(
        title="tiny",
        settings={"design": "edof"},
        bench=described.model_dump(mode="json"),
        wavelength=wavelength,
        grey=levels[None],
        phase=None,
        orders=1,
        frame_time=0.0,
        pixel_pitch=panel.pitch,
        psf=Grid(np.ones((1, 3, 3), np.float32), axis, axis),
        target=None,
        quality={},
        decoder=decoder if has_decoder else None,
    )
    write_design(path, contents)
    return path
