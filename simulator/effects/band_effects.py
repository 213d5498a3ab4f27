"""What the filter does to a picture: a band sampled at few wavelengths, and a leak outside it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.slm.panel import max_phase
from simulator.effects.electron_bounds import (
    light_norm_bound,
    max_light_seconds,
    proportional_error_bound,
    relative_light_change,
    sensor_error_bound,
)
from simulator.effects.landed_light import is_light_moved, landed_light
from simulator.effects.lens_effects import rim_displacement
from simulator.effects.light_effects import FAR, BlurEffect, light_share_bound, occlusion_factor
from simulator.effects.picture_norms import estimated_light
from simulator.effects.psf_bounds import illuminated_area_change, phase_span, wave_distance
from simulator.effects.rendering_work import FILTER_BANDWIDTH, LEVELS, OUT_OF_BAND_LEAK
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.spectra import Which, leak_share, spectral_measure, weight_errors
from simulator.formation.windows import max_blur_distance
from simulator.panel_at_wavelength import panel_at
from simulator.planning import Bound
from simulator.probing.sampled_frequencies import SampledFrequencies
from simulator.situation import Situation

Array = NDArray[np.float64]


# Factor of bound and estimate, computed from a sample of the frequencies; from audits.
_MARGIN = 2.0

# Changes at which more nodes count as no finer: of the light in the frame; of all light, where it
# can't be told from rounding; and by estimates. Chosen.
_CONVERGED, _ROUNDING, _LIKELY_CONVERGED = 2e-5, 5e-6, 1e-4

_THINNING = 4  # an estimate takes one of so many sampled frequencies. Chosen.

# Largest relative change of a dim pixel over that of the whole picture, from audits. Light far
# from an image is dim, and the first to be wrong.
_DIM_PIXEL_MARGIN = 24.0


class Bandwidth(BlurEffect):
    """The filter's bandwidth: a PSF grows with the wavelength, and a pattern's phase falls."""

    name = FILTER_BANDWIDTH
    noise_change = FAR
    kind = "axis"
    recipe_field, recipe_values = "wavelengths", LEVELS.wavelengths
    physics = "each wavelength of the band has a PSF of its own, wider and less turned"
    source = "Golub and Welsch 1969; Goodman, Introduction to Fourier Optics 6.1"
    levels = tuple(str(n) for n in LEVELS.wavelengths)

    def is_caused(self, s: Situation) -> bool:
        return not spectral_measure(s, "band").is_empty

    def finest_level(self, s: Situation) -> int:
        return len(_node_count_errors(s)) - 1

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        change = occlusion_factor(s) * _node_count_errors(s)[level]
        how = f"audited ×{_MARGIN:g}: quadrature of H(k λ) by the far field, at some k"
        return proportional_error_bound(s, change, how, _DIM_PIXEL_MARGIN)

    def likely_error(self, s: Situation, level: int) -> Bound:
        if level >= self.finest_level(s):
            return Bound()
        how = "estimated: quadrature of H(k λ) by the far field"
        change = occlusion_factor(s) * _node_count_errors(s)[level]
        return self.likely_light_error(s, change, how, self.error_bound(s, level).sigma)

    def explain(self, s: Situation) -> str:
        width = s.band.fwhm * 1e9
        return f"a band of {width:.3g} nm around {s.wavelength * 1e9:.4g} nm scales the PSF"


def _node_count_errors(s: Situation) -> tuple[float, ...]:
    """Return the L2 errors in electrons of a band's light, by number of wavelength nodes.

    The list begins with 1 node and ends where the error has converged. A coarser level never has a
    smaller error than a finer one. Little light in the frame is what a pattern leaves of the image,
    or its far side lobes: both change more with the wavelength than estimates tell.
    """
    if s.cache.are_estimates and not is_light_moved(s):
        rates = _likely_error_rates(s, "band", LEVELS.wavelengths)
    else:
        rates = _node_count_error_rates(s, _THINNING if s.cache.are_estimates else 1)
        if s.pattern_probe.samples_per_spot < 2:
            # The finest detail, which the probe then lacks, turns most and asks for a level more.
            rates = (rates[0], *rates)[: len(LEVELS.wavelengths)]
    return tuple(max_light_seconds(s) * one for one in rates)


@cached_across_exposures
def _node_count_error_rates(s: Situation, step: int) -> tuple[float, ...]:
    """Return the L2 errors by number of nodes, electrons/s, from one in `step` frequencies."""
    found, plane = spectral_measure(s, "band"), s.picture_probe.plane
    some = s.picture_probe.sampled_frequencies
    most = light_norm_bound(s) / max(max_light_seconds(s), 1e-300)
    # The frame may get but a little of the light, which is then far from its image.
    landed = landed_light(s)
    least = most if landed is None else min(landed.norm, most)
    enough = max(_CONVERGED * least, _ROUNDING * most)
    if not len(some.ky) and not s.camera.lens.lateral_colour:
        # Uniform light has no frequencies but 0.
        return (0.0,)
    some = some.every(step).with_aliases(plane)
    squares = sampled_powers(s, some)
    transfers, changes = turned_transfers(s, found.nodes, some, 0.5), list[float]()
    turns = _phase_turns(s) if is_light_moved(s) else None
    for count in LEVELS.wavelengths:
        wrong, change = weight_errors(found, count), 0.0
        for parts, power in squares:
            rows = np.unique(wrong[:, parts].reshape(-1, wrong.shape[2]), axis=0)
            apart = transfers.error_power(rows, power)
            if turns is not None:
                # Whatever part of the light lands may turn by the whole span against the rest.
                turned = (np.abs(turns @ rows.T) ** 2).max()
                apart = max(apart, float(turned * power.sum()))
            change += math.sqrt(apart)
        change += _brightness_error(s, "band", count)
        changes.append(min(_MARGIN * off_axis_factor(s) * change, most))
        if changes[-1] <= enough:
            break
    return tuple(np.maximum.accumulate(changes[::-1])[::-1].tolist())


@cached_across_exposures
def _likely_error_rates(s: Situation, which: Which, counts: tuple[int, ...]) -> tuple[float, ...]:
    """Estimate the L2 error rates of band or leak, electrons/s, for numbers of wavelength nodes.

    The list ends where the error has converged. The errors of lights with different spectra are
    taken to be independent, and a part of the pattern to differ in phase by a quarter of the
    phase's span.
    """
    found, some = spectral_measure(s, which), s.picture_probe.sampled_frequencies
    if not len(some.ky) and not s.camera.lens.lateral_colour:
        return (0.0,)
    some = some.every(_THINNING).with_aliases(s.picture_probe.plane)
    squares, transfers = sampled_powers(s, some), turned_transfers(s, found.nodes, some, 0.25)
    rates, enough = [], _LIKELY_CONVERGED * estimated_light(s)[1]
    for count in counts:
        wrong, total = weight_errors(found, count), 0.0
        for parts, power in squares:
            rows = np.unique(wrong[:, parts].reshape(-1, wrong.shape[2]), axis=0)
            total += transfers.error_power(rows, power)
        total += _brightness_error(s, which, count) ** 2
        rates.append(_MARGIN * math.sqrt(total))
        if rates[-1] <= enough:
            break
    return tuple(np.maximum.accumulate(rates[::-1])[::-1].tolist())


def _brightness_error(s: Situation, which: Which, count: int) -> float:
    """Return the L2 error by few wavelengths of which larger images are dimmer, electrons/s."""
    lens, found = s.camera.lens, spectral_measure(s, which)
    if not lens.lateral_colour or lens.relative_illumination:
        return 0.0
    density = np.array([lens.image_scale(one) ** -2 for one in found.nodes.tolist()])
    return float(np.abs(weight_errors(found, count) @ density).max() * s.picture_probe.norm_bound)


def sampled_powers(s: Situation, some: SampledFrequencies) -> list[tuple[list[int], Array]]:
    """Return the power at sampled frequencies for each spectrum, with the numbers of its parts."""
    plane = s.picture_probe.plane
    return [
        (parts, some.represented_power(squared, plane))
        for parts, squared in s.picture_probe.powers_by_spectrum
    ]


@dataclass(frozen=True)
class TurnedTransfers:
    """Hold transfer functions of a pattern's parts over wavelengths, each (frequencies, nodes).

    turns: by any of which each may turn, (turns, nodes).
    """

    transfers: list[NDArray[np.complex128]]
    turns: NDArray[np.complex128]

    def error_power(self, wrong: Array, power: Array) -> float:
        """Return the largest squared error of any transfer function and weights of few wavelengths.

        wrong: errors of the nodes' weights, (weights, nodes).
        power: the picture's, (frequencies,).
        """
        # It's the few weights that turn, not each transfer function.
        turned = (self.turns[:, None] * wrong).reshape(-1, wrong.shape[1]).T
        return max(float((power @ np.abs(one @ turned) ** 2).max()) for one in self.transfers)


def turned_transfers(
    s: Situation, nodes: Array, some: SampledFrequencies, part: float
) -> TurnedTransfers:
    """Return the transfer functions that parts of the pattern may have at wavelengths `nodes`.

    Phase and aberrations go with 1/λ, so that a part turns over the band against the rest.
    part: of the phase's span, by which it may differ to either side.
    """
    grown = nodes / s.wavelength
    span, steps = sum(_phase_spans(s)), np.array([0.0, part, -part])
    turns = np.exp(1j * steps[:, None] * (span * (1 / grown - 1)))
    # A PSF grows with λ, so that its transfer function shrinks.
    ky, kx = (one[:, None] * grown for one in s.mount.to_panel_axes(some.ky, some.kx))
    y, x = (s.wavelength / min(nodes[0], s.wavelength) * one for one in max_blur_distance(s))
    found = s.pattern_probe.transfers_at(ky, kx, (y, x))
    for radians in _colour_turns(s, nodes, np.hypot(some.ky, some.kx)):
        turn = np.exp(1j * part * radians)
        found = [other for one in found for other in (one, one * turn, one * turn.conj())] + [
            one * turn**2 for one in found
        ]
    return TurnedTransfers(found, turns)


def _colour_turns(s: Situation, wavelengths: Array, k: Array) -> list[Array]:
    """Return by how many radians a lens' colours turn light against that of the band's centre.

    They are those of a transfer function at frequencies k in cycles/m: of light from the pupil's
    rim by axial colour, and of light in the frame's corners by lateral colour; each (frequencies,
    wavelengths).
    """
    lens, sensor = s.camera.lens, s.camera.sensor
    ways = []
    if lens.axial_colour:
        shifts = [lens.focus_shift(one) for one in (s.wavelength, *wavelengths.tolist())]
        ways.append([math.copysign(rim_displacement(s, one), one) for one in shifts])
    if lens.lateral_colour:
        corner = math.hypot(*sensor.shape) * sensor.pitch / 2
        scales = [lens.image_scale(one) for one in (s.wavelength, *wavelengths.tolist())]
        ways.append([corner * one for one in scales])
    return [
        np.asarray(2 * np.pi * np.multiply.outer(k, np.array(way[1:]) - way[0])) for way in ways
    ]


def _phase_turns(s: Situation) -> NDArray[np.complex128]:
    """Return how parts of the pattern's light turn over the band against the rest, (turns, nodes).

    These are the largest turns, and lesser ones. Light of two parts that cancels at the centre of
    the band, as between the squares of a checkerboard, doesn't do so elsewhere. The panel's phase
    falls faster than 1/λ, by its dispersion.
    """
    nodes, panel = spectral_measure(s, "band").nodes, s.camera.panel
    shown, bent = _phase_spans(s)
    ranges = np.array([max_phase(panel_at(panel, one), one) for one in nodes.tolist()])
    panel_turn = ranges / s.pattern_probe.linear_phase_range - 1
    turn = shown * panel_turn + bent * (s.wavelength / nodes - 1)
    return np.asarray(np.exp(1j * np.linspace(0.25, 1, 4)[:, None] * turn))


def off_axis_factor(s: Situation) -> float:
    """Return how many times larger a band's error may be off the lens' axis than on it.

    Light from off the axis passes another part of the panel, and is aberrated more. Amplitudes add.
    """
    apart = math.sqrt(illuminated_area_change(s)) if s.camera.separation else 0.0
    return (1 + apart + wave_distance(s)) ** 2


def _phase_spans(s: Situation) -> tuple[float, float]:
    """Return the radians that the pattern's and the lens' phases span."""
    shown = max(float(one.max() - one.min()) for one in s.pattern_probe.phases)
    bent = max(float(one.max() - one.min()) for one in s.pattern_probe.lens_phases)
    return shown, bent + (phase_span(s) if s.camera.lens.field_aberrations else 0.0)


class Leak(BlurEffect):
    """The filter's out-of-band leak: light of wavelengths that it doesn't block wholly."""

    name = OUT_OF_BAND_LEAK
    likely_shares = (1.0, 0.06)
    noise_change = FAR
    kind = "stage"
    recipe_field, recipe_values = "leak", LEVELS.leak
    physics = "a filter blocks other wavelengths a thousandfold, not wholly, and there are many"
    source = "thesis §5.6; any filter's data sheet"
    levels = ("off", *(str(n) for n in LEVELS.leak[1:]))

    def is_caused(self, s: Situation) -> bool:
        return bool(s.band.leak) and not spectral_measure(s, "leak").is_empty

    def estimated_error(self, s: Situation, level: int) -> float:
        likely = relative_light_change(s, self.error_bound(s, level).mean)
        return likely if level == 0 else 0.1 * likely

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        share = leak_share(s)
        # All of the leak's light is rendered, but its PSF may differ.
        moved = light_share_bound(s, 2 * share, "proved: Young; light beside the band moves")
        if level:
            return moved
        how = "proved: Young; electrons beside the band"
        missing = sensor_error_bound(s, occlusion_factor(s) * share * light_norm_bound(s), how)
        return max(missing, moved, key=lambda one: one.mean)

    def likely_error(self, s: Situation, level: int) -> Bound:
        told = super().likely_error(s, level)
        if not 0 < level < self.finest_level(s):
            return told
        rates = _likely_error_rates(s, "leak", LEVELS.leak[1:-1])
        rate = rates[min(level, len(rates)) - 1]
        change = occlusion_factor(s) * leak_share(s) * max_light_seconds(s) * rate
        how = "estimated: quadrature of H(k λ) by the far field"
        found = self.likely_light_error(s, change, how)
        return max(told, found, key=lambda one: one.mean)

    def explain(self, s: Situation) -> str:
        low, high = (1e9 * end for end in s.band.leak_range)
        makes = f"makes {leak_share(s):.2g} of the electrons"
        return f"{s.band.leak:.2g} passes from {low:.0f} to {high:.0f} nm, and {makes}"
