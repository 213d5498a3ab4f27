"""Describe a phase pattern by numbers that an optimiser moves: of pixels, lines, radii or parts."""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import scipy.linalg
import scipy.sparse
import torch
from scipy.interpolate import BSpline

from optics.camera import Panel
from optics.patterns import cubic_phase_mask, even_vergences, focal_sweep_axicon, multi_focus_rings
from optics.plane import Plane
from optics.quarter_symmetry import crop_quarter, mirror_quarter, quarter_distances, quarter_shape
from optics.validation import (
    accepts_numpy,
    as_floating_point,
    require_finite,
    require_tensor,
    require_wavelength,
)


class PhaseParametrisation(ABC):
    """Describe how parameters, which an optimiser moves, make a phase pattern on a panel.

    The phase, in radians, is linear in the parameters and differentiable by torch. It has the
    parameters' type, float32 or float64, and device, and it isn't wrapped.
    """

    name: ClassVar[str]
    symmetry: str
    """What the phase's short form is: "none": the whole phase; "quarter": a quarter of it, which
    the other quarters mirror about the centre of the pixels; "separable": the phases of all rows
    and then of all columns, whose sums are the phase."""
    shape: tuple[int, int]
    """(rows, columns) of the panel."""

    def __post_init__(self) -> None:
        if len(self.shape) != 2:
            raise ValueError(f"shape is {self.shape}; give (rows, columns)")
        Plane(self.shape, (1.0, 1.0))

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of parameters of the phase pattern."""

    @property
    def mirrored(self) -> bool:
        """Whether the phase pattern equals its mirror images in both axes, bit for bit."""
        return self.symmetry == "quarter"

    @accepts_numpy
    def phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Compute the phase pattern, (rows, columns), from parameters, (count,).

        Raises ValueError if there is another number of parameters.
        """
        short = self.symmetric_phase(parameters)
        if self.symmetry == "quarter":
            return mirror_quarter(short, self.shape)
        if self.symmetry == "separable":
            y, x = short[: self.shape[0]], short[self.shape[0] :]
            return y[:, None] + x[None, :]
        return short

    @accepts_numpy
    def symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Compute the short form of the phase pattern that its symmetry allows.

        It is (rows, columns) for the symmetry "none", (ceil(rows / 2), ceil(columns / 2)) for
        "quarter", with the pixel nearest to the centre first, and (rows + columns,) for
        "separable". Raises ValueError if there is another number of parameters.
        """
        require_tensor("parameters", parameters)
        if tuple(parameters.shape) != (self.count,):
            raise ValueError(
                f"parameters is {tuple(parameters.shape)}; {self.name} has ({self.count},) for a "
                f"panel of {self.shape[1]} x {self.shape[0]} pixels"
            )
        return self._symmetric_phase(as_floating_point(parameters))

    @accepts_numpy
    def quarter_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Compute a quarter of a mirrored phase pattern, the pixel nearest to the centre first.

        Raises ValueError if the pattern isn't mirrored, or there is another number of parameters.
        """
        if not self.mirrored:
            raise ValueError(
                f"{self.name} doesn't mirror its phase in both axes, so that a quarter isn't all "
                "of it; take phase() or symmetric_phase()"
            )
        short = self.symmetric_phase(parameters)
        return short if self.symmetry == "quarter" else crop_quarter(self.phase(parameters))

    @accepts_numpy
    def fit(self, phase: torch.Tensor) -> torch.Tensor:
        """Compute the parameters whose phase pattern is nearest to a given one, (rows, columns).

        Nearest means the least sum of squared differences over the panel's pixels. The phase must
        not be wrapped: a jump of a whole wave is a difference too. The result has the phase's type
        and is computed in float64. Raises ValueError if the phase has another shape, or isn't
        finite.
        """
        require_tensor("phase", phase)
        if tuple(phase.shape) != self.shape:
            raise ValueError(f"phase is {tuple(phase.shape)} pixels; the panel has {self.shape}")
        require_finite("phase", phase)
        given = as_floating_point(phase.detach())
        return self._fit(given.to(torch.float64)).to(given.dtype)

    @abstractmethod
    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Compute the short form of the phase pattern from parameters of the right number."""

    @abstractmethod
    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        """Compute the parameters nearest to a finite float64 phase of the panel's shape."""


def _mean_of_images(phase: torch.Tensor, axes: tuple[int, ...] = (0, 1)) -> torch.Tensor:
    """Compute the mean of a phase pattern and its mirror images in axes.

    Among the patterns that are mirrored in these axes it is the nearest.
    """
    for axis in axes:
        phase = (phase + phase.flip(axis)) / 2
    return phase


