"""What the decisions depend on, and what a decision is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from optics.camera import Camera


@dataclass(frozen=True)
class Situation:
    """What the decisions depend on.

    wavelength, bandwidth: of the filter, metres (full width at half maximum).
    spread: radius of the PSF on the sensor, metres, from the slope of the shown phase.
    sizes: of the panel's effects on what is shown, by name; what isn't there has none.
    """

    camera: Camera
    wavelength: float
    bandwidth: float
    spread: float
    sizes: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Decision:
    """One effect: on or off, the estimate that decided, and the physics in a sentence.

    estimate: relative change of the mean picture, or of the noise in standard deviations.
    nodes: samples along an axis of the image-formation integral; 1 for stages. forced: whether
    somebody decided who wasn't the estimate.
    """

    effect: str
    on: bool
    estimate: float
    measure: str
    why: str
    nodes: int = 1
    forced: bool = False
