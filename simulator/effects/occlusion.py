"""The effect of occlusion: near layers hide far ones."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from scipy.ndimage import maximum_filter1d

from simulator.effects.electron_bounds import max_light_seconds, sensor_error_bound
from simulator.effects.likely_errors import LightEffect
from simulator.effects.moving import transform
from simulator.effects.rendering_work import (
    FILTER_BANDWIDTH,
    LEVELS,
    OCCLUSION,
    OUT_OF_BAND_LEAK,
    place_count_at,
)
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation


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
        """Estimate the occlusion effect: the sharp picture's relative error without covers.

        Without covers, all layers are transparent.
        """
        whole = s.picture_probe.norm_bound
        if not whole:
            return 0.0
        transparent = torch.stack(s.picture_probe.lights).sum(0)
        return float((transparent - s.picture_probe.sharp_picture).double().norm()) / whole

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: light behind, as far as a PSF reaches from what hides, and what falls beyond"
        return sensor_error_bound(s, max_light_seconds(s) * self._hidden_light_bound(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations that the occlusion effect adds to simply summing the layers' light.

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
        """Bound the L2 norm of light that the occlusion effect should hide, electrons per second.

        The bound is a layer's blurred light times the blurred covers before it. It consists of
        light that starts within twice a PSF's reach of a cover, and of the shares of light and
        covers that fall beyond the reach.
        """
        # Shares of a PSF's light beyond its reach: whichever gives the least bound.
        shares = (1e-1, 1e-2, 1e-3, 1e-4)
        return min(self._hidden_light_within(s, share) for share in shares)

    def _hidden_light_within(self, s: Situation, share: float) -> float:
        """Bound the occlusion effect's hidden light if `share` of a PSF is beyond its reach."""
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
        """Bound the PSF's side-order light that reaches the frame, for the occlusion effect."""
        far = max(
            n * p
            for n, p in zip(s.picture_probe.plane.shape, s.picture_probe.plane.pitch, strict=True)
        )
        return s.pattern_probe.side_order_share if s.pattern_probe.period / 2 < far else 0.0


def _dilate_mask(mask: torch.Tensor, pixels: int) -> torch.Tensor:
    """Grow the occlusion effect's mask of covers by a square of `pixels` to each side."""
    values = mask.numpy()
    for axis, n in enumerate(values.shape):
        values = maximum_filter1d(values, min(2 * pixels + 1, 2 * n + 1), axis, mode="constant")
    return torch.from_numpy(values)
