"""A PNG file a frame."""

from __future__ import annotations

from pathlib import Path

from labapp.files.writing import encoded
from labapp.runs.export.work import Work


def write_pngs(work: Work, draft: Path) -> None:
    for name, image in zip(work.names, work.images(), strict=False):
        (draft / name).write_bytes(encoded(Path(name), image))
