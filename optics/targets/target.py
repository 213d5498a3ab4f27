"""Define the base of all targets: a brightness on a plane, its bounding box, and its checks."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, ParamSpec, Protocol, TypeVar

import torch

from optics.plane import Plane

P = ParamSpec("P")


class Renderable(Protocol):
    """What draws a shape: its reach, and its intensity on a plane."""

    @property
    def reach(self) -> float:
        """The largest distance of light from the axis along y or x, in metres."""

    def render(self, plane: Plane) -> torch.Tensor:
        """Compute the intensity on a plane, with a sum of 1.

        Raises ValueError for a shape that doesn't fit on the plane or falls between its samples.
        """


@dataclass(frozen=True, eq=False)
class Drawing:
    """One shape with its sizes.

    bounding_box: lowest and highest y, lowest and highest x of its strokes' middles, metres.
    width: standard deviation across its strokes, metres; 0 without strokes.
    brightness: computes the shape on a plane, on any scale.
    sizes, remedy: words for the error message if the shape doesn't fit.
    """

    bounding_box: tuple[float, float, float, float]
    width: float
    brightness: Callable[[Plane], torch.Tensor]
    sizes: str
    remedy: str

    @property
    def reach(self) -> float:
        # At three widths from a stroke a hundredth of its peak is left.
        return max(map(abs, self.bounding_box)) + 3.0 * self.width

    def render(self, plane: Plane) -> torch.Tensor:
        self._require_fit(plane)
        intensity = self.brightness(plane)
        return intensity / intensity.sum()

    def _require_fit(self, plane: Plane) -> None:
        """Raise ValueError for a shape between the samples of a plane, or beyond its window."""
        coarsest = max(plane.pitch)
        if 0 < self.width < 0.5 * coarsest:
            raise ValueError(
                f"width {format_micrometres(self.width)} falls between samples of "
                f"{format_micrometres(coarsest)}; choose at least half a sample"
            )
        # At two widths from a stroke an eighth of its peak is left; no less must fit.
        margin = 2.0 * self.width
        for axis in (0, 1):
            place = plane.coordinates(axis)
            low, high = self.bounding_box[2 * axis : 2 * axis + 2]
            first, last = float(place[0]), float(place[-1])
            if low - margin < first or high + margin > last:
                room = max(0.0, min(-first, last))
                raise ValueError(
                    f"{self.sizes} doesn't fit in the window, which reaches "
                    f"{format_micrometres(room)}; {self.remedy}"
                )


@dataclass(frozen=True, eq=False)
class Drawings:
    """Several drawings, rendered as (n, rows, columns), each with sum 1."""

    parts: Sequence[Drawing]

    @property
    def reach(self) -> float:
        return max(part.reach for part in self.parts)

    def render(self, plane: Plane) -> torch.Tensor:
        return torch.stack([part.render(plane) for part in self.parts])


D = TypeVar("D", bound=Renderable)


class Target(Generic[P, D]):
    """Wrap a shape that a PSF should have as a function of a plane and the shape's sizes.

    Call it with a Plane and the sizes to get the intensity, or call `reach` with the sizes alone.

    Parameters
    ----------
    draw : callable
        Makes the drawing from the sizes, or raises ValueError.

    Examples
    --------
    >>> from optics.plane import Plane
    >>> from optics.targets import ring
    >>> light = ring(Plane((64, 64), (1e-6, 1e-6)), radius=10e-6, width=2e-6)
    >>> round(float(light.sum()), 6)
    1.0
    """

    def __init__(self, draw: Callable[P, D]) -> None:
        self.draw = draw
        functools.update_wrapper(self, draw)

    def __call__(self, plane: Plane, /, *args: P.args, **kwargs: P.kwargs) -> torch.Tensor:
        """Compute the intensity on a plane, float64, with a sum of 1.

        Parameters
        ----------
        plane : Plane
            Samples on the sensor.
        *args, **kwargs : object
            Sizes, as the shape's `draw` takes them.

        Returns
        -------
        torch.Tensor, (rows, columns), float64
            Intensity; (n, rows, columns) for shapes of several pictures, each with a sum of 1.

        Raises
        ------
        ValueError
            If the sizes aren't possible, or the shape doesn't fit on the plane or falls between its
            samples.
        """
        return self.draw(*args, **kwargs).render(plane)

    def reach(self, *args: P.args, **kwargs: P.kwargs) -> float:
        """Return the largest distance of light from the axis along y or x, in metres."""
        return self.draw(*args, **kwargs).reach


def format_micrometres(length: float) -> str:
    """Format a length, given in metres, as micrometres."""
    return f"{length * 1e6:.4g} µm"
