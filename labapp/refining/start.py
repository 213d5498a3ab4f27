"""What a refinement starts from: a design's goal for the present camera, and its phases."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from labapp.common.errors import UserError
from labapp.files.design_file import DesignContents
from labapp.files.pattern_table import Pattern, PSFPattern, VideoPattern
from labapp.patterns.grey_levels import target_on_design_grid
from optics.camera import Camera
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.slow_crystal import shortest_panel_phases, usable_orders
from optics.slm import grey_to_phase, phase_to_grey
from optics.slm.lut import flatness_phase


@dataclass(frozen=True, eq=False)
class RefinementStart:
    """Pattern table, retrieval goal and phases of a design.

    phases are (frames, rows, columns), radians. orders is the number of whole waves of the
    panel's range that they use.
    """

    spec: PSFPattern
    goal: RetrievalGoal
    phases: torch.Tensor
    orders: int

    @property
    def frames(self) -> int:
        return len(self.phases)

    def phases_on_panel(self, phases: torch.Tensor) -> torch.Tensor:
        """Return phases as the panel shows them.

        For a video on a slow panel, whole waves are added so that its liquid crystal has the
        least to change from frame to frame.
        """
        panel, wavelength = self.goal.camera.panel, self.goal.wavelength
        slow = self.frames > 1 and panel.response_time > 0
        if not slow or self.orders != usable_orders(panel, wavelength):
            return phases
        return shortest_panel_phases(self.goal, phases)

    def grey_levels(self, phases: torch.Tensor) -> NDArray[np.uint8]:
        """Return the grey levels of phases on the panel, (frames, rows, columns)."""
        panel, wavelength = self.goal.camera.panel, self.goal.wavelength
        greys = [phase_to_grey(panel, phase, wavelength, self.orders) for phase in phases]
        return np.stack([grey.numpy() for grey in greys])


def build_start(contents: DesignContents, path: Path, camera: Camera) -> RefinementStart:
    """Pose the design's goal for the camera as it is calibrated now.

    Raises UserError if the design isn't for a PSF's shape, or is for another panel.
    """
    spec = _spec(contents, path)
    panel, (rows, columns) = camera.panel, contents.grey.shape[1:]
    same = np.isclose(contents.pixel_pitch, panel.pitch, rtol=1e-6, atol=0)
    if (rows, columns) != panel.shape or not same:
        raise UserError(
            f"{path}: is for a panel of {columns} x {rows} pixels of "
            f"{contents.pixel_pitch * 1e6:g} µm, and this bench's has {panel.shape[1]} x "
            f"{panel.shape[0]} of {panel.pitch * 1e6:g} µm. Retrieve it for this bench."
        )
    drawings = spec.target.video_drawings(len(contents.grey), Path())
    if len(drawings) > 1:
        raise UserError(
            f"{path}: {spec.summary} changes with time, and a picture shows its mean. Refine a "
            "shape that stands still."
        )
    try:
        target, plane = target_on_design_grid(drawings[0], camera, spec.wavelength)
        goal = RetrievalGoal(camera, target, plane, spec.wavelength)
    except ValueError as error:
        raise UserError(f"{path}: {error}.") from error
    return RefinementStart(spec, goal, _phases(contents, camera, spec.wavelength), contents.orders)


def _spec(contents: DesignContents, path: Path) -> PSFPattern:
    try:
        spec = TypeAdapter[Pattern](Pattern).validate_python(contents.settings.get("pattern"))
    except ValidationError as error:
        raise UserError(f"{path}: its settings name no pattern. Make it again.") from error
    still = spec.pattern if isinstance(spec, VideoPattern) else spec
    if not isinstance(still, PSFPattern):
        raise UserError(
            f"{path}: {contents.title} has no target to come nearer to. Give a design that "
            "labapp retrieve wrote."
        )
    return still


def _phases(contents: DesignContents, camera: Camera, wavelength: float) -> torch.Tensor:
    """Return the phases of a design, computed from grey levels if it has none."""
    if contents.phase is not None:
        return torch.from_numpy(contents.phase)
    panel = camera.panel
    phases = grey_to_phase(panel, torch.from_numpy(contents.grey), wavelength)
    if panel.flatness is not None:
        phases = phases + flatness_phase(panel, wavelength)
    return phases.to(torch.float32)
