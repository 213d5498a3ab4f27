"""Export frames as one OME-TIFF file, for microscopy programs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from labapp.runs.export.export_job import ExportJob
from labapp.runs.export.ome import ome_xml
from labapp.runs.export.single_files import tiff_tags

_TIFF_LIMIT = 2**32 - 2**25
"""Largest size in bytes of a TIFF file's pictures, with 32 MiB left for its directories of pages.
Larger exports are written as BigTIFF."""


def write_ome_tiff(work: ExportJob, draft: Path) -> None:
    """Write a run's exported frames as one OME-TIFF file."""
    import tifffile

    shape = (len(work.frames), *work.shape)
    description = ome_xml(work)
    is_big = 2 * math.prod(shape) + len(description) > _TIFF_LIMIT
    with tifffile.TiffWriter(draft / work.names[0], bigtiff=is_big, ome=False) as file:
        file.write(
            work.images(),
            shape=shape,
            dtype=np.uint16,
            photometric="minisblack",
            **tiff_tags(work, description),
        )
