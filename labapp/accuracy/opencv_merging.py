"""Merges brackets by OpenCV, to be measured beside our merges."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from optics import hdr

OPENCV_MERGES: Mapping[str, tuple[Callable[[], Any], Callable[[], Any]]] = MappingProxyType(
    {
        "Debevec": (cv2.createCalibrateDebevec, cv2.createMergeDebevec),
        "Robertson": (cv2.createCalibrateRobertson, cv2.createMergeRobertson),
    }
)
"""OpenCV's merges of exposure brackets, with what they calibrate the response curve by: Debevec and
Malik, SIGGRAPH 1997, doi 10.1145/258734.258884; Robertson, Borman, Stevenson, ICIP 1999, doi
10.1109/ICIP.1999.817091."""


def merge_by_opencv(bracket: hdr.Bracket, name: str) -> NDArray[np.float64]:
    """Return an exposure bracket's light by OpenCV, in its own unit.

    It takes pictures of three colours and eight bits, which are the upper ones of the frames.
    """
    shift = max(bracket.sensor.bits - 8, 0)
    frames = [
        cv2.merge([(np.asarray(one).astype(np.uint16) >> shift).astype(np.uint8)] * 3)
        for one in bracket.frames
    ]
    calibrate, merge = OPENCV_MERGES[name]
    times = bracket.times.astype(np.float32)
    response = calibrate().process(frames, times)
    light = merge().process(frames, times, response)
    return np.asarray(light[..., 0], dtype=np.float64)
