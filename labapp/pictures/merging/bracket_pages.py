"""Read the frames of a bracket: one in each file, or all as the pages of a TIFF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.guarded_reading import read_bytes
from labapp.files.picture.encoding import Encoding
from labapp.files.picture.opening import count_pages
from labapp.files.picture.photograph import Photograph, read_photograph

_TIFF = (".tif", ".tiff")


def read_frames(
    paths: Sequence[Path], encoding: Encoding | None
) -> tuple[list[Photograph], list[str]]:
    """Read photographs, and return them with their names.

    The pages of a single TIFF are frames, in their order. Raises UserError for files of which one
    has several pages.
    """
    counts = [_pages(path) for path in paths]
    if len(paths) == 1 and counts[0] > 1:
        (path,) = paths
        pages = range(counts[0])
        return (
            [read_photograph(path, encoding=encoding, page=page) for page in pages],
            [f"{path.name}, page {page + 1}" for page in pages],
        )
    several = [path for path, count in zip(paths, counts, strict=True) if count > 1]
    if several:
        raise UserError(
            f"{several[0]}: has {counts[list(paths).index(several[0])]} pages. Give a TIFF whose "
            "pages are the frames by itself, or files of one picture each."
        )
    return [read_photograph(path, encoding=encoding) for path in paths], [
        path.name for path in paths
    ]


def _pages(path: Path) -> int:
    """Return how many pages a file has; 1 unless it's a TIFF."""
    return count_pages(path, read_bytes(path)) if path.suffix.lower() in _TIFF else 1
