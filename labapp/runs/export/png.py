"""A PNG file a frame."""

from __future__ import annotations

from pathlib import Path

from labapp.common.errors import UserError
from labapp.runs.export.work import Work


def write_pngs(work: Work, draft: Path) -> None:
    import cv2

    for name, image in zip(work.names, work.images(), strict=False):
        done, data = cv2.imencode(".png", image)
        if not done:
            raise UserError(f"{name}: could not be encoded.")
        (draft / name).write_bytes(data.tobytes())
