"""One pattern for three wavelengths, beside patterns that are designed for each of them alone."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import torch

from figures import Figure
from optics.camera import Camera, Lens, Panel, Sensor
from optics.edof.dioptres import random_dioptres
from optics.edof.panel_transfer import QuarterTransfer
from optics.edof.pattern_rating import rate_pattern
from optics.edof.pattern_search import DesignBand, design_pattern
from optics.edof.picture_spectrum import NATURAL_SPECTRUM
from optics.edof.transfer_design import TransferDesign
from optics.patterns import even_vergences, multi_focus_rings
from optics.quarter_symmetry import crop_quarter
from optics.slm import max_phase
from optics.threads import single_threaded

_CAMERA = Camera(Panel(unmodulated=0.0), Lens(0.1, 5.6, math.inf), Sensor(pitch=3.45e-6))
"""The thesis' camera of chapter 5, and the ranges of its panel at three wavelengths."""

_WAVELENGTHS = (532e-9, 452e-9, 633e-9)
"""Metres; the pattern is shown for the first one, wrapped to a wave."""

_NOISE, _SIZE, _STEPS = 0.008, 256, 500
"""Steps of a design for one wavelength; one for all takes turns, and as many for each."""

_SPREAD_GOAL, _LOSS_GOAL = 0.3, 0.15
"""dB."""

_Pattern = Callable[[torch.Tensor], torch.Tensor]


@single_threaded
def achromatic_figures(folder: Path) -> list[Figure]:
    """Expected PSNR of one filter for each wavelength, for all depths, at random depths."""
    began = time.process_time()
    transfers = [QuarterTransfer(TransferDesign(_CAMERA, w, _SIZE)) for w in _WAVELENGTHS]
    own = [_design_alone(one, w) for one, w in zip(transfers, _WAVELENGTHS, strict=True)]
    alone = [_level(one, phase) for one, phase in zip(transfers, own, strict=True)]
    first, joint = (_levels(transfers, one) for one in (own[0], _design_together(transfers)))
    spread = max(joint) - min(joint)
    loss = (sum(alone) - sum(joint)) / 3
    gain = (sum(joint) - sum(first)) / 3
    return [
        Figure(
            "one pattern for 532, 452 and 633 nm: spread over them",
            f"≤ {_SPREAD_GOAL:g} dB",
            f"{spread:.2f} dB: {_listed(joint)} dB; designed for 532 nm alone {_listed(first)} dB",
            spread <= _SPREAD_GOAL,
        ),
        Figure(
            "the same: mean below that of patterns for each wavelength by itself",
            f"≤ {_LOSS_GOAL:g} dB",
            f"{loss:.2f} dB, below {_listed(alone)} dB; {time.process_time() - began:.0f} s",
            loss <= _LOSS_GOAL,
        ),
        Figure(
            "the same: mean over that of the pattern for 532 nm, shown at all three",
            f"≥ {-_LOSS_GOAL:g} dB",
            f"{gain:+.2f} dB",
            gain >= -_LOSS_GOAL,
        ),
    ]


def _listed(levels: Sequence[float]) -> str:
    return ", ".join(f"{one:.2f}" for one in levels)


def _design_alone(transfer: QuarterTransfer, wavelength: float) -> torch.Tensor:
    """A quarter of a pattern for one wavelength, which it is shown for."""
    found = design_pattern(
        transfer,
        _rings(wavelength),
        _spectrum(transfer),
        _NOISE,
        steps=_STEPS,
        generator=torch.Generator().manual_seed(1),
    )
    return found.phase


def _design_together(transfers: Sequence[QuarterTransfer]) -> torch.Tensor:
    """A quarter of a pattern for all wavelengths: its phase at the first one."""
    first, *further = (_band(transfers, band) for band in range(len(transfers)))
    found = design_pattern(
        first.transfer,
        _rings(_WAVELENGTHS[0]),
        first.spectrum,
        _NOISE,
        steps=_STEPS * len(transfers),
        generator=torch.Generator().manual_seed(1),
        pattern=first.pattern,
        further_bands=further,
    )
    return found.parameters


def _rings(wavelength: float) -> torch.Tensor:
    """A quarter of rings of ten foci."""
    return crop_quarter(multi_focus_rings(_CAMERA.panel, even_vergences(2.0, 0.0, 10), wavelength))


def _spectrum(transfer: QuarterTransfer) -> torch.Tensor:
    return NATURAL_SPECTRUM.on_grid(transfer.grid)


def _band(transfers: Sequence[QuarterTransfer], band: int) -> DesignBand:
    transfer = transfers[band]
    return DesignBand(transfer, _spectrum(transfer), _seen_at(band))


def _seen_at(band: int) -> _Pattern:
    """From the phase at the first wavelength to that of the same grey levels at another one.

    Derivatives pass the wrapping's jumps by.
    """
    ratio = max_phase(_CAMERA.panel, _WAVELENGTHS[band]) / max_phase(_CAMERA.panel, _WAVELENGTHS[0])
    return lambda phase: ratio * torch.remainder(phase, 2 * math.pi)


def _levels(transfers: Sequence[QuarterTransfer], phase: torch.Tensor) -> list[float]:
    """Levels of a pattern that is shown for the first wavelength, at all of them."""
    return [_level(one, _seen_at(band)(phase)) for band, one in enumerate(transfers)]


def _level(transfer: QuarterTransfer, phase: torch.Tensor) -> float:
    """Expected PSNR in dB, at depths that no design used."""
    depths = random_dioptres(64, torch.Generator().manual_seed(2))
    return rate_pattern(transfer, phase, _spectrum(transfer), _NOISE, depths).blind


MEASUREMENTS = {"edof-achromatic": achromatic_figures}
