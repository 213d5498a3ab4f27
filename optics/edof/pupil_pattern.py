"""What stands in the pupil: a phase pattern or a smaller stop."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.camera import Camera
from optics.slm.panel import Panel
from optics.validation import require_finite, require_positive

STOP_DIAMETERS = (1e-3, 2e-3, 4e-3)
"""Diameters in metres of the round stops that every evaluation compares patterns with."""


@dataclass(frozen=True, eq=False)
class PupilPattern:
    """A pattern in the pupil: phase, and amplitude where light is blocked.

    Parameters
    ----------
    name : str
        Name in tables.
    phase : torch.Tensor, (rows, columns), optional
        Radians on the panel's pixels; zero by default.
    amplitude : torch.Tensor, (rows, columns), optional
        Amplitude transmittance of the panel's pixels, 0 to 1; one by default.

    Raises
    ------
    ValueError
        If values aren't finite, an amplitude isn't within 0 to 1, or it blocks all light.
    """

    name: str
    phase: torch.Tensor | None = None
    amplitude: torch.Tensor | None = None

    def __post_init__(self) -> None:
        if self.phase is not None:
            require_finite("phase", self.phase)
        if self.amplitude is None:
            return
        require_finite("amplitude", self.amplitude)
        low, high = float(self.amplitude.min()), float(self.amplitude.max())
        if not (low >= 0 and 0 < high <= 1):
            raise ValueError(
                f"amplitude goes from {low:g} to {high:g}; it must lie within 0 to 1, and pass "
                "light somewhere"
            )


def collected_share(pattern: PupilPattern, camera: Camera) -> float:
    """Return the share of the open pupil's light that a pattern collects, 0 to 1.

    A phase alone collects all of it. The pupil is what the panel and the lens' stop both pass, as
    if they stood in one plane. Raises ValueError if the pattern has another shape than the panel,
    or passes no light within the stop.
    """
    panel = camera.panel
    for name in ("phase", "amplitude"):
        given = getattr(pattern, name)
        if given is not None and tuple(given.shape) != panel.shape:
            raise ValueError(
                f"{name} of {pattern.name} is {tuple(given.shape)}; the panel has {panel.shape}"
            )
    if pattern.amplitude is None:
        return 1.0
    open_pupil = _disc(panel, camera.lens.stop_diameter)
    power = pattern.amplitude.to(torch.float64).square() * open_pupil
    share = float(power.sum() / open_pupil.sum())
    if not share > 0:
        raise ValueError(f"amplitude of {pattern.name} passes no light within the lens' stop")
    return share


def round_stop(panel: Panel, diameter: float) -> PupilPattern:
    """Return a round hole without phase, made of whole panel pixels.

    Parameters
    ----------
    panel : Panel
        The panel whose pixels it covers.
    diameter : float
        Metres.

    Returns
    -------
    PupilPattern
        The hole, centred on the axis.

    Raises
    ------
    ValueError
        If the diameter isn't positive, or less than two pixels.
    """
    require_positive("diameter", diameter, "m")
    if diameter < 2 * panel.pitch:
        raise ValueError(
            f"diameter is {diameter:g} m; whole pixels make no hole of that size: give "
            f"{2 * panel.pitch:g} m at least"
        )
    inside = _disc(panel, diameter)
    return PupilPattern(f"stop {diameter * 1e3:g} mm", amplitude=inside.to(torch.float32))


def _disc(panel: Panel, diameter: float) -> torch.Tensor:
    """Return 1 for the panel's pixels whose centres lie in a round hole, else 0, float64."""
    y, x = panel.plane.mesh()
    return (y**2 + x**2 <= (0.5 * float(diameter)) ** 2).to(torch.float64)
