"""Objects at several depths and in motion: what moves, and what hides what."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from optics.sensor.readout import row_delay
from simulator.effects.blur_effects import MAX_SINC_LOSS
from simulator.effects.electron_bounds import (
    is_lamp_flickering,
    lamp_ripple,
    max_light_seconds,
    sensor_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.effects.rendering_work import (
    FILTER_BANDWIDTH,
    LEVELS,
    OCCLUSION,
    OUT_OF_BAND_LEAK,
    PSF_REACH,
    light_samples_at,
    place_count_at,
)
from simulator.formation.windows import rendering_windows, transform_operations
from simulator.planning import Bound, OnOffEffect
from simulator.probing.sampled_frequencies import Gain
from simulator.situation import Situation


class Motion(LightEffect):
    name = "motion"
    likely_shares = (0.5,)
    kind = "axis"
    recipe_field, recipe_values = "motion", (1, 2, 4, 8, 16, 32)
    physics = "what moves during the exposure is smeared along its path"
    source = "the transfer function of a uniform motion, sinc(k v T); Goodman, Introduction to "\
        "Fourier Optics"  # fmt: skip
    levels = ("off", "2", "4", "8", "16", "32")

    def is_present(self, s: Situation) -> bool:
        return s.target.is_moving and not s.picture_probe.is_dark and any(self._paths(s))

    def finest_level(self, s: Situation) -> int:
        # A uniform motion is rendered exactly, if the light, the panel and the rows' times are
        # constant.
        changing = (
            s.panel_content.is_changing or is_lamp_flickering(s) or row_delay(s.camera.sensor)
        )
        return len(self.levels) - 1 if changing else 1

    def estimated_error(self, s: Situation, level: int) -> float:
        whole = s.picture_probe.norm_bound
        return self._change(s, level) / whole if whole and level < self.finest_level(s) else 0.0

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        change = self._change(s, level) + self._change(s, self.finest_level(s))
        how = "proved: phases of light along the path, (π k v T)²/6 at most"
        return sensor_error_bound(s, change * max_light_seconds(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations of further parts of the motion: each is a picture.

        All parts use the same PSFs.
        """
        parts = sum(len(layer.parts) for layer in s.target.layers)
        more = self._parts(s, levels[self.name]) - 1
        return more * (2 * parts + 1) * transform(s, levels)

    def explain(self, s: Situation) -> str:
        pixels = max(self._paths(s)) / s.camera.sensor.pitch
        return f"it moves by {pixels:.3g} pixels in {s.exposure * 1e3:.3g} ms"

    def _paths(self, s: Situation) -> list[float]:
        """Return the metres on the sensor over which each layer is smeared."""
        speed = math.hypot(*s.target.velocity)
        scales = (s.camera.magnification(layer.distance) for layer in s.target.layers)
        return [speed * s.exposure * scale for scale in scales]

    def _parts(self, s: Situation, level: int) -> int:
        """Return how many parts a level divides the frame's motion into."""
        return 2**level * math.ceil(s.exposure_span / s.exposure) if level else 1

    def _change(self, s: Situation, level: int) -> float:
        """Bound the L2 error at a level, in electrons per second."""
        return s.picture_probe.change_bound([self._gain(s, path, level) for path in self._paths(s)])

    def _gain(self, s: Situation, path: float, level: int) -> Gain:
        """Bound the error by frequency, for a layer that moves `path` metres on the sensor.

        All light of a part of the path, of length ℓ, is spread evenly over the part: its phases 2π
        k x differ from that of the middle by 2π k ℓ/4 on average. They are weighted by the lamp's
        deviation, at most twice its ripple, or by the PSF's change, at most 2. With a rolling
        shutter, rows see parts of these parts: then the phase of each instant counts, over a path
        that is longer by the frame's duration over the exposure.
        """
        part = path / 2**level if level else path
        uneven = 2.0 * (1 + lamp_ripple(s)) if s.panel_content.is_changing else 2 * lamp_ripple(s)
        late = (
            math.sqrt(s.exposure_span / s.exposure) * (1 + lamp_ripple(s))
            if row_delay(s.camera.sensor)
            else 0.0
        )
        away = part if level else path * s.exposure_span / s.exposure

        def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
            if late:
                # At level 0, light is rendered where it is in the middle of the first row's
                # exposure; other rows' light may be the path of a whole frame away from there.
                reach = 2 * np.pi if level == 0 else np.pi
                return late * np.minimum(2.0, reach * k * away)
            smear = np.minimum((np.pi * k * path) ** 2 / 6, MAX_SINC_LOSS) if level == 0 else 0.0
            return smear + uneven * np.minimum(1.0, np.pi * k * part / 2)

        return gain


