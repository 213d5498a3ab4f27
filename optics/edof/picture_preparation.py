"""Bring a photograph to the size and the light in which the evaluation protocol simulates it."""

from __future__ import annotations

from typing import Literal

import torch

from optics.validation import accepts_numpy, require_count, require_finite

LightScale = Literal["linear", "srgb"]
"""Whether a picture's values are proportional to light, or encoded by the curve of sRGB."""

_LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue in the luminance of linear sRGB (IEC 61966-2-1)."""


@accepts_numpy
def decode_srgb(picture: torch.Tensor) -> torch.Tensor:
    """Convert a picture of sRGB values to linear light (IEC 61966-2-1).

    Parameters
    ----------
    picture : torch.Tensor or numpy.ndarray
        Values from 0 to 1.

    Returns
    -------
    torch.Tensor or numpy.ndarray
        Light, 0 to 1.
    """
    power = ((picture.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4
    return torch.where(picture <= 0.04045, picture / 12.92, power)


@accepts_numpy
def encode_srgb(picture: torch.Tensor) -> torch.Tensor:
    """Convert a picture of linear light to sRGB values, 0 to 1 (IEC 61966-2-1).

    Parameters
    ----------
    picture : torch.Tensor or numpy.ndarray
        Light. Below 0 or above 1 it is clipped, as a display does it.

    Returns
    -------
    torch.Tensor or numpy.ndarray
        Values from 0 to 1.
    """
    light = picture.clamp(0, 1)
    power = 1.055 * light.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(light <= 0.0031308, 12.92 * light, power)


@accepts_numpy
def prepare_scene(
    picture: torch.Tensor, side: int, light: LightScale = "srgb", shortest_edge: int | None = None
) -> torch.Tensor:
    """Turn a photograph into a square grey scene: resize, crop the middle, decode, make grey.

    Parameters
    ----------
    picture : torch.Tensor or numpy.ndarray, (rows, columns) or (rows, columns, 3)
        Values encoded by the curve of sRGB: float from 0 to 1, or uint8 from 0 to 255. Colours are
        red, green, blue.
    side : int
        Side of the scene in pixels.
    light : {"srgb", "linear"}, default "srgb"
        "linear" decodes the values to light. "srgb" takes the encoded values as if they were light.
    shortest_edge : int, optional
        Pixels of the photograph's shortest edge after it is resized (bicubic, with antialiasing).
        It isn't resized by default.

    Returns
    -------
    torch.Tensor or numpy.ndarray, (side, side), float32
        The scene, 0 to 1.

    Raises
    ------
    ValueError
        If the picture has another shape, is too small for the scene, or holds values outside 0 to
        1, or if an argument is out of range.
    """
    require_count("side", side)
    if light not in ("linear", "srgb"):
        raise ValueError(f"light is {light!r}; choose linear or srgb")
    values = _encoded_channels(picture)
    if shortest_edge is not None:
        require_count("shortest_edge", shortest_edge)
        values = _resize(values, shortest_edge)
    rows, columns = values.shape[-2:]
    if min(rows, columns) < side:
        raise ValueError(
            f"picture is {columns} x {rows} pixels; the scene needs {side} x {side}: give a larger "
            "picture, or a protocol with a smaller crop, or with a periodic border"
        )
    top, left = rows // 2 - side // 2, columns // 2 - side // 2
    values = values[:, top : top + side, left : left + side]
    return convert_to_luminance(decode_srgb(values) if light == "linear" else values)


def _encoded_channels(picture: torch.Tensor) -> torch.Tensor:
    """Return a photograph's sRGB values as float32, (1 or 3, rows, columns), after checking it."""
    if picture.ndim not in (2, 3) or (picture.ndim == 3 and picture.shape[2] != 3):
        raise ValueError(
            f"picture is {tuple(picture.shape)}; give (rows, columns) or (rows, columns, 3)"
        )
    values = picture[None] if picture.ndim == 2 else picture.movedim(2, 0)
    values = values / 255.0 if values.dtype == torch.uint8 else values.to(torch.float32)
    require_finite("picture", values)
    if not (values.min() >= 0 and values.max() <= 1):
        raise ValueError(
            f"picture goes from {float(values.min()):g} to {float(values.max()):g}; give sRGB "
            "values from 0 to 1, or uint8"
        )
    return values


def _resize(values: torch.Tensor, shortest_edge: int) -> torch.Tensor:
    """Resize a photograph's channels so that its shortest edge has a number of pixels."""
    rows, columns = values.shape[-2:]
    scale = shortest_edge / min(rows, columns)
    size = (round(rows * scale), round(columns * scale))
    resized = torch.nn.functional.interpolate(
        values[None], size=size, mode="bicubic", antialias=True, align_corners=False
    )[0]
    # Bicubic interpolation overshoots at edges.
    return resized.clamp(0, 1)


def convert_to_luminance(channels: torch.Tensor) -> torch.Tensor:
    """Convert red, green and blue of a picture, (3, rows, columns), to their luminance.

    One channel, (1, rows, columns), is taken as it is.
    """
    if channels.shape[0] == 1:
        return channels[0].contiguous()
    weights = torch.tensor(_LUMINANCE, dtype=channels.dtype)
    # A matrix product would run in half precision under autocast.
    return (weights[:, None, None] * channels).sum(0)
