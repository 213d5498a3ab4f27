"""The kinds of files that there are, and what writes each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from labapp.runs.export.npy import write_npy
from labapp.runs.export.ome_tiff import write_ome_tiff
from labapp.runs.export.png import write_pngs
from labapp.runs.export.tiff import write_tiffs
from labapp.runs.export.work import Work

WRITERS: dict[str, Callable[[Work, Path], None]] = {
    "tiff": write_tiffs,
    "png": write_pngs,
    "ome-tiff": write_ome_tiff,
    "npy": write_npy,
}
"""By kind; each writes the work's files, but for the table, into a folder."""

KINDS = tuple(WRITERS)