def transform(s: Situation, levels: Mapping[str, int]) -> float:
    """Return the operations of a Fourier transform of the whole picture.

    The number depends on how far the PSFs reach and how fine the samples are.
    """
    windows = rendering_windows(s, LEVELS.windows[levels.get(PSF_REACH, 0)])
    return transform_operations(*(n * light_samples_at(s, levels) for n in windows.picture))


class Occlusion(LightEffect, OnOffEffect):
    name = OCCLUSION
    likely_shares = (0.5,)
    recipe_field = "occlusion"
    physics = "what is near hides what is behind it, and more of it where it is blurred"
    source = "Hasinoff and Kutulakos 2007, doi 10.1109/ICCV.2007.4408910"

    def is_present(self, s: Situation) -> bool:
        return any(one is not None and bool(one.any()) for one in s.picture_probe.covers) and any(
            bool(light.any()) for light in s.picture_probe.lights[1:]
        )

    def estimated_error_if_omitted(self, s: Situation) -> float:
        """Estimate the sharp picture's relative error if all layers are transparent."""
        whole = s.picture_probe.norm_bound
        if not whole:
            return 0.0
        transparent = torch.stack(s.picture_probe.lights).sum(0)
        return float((transparent - s.picture_probe.sharp_picture).double().norm()) / whole

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: light behind, as far as a PSF reaches from what hides, and what falls beyond"
        return sensor_error_bound(s, max_light_seconds(s) * self._hidden_light_bound(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations beyond those of simply summing the layers' light.

        For every wavelength, each layer's transfer function is transformed, for its light and its
        cover, and so are the pictures of both.
        """
        if not levels[self.name]:
            return 0.0
        colour = s.camera.sensor.colour
        channels = len(colour.channels) if colour and levels.get("colour filter array", 0) else 1
        nodes = (
            LEVELS.wavelengths[levels.get(FILTER_BANDWIDTH, 0)]
            + LEVELS.leak[levels.get(OUT_OF_BAND_LEAK, 0)]
        )
        places = place_count_at(levels)
        layers = s.target.layers
        covers = sum(one is not None for one in s.picture_probe.covers)
        pictures = covers + len(layers) * channels
        each = places * (covers + len(layers)) + pictures
        added = places * sum(min(nodes, len(one.parts) * channels) for one in layers)
        return (nodes * each + covers + channels - added) * transform(s, levels)

    def explain(self, s: Situation) -> str:
        edges = s.picture_probe.edge_length / s.camera.sensor.pitch
        return f"near things hide what is behind them along {edges:.3g} pixels of edges"

    def _hidden_light_bound(self, s: Situation) -> float:
        """Bound the L2 norm of light that near layers should hide, electrons per second.

        The bound is a layer's blurred light times the blurred covers before it. It consists of
        light that starts within twice a PSF's reach of a cover, and of the shares of light and
        covers that fall beyond the reach.
        """
        # Shares of a PSF's light beyond its reach: whichever gives the least bound.
        shares = (1e-1, 1e-2, 1e-3, 1e-4)
        return min(self._hidden_light_within(s, share) for share in shares)

    def _hidden_light_within(self, s: Situation, share: float) -> float:
        """Bound the hidden light if `share` of a PSF is beyond its reach."""
        reach = s.pattern_probe.reach_of_share(share)
        pixels = math.ceil(reach / s.camera.sensor.pitch)
        beyond = min(share + self._side_order_share(s), 1.0)
        hidden = torch.zeros(s.picture_probe.plane.shape, dtype=torch.uint8)
        total = 0.0
        for light, cover in zip(s.picture_probe.lights, s.picture_probe.covers, strict=True):
            all_of_it = float(light.double().norm())
            if hidden.any() and all_of_it:
                near = float((light * _dilate_mask(hidden, 2 * pixels)).double().norm())
                total += min(near + 2 * beyond * all_of_it, all_of_it)
            if cover is not None:
                hidden |= (cover > 0).to(torch.uint8)
        return total

    def _side_order_share(self, s: Situation) -> float:
        """Bound the share of a PSF's light in side orders that reaches the frame."""
        far = max(
            n * p
            for n, p in zip(s.picture_probe.plane.shape, s.picture_probe.plane.pitch, strict=True)
        )
        return s.pattern_probe.side_order_share if s.pattern_probe.period / 2 < far else 0.0


def _dilate_mask(mask: torch.Tensor, pixels: int) -> torch.Tensor:
    """Grow a mask by a square of `pixels` to each side."""
    values = mask.numpy()
    for axis, n in enumerate(values.shape):
        values = maximum_filter1d(values, min(2 * pixels + 1, 2 * n + 1), axis, mode="constant")
    return torch.from_numpy(values)
