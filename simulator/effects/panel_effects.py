"""What the panel does beside its pattern, each with a bound of what it changes of a PSF."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.special
import torch

from optics.camera import Panel
from optics.slm.coupling import fringing_field_mean
from optics.slm.dynamics import first_start_phase, relaxed_phase
from optics.slm.modulator import (
    front_reflection_share,
    scattered_share,
    transmitted_unmodulated_share,
)
from optics.slm.panel import gap_amplitude, max_gap_power
from simulator.effects.electron_bounds import is_lamp_flickering
from simulator.effects.field_distance import (
    MARGIN,
    describe_proof,
    has_coherent_background,
    margin,
    phase_error_psf_bound,
    psf_distance_bound,
    sample_pixels,
)
from simulator.effects.light_effects import FAR, OnOffBlurEffect, psf_error_bound
from simulator.effects.rendering_work import FLICKER, PANEL_DISPERSION, POLARISATION_INTERFERENCE
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.spectra import Which, spectral_measure
from simulator.formation.nodes import gauss_quadrature
from simulator.panel_at_wavelength import modulator_at
from simulator.planning import Bound
from simulator.recipe import Recipe
from simulator.situation import Situation


class PanelEffect(OnOffBlurEffect):
    """An imperfection of the panel: a field of Panel that isn't at its neutral value."""

    panel_field: ClassVar[str]
    neutral_value: ClassVar[Any] = 0.0

    @abstractmethod
    def psf_change_bound(self, s: Situation) -> tuple[float, str]:
        """Bound the change ‖Δh‖₁ of PSFs, at any levels of all else, and say how it's known."""

    def is_caused(self, s: Situation) -> bool:
        return bool(getattr(s.camera.panel, self.panel_field) != self.neutral_value)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        change, how = self.psf_change_bound(s)
        return psf_error_bound(s, change, how, s.pattern_probe.peak)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        return 20.0 * math.prod(s.camera.panel.shape) if levels[self.name] else 0.0

    def add_to_recipe(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        datum = getattr(s.camera.panel, self.panel_field)
        return recipe.with_changes(panel=replace(recipe.panel, **{self.panel_field: datum}))


class RedirectedLight(PanelEffect):
    """An imperfection of the panel that moves a share of the light away from the pattern's PSF."""

    @abstractmethod
    def redirected_share(self, s: Situation) -> float:
        """Return the largest share of the light that moves."""

    def psf_change_bound(self, s: Situation) -> tuple[float, str]:
        return 2 * self.redirected_share(s), "proved: light that moves counts twice"


class Illumination(PanelEffect):
    name = "illumination"
    likely_shares = (0.3,)
    panel_field, neutral_value = "illumination", None
    physics = "the light on the panel isn't even, and a PSF's fringes follow it"
    source = "Goodman, Introduction to Fourier Optics, apodisation"

    def psf_change_bound(self, s: Situation) -> tuple[float, str]:
        panel, pixels = s.camera.panel, sample_pixels(s)
        assert panel.illumination is not None
        light = panel.illumination.at_pixels(panel)
        field = pixels(torch.sqrt(light / light.mean())).to(torch.complex128)
        # The gaps between pixels are lit as unevenly as the pixels.
        found = psf_distance_bound(pixels, field, torch.ones_like(field)) * max_gap_power(panel)
        how = describe_proof(s, "Cauchy-Schwarz; amplitude that isn't the mean's")
        return margin(s) * found, how

    def explain(self, s: Situation) -> str:
        return "the light on the panel isn't even"


class FrontReflection(RedirectedLight):
    name = "front reflection"
    likely_shares = (0.4,)
    noise_change = FAR
    panel_field = "front_reflection"
    physics = "the cover glass reflects light that never meets the pattern"
    source = "thesis §5.6"

    def redirected_share(self, s: Situation) -> float:
        return front_reflection_share(s.camera.panel)

    def explain(self, s: Situation) -> str:
        return f"{self.redirected_share(s):.1%} of the light never enters the panel"


class PanelResponse(PanelEffect):
    name = "panel response"
    likely_shares = (0.4,)
    panel_field, neutral_value = "response", None
    physics = "the phase isn't proportional to the grey level"
    source = "thesis §2.3"

    def psf_change_bound(self, s: Situation) -> tuple[float, str]:
        panel, pixels = s.camera.panel, sample_pixels(s)
        reach = s.pattern_probe.linear_phase_range
        worst = 0.0
        for grey, phase in zip(s.pattern_probe.greys, s.pattern_probe.phases, strict=True):
            straight = grey.to(torch.float64) * (reach / (panel.levels - 1))
            error = pixels(phase - straight)
            worst = max(worst, phase_error_psf_bound(s, pixels, error))
        spread = (1 + gap_amplitude(panel)) * phase_error_gain(panel)
        return margin(s) * worst * spread, describe_proof(s, "Cauchy-Schwarz; the rms phase error")

    def explain(self, s: Situation) -> str:
        return "the phase isn't proportional to the grey level"


def phase_error_gain(panel: Panel) -> float:
    """Return how many times coupling and illumination may enlarge a phase error."""
    lit = 1.0
    if panel.illumination is not None:
        light = panel.illumination.at_pixels(panel)
        lit = math.sqrt(float(light.max() / light.mean()))
    return lit * (1.5 if panel.coupling else 1.0)


class Coupling(PanelEffect):
    name = "neighbour coupling"
    likely_shares = (0.3,)
    panel_field = "coupling"
    physics = "fringing fields blur the phase across the edges of pixels"
    source = "Persson, Engström and Goksör 2012, doi 10.1364/OE.20.022334"

    def psf_change_bound(self, s: Situation) -> tuple[float, str]:
        panel, worst = s.camera.panel, 0.0
        sigma, side = panel.coupling / panel.pitch, math.sqrt(panel.fill_factor)
        for phase in s.pattern_probe.phases:
            for block, opened in _blocks(phase, s.pattern_probe.aperture_share):
                field = fringing_field_mean(block, sigma, side)
                sharp = torch.polar(torch.ones_like(block), block)
                weight = opened**2
                if not bool(weight.any()):
                    continue
                away = ((field - sharp).abs() ** 2 * weight).sum() / weight.sum()
                worst = max(worst, float(away))
        change = 2 * math.sqrt(worst) * (1 + gap_amplitude(panel)) * phase_error_gain(panel)
        return change, "audited ×1.5: Cauchy-Schwarz; what the blur changes of the field"

    def explain(self, s: Situation) -> str:
        return f"fringing fields blur the phase by {s.camera.panel.coupling * 1e6:.2g} µm"


def _blocks(
    phase: torch.Tensor, aperture_share: torch.Tensor
) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Return 4 x 4 blocks of 64 x 64 pixels from all over a panel, or the whole of a small one."""
    count, side = 4, 64
    if phase.numel() <= (count * side) ** 2:
        return [(phase, aperture_share)]
    down, along = ([(n - side) * k // (count - 1) for k in range(count)] for n in phase.shape)
    parts = [(slice(y, y + side), slice(x, x + side)) for y in down for x in along]
    return [(phase[part].contiguous(), aperture_share[part]) for part in parts]


class Flicker(PanelEffect):
    name = FLICKER
    likely_shares = (0.3,)
    panel_field = "flicker"
    physics = "the drive makes the phase ripple within a frame"
    source = "thesis §3.4"

    def psf_change_bound(self, s: Situation) -> tuple[float, str]:
        """Bound ‖Δh‖₁ of PSFs by the loss of the mean field and the power of the ripple.

        The ripple's first order averages out. What is left is the loss of the mean field, 1 - J₀,
        which interferes, and the power of the ripple, 2 (1 - J₀).
        """
        pixels, panel, worst = sample_pixels(s), s.camera.panel, 0.0
        for phase in s.pattern_probe.phases:
            some = pixels(phase)
            if not has_coherent_background(s):
                some = some - pixels.mean(some).real
            lost = torch.from_numpy(1 - scipy.special.j0((panel.flicker * some).numpy()))
            rms = math.sqrt(pixels.mean(lost**2).real)
            worst = max(worst, 2 * pixels.mean(lost).real + 2 * rms)
        spread = max_gap_power(panel) * phase_error_gain(panel) ** 2
        # A nonlinear response may make phases larger than the pattern's.
        return margin(s) * 1.5 * worst * spread, "audited ×1.5: mean and power of the ripple"

    def explain(self, s: Situation) -> str:
        return f"the drive makes the phase ripple by {s.camera.panel.flicker:.1%}"


class Jitter(RedirectedLight):
    name = "jitter"
    likely_shares = (0.6,)
    noise_change = FAR
    panel_field = "jitter"
    physics = "each pixel errs on its own, and scatters light evenly"
    source = "Ruze, Proc. IEEE 54, 633 (1966)"

    def redirected_share(self, s: Situation) -> float:
        return scattered_share(s.camera.panel.jitter) * max_gap_power(s.camera.panel)

    def explain(self, s: Situation) -> str:
        return f"pixels err on their own by {s.camera.panel.jitter:.2g} rad and scatter light"


class GapLight(PanelEffect):
    name = "gap light"
    likely_shares = (0.8,)
    noise_change = FAR
    panel_field = "gap_reflection"
    physics = "the frame between pixels sends light that no pattern turns"
    source = "thesis §2.3"

    def psf_change_bound(self, s: Situation) -> tuple[float, str]:
        g = gap_amplitude(s.camera.panel)
        return (2 + g) * g, "proved: Cauchy-Schwarz; the frame's amplitude"

    def explain(self, s: Situation) -> str:
        amplitude = gap_amplitude(s.camera.panel)
        return f"the frame between pixels sends {amplitude:.1%} of their amplitude"


class Flatness(PanelEffect):
    name = "flatness"
    likely_shares = (0.4,)
    panel_field, neutral_value = "flatness", None
    physics = "the panel isn't flat, and its figure is a wavefront of its own"
    source = "Maréchal; Born and Wolf 9.1"

    def psf_change_bound(self, s: Situation) -> tuple[float, str]:
        panel, pixels = s.camera.panel, sample_pixels(s)
        assert panel.flatness is not None
        # The figure's phase is largest at the band's shortest wavelength.
        path = panel.flatness.at_pixels(panel) * (2 * math.pi / s.band.support[0])
        change = phase_error_psf_bound(s, pixels, pixels(path))
        change = change * max_gap_power(panel) * phase_error_gain(panel)
        return margin(s) * change, describe_proof(s, "Cauchy-Schwarz; the figure's rms phase")

    def explain(self, s: Situation) -> str:
        return "the panel isn't flat"


class UnmodulatedLight(RedirectedLight):
    name = "unmodulated light"
    likely_shares = (0.4,)
    noise_change = FAR
    panel_field = "unmodulated"
    physics = "light of the polarisation that the crystal doesn't turn ignores the pattern"
    source = "thesis §5.6"

    def redirected_share(self, s: Situation) -> float:
        # Without front reflection, all of the unmodulated light would be transmitted.
        return max(transmitted_unmodulated_share(s.camera.panel), s.camera.panel.unmodulated)

    def explain(self, s: Situation) -> str:
        share = s.camera.panel.unmodulated
        return f"{share:.1%} of the light ignores the pattern and stays in the centre"


class Interference(OnOffBlurEffect):
    name = POLARISATION_INTERFERENCE
    likely_shares = (0.5,)
    recipe_field = "interference"
    typical_bound_share = 0.3
    physics = "behind an analyser, light that the panel turns and light that it doesn't interfere"
    source = "Saleh and Teich, Fundamentals of Photonics 6.1; optics.polarisation"
    requires = ("unmodulated light", "diffraction")

    def is_caused(self, s: Situation) -> bool:
        return s.interference != 0

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        pixels = sample_pixels(s)
        powers = [
            pixels.mean(pixels(field).abs().double() ** 2).real for field in s.pattern_probe.fields
        ]
        # Light from the gaps between pixels, and an uneven beam, may raise the power of either
        # wave above 1.
        brightest = max(1.0, *powers) * 1.2
        how = "proved: Cauchy-Schwarz on two waves, each of all the light"
        return psf_error_bound(s, abs(s.interference) * brightest, how)

    def explain(self, s: Situation) -> str:
        return f"the two beat by {abs(s.interference):.2g} of the light at most"


class PanelDispersion(OnOffBlurEffect):
    name = PANEL_DISPERSION
    likely_shares = (0.15,)
    recipe_field = "dispersion"
    physics = "a pattern's phase falls with the wavelength, as the crystal's path hardly changes"
    source = "Li and Wu 2004, doi 10.1063/1.1635971"

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        change = MARGIN * _dispersed_psf_change(s)
        how = f"audited ×{MARGIN:g}: Cauchy-Schwarz; the rms phase error over the band"
        return psf_error_bound(s, change, how, s.pattern_probe.peak)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        return 60.0 * math.prod(s.camera.panel.shape) if levels[self.name] else 0.0

    def explain(self, s: Situation) -> str:
        share = s.band.fwhm / s.wavelength
        return f"over the band the pattern's phase changes by {share:.2g} of it"


@cached_across_exposures
def _dispersed_psf_change(s: Situation) -> float:
    """Bound the change ‖Δh‖₁ of a PSF by dispersion, over band and leak."""
    return _psf_change_over(s, "band") + (_psf_change_over(s, "leak") if s.band.leak else 0.0)


def _psf_change_over(s: Situation, which: Which) -> float:
    """Bound the mean change ‖Δh‖₁ of a PSF by dispersion over the band or the leak.

    Each wavelength has the weight of its largest share in any part and channel, over the brightest
    channel's electrons.
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
    """Bound the change ‖Δh‖₁ of a PSF by dispersion at one wavelength."""
    pixels, panel = sample_pixels(s), s.camera.panel
    there = modulator_at(panel, wavelength)
    # A response that varies over the panel has to be evaluated on all pixels.
    maps = panel.response is not None and panel.response.shares.shape[1:3] != (1, 1)
    figure = 2 * np.pi * (1 / wavelength - 1 / s.wavelength)
    spread = max_gap_power(panel) * phase_error_gain(panel)
    changes = []
    for grey, phase in zip(s.pattern_probe.greys, s.pattern_probe.phases, strict=True):
        error = pixels(there.phase(grey)) if maps else there.phase(pixels(grey))
        error = torch.as_tensor(error) - pixels(phase)
        if panel.flatness is not None:
            error = error + figure * pixels(panel.flatness.at_pixels(panel))
        changes.append(phase_error_psf_bound(s, pixels, error) * spread)
    return max(changes)


class CrystalResponse(OnOffBlurEffect):
    name = "liquid-crystal response"
    likely_shares = (0.2,)
    kind = "axis"
    physics = "the crystal follows a video's frames exponentially, and shows none of them wholly"
    source = "thesis §3.4"

    def is_caused(self, s: Situation) -> bool:
        return bool(s.camera.panel.response_time) and s.panel_content.is_changing

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        spread = max_gap_power(s.camera.panel) * phase_error_gain(s.camera.panel) ** 2
        change = MARGIN * _lagging_psf_change(s) * spread
        how = f"audited ×{MARGIN:g}: mean and power of what the field lacks, worst of all times"
        return psf_error_bound(s, change, how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        pixels = math.prod(s.camera.panel.shape) if levels[self.name] else 0
        return 100.0 * pixels * len(s.panel_content.names)

    def explain(self, s: Situation) -> str:
        tau, frame = s.camera.panel.response_time, s.panel_content.frame_time
        return f"the phase follows in {tau * 1e3:.2g} ms, of frames of {frame * 1e3:.3g} ms"

    def add_to_recipe(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        tau = s.camera.panel.response_time
        return recipe.with_changes(crystal=True, panel=replace(recipe.panel, response_time=tau))


# Evenly spaced times in a part of a frame, and last frames of a video, for which the crystal's
# response is computed at most. Chosen.
_CRYSTAL_TIMES, _CRYSTAL_FRAMES = 24, 24


def _lagging_psf_change(s: Situation) -> float:
    """Bound the change ‖Δh‖₁ of a PSF by the crystal's slow response.

    The mean over time of |p|², less |q|² of the settled field q, is the power of the difference of
    the fields, and twice its mean times q (Cauchy-Schwarz).
    """
    pixels, tau, shown = sample_pixels(s), s.camera.panel.response_time, s.panel_content
    settled = {
        name: pixels(
            torch.as_tensor(s.pattern_probe.modulator.phase(torch.from_numpy(grey.copy())))
        )
        for name, grey in shown.pictures.items()
    }
    names = shown.names[-_CRYSTAL_FRAMES:]
    phases = torch.stack([settled[name] for name in names])
    start = first_start_phase(phases, shown.frame_time, tau)
    # A rolling shutter or a flickering lamp may let parts of a frame count unequally.
    uneven = s.camera.sensor.shutter == "rolling" or is_lamp_flickering(s)
    parts, found = _seen_frame_parts(s, uneven=uneven), list[tuple[float, float]]()
    for frame, end in enumerate(phases):
        for begin, finish, share in parts.get(frame if len(names) == len(shown.names) else -1, ()):
            steps = [(k + 0.5) / _CRYSTAL_TIMES for k in range(_CRYSTAL_TIMES)]
            times = [begin + step * (finish - begin) for step in steps]
            lacking = [torch.expm1(1j * (relaxed_phase(end, start, t, tau) - end)) for t in times]
            mean = torch.stack(lacking).mean(0)
            power = torch.stack([one.abs() ** 2 for one in lacking]).mean(0)
            rms = math.sqrt(pixels.mean(mean.abs() ** 2).real)
            found.append((share, pixels.mean(power).real + 2 * rms))
        start = relaxed_phase(end, start, shown.frame_time, tau)
    if uneven:
        return max(one for _, one in found)
    whole = sum(share for share, _ in found)
    return sum(share * one for share, one in found) / whole


def _seen_frame_parts(s: Situation, *, uneven: bool) -> dict[int, list[tuple[float, float, float]]]:
    """Return which parts of each video frame an exposure sees, each as (begin, end, share).

    Where parts may count unequally, they are the eighths of each frame. If there are too many
    frames to tell apart, key -1 has the whole frame.
    """
    frame_time, n = s.panel_content.frame_time, len(s.panel_content.names)
    if uneven:
        step = frame_time / 8
        eighths = [(k * step, (k + 1) * step, 1.0) for k in range(8)]
        return dict.fromkeys(range(-1, n), eighths)
    if n > _CRYSTAL_FRAMES:
        return {-1: [(0.0, frame_time, 1.0)]}
    parts: dict[int, list[tuple[float, float, float]]] = {}
    for span in s.panel_content.frame_sequence(s.exposure_start, s.exposure).spans:
        parts.setdefault(span.frame, []).append((span.begin, span.end, span.share))
    return parts
