"""The effect of the panel's dispersion: its phase at the wavelengths of a band."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import torch

from optics.slm.modulator import max_gap_power
from simulator.effects.blur_effects import OnOffBlurEffect, psf_error_bound
from simulator.effects.field_distance import MARGIN, phase_error_psf_bound, sample_pixels
from simulator.effects.panel_effects import phase_error_gain
from simulator.effects.rendering_work import PANEL_DISPERSION
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.spectra import spectral_measure
from simulator.formation.nodes import gauss_quadrature
from simulator.panel_at_wavelength import modulator_at
from simulator.planning import Bound
from simulator.situation import Situation


class PanelDispersion(OnOffBlurEffect):
    name = PANEL_DISPERSION
    likely_shares = (0.15,)
    recipe_field = "dispersion"
    physics = "a pattern's phase falls with the wavelength, as the crystal's path hardly changes"
    source = "Li and Wu 2004, doi 10.1063/1.1635971"

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        change = MARGIN * cached_across_exposures(s, self.name, lambda: _total_psf_change(s))
        how = f"audited ×{MARGIN:g}: Cauchy-Schwarz; the rms phase error over the band"
        return psf_error_bound(s, change, how, s.pattern_probe.peak)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        rows, columns = s.camera.panel.shape
        return 60.0 * rows * columns if levels[self.name] else 0.0

    def explain(self, s: Situation) -> str:
        return (
            f"over the band the pattern's phase changes by {s.band.fwhm / s.wavelength:.2g} of it"
        )


def _total_psf_change(s: Situation) -> float:
    """Bound the panel dispersion effect's change ‖Δh‖₁ of a PSF, over band and leak."""
    return _psf_change_over(s, "band") + (_psf_change_over(s, "leak") if s.band.leak else 0.0)


def _psf_change_over(s: Situation, which: Literal["band", "leak"]) -> float:
    """Bound the panel dispersion effect's mean change ‖Δh‖₁ of a PSF over the band or the leak.

    Each wavelength is weighted by its share of the brightest channel's electrons, or by the largest
    share that it has in any part and channel. The leak counts by its share of the light.
    """
    found, band = spectral_measure(s, which), spectral_measure(s, "band")
    if found.is_empty:
        return 0.0
    nodes, weights = gauss_quadrature(found.wavelengths, found.electrons, 7)
    masses = np.maximum(found.electrons.sum(-1).max(0), band.electrons.sum(-1).max(0))
    lit = masses > 0
    shares = np.abs(weights[:, lit]) / masses[lit][None, :, None]
    worst = shares.reshape(-1, len(nodes)).max(0)
    changes = np.array([_psf_change_at(s, float(node)) for node in nodes])
    return float(min((worst * changes).sum(), max(changes) * worst.sum()))


def _psf_change_at(s: Situation, wavelength: float) -> float:
    """Bound the panel dispersion effect's change ‖Δh‖₁ of a PSF at one wavelength."""
    pixels, panel = sample_pixels(s), s.camera.panel
    there = modulator_at(panel, wavelength)
    # A response that varies over the panel has to be evaluated on all pixels.
    maps = panel.response is not None and panel.response.shares.shape[1:3] != (1, 1)
    figure = 0.0
    if panel.flatness is not None:
        figure = 2 * np.pi * (1 / wavelength - 1 / s.wavelength)
    spread = max_gap_power(panel) * phase_error_gain(panel)
    changes = []
    for grey, phase in zip(s.pattern_probe.greys, s.pattern_probe.phases, strict=True):
        error = pixels(there.phase(grey)) if maps else there.phase(pixels(grey))
        error = torch.as_tensor(error) - pixels(phase)
        if figure and panel.flatness is not None:
            error = error + figure * pixels(panel.flatness.at_pixels(panel))
        changes.append(phase_error_psf_bound(s, pixels, error) * spread)
    return max(changes)
