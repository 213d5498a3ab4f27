"""A filter seen at an angle: its band shifts for light from off the axis."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from optics.fourier import rfft_column_weights
from simulator.effects.band_effects import off_axis_factor, sampled_powers, turned_transfers
from simulator.effects.electron_bounds import (
    light_norm_bound,
    max_light_seconds,
    proportional_error_bound,
)
from simulator.effects.light_effects import FAR, BlurEffect, occlusion_factor
from simulator.effects.rendering_work import FILTER_ANGLE, LEVELS
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.spectra import measures_at_angles, spectral_measure
from simulator.filter_angles import angle_nodes, largest_squared_sine
from simulator.formation.nodes import interpolation_weights
from simulator.planning import Bound
from simulator.situation import Situation

Array = NDArray[np.float64]


# Angles at which the interpolated band is compared with the true one; the worst of them, which
# are looked at for PSFs; and one of how many frequencies is taken there. Chosen.
_ANGLES, _WORST, _THINNING = 17, 2, 4

# Factor of what the band's shift does to PSFs, as computed from a sample of frequencies; and
# largest relative change of a dim pixel over that of the picture. From audits.
_MARGIN, _DIM_PIXEL_MARGIN = 2.0, 12.0

_CONVERGED = 1e-5  # change relative to all light at which more angles count as no finer. Chosen.


class FilterAngle(BlurEffect):
    """The filter's band over the field: at an angle, thin films pass shorter wavelengths."""

    name = FILTER_ANGLE
    noise_change = FAR
    kind = "axis"
    recipe_field, recipe_values = "angles", LEVELS.angles
    physics = "thin films pass shorter wavelengths at an angle, so that the band falls off the axis"
    source = "Macleod, Thin-Film Optical Filters: λ = λ₀ √(1 - sin²θ / n²)"
    levels = tuple(str(n) for n in LEVELS.angles)

    def is_caused(self, s: Situation) -> bool:
        return s.band.shifts_with_angle and not spectral_measure(s, "band").is_empty

    def finest_level(self, s: Situation) -> int:
        return len(_error_rates(s)) - 1

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        turned = f"audited ×{_MARGIN:g}: H(k λ) of the wavelengths that differ"
        how = f"proved: the light that few angles miss; {turned}"
        change = occlusion_factor(s) * max_light_seconds(s) * _error_rates(s)[level]
        return proportional_error_bound(s, change, how, _DIM_PIXEL_MARGIN)

    def explain(self, s: Situation) -> str:
        steepest = largest_squared_sine(s.camera)
        shift = s.wavelength - s.band.at_angle(steepest).centre
        angle = math.degrees(math.asin(math.sqrt(steepest)))
        return f"at {angle:.3g}° in the frame's corner the band is {shift * 1e9:.3g} nm lower"


@cached_across_exposures
def _error_rates(s: Situation) -> tuple[float, ...]:
    """Return the L2 errors in electrons per second, by number of angles.

    The list ends where the error has converged; no finer level has a larger one. Light of a wrong
    band differs by the electrons that are missing or too many, whatever its blur (Young), and by
    the PSFs of wavelengths that differ. All light is taken to come from the angle at which most is
    wrong. Both together are no more than all electrons of wavelengths that differ.
    """
    greatest = largest_squared_sine(s.camera)
    checked = np.linspace(0, greatest, _ANGLES).tolist()
    known = {count: angle_nodes(greatest, count) for count in LEVELS.angles}
    x, true, *measures = measures_at_angles(s, [checked, *known.values()])
    masses = spectral_measure(s, "band").electrons.sum(-1).max(0)
    masses = np.where(masses > 0, masses, 1.0)[:, None]
    most = light_norm_bound(s) / max(max_light_seconds(s), 1e-300)
    rows, columns = s.picture_probe.plane.shape
    counts = rfft_column_weights(columns)
    norms = [
        (parts, math.sqrt(float((squared * counts).double().sum()) / (rows * columns)))
        for parts, squared in s.picture_probe.powers_by_spectrum
    ]
    turned_change = _turned_picture(s)

    def norm_of(share: Array) -> float:
        """Return the norm of light of which each part has a share, electrons/s. share: (parts,)."""
        apart = sum(norm * float(share[parts].max()) for parts, norm in norms)
        beside = s.picture_probe.off_plane_star_rate
        return min(apart + beside * float(share.max()), float(share.max()) * most)

    rates = list[float]()
    for squared, measure in zip(known.values(), measures, strict=True):
        share = interpolation_weights(squared, np.array(checked))
        wrong = (np.tensordot(share.T, measure, 1) - true) / masses
        missing = norm_of(np.abs(wrong.sum(-1)).max((0, 1)))
        any_way = norm_of(np.abs(wrong).sum(-1).max((0, 1)))
        rates.append(min(missing + turned_change(x, wrong, measure[0] / masses), any_way))
        if rates[-1] <= _CONVERGED * most:
            break
    return tuple(np.maximum.accumulate(rates[::-1])[::-1].tolist())


def _turned_picture(s: Situation) -> Callable[[Array, Array, Array], float]:
    """Return a bound of what a wrong band changes by its PSFs alone, in electrons/s.

    Missing electrons are given back in the spectrum of the axis. Its arguments are wavelengths x,
    the wrong electrons, (angles, channels, parts, wavelengths), and the spectrum of the axis,
    (channels, parts, wavelengths).
    """
    nodes, some = spectral_measure(s, "band").nodes, s.picture_probe.sampled_frequencies
    if not len(some.ky):
        # Uniform light has no frequencies but 0.
        return lambda x, wrong, axis: 0.0
    some = some.every(_THINNING).with_aliases(s.picture_probe.plane)
    transfers, powers = turned_transfers(s, nodes, some, 0.5), sampled_powers(s, some)
    factor = _MARGIN * off_axis_factor(s)

    def change(x: Array, wrong: Array, axis: Array) -> float:
        lit = np.maximum(axis.sum(-1, keepdims=True), 1e-300)
        shape = wrong - wrong.sum(-1, keepdims=True) * axis / lit
        worst = np.argsort(np.abs(shape).sum((1, 2, 3)))[-_WORST:]
        shape, found = shape[worst] @ interpolation_weights(nodes.tolist(), x).T, 0.0
        for parts, power in powers:
            rows = np.unique(shape[:, :, parts].reshape(-1, len(nodes)), axis=0)
            found += math.sqrt(transfers.error_power(rows, power))
        return factor * found

    return change