@dataclass(frozen=True)
class FreePhase(PhaseParametrisation):
    """Describe a phase pattern by the phase of every pixel, row by row."""

    shape: tuple[int, int]
    name: ClassVar[str] = "free"
    symmetry = "none"

    @property
    def count(self) -> int:
        """Number of pixels of the phase pattern."""
        return self.shape[0] * self.shape[1]

    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        return parameters.reshape(self.shape)

    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        return phase.reshape(-1).clone()


@dataclass(frozen=True)
class QuarterPhase(PhaseParametrisation):
    """Describe a phase pattern by a quarter's pixels, which the other quarters mirror.

    The parameters are the phases of the quarter behind the centre of the pixels on both axes, row
    by row. The middle line of an odd number belongs to it.
    """

    shape: tuple[int, int]
    name: ClassVar[str] = "quarter"
    symmetry = "quarter"

    @property
    def count(self) -> int:
        """Number of pixels of a quarter of the phase pattern."""
        return math.prod(quarter_shape(self.shape))

    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        return parameters.reshape(quarter_shape(self.shape))

    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        return crop_quarter(_mean_of_images(phase)).reshape(-1).clone()


@dataclass(frozen=True)
class SeparablePhase(PhaseParametrisation):
    """Describe a phase pattern as the sum of a phase of each row and one of each column.

    The parameters are the rows' phases and then the columns'; of a mirrored axis, those behind the
    centre, with the one nearest to it first. A constant may go from the rows' to the columns'
    without changing the pattern; `fit` gives both the same share of the mean.
    """

    shape: tuple[int, int]
    mirrored_axes: tuple[bool, bool] = (False, False)
    name: ClassVar[str] = "separable"
    symmetry = "separable"

    @property
    def mirrored(self) -> bool:
        """Whether the separable phase pattern equals its mirror images in both axes."""
        return all(self.mirrored_axes)

    @property
    def count(self) -> int:
        """Number of phases of rows and columns that make the phase pattern."""
        return sum(self._counts)

    @property
    def _counts(self) -> list[int]:
        """Numbers of parameters of the phase pattern's rows and columns."""
        return [
            (pixels + 1) // 2 if mirrored else pixels
            for pixels, mirrored in zip(self.shape, self.mirrored_axes, strict=True)
        ]

    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        lines = [
            torch.cat([line[pixels % 2 :].flip(0), line]) if mirrored else line
            for line, pixels, mirrored in zip(
                torch.split(parameters, self._counts), self.shape, self.mirrored_axes, strict=True
            )
        ]
        return torch.cat(lines)

    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        phase = _mean_of_images(phase, tuple(axis for axis in (0, 1) if self.mirrored_axes[axis]))
        half_mean = phase.mean() / 2
        lines = (phase.mean(1) - half_mean, phase.mean(0) - half_mean)
        # Of a mirrored axis, all lines behind the centre; of another one, all.
        counts = zip(lines, self._counts, strict=True)
        return torch.cat([line[len(line) - count :] for line, count in counts])


_DEGREE = 3  # degree of the spline's polynomials: cubic, with continuous curvature

# Weight of the parameters' squares in a fit, as a share of the normal matrix' largest entry.
#
# It decides where pixels don't, near the centre of a spline with more parameters than radii.
# Where they do, it changes parameters by about this share.
_DAMPING = 1e-12


