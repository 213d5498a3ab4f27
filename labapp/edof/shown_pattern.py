"""Compare the pattern that a photograph was taken through with the one that a decoder is for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch

from labapp.common.errors import UserError
from labapp.edof.trained_pattern import TrainedPattern
from optics.camera import Camera
from optics.slm import grey_to_phase, phase_to_grey
from optics.slm.lut import flatness_phase

_LEAST_STREHL = 0.98
"""Least Strehl ratio of the shown pattern against the trained one. Chosen: 0.14 rad rms. Rounding
to 16 levels a wave costs 0.013. Measured: a pattern has 0.95 against itself before its joint
training; an unrelated one has next to 0."""

_MOST_WAVELENGTH_CHANGE = 0.02
"""Largest relative difference from the wavelength of the training. Chosen: the PSF changes its size
by as much, 9 pixels of 450 at its rim."""


@dataclass(frozen=True, eq=False)
class ShownPattern:
    """A trained pattern as a bench has shown it.

    pattern: with its network; the grey levels give `camera` the phase that was shown, at the
        wavelength of the photograph.
    camera: of the bench; the flatness of its panel is part of the pattern.
    strehl: likeness of the shown phase with that of the training, from 0 to 1.
    same_levels: whether the panel was sent the grey levels of the training.
    """

    pattern: TrainedPattern
    camera: Camera
    strehl: float
    same_levels: bool


def match_shown_pattern(
    pattern: TrainedPattern, camera: Camera, grey: np.ndarray, wavelength: float, source: str
) -> ShownPattern:
    """Return a trained pattern with the phase that a bench has shown.

    Phases are compared, as a calibrated panel shows the same phase by other grey levels. Raises
    UserError if it is another pattern, for another panel or wavelength, or a video.

    camera: the one that has taken the photograph.
    grey: (rows, columns), uint8, what its panel was sent.
    wavelength: metres.
    source: the photograph and its pattern, in words, for errors.
    """
    own, panel = pattern.camera.panel, camera.panel
    if grey.ndim != 2:
        raise UserError(
            f"{source}: is a video of patterns, and {pattern.path} decodes a still one. Choose a "
            "photograph through the decoder's pattern: --pattern NAME."
        )
    if (panel.shape, panel.pitch) != (own.shape, own.pitch):
        raise UserError(
            f"{source}: was shown on a panel of {_describe_panel(camera)}, and the decoder "
            f"{pattern.path} is for one of {_describe_panel(pattern.camera)}. Train a pattern for "
            "the panel: labapp train edof."
        )
    if abs(wavelength / pattern.wavelength - 1) > _MOST_WAVELENGTH_CHANGE:
        raise UserError(
            f"{source}: was taken at {1e9 * wavelength:g} nm, and the decoder {pattern.path} is "
            f"for {1e9 * pattern.wavelength:g} nm. Choose a photograph of that wavelength "
            "(--wavelength-nm), or train a decoder for this one: labapp train edof."
        )
    phase = grey_to_phase(panel, torch.from_numpy(grey), wavelength)
    if panel.flatness is not None:
        phase = phase + flatness_phase(panel, wavelength)
    strehl = strehl_ratio(phase, pattern.phase)
    same = bool(np.array_equal(grey, pattern.grey))
    if strehl < _LEAST_STREHL:
        raise UserError(_describe_difference(pattern, source, strehl, same))
    flat = replace(panel, flatness=None)
    levels = phase_to_grey(flat, phase, wavelength).numpy()
    shown = replace(pattern, grey=levels, wavelength=wavelength)
    return ShownPattern(shown, replace(camera, panel=flat), strehl, same)


def strehl_ratio(phase: torch.Tensor, reference: torch.Tensor) -> float:
    """Return the Strehl ratio of a phase against another: 1 for phases equal but for a constant.

    phase, reference: (rows, columns), radians.
    """
    difference = phase.double() - reference.double()
    return float(difference.cos().mean().square() + difference.sin().mean().square())


def _describe_panel(camera: Camera) -> str:
    """Name the number and the pitch of a panel's pixels."""
    rows, columns = camera.panel.shape
    return f"{columns}x{rows} pixels of {1e6 * camera.panel.pitch:g} µm"


def _describe_difference(pattern: TrainedPattern, source: str, strehl: float, same: bool) -> str:
    """Say how a shown pattern differs from a decoder's, and what helps."""
    if same:
        return (
            f"{source}: has the grey levels of the decoder {pattern.path}, but this panel makes "
            f"other phases of them (Strehl ratio {strehl:.2f}). Show the pattern's phase on it: "
            'kind = "edof" for the bundled pattern, or train one for this bench: labapp train edof.'
        )
    apart = f", {math.sqrt(-math.log(strehl)):.1f} rad rms" if strehl > 0.1 else ""
    return (
        f"{source}: isn't the pattern of the decoder {pattern.path} (Strehl ratio {strehl:.2f} "
        f"between their phases{apart}). Give the decoder that was trained with it: --decoder FILE, "
        "or choose a photograph through the decoder's pattern: --pattern NAME."
    )
