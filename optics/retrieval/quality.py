"""Measure the quality of a retrieved pattern or video on a grid that resolves speckle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.camera.pupil import open_area, with_stop_shadow_on_panel
from optics.metrics import efficiency, scaled_nrmse, speckle_contrast
from optics.retrieval.goal import RetrievalGoal


@dataclass(frozen=True)
class PatternQuality:
    """Figures of merit of a PSF in its target's window, as `optics.metrics` defines them.

    Parameters
    ----------
    efficiency : float
        Share of all light that leaves the pupil and falls where the target exceeds 2 % of its peak,
        0 to 1. Light that the panel's gaps send into other orders is missing, and light that the
        panel can't modulate counts where it falls.
    steered_share : float
        The same of the modulated light of one order: what a panel without gaps and without
        unmodulated light would reach.
    contrast : float
        Speckle contrast of the modulated light where the target exceeds half of its peak.
    nrmse : float
        Normalised root-mean-square error of the modulated light's shape, with the best scale.
    """

    efficiency: float
    steered_share: float
    contrast: float
    nrmse: float


def measure_quality(goal: RetrievalGoal, light: torch.Tensor) -> PatternQuality:
    """Measure the quality of a retrieved phase's PSF on the goal's plane.

    `light` is the PSF of the modulated light, as shares of one order's light.
    """
    target = goal.target
    return PatternQuality(
        efficiency(light_with_gaps(goal, light), target),
        efficiency(light, target),
        speckle_contrast(light, target),
        scaled_nrmse(light, target),
    )


def light_with_gaps(goal: RetrievalGoal, light: torch.Tensor) -> torch.Tensor:
    """Convert a retrieved PSF to shares of all light, with the panel's gaps and unmodulated light.

    A pixel of fill factor F sends the share F sinc²(m sqrt F) sinc²(n sqrt F) of its light to the
    place m by n orders off the axis, and unmodulated light adds in intensity (thesis §5.6). Where
    the stop's shadow limits the light, shares are of what panel and stop would pass in one plane,
    as those of a PSFOperator.

    light: PSF of the modulated light, as shares of one order's light, (rows, columns).
    """
    camera, panel = goal.camera, goal.camera.panel
    order = goal.plane.pitch[0] * goal.far_field_samples
    y, x = (torch.sinc(u / order * math.sqrt(panel.fill_factor)) ** 2 for u in goal.plane.mesh())
    straight = goal.far_field.intensity(goal.amplitude.to(torch.complex64)).to(torch.float64)
    share, passing = panel.unmodulated, open_area(with_stop_shadow_on_panel(camera))
    shown = (1 - share) * light + share * straight / goal.power
    return shown * (panel.fill_factor * y * x * passing / open_area(camera))
