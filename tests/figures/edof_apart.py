"""Patterns for depth of field where the panel stands before the lens."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import torch

from figures import TOLD, Figure, edof_protocol
from figures.edof_judge import PSFJudge
from figures.edof_protocol import CAMERA, _wiener
from optics.camera import Camera
from optics.edof.evaluation import prepare_scenes
from optics.edof.panel_transfer import QuarterTransfer
from optics.edof.pattern_search import design_pattern
from optics.edof.picture_spectrum import NATURAL_SPECTRUM
from optics.edof.protocol import STRICT
from optics.edof.protocol_psfs import PupilPattern, compute_depth_psfs
from optics.edof.transfer_design import TransferDesign
from optics.psf.chain_collapsed import collapse_to_thin_camera
from optics.quarter_symmetry import crop_quarter

_WAVELENGTH = 520e-9

_SEPARATION = 83.5e-3
"""Metres from panel to lens in the published program."""

_CHAIN_GOAL = 0.3
"""Decibels by which such a pattern may score below one for a panel at the lens."""


def separation_figures(phase: torch.Tensor, pictures: Sequence[torch.Tensor]) -> list[Figure]:
    """Panel and lens 83.5 mm apart: a pattern that doesn't know it, and one that is made for it."""
    protocol = replace(STRICT, off_grid_count=1)
    apart, scenes = replace(CAMERA, separation=_SEPARATION), prepare_scenes(pictures, protocol)
    # A pattern with an amplitude is computed whole, as it has to be before a lens that is apart.
    opened = torch.ones(CAMERA.panel.shape)
    own = PupilPattern("for 0 mm", phase, opened)
    made = PupilPattern("for 83.5 mm", design_apart(), opened)

    def levels(pattern: PupilPattern, camera: Camera, decoded_for: Camera) -> np.ndarray:
        wanted = compute_depth_psfs(pattern, protocol.design_dioptres, decoded_for, protocol)
        test = compute_depth_psfs(pattern, protocol.test_dioptres, camera, protocol)
        return PSFJudge(wanted, scenes, protocol, _wiener(STRICT)).levels(test)

    plain, wrong = levels(own, CAMERA, CAMERA), levels(own, apart, CAMERA)
    right = levels(made, apart, apart)
    millimetres = 1e3 * _SEPARATION
    return [
        Figure(
            f"pattern and filter for a panel at the lens, {millimetres:g} mm before it",
            TOLD,
            f"{(plain - wrong).mean():.2f} dB lost of {plain.mean():.2f}, worst distance "
            f"{(plain - wrong).max():.2f} dB",
            None,
        ),
        Figure(
            f"pattern for a panel {millimetres:g} mm before the lens, below one at the lens",
            f"≤ {_CHAIN_GOAL:g} dB",
            f"{(plain - right).mean():.2f} dB, {right.mean():.2f} of {plain.mean():.2f} dB",
            bool((plain - right).mean() <= _CHAIN_GOAL),
        ),
    ]


@cache
def design_apart() -> torch.Tensor:
    """The pattern for a panel that stands before the lens, made as `labapp design edof` does."""
    thin = collapse_to_thin_camera(replace(CAMERA, separation=_SEPARATION), math.inf)
    transfer = QuarterTransfer(TransferDesign(thin, _WAVELENGTH, edof_protocol._SIZE, 1))
    found = design_pattern(
        transfer,
        crop_quarter(edof_protocol._rings()),
        NATURAL_SPECTRUM.on_grid(transfer.grid),
        edof_protocol._NOISE,
        steps=edof_protocol._STEPS,
        generator=torch.Generator().manual_seed(edof_protocol._SEED),
    )
    return transfer.mirror(found.phase)
