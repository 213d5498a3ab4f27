"""Use a picture as a target."""

from __future__ import annotations

import torch

from optics.plane import Plane
from optics.targets.target import Drawing, Target, format_micrometres
from optics.validation import accepts_numpy, as_floating_point, require_finite, require_positive


@Target
@accepts_numpy
def logo(picture: torch.Tensor, size: float, invert: bool = False) -> Drawing:
    """Draw a picture, centred on the axis.

    Each sample has the picture's mean over its area.

    Parameters
    ----------
    picture : torch.Tensor or numpy.ndarray, (rows, columns)
        Brightness, nowhere negative.
    size : float
        Length of the longer side, metres.
    invert : bool, default False
        Whether dark parts of the picture become the target's light, in place of bright ones.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.

    Raises
    ------
    ValueError
        If the picture has no light, is negative or not finite somewhere, or is smaller than a
        sample when it is put on a plane.
    """
    require_positive("size", size, "m")
    if picture.ndim != 2 or not picture.numel():
        raise ValueError(f"picture has shape {tuple(picture.shape)}; give rows and columns")
    light = as_floating_point(picture).to(torch.float64)
    require_finite("picture", light)
    if light.min() < 0:
        raise ValueError(f"picture is {float(light.min()):g} somewhere; light can't be negative")
    light = light.max() - light if invert else light
    if not light.any():
        raise ValueError("picture has no light; give a brighter one, or turn `invert` round")
    pixel = size / max(light.shape)
    half_y, half_x = (n * pixel / 2 for n in light.shape)

    def brightness(plane: Plane) -> torch.Tensor:
        if size < max(plane.pitch):
            raise ValueError(
                f"size {format_micrometres(size)} falls between samples of "
                f"{format_micrometres(max(plane.pitch))}; choose a larger one"
            )
        y, x = (_pixel_coverage(plane, axis, n, pixel) for axis, n in enumerate(light.shape))
        return y @ light @ x.T

    return Drawing(
        (-half_y, half_y, -half_x, half_x),
        0.0,
        brightness,
        f"a picture of {format_micrometres(size)}",
        "choose a smaller size",
    )


def _pixel_coverage(plane: Plane, axis: int, count: int, pixel: float) -> torch.Tensor:
    """Compute the share of each picture pixel on each sample along one axis, (samples, pixels)."""
    pitch = plane.pitch[axis]
    sample = plane.coordinates(axis)[:, None]
    start = (torch.arange(count, dtype=torch.float64) - count / 2) * pixel
    low = torch.maximum(sample - pitch / 2, start)
    high = torch.minimum(sample + pitch / 2, start + pixel)
    return (high - low).clamp(min=0) / pixel
