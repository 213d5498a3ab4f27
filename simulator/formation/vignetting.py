"""Vignetting: the share of a point's light that arrives, by the place of its image."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera, Lens
from optics.camera.pupil import share_through_stop
from optics.plane import Plane
from simulator.mount import Mount

_PLACES = 33
"""Places along an axis at which the light through the stop is computed. Chosen."""


def vignetting(camera: Camera, mount: Mount, plane: Plane, distance: float) -> torch.Tensor:
    """Return each place's light over that on the axis, float32.

    The result is (rows, columns) of the plane. camera: in the panel's axes. Vignetting is cos⁴ of
    the angle at which the lens appears from the sensor, or what the lens' curve of relative
    illumination has instead where distortion brings the light, times the panel's light that passes
    the stop, relative to that on the axis (share_through_stop()). The latter is interpolated
    linearly between 33 x 33 places, the outermost of which are on the plane's edges; a plane of
    fewer samples needs no others.
    """
    y, x = plane.mesh()
    share = _relative_illumination(camera.lens, y**2 + x**2)
    if camera.separation:
        share = share * _relative_stop_transmission(camera, mount, plane, distance)
    return share.to(torch.float32)


def _relative_illumination(lens: Lens, squared_height: torch.Tensor) -> torch.Tensor:
    """Return the vignetting of the lens itself: its curve of relative illumination, or else cos⁴.

    squared_height: of the places, m². The curve is linear in it between two pairs, which makes it
    smooth on the axis, and it is even beyond the last.
    """
    if not lens.relative_illumination:
        return (1 + squared_height / lens.image_distance**2) ** -2
    height, share = np.array(lens.relative_illumination).T
    squared = squared_height.numpy()
    by = lens.radial_distortion
    if by is not None:
        squared = by.distorted(np.sqrt(squared)) ** 2
    return torch.from_numpy(np.interp(squared, height**2, share))


def _relative_stop_transmission(
    camera: Camera, mount: Mount, plane: Plane, distance: float
) -> torch.Tensor:
    """Return the light through the stop by place, relative to that on the axis."""

    def share(y: float, x: float) -> float:
        return share_through_stop(
            camera, distance, mount.place_in_panel_axes((y, x), camera, distance)
        )

    axis = share(0.0, 0.0)
    if not axis:
        raise ValueError(
            "the stop hides the panel from the middle of the field; no light passes: move the "
            "panel nearer to the lens, or open the stop"
        )
    ends = [(float(one.min()), float(one.max())) for one in plane.mesh()]
    counts = (min(_PLACES, max(n, 2)) for n in plane.shape)
    grid = [np.linspace(*end, count) for end, count in zip(ends, counts, strict=True)]
    known = np.array([[share(float(y), float(x)) for x in grid[1]] for y in grid[0]])
    down = _interpolate(known / axis, plane.coordinates(0).numpy(), grid[0])
    return torch.from_numpy(_interpolate(down.T, plane.coordinates(1).numpy(), grid[1]).T)


def _interpolate(
    values: NDArray[np.float64], at: NDArray[np.float64], nodes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate values linearly along the first axis, between evenly spaced nodes."""
    step = nodes[1] - nodes[0]
    if not step:
        return np.repeat(values[:1], len(at), axis=0)
    place = np.clip((at - nodes[0]) / step, 0, len(nodes) - 1)
    low = np.minimum(place.astype(int), len(nodes) - 2)
    share = (place - low)[:, None]
    return values[low] * (1 - share) + values[low + 1] * share
