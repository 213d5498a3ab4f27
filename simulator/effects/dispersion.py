"""The panel's phase at the wavelengths of a band."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import torch

from optics.slm.gap import gap_light
from simulator.effects.blurs import BlurStage, spread_otherwise
from simulator.effects.costs import DISPERSION
from simulator.effects.keeping import kept
from simulator.effects.panel_effects import blurred
from simulator.effects.spectra import measure
from simulator.effects.wavefronts import MARGIN, of_phase, sampled
from simulator.formation.nodes import interpolating
from simulator.panel import modulator_at
from simulator.planning import Bound
from simulator.situation import Situation

_NODES = 7


class PanelDispersion(BlurStage):
    name = DISPERSION
    entry = "dispersion"
    physics = "a pattern's phase falls with the wavelength, as the crystal's path hardly changes"
    source = "Li and Wu 2004, doi 10.1063/1.1635971"

    def left_out(self, s: Situation) -> Bound:
        change = MARGIN * kept(s, self.name, lambda: _changes(s))
        how = f"audited ×{MARGIN:g}: Cauchy-Schwarz; the rms phase error over the band"
        return spread_otherwise(s, change, how, s.pattern.peak)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        rows, columns = s.camera.panel.shape
        return 60.0 * rows * columns if levels[self.name] else 0.0

    def why(self, s: Situation) -> str:
        return (
            f"over the band the pattern's phase changes by {s.band.fwhm / s.wavelength:.2g} of it"
        )


def _changes(s: Situation) -> float:
    return _change(s, "band") + (_change(s, "leak") if s.band.leak else 0.0)


def _change(s: Situation, which: Literal["band", "leak"]) -> float:
    """‖Δh‖₁ at most, in the mean over wavelengths as the brightest channel sees them, or as that
    part and channel does whose share is largest; of the leak by its share of the light."""
    found, band = measure(s, which), measure(s, "band")
    if found.empty:
        return 0.0
    nodes, weights = interpolating(found.x, found.of, _NODES)
    masses = np.maximum(found.of.sum(-1).max(0), band.of.sum(-1).max(0))
    lit = masses > 0
    shares = np.abs(weights[:, lit]) / masses[lit][None, :, None]
    worst = shares.reshape(-1, len(nodes)).max(0)
    changes = np.array([_at(s, float(node)) for node in nodes])
    return float(min((worst * changes).sum(), max(changes) * worst.sum()))


def _at(s: Situation, wavelength: float) -> float:
    pixels, panel = sampled(s), s.camera.panel
    there = modulator_at(panel, wavelength)
    # Only of a panel that is the same all over, some pixels do without the others.
    maps = panel.response is not None and panel.response.shares.shape[1:3] != (1, 1)
    figure = 0.0
    if panel.flatness is not None:
        figure = 2 * np.pi * (1 / wavelength - 1 / s.wavelength)
    spread = (1 + gap_light(panel)) ** 2 * blurred(panel)
    changes = []
    for grey, phase in zip(s.pattern.greys, s.pattern.phases, strict=True):
        error = pixels(there.phase(grey)) if maps else there.phase(pixels(grey))
        error = torch.as_tensor(error) - pixels(phase)
        if figure and panel.flatness is not None:
            error = error + figure * pixels(panel.flatness.on(panel))
        changes.append(of_phase(s, pixels, error) * spread)
    return max(changes)
