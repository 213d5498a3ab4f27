"""Describe a phase pattern as a weighted sum of given patterns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import torch

from optics.camera import Panel
from optics.edof.phase_parametrisation import PhaseParametrisation
from optics.patterns import cubic_phase_mask, even_vergences, focal_sweep_axicon, multi_focus_rings
from optics.quarter_symmetry import crop_quarter, mirror_quarter, quarter_distances
from optics.validation import require_finite, require_wavelength

_LEAST_SHARE = 1e-6
"""Share of a part, in root mean square, that no other parts make up, for its weight to be sure."""


class SumOfParts(PhaseParametrisation):
    """Describe a phase pattern as a sum of given patterns, the parts, each times its weight.

    The parameters are the weights, in the order of the parts. If all parts equal their mirror
    images in both axes bit for bit, so does the pattern, and its symmetry is "quarter".

    Parameters
    ----------
    parts : mapping of str to torch.Tensor, (rows, columns)
        The patterns by name, radians.

    Raises
    ------
    ValueError
        If there are none, their shapes differ, values aren't finite, or a part is a sum of others,
        so that the weights aren't determined.
    """

    name: ClassVar[str] = "parts"

    def __init__(self, parts: Mapping[str, torch.Tensor]) -> None:
        if not parts:
            raise ValueError("parts is empty; give one pattern or more")
        self.names = tuple(parts)
        first = parts[self.names[0]]
        self.shape = (first.shape[-2], first.shape[-1])
        for name, part in parts.items():
            if tuple(part.shape) != self.shape:
                raise ValueError(
                    f"part {name} is {tuple(part.shape)} pixels and {self.names[0]} {self.shape}; "
                    "give all of the panel's shape"
                )
            require_finite(f"part {name}", part)
        stack = torch.stack([part.detach().to(torch.float64) for part in parts.values()])
        self._whole = stack.flatten(1)
        mirrored = all(torch.equal(stack, stack.flip(axis)) for axis in (1, 2))
        self.symmetry = "quarter" if mirrored else "none"
        self._short = crop_quarter(stack).contiguous() if mirrored else stack
        self._require_independence()

    @property
    def count(self) -> int:
        """Number of parts of the phase pattern."""
        return len(self.names)

    def _require_independence(self) -> None:
        """Raise ValueError for a part of the phase pattern that is nearly a sum of those before."""
        sizes = self._whole.norm(dim=1)
        triangle = torch.linalg.qr(self._whole.T, mode="r").R.diagonal().abs()
        for name, size, left in zip(self.names, sizes.tolist(), triangle.tolist(), strict=False):
            if not left > _LEAST_SHARE * size:
                raise ValueError(
                    f"part {name} is zero or a sum of the parts before it; leave it out"
                )
        if len(triangle) < self.count:
            raise ValueError(f"parts has {self.count} patterns of {len(triangle)} pixels")

    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        short = self._short.to(parameters.device, parameters.dtype)
        # A matrix product would run in half precision under autocast, in the gradient too.
        return (parameters[:, None, None] * short).sum(0)

    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        whole = self._whole.to(phase.device)
        return torch.linalg.lstsq(whole.T, phase.reshape(-1, 1)).solution[:, 0]


def depth_of_field_parts(
    panel: Panel, near: float, far: float, wavelength: float
) -> dict[str, torch.Tensor]:
    """Compute analytic patterns whose weighted sums extend the depth of field.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    near, far : float
        Limits of the range of depth, dioptres; 0 is infinity.
    wavelength : float
        Metres.

    Returns
    -------
    dict of str to torch.Tensor, (rows, columns), float64
        Radians, each about the centre of the pixels but for the cubic mask: "lens", a lens of 1
        dioptre; "quartic", a wave at the corners that goes as the fourth power of the radius;
        "focal-sweep" and "multi-focus", patterns of the whole range with their default settings;
        "cubic", a wave at half of the longer side.

    Raises
    ------
    ValueError
        If a number is out of range, or the range is too steep for the pixels.
    """
    require_wavelength("wavelength", wavelength)
    y, x = quarter_distances(panel.shape, (panel.pitch, panel.pitch))
    squared = mirror_quarter(y**2 + x**2, panel.shape)
    vergences = even_vergences(near, far, 10)
    return {
        "lens": -math.pi / wavelength * squared,
        "quartic": 2 * math.pi * (squared / squared.max()) ** 2,
        "focal-sweep": focal_sweep_axicon(panel, near, far, wavelength),
        "multi-focus": multi_focus_rings(panel, vergences, wavelength),
        "cubic": cubic_phase_mask(panel, 2 * math.pi),
    }
