"""Features of a simulated GigE camera that change its pictures, and what they do to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray


class CameraFeature(NamedTuple):
    """Where a simulated camera keeps a feature.

    kind: its type in GenICam. scale: what the register holds for a value of 1. start: the value
    after power-up.
    """

    address: int
    kind: Literal["switch", "choice", "integer", "float"]
    scale: int = 1
    start: float = 0


FEATURES = {
    "ReverseX": CameraFeature(0x8000, "switch"),
    "ReverseY": CameraFeature(0x8004, "switch"),
    "GammaEnable": CameraFeature(0x8008, "switch"),
    "Gamma": CameraFeature(0x800C, "float", 100, 1.0),
    "LUTEnable": CameraFeature(0x8010, "switch"),
    "TestPattern": CameraFeature(0x8014, "choice"),
    "DecimationHorizontal": CameraFeature(0x8018, "integer", 1, 1),
    "DecimationVertical": CameraFeature(0x801C, "integer", 1, 1),
    "DigitalShift": CameraFeature(0x8020, "integer"),
    "BlackLevel": CameraFeature(0x8024, "float", 100),
    "BlackLevelClampingEnable": CameraFeature(0x8028, "switch"),
    "SharpeningEnable": CameraFeature(0x802C, "switch"),
    "TestPattern[ImageProcessor]": CameraFeature(0x8054, "choice"),
}
"""Those that the simulated camera has, by their names in GenICam's SFNC, with the entry of the
selector behind which they lie, if it isn't the first."""

SELECTORS = {"TestPattern": ("TestPatternGeneratorSelector", ("Sensor", "ImageProcessor"), 0x8060)}
"""Selectors of the simulated camera's features, their entries and their registers."""

_OTHERS = {
    "Gain": CameraFeature(0x110, "float", 10),
    "OffsetX": CameraFeature(0x130, "integer"),
    "OffsetY": CameraFeature(0x134, "integer"),
    "BinningHorizontal": CameraFeature(0x108, "integer"),
    "BinningVertical": CameraFeature(0x10C, "integer"),
    "GainAuto": CameraFeature(0x114, "choice"),
    "ExposureAuto": CameraFeature(0x3E0, "choice"),
}


def register_of(name: str, value: float) -> tuple[int, int]:
    """Return the address and the number that set a feature of a simulated camera."""
    feature = (FEATURES | _OTHERS)[name]
    return feature.address, round(value * feature.scale)


def apply_features(
    image: NDArray[np.uint16], registers: Sequence[int], full_scale: int
) -> NDArray[np.uint16]:
    """Return what a simulated camera makes of its sensor's picture with its features set so.

    registers: those of FEATURES first, in their order.
    """
    value = dict(zip(FEATURES, registers, strict=False))
    if all(value[name] == round(one.start * one.scale) for name, one in FEATURES.items()):
        return image
    numbers = image.astype(float)[
        :: max(1, value["DecimationVertical"]), :: max(1, value["DecimationHorizontal"])
    ]
    if value["SharpeningEnable"]:
        numbers[:, 1:-1] += numbers[:, 1:-1] - (numbers[:, 2:] + numbers[:, :-2]) / 2
    numbers = (numbers + value["BlackLevel"] / 100) * 2 ** value["DigitalShift"]
    share = np.clip(numbers / full_scale, 0, 1)
    if value["GammaEnable"]:
        share = share ** (value["Gamma"] / 100)
    if value["LUTEnable"]:
        share = np.sqrt(share)
    numbers = np.rint(share * full_scale)
    if value["TestPattern"] or value["TestPattern[ImageProcessor]"]:
        rows, columns = np.indices(numbers.shape)
        numbers = (rows + columns) % (full_scale + 1)
    across, down = (-1 if value[name] else 1 for name in ("ReverseX", "ReverseY"))
    return numbers[::down, ::across].astype(np.uint16)
