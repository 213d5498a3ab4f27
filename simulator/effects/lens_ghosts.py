"""The effect of a lens' ghosts: copies of the picture, scaled and out of focus."""

from __future__ import annotations

import math
from collections.abc import Mapping

from optics.camera.ghost import total_share
from simulator.effects.electron_bounds import (
    ghost_gain,
    light_norm_bound,
    off_plane_star_electrons,
    relative_light_change,
    sensor_error_bound,
    total_electrons,
)
from simulator.effects.ghost_light import GhostLight, ghost_lights
from simulator.effects.likely_errors import FAR, LightEffect
from simulator.effects.psf_bounds import is_uniform_scene
from simulator.effects.rendering_work import (
    LENS_GHOSTS,
    added_operations,
    channel_count_at,
    picture_samples_at,
)
from simulator.effects.vignetting_bounds import max_vignetting_change
from simulator.formation.ghosts import ghost_operations
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation


class LensGhosts(OnOffEffect, LightEffect):
    name = LENS_GHOSTS
    recipe_field = "ghosts"
    noise_change = FAR
    physics = "two of the lens' surfaces reflect some light, which makes a copy out of focus"
    source = "Hullin et al. 2011, doi 10.1145/2010324.1965003; Lee and Eisemann 2013, ray matrices"

    def is_present(self, s: Situation) -> bool:
        return total_share(s.camera.ghosts) > 0 and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return relative_light_change(s, _change(s, ghost_lights(s)))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the picture's error if the lens ghosts effect is left out.

        Ghosts and the light that they take from the picture are both positive, so that the square
        of their difference is no more than the sum of their squares. Dark pixels beside bright ones
        count as they do for veiling glare: |√a - √b|² ≤ |a - b|.
        """
        ghosts = ghost_lights(s)
        how = "proved: no more than all ghosts, and all light that they take from the picture"
        change = _change(s, ghosts)
        bound = sensor_error_bound(s, change, how, read_noise=False)
        slope = bound.variance / change if change else 0.0
        taken = total_share(s.camera.ghosts) * (total_electrons(s) + off_plane_star_electrons(s))
        moved = taken + sum(one.total for one in ghosts)
        sigma = min(bound.sigma, math.sqrt(slope * moved))
        return Bound(bound.mean, bound.variance, sigma, how=how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        if not levels[self.name]:
            return 0.0
        ghosts = len(s.camera.ghosts) * channel_count_at(s, levels)
        pictures = max(1, len(s.panel_content.pictures))
        own = ghosts * pictures * ghost_operations(picture_samples_at(s, levels))
        return own + added_operations(s, levels, self.name)

    def explain(self, s: Situation) -> str:
        ghosts = s.camera.ghosts
        brightest = max(ghosts, key=lambda one: one.brightness)
        return (
            f"{total_share(ghosts):.2g} of the light is in {len(ghosts)} of them; the brightest is "
            f"{brightest.magnification:.2g} times as large as the picture"
        )


def _change(s: Situation, ghosts: tuple[GhostLight, ...]) -> float:
    """Bound the L2 norm of the electrons that the lens ghosts effect moves."""
    light = light_norm_bound(s) / ghost_gain(s.camera)
    taken = total_share(s.camera.ghosts) * light
    added = sum(one.norm for one in ghosts)
    most = math.hypot(taken, added)
    if not is_uniform_scene(s):
        return most
    # Even light and its ghosts differ by a factor, but for what vignetting makes of both.
    kept = sum(one.brightness - one.share for one in s.camera.ghosts)
    uneven = max_vignetting_change(s) * (taken + added)
    return min(abs(kept) * light + uneven, most)
