"""Compute patterns whose parts focus at different depths: rings, a focal sweep, and a lattice.

Depths are vergences in dioptres (1/m): 1 over the distance from the panel in metres, and 0 for
infinity. With an object at the vergence D and the camera's lens focused at F, a part of the panel
whose phase is -pi / wavelength (V - F) r² is in focus for D = V: it cancels what is left of the
object's wave after the lens. All parts share one centre, so that they image a point on the axis to
the same place; a part about a centre of its own, c, would shift its image by the focal length times
(V - F) c.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import torch

from optics.camera import Panel
from optics.patterns.foci import (
    require_depth_range,
    require_lengths,
    require_slope_within,
    require_vergences,
    visible_area,
    visible_share,
)
from optics.quarter_symmetry import mirror_quarter, quarter_distances

__all__ = ["even_vergences", "lattice_focal_lens", "multi_focus_rings"]

# The step of an interleaved order, as a share of the number of foci.
#
# The golden ratio puts every next focus into the largest gap between the foci before it. Measured
# for ten foci: of the steps 1, 3, 7 and 9, the nearest to it, 7, has the least expected error of
# a blind filter with the spectrum of BSDS' photographs.
_GOLDEN = (math.sqrt(5) - 1) / 2

# Circles whose visible areas are computed to find the rings' edges, from the centre outwards.
_RADII = 100_001


def even_vergences(near: float, far: float, count: int) -> tuple[float, ...]:
    """Compute the middles of equal parts of a range of depth in dioptres, from near to far.

    Parameters
    ----------
    near, far : float
        The range's limits in dioptres, for instance 2 and 0 from half a metre to infinity.
    count : int
        Number of parts, 1 or more.

    Returns
    -------
    tuple of float
        `count` vergences in dioptres.

    Raises
    ------
    ValueError
        If the range is no range, or the count is less than 1.
    """
    require_depth_range(near, far)
    if count < 1:
        raise ValueError(f"count is {count}; choose 1 or more")
    return tuple(near - (near - far) * (part + 0.5) / count for part in range(count))


def multi_focus_rings(
    panel: Panel,
    vergences: Sequence[float],
    wavelength: float,
    rings: int = 40,
    focus: float = 0.0,
    radius: float | None = None,
    order: Literal["cyclic", "interleaved", "random"] = "interleaved",
    generator: torch.Generator | None = None,
) -> torch.Tensor:
    """Compute rings that are Fresnel lenses, each with one of several foci.

    The rings have equal areas on the panel: beyond half of the panel's shorter side, where its
    edges cut them, they are wider. The foci take turns over the rings, so that each has about the
    same light, from rings near the centre as well as near the edges.

    Between rings the phase jumps, by half a wave at most: whole waves, which change nothing at the
    wavelength, are taken out of the jumps. The pattern equals its mirror images in both axes bit
    for bit, for its centre is that of the pixels: for even numbers of them, half a pixel before the
    origin of the panel's plane.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    vergences : sequence of float
        The depths in focus, dioptres; 0 is infinity. See `even_vergences`.
    wavelength : float
        Metres.
    rings : int, default 40
        Number of rings, as many as there are foci or more. A multiple of them shares the light
        evenly.
    focus : float, default 0.0
        Vergence of the plane in focus of the camera's lens, dioptres.
    radius : float, optional
        Outer edge of the last ring, metres; by default the panel's corners. Beyond it the last
        ring goes on.
    order : {"cyclic", "interleaved", "random"}, default "interleaved"
        How the foci take turns from the centre outwards: in the given order; with a step of about
        0.62 of their number, so that neighbouring rings differ much; or in a new random order every
        time.
    generator : torch.Generator, optional
        Source of the random orders; needed for "random" alone.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If a number is out of range, there are more rings than pixels can show, or a lens is too
        steep; the message names the limit.

    Notes
    -----
    Measured for the thesis' camera, 2 dioptres to infinity, as the expected error of one Wiener
    filter for 30 depths, with noise of 0.008 and the spectrum of Kodak's photographs, in dB: ten
    even foci in 40 rings 20.6, in cyclic order 20.4; the thesis' ten distances 20.3, in cyclic
    order 19.6. Rings of equal area of the whole circle come to the same within 0.1 dB.
    """
    foci = require_vergences(vergences)
    radius = require_lengths(panel, wavelength, focus, radius)
    if not len(foci) <= rings:
        raise ValueError(f"rings is {rings}; choose {len(foci)} or more, one for every vergence")
    most = _most_rings(panel, radius)
    if rings > most:
        raise ValueError(
            f"rings is {rings}; choose at most {most}, so that a ring is a pixel wide at least"
        )
    turns = _ring_order(len(foci), rings, order, generator)
    by_ring = torch.tensor([foci[turn] for turn in turns], dtype=torch.float64)
    y, x = quarter_distances(panel.shape, (panel.pitch, panel.pitch))
    squared = y**2 + x**2
    ring = torch.clamp((visible_share(panel, squared, radius) * rings).long(), max=rings - 1)
    vergence = by_ring[ring]
    phase = -math.pi / wavelength * (vergence - focus) * squared
    require_slope_within(phase, ring, "vergences has one that", panel, wavelength, focus)
    waves = _waves_at_edges(panel, radius, by_ring, wavelength)
    return mirror_quarter(phase - 2 * math.pi * waves[ring], panel.shape)


def lattice_focal_lens(
    panel: Panel,
    near: float,
    far: float,
    wavelength: float,
    columns: int = 4,
    rows: int = 2,
    focus: float = 0.0,
) -> torch.Tensor:
    """Compute a lattice-focal lens, rectangles that are Fresnel lenses of different foci.

    The foci are the middles of as many equal parts of the range, in dioptres, as there are
    rectangles. They follow each other along the rows, from near at the first pixel to far at the
    last. (Two other orders, taken at random, were within 0.15 dB for the thesis' panel.) All lenses
    share the axis as their centre; the phase jumps between them. The pattern keeps contrast at all
    depths for a filter that knows the depth; its PSFs change with the depth.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    near, far : float
        Limits of the range in focus, dioptres; 0 is infinity. near is more than far.
    wavelength : float
        Metres.
    columns, rows : int, default 4 and 2
        Numbers of rectangles along x and y. Where they don't divide the panel's, some rectangles
        are a pixel wider.
    focus : float, default 0.0
        Vergence of the plane in focus of the camera's lens, dioptres.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If a number is out of range, or a lens is too steep; the message names the limit.

    References
    ----------
    Levin, Hasinoff, Green, Durand and Freeman 2009, doi 10.1145/1531326.1531403.
    """
    require_depth_range(near, far)
    require_lengths(panel, wavelength, focus, None)
    grid = {"rows": rows, "columns": columns}
    for (name, count), pixels in zip(grid.items(), panel.shape, strict=True):
        if not 1 <= count <= pixels:
            raise ValueError(f"{name} is {count}; choose 1 to {pixels}, as the panel has pixels")
    row, column = (
        torch.arange(pixels) * count // pixels
        for count, pixels in zip(grid.values(), panel.shape, strict=True)
    )
    part = row[:, None] * columns + column[None, :]
    vergence = torch.tensor(even_vergences(near, far, rows * columns), dtype=torch.float64)[part]
    y, x = panel.plane.mesh()
    phase = -math.pi / wavelength * (vergence - focus) * (y**2 + x**2)
    require_slope_within(phase, part, f"near {near:g} or far {far:g}", panel, wavelength, focus)
    return phase


def _most_rings(panel: Panel, radius: float) -> int:
    """Compute how many rings of equal visible area a panel can show, each a pixel wide or more.

    The narrowest ring is where the circle is longest on the panel, before its edges cut it.
    """
    last = torch.tensor(radius**2, dtype=torch.float64)
    longest = 2 * math.pi * min(radius, min(panel.shape) * panel.pitch / 2)
    return max(1, math.floor(float(visible_area(panel, last)) / (longest * panel.pitch)))


def _waves_at_edges(
    panel: Panel, radius: float, vergences: torch.Tensor, wavelength: float
) -> torch.Tensor:
    """Compute the whole waves that each ring of lenses is ahead of the first by its jumps.

    vergences: of the rings, dioptres. A jump is that of lenses whose phase is 0 on the axis.
    """
    squared = torch.linspace(0, radius**2, _RADII, dtype=torch.float64)
    share = visible_share(panel, squared, radius)
    inner = torch.arange(1, len(vergences)) / len(vergences)
    edges = torch.from_numpy(np.interp(inner.numpy(), share.numpy(), squared.numpy()))
    jumps = -torch.diff(vergences) * edges / (2 * wavelength)
    return torch.cat([torch.zeros(1, dtype=torch.float64), torch.round(jumps).cumsum(0)])


def _ring_order(foci: int, rings: int, order: str, generator: torch.Generator | None) -> list[int]:
    """Return the number of every ring's focus, from the centre outwards."""
    cycles = -(-rings // foci)
    if order == "cyclic":
        turns = list(range(foci)) * cycles
    elif order == "interleaved":
        steps = [step for step in range(1, foci + 1) if math.gcd(step, foci) == 1]
        step = min(steps, key=lambda one: abs(one - _GOLDEN * foci))
        turns = [step * turn % foci for turn in range(foci)] * cycles
    elif order == "random":
        if generator is None:
            raise ValueError("generator is None; give one for the order 'random'")
        shuffled = (torch.randperm(foci, generator=generator).tolist() for _ in range(cycles))
        turns = [one for cycle in shuffled for one in cycle]
    else:
        raise ValueError(f"order is {order!r}; choose 'cyclic', 'interleaved' or 'random'")
    return turns[:rings]
