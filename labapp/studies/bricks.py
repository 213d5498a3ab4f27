"""Bricks at several distances, and the sharpness of their edges before and after refocusing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from labapp.files.scene_targets import LayersTable
from labapp.pictures.analysis.brackets import Picture
from labapp.runs.record.reader import Record
from labapp.studies.contract import ResultRow
from optics.camera import Camera

BRICKS_TARGET = "bricks"
"""Name of the target with the bricks."""

BrickRegion = tuple[float, slice, slice]
"""A brick's distance in metres, and the rows and columns of the sensor that see it."""


def brick_regions(record: Record, camera: Camera) -> list[BrickRegion]:
    """Return where the sensor sees the bricks of the simulated scene, the nearest first.

    The list is empty for a real scene, whose layout isn't known.
    """
    table = record.scene.targets.get(BRICKS_TARGET) if record.scene else None
    if not isinstance(table, LayersTable):
        return []
    found = []
    for layer in table.layers:
        if layer.picture.kind != "brick":
            continue
        scale = camera.magnification(layer.distance_m) / camera.sensor.pitch * 1e-3
        sides = []
        for offset, size, pixels in zip(
            layer.picture.offset_mm, layer.picture.size_mm, camera.sensor.shape, strict=True
        ):
            middle, half = pixels / 2 + offset * scale, (size / 2 + 3) * scale
            sides.append(slice(max(0, round(middle - half)), min(pixels, round(middle + half))))
        found.append((layer.distance_m, sides[0], sides[1]))
    return found


def sharpness_rows(
    scenes: Sequence[Picture], regions: Sequence[BrickRegion], near: float
) -> list[ResultRow]:
    """Compare the sharpness of bricks without and with the lens on the SLM.

    scenes: the pictures without and with the lens.
    near: distance that the lens brings into focus, metres.
    """
    rows = []
    for distance, y, x in regions:
        plain, coded = (edge_steepness(scene[y, x]) for scene in scenes)
        ratio = coded / plain
        wanted = "more than 1" if abs(distance - near) < 0.05 else "-"
        if distance == max(one[0] for one in regions):
            wanted = "less than 1"
        rows.append(
            ResultRow(
                f"steepest edges of the brick at {distance:g} m, with the lens over without",
                "picture only",
                wanted,
                f"{ratio:.2f}",
                ratio,
            )
        )
    return rows


def edge_steepness(picture: Picture) -> float:
    """Return the steepness of a picture's steepest edges, relative to its range.

    This is the 99th percentile of the gradient over the range of the picture's values. The gradient
    is taken over two pixels, which reduces the influence of noise.
    """
    y = picture[2:, 1:-1] - picture[:-2, 1:-1]
    x = picture[1:-1, 2:] - picture[1:-1, :-2]
    low, high = np.percentile(picture, [1, 99])
    return float(np.percentile(np.hypot(y, x), 99) / (high - low))