@dataclass(frozen=True)
class RadialPhase(PhaseParametrisation):
    """Describe a round phase pattern by a cubic spline over the distance from the pixels' centre.

    The parameters are the coefficients of B-splines, evenly spaced from the centre to the panel's
    corners: the phase at a radius is the weighted mean of the four nearest ones. The phase has no
    jumps; a fit spreads those of a given phase over about two spaces between parameters. Fitted to
    `multi_focus_rings` on the thesis' panel, 0.9875 of the light is in step with theirs, and a
    blind filter's expected error is the same within 0.02 dB (measured).

    values: number of parameters, 4 or more, up to the number of a quarter's pixels; by default one
        for a pixel's pitch of radius, 1102 for the thesis' panel.
    """

    shape: tuple[int, int]
    values: int | None = None
    name: ClassVar[str] = "radial"
    symmetry = "quarter"
    _on_device: dict[tuple[torch.dtype, torch.device], tuple[torch.Tensor, torch.Tensor]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        most = max(_DEGREE + 1, math.prod(quarter_shape(self.shape)))
        if self.values is not None and not _DEGREE + 1 <= self.values <= most:
            raise ValueError(f"values is {self.values}; choose {_DEGREE + 1} to {most}")

    @property
    def count(self) -> int:
        """Number of B-splines of the round phase pattern."""
        if self.values is not None:
            return self.values
        return max(_DEGREE + 1, math.ceil(0.5 * math.hypot(*self.shape)))

    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        key = (parameters.dtype, parameters.device)
        if key not in self._on_device:
            # SciPy stores as many weights for every pixel as splines overlap.
            splines = torch.from_numpy(self._spline_values.indices.astype(np.int64))
            weights = torch.from_numpy(self._spline_values.data).reshape(-1, _DEGREE + 1)
            self._on_device[key] = splines.to(key[1]), weights.to(key[1], key[0])
        splines, weights = self._on_device[key]
        near = parameters.index_select(0, splines).reshape(weights.shape)
        return (weights * near).sum(1).reshape(quarter_shape(self.shape))

    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        """Solve the normal equations, whose matrix has only as many diagonals as splines overlap.

        Pixels count as often as they are mirrored: 1, 2 or 4 times.
        """
        matrix = self._spline_values
        quarter = crop_quarter(_mean_of_images(phase)).reshape(-1).cpu().numpy()
        rows, columns = (np.full((n + 1) // 2, 2.0) for n in self.shape)
        rows[: self.shape[0] % 2] = columns[: self.shape[1] % 2] = 1.0
        weighted = matrix.T.multiply(np.multiply.outer(rows, columns).reshape(-1)).tocsr()
        normal = (weighted @ matrix).tocsr()
        bands = np.zeros((_DEGREE + 1, self.count))
        for above in range(_DEGREE + 1):
            bands[_DEGREE - above, above:] = normal.diagonal(above)
        bands[_DEGREE] += _DAMPING * bands[_DEGREE].max()
        solved = scipy.linalg.solveh_banded(bands, weighted @ quarter)
        return torch.from_numpy(solved).to(phase.device)

    @functools.cached_property
    def _spline_values(self) -> scipy.sparse.csr_array:
        """The values of the round phase's B-splines at a quarter's pixels, (pixels, splines)."""
        y, x = quarter_distances(self.shape, (1.0, 1.0))
        place = torch.hypot(y, x).reshape(-1).numpy() / (0.5 * math.hypot(*self.shape))
        inner = np.linspace(0, 1, self.count - _DEGREE + 1)
        knots = np.concatenate([np.zeros(_DEGREE), inner, np.ones(_DEGREE)])
        return BSpline.design_matrix(place, knots, _DEGREE).tocsr()


# Share of a part, in root mean square, that no other parts make up, for its weight to be sure.
_LEAST_SHARE = 1e-6


class SumOfParts(PhaseParametrisation):
    """Describe a phase pattern as a sum of given patterns, the parts, each times its weight.

    The parameters are the weights, in the order of the parts. If all parts equal their mirror
    images in both axes bit for bit, so does the pattern, and its symmetry is "quarter". Raises
    ValueError if there is no part, their shapes differ, values aren't finite, or a part is a sum of
    others, so that the weights aren't determined.

    parts: the patterns by name, (rows, columns), radians.
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
        triangle = torch.linalg.qr(self._whole.T, mode="r").R.diagonal().abs()
        sizes = self._whole.norm(dim=1).tolist()
        for name, size, left in zip(self.names, sizes, triangle.tolist(), strict=False):
            if not left > _LEAST_SHARE * size:
                raise ValueError(
                    f"part {name} is zero or a sum of the parts before it; leave it out"
                )
        if len(triangle) < self.count:
            raise ValueError(f"parts has {self.count} patterns of {len(triangle)} pixels")

    @property
    def count(self) -> int:
        """Number of parts of the phase pattern."""
        return len(self.names)

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
    """Compute analytic patterns whose weighted sums extend the depth of field, for `SumOfParts`.

    They are radians, (rows, columns), float64, each about the centre of the pixels but for the
    cubic mask: "lens", a lens of 1 dioptre; "quartic", a wave at the corners that goes as the
    fourth power of the radius; "focal-sweep" and "multi-focus", patterns of the whole range with
    their default settings; "cubic", a wave at half of the longer side. Raises ValueError if a
    number is out of range, or the range is too steep for the pixels.

    near, far: limits of the range of depth, dioptres; 0 is infinity.
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


PARAMETRISATIONS: Mapping[str, Callable[[tuple[int, int]], PhaseParametrisation]] = {
    "free": FreePhase,
    "quarter": QuarterPhase,
    "radial": RadialPhase,
    "separable": SeparablePhase,
    "separable-mirrored": lambda shape: SeparablePhase(shape, (True, True)),
}
"""The parametrisations that need no more than a panel's shape, by their names.

`SumOfParts` needs the parts.
"""


def make_parametrisation(name: str, shape: tuple[int, int]) -> PhaseParametrisation:
    """Return the parametrisation of a phase pattern by its name.

    Parameters
    ----------
    name : str
        One of PARAMETRISATIONS.
    shape : tuple of (int, int)
        (rows, columns) of the panel.

    Returns
    -------
    PhaseParametrisation
        The way to describe a pattern of that shape.

    Raises
    ------
    ValueError
        If there is no such name, or the shape isn't that of a panel.
    """
    if name not in PARAMETRISATIONS:
        raise ValueError(f"name is {name!r}; choose {', '.join(PARAMETRISATIONS)}")
    return PARAMETRISATIONS[name](shape)
