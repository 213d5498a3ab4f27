"""A filter seen at an angle: its band shifts for light from off the axis."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.fourier import rfft_column_weights
from simulator.effects.band_effects import (
    TurnedTransfers,
    off_axis_factor,
    sampled_powers,
    turned_transfers,
)
from simulator.effects.blur_effects import BlurEffect, occlusion_factor
from simulator.effects.electron_bounds import (
    light_norm_bound,
    max_light_seconds,
    proportional_error_bound,
)
from simulator.effects.likely_errors import FAR
from simulator.effects.rendering_work import FILTER_ANGLE, LEVELS
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.spectra import measures_at_angles, spectral_measure
from simulator.filter_angles import angle_nodes, largest_squared_sine
from simulator.formation.nodes import interpolation_weights
from simulator.planning import Bound
from simulator.situation import Situation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FilterAngleBoundSettings:
    """Tune the error bound of few angles at the filter.

    angles: at which the interpolated band is compared with the true one. Chosen.
    worst_angles: how many of them, where most is wrong, are looked at for PSFs. Chosen.
    thinning: one of so many sampled frequencies is taken. Chosen.
    margin: factor of what the band's shift does to PSFs, computed from a sample of the frequencies;
        from audits.
    converged_change: relative to all light, at which more angles count as no finer. Chosen.
    dim_pixel_margin: largest relative change of a dim pixel over that of the whole picture, as of
        the band's other effects.
    """

    angles: int = 17
    worst_angles: int = 2
    thinning: int = 4
    margin: float = 2.0
    converged_change: float = 1e-5
    dim_pixel_margin: float = 12.0


_SETTINGS = FilterAngleBoundSettings()


class FilterAngle(BlurEffect):
    """The filter's band over the field: at an angle, thin films pass shorter wavelengths."""

    name = FILTER_ANGLE
    noise_change = FAR
    kind = "axis"
    recipe_field, recipe_values = "angles", LEVELS.angles
    physics = "thin films pass shorter wavelengths at an angle, so that the band falls off the axis"
    source = "Macleod, Thin-Film Optical Filters: λ = λ₀ √(1 - sin²θ / n²)"
    levels = tuple(str(n) for n in LEVELS.angles)

    def is_present(self, s: Situation) -> bool:
        return (
            s.band.shifts_with_angle
            and not s.picture_probe.is_dark
            and not spectral_measure(s, "band").is_empty
        )

    def finest_level(self, s: Situation) -> int:
        return len(_error_rates(s)) - 1

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        rate = _error_rates(s)[level]
        how = (
            f"proved: the light that few angles miss; audited ×{_SETTINGS.margin:g}: H(k λ) of the "
            "wavelengths that differ"
        )
        change = occlusion_factor(s) * max_light_seconds(s) * rate
        return proportional_error_bound(s, change, how, _SETTINGS.dim_pixel_margin)

    def explain(self, s: Situation) -> str:
        steepest = largest_squared_sine(s.camera)
        shift = s.wavelength - s.band.at_angle(steepest).centre
        angle = math.degrees(math.asin(math.sqrt(steepest)))
        return f"at {angle:.3g}° in the frame's corner the band is {shift * 1e9:.3g} nm lower"


def _error_rates(s: Situation) -> tuple[float, ...]:
    """Return the L2 errors in electrons per second, by number of angles.

    The list ends where the error has converged. No finer level has a larger error.
    """
    return cached_across_exposures(s, FILTER_ANGLE, lambda: _find_error_rates(s))


