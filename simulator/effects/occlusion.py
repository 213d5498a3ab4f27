"""Near things that hide far ones."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from scipy.ndimage import maximum_filter1d

from simulator.effects.costs import BAND, BESIDE, LEAK, PLACE, PLACES, WAVELENGTHS
from simulator.effects.moving import transform
from simulator.effects.on_pixels import seconds, through_sensor
from simulator.planning import Bound, Stage
from simulator.situation import Situation

_SHARES = (1e-1, 1e-2, 1e-3, 1e-4)
"""Of a PSF's light, that may fall beyond the reach within which it is looked at."""


class Occlusion(Stage):
    name = "occlusion"
    entry = "occlusion"
    physics = "what is near hides what is behind it, and more of it where it is blurred"
    source = "Hasinoff and Kutulakos 2007, doi 10.1109/ICCV.2007.4408910"

    def caused(self, s: Situation) -> bool:
        return any(one is not None and bool(one.any()) for one in s.picture.covers) and any(
            bool(light.any()) for light in s.picture.lights[1:]
        )

    def missed(self, s: Situation) -> float:
        """Sharp: what would shine through."""
        whole = s.picture.l2
        if not whole:
            return 0.0
        transparent = torch.stack(s.picture.lights).sum(0)
        return float((transparent - s.picture.picture).double().norm()) / whole

    def left_out(self, s: Situation) -> Bound:
        how = "proved: light behind, as far as a PSF reaches from what hides, and what falls beyond"
        return through_sensor(s, seconds(s) * self._through(s), how)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Of transforms beyond those of layers that are added: for every wavelength each layer's
        transfer function, for what shines and what hides, and the picture of either."""
        if not levels[self.name]:
            return 0.0
        colour = s.camera.sensor.colour
        channels = len(colour.channels) if colour and levels.get("colour filter array", 0) else 1
        nodes = WAVELENGTHS[levels.get(BAND, 0)] + LEAK[levels.get(BESIDE, 0)]
        places = PLACES[levels.get(PLACE, 0)] ** 2
        layers = s.target.layers
        covers = sum(one is not None for one in s.picture.covers)
        pictures = covers + len(layers) * channels
        each = places * (covers + len(layers)) + pictures
        added = places * sum(min(nodes, len(one.parts) * channels) for one in layers)
        return (nodes * each + covers + channels - added) * transform(s, levels)

    def why(self, s: Situation) -> str:
        edges = s.picture.edge_length / s.camera.sensor.pitch
        return f"near things hide what is behind them along {edges:.3g} pixels of edges"

    def _through(self, s: Situation) -> float:
        """L2 of electrons per second that come through what should hide them, at most.

        A layer's blurred light times the blurred covers before it: light that starts within
        twice a PSF's reach of a cover; and what falls farther away, which is a share of the
        light for the layer, and of the covers.
        """
        return min(self._reaching(s, share) for share in _SHARES)

    def _reaching(self, s: Situation, share: float) -> float:
        reach = s.pattern.reach(share)
        pixels = math.ceil(reach / s.camera.sensor.pitch)
        beyond = min(share + self._aside(s), 1.0)
        hidden = torch.zeros(s.picture.plane.shape, dtype=torch.uint8)
        total = 0.0
        for light, cover in zip(s.picture.lights, s.picture.covers, strict=True):
            all_of_it = float(light.double().norm())
            if hidden.any() and all_of_it:
                near = float((light * _widened(hidden, 2 * pixels)).double().norm())
                total += min(near + 2 * beyond * all_of_it, all_of_it)
            if cover is not None:
                hidden |= (cover > 0).to(torch.uint8)
        return total

    def _aside(self, s: Situation) -> float:
        """Share of a PSF's light in orders of the panel's pixels that may land in the frame."""
        far = max(n * p for n, p in zip(s.picture.plane.shape, s.picture.plane.pitch, strict=True))
        return s.pattern.order_light if s.pattern.period / 2 < far else 0.0


def _widened(mask: torch.Tensor, pixels: int) -> torch.Tensor:
    """A mask, and all within a square of so many pixels to each side."""
    values = mask.numpy()
    for axis, n in enumerate(values.shape):
        values = maximum_filter1d(values, min(2 * pixels + 1, 2 * n + 1), axis, mode="constant")
    return torch.from_numpy(values)
