"""Read photographs, and measure their power spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from labapp.files.reading import bundled_path
from labapp.training.edof.config import EdofTrainingConfig
from labapp.training.manifest import DataManifest
from labapp.training.pictures import TrainingPictures, read_training_data
from labapp.training.scenes import PatchSource
from labapp.training.task import VALIDATION_STEP, sample_generator
from optics.edof.picture_spectrum import (
    NATURAL_SPECTRUM,
    SpectrumModel,
    fit_spectrum_model,
    measure_picture_spectrum,
)
from optics.edof.protocol import decode_srgb
from optics.progress import Progress

BUNDLED_FINGERPRINTS = bundled_path("edof-test-pictures.npz")
"""Fingerprints of the photographs on which the figures of depth of field are measured."""

_SPECTRUM_PATCHES = 256
"""Patches whose mean power spectrum is measured. Chosen: the mean is known to a tenth or so."""


def read_pictures(
    folders: Sequence[Path],
    test_pictures: Sequence[Path],
    config: EdofTrainingConfig,
    progress: Progress,
) -> tuple[TrainingPictures | None, DataManifest | None]:
    """Read the photographs of folders; none without folders.

    Raises UserError if there is one picture only, a file isn't a picture, or one is a test picture.
    """
    if not folders:
        return None, None
    return read_training_data(
        folders,
        test_pictures=test_pictures or [BUNDLED_FINGERPRINTS],
        smallest_side=config.training.side,
        shortest_edges=config.scenes.shortest_edges,
        progress=progress,
    )


def measure_spectrum(pictures: PatchSource, config: EdofTrainingConfig) -> SpectrumModel:
    """Return the power spectrum that pattern and decoder take pictures to have.

    It is measured on patches of the pictures as they are shown to the camera, unless the
    configuration asks for that of natural photographs.
    """
    if config.scenes.spectrum == "natural":
        return NATURAL_SPECTRUM
    side, patches = config.training.side, []
    for number in range(_SPECTRUM_PATCHES):
        # Numbers below the samples' are never drawn from in a step of validation.
        generator = sample_generator(config.seed + 1, VALIDATION_STEP, number)
        values = torch.from_numpy(pictures.patch(generator, side))
        patches.append(decode_srgb(values) if config.scenes.light == "linear" else values)
    return fit_spectrum_model(
        measure_picture_spectrum(torch.stack(patches), side),
        f"{_SPECTRUM_PATCHES} patches of the training's pictures",
    )