def _find_error_rates(s: Situation) -> tuple[float, ...]:
    """Compute what _error_rates() keeps.

    Light of a wrong band differs by the electrons that are missing or too many, whatever its blur
    (Young), and by the PSFs of wavelengths that differ. All light is taken to come from the angle
    at which most is wrong. Both together are no more than all electrons of wavelengths that differ.
    """
    greatest = largest_squared_sine(s.camera)
    checked = np.linspace(0, greatest, _SETTINGS.angles).tolist()
    known = {count: angle_nodes(greatest, count) for count in LEVELS.angles}
    x, true, *measures = measures_at_angles(s, [checked, *known.values()])
    masses = spectral_measure(s, "band").electrons.sum(-1).max(0)
    masses = np.where(masses > 0, masses, 1.0)[:, None]
    most = light_norm_bound(s) / max(max_light_seconds(s), 1e-300)
    lights, turned = _norms_by_spectrum(s), _TurnedPicture.of(s)

    def norm_of(share: Array) -> float:
        """Return the norm of light of which each part has a share, electrons/s. share: (parts,)."""
        apart = sum(norm * float(share[parts].max()) for parts, norm in lights)
        beside = s.picture_probe.off_plane_star_rate
        return min(apart + beside * float(share.max()), float(share.max()) * most)

    rates = list[float]()
    for squared, measure in zip(known.values(), measures, strict=True):
        share = interpolation_weights(squared, np.array(checked))
        wrong = (np.tensordot(share.T, measure, 1) - true) / masses
        missing = norm_of(np.abs(wrong.sum(-1)).max((0, 1)))
        any_way = norm_of(np.abs(wrong).sum(-1).max((0, 1)))
        rates.append(min(missing + turned.change(x, wrong, measure[0] / masses), any_way))
        if rates[-1] <= _SETTINGS.converged_change * most:
            break
    return tuple(np.maximum.accumulate(rates[::-1])[::-1].tolist())


def _norms_by_spectrum(s: Situation) -> list[tuple[list[int], float]]:
    """Return the L2 norm of the sharp light of each spectrum, electrons/s.

    Each entry has the numbers of the parts with that spectrum, which are lit.
    """
    probe = s.picture_probe
    rows, columns = probe.plane.shape
    counts = rfft_column_weights(columns)
    return [
        (parts, math.sqrt(float((squared * counts).double().sum()) / (rows * columns)))
        for parts, squared in probe.powers_by_spectrum
    ]


@dataclass(frozen=True)
class _TurnedPicture:
    """The sharp picture, and the transfer functions of the pattern's parts.

    powers: of the lights of each spectrum, at some frequencies; none of uniform light, which has no
        other frequency than 0.
    nodes: the transfer functions' wavelengths, metres.
    """

    powers: list[tuple[list[int], Array]]
    nodes: Array
    transfers: TurnedTransfers | None
    factor: float

    @classmethod
    def of(cls, s: Situation) -> _TurnedPicture:
        nodes, some = spectral_measure(s, "band").nodes, s.picture_probe.sampled_frequencies
        if not len(some.ky):
            return cls([], nodes, None, 0.0)
        some = some.every(_SETTINGS.thinning).with_aliases(s.picture_probe.plane)
        transfers = turned_transfers(s, nodes, some, 0.5)
        factor = _SETTINGS.margin * off_axis_factor(s)
        return cls(sampled_powers(s, some), nodes, transfers, factor)

    def change(self, x: Array, wrong: Array, axis: Array) -> float:
        """Bound what a wrong band changes by its PSFs alone, in electrons/s.

        Missing electrons are given back in the spectrum of the axis.
        x: wavelengths.
        wrong: electrons, (angles, channels, parts, wavelengths).
        axis: spectrum of the axis, (channels, parts, wavelengths).
        """
        if self.transfers is None:
            return 0.0
        lit = np.maximum(axis.sum(-1, keepdims=True), 1e-300)
        shape = wrong - wrong.sum(-1, keepdims=True) * axis / lit
        worst = np.argsort(np.abs(shape).sum((1, 2, 3)))[-_SETTINGS.worst_angles :]
        shape, change = shape[worst] @ interpolation_weights(self.nodes.tolist(), x).T, 0.0
        for parts, power in self.powers:
            rows = np.unique(shape[:, :, parts].reshape(-1, len(self.nodes)), axis=0)
            change += math.sqrt(self.transfers.error_power(rows, power))
        return self.factor * change
