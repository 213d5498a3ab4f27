"""The designed pattern for extended depth of field, and the patterns beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from labapp.common.errors import UserError
from labapp.edof.trained_pattern import (
    BUNDLED_PATTERN,
    TrainedPattern,
    bundled_trained_pattern,
    read_trained_pattern,
)
from labapp.files.design_file import read_design
from labapp.files.output_paths import is_design
from labapp.studies.catalogue.edof import EdofSettings
from optics.camera import Camera
from optics.edof.dioptres import DEPTH_RANGE
from optics.edof.protocol_psfs import PupilPattern
from optics.slm import Modulator

DESIGNED, RINGS, NEUTRAL = "designed", "rings", "neutral"
"""Names in the plan of the designed pattern, of hand-made rings, and of no pattern."""

PATTERNS = (DESIGNED, RINGS, NEUTRAL)


def pattern_tables(settings: EdofSettings) -> dict[str, Any]:
    """Return the plan tables of the patterns; UserError if the design file is missing."""
    far, near = DEPTH_RANGE
    return {
        DESIGNED: {"kind": "image", "file": str(design_path(settings))},
        RINGS: {
            "kind": "multi-focus",
            "near_dioptre": near,
            "far_dioptre": far,
            "wavelength_nm": settings.wavelength_nm,
        },
    }


def trained_pattern(settings: EdofSettings) -> TrainedPattern:
    """Return the pattern whose decoder is used: the chosen one, or else the bundled one."""
    path = design_path(settings)
    if not is_design(path) or read_design(path).decoder is None:
        return bundled_trained_pattern()
    return read_trained_pattern(path)


def design_path(settings: EdofSettings) -> Path:
    """Return the path of the design file that is shown; UserError if it is missing."""
    path = Path(settings.pattern).expanduser() if settings.pattern else BUNDLED_PATTERN
    if not path.is_file():
        raise UserError(
            f"study edof: there is no pattern {path}. Make one (labapp design edof --out edof.h5), "
            "and give it: pattern=edof.h5"
        )
    return path.absolute()


def pattern_in_pupil(
    name: str, grey: torch.Tensor, camera: Camera, wavelength: float
) -> PupilPattern:
    """Return what grey levels do to light in the pupil, as far as the panel is known.

    A panel that is calibrated has a response and a flatness; fringing dims pixels beside a jump of
    the phase.
    wavelength: metres.
    """
    panel = camera.panel
    modulator = Modulator(panel, wavelength)
    phase = modulator.phase(grey)
    if not (panel.coupling or panel.gap_reflection or panel.flatness or panel.illumination):
        return PupilPattern(name, phase)
    field = modulator.modulation(phase)
    amplitude = field.abs()
    return PupilPattern(name, field.angle(), amplitude / amplitude.max())
