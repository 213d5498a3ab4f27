"""One OME-TIFF file of all frames, for microscopy programs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from labapp.runs.export.export_job import ExportJob
from labapp.runs.export.ome import ome_xml
from labapp.runs.export.single_files import tiff_tags

_TIFF_LIMIT = 2**32 - 2**25
"""Bytes that a TIFF file can have, with room for its tables of contents; more is BigTIFF."""


def write_ome_tiff(work: ExportJob, draft: Path) -> None:
    import tifffile

    shape = (len(work.frames), *work.shape)
    description = ome_xml(work)
    is_big = 2 * math.prod(shape) + len(description) > _TIFF_LIMIT
    with tifffile.TiffWriter(draft / work.names[0], bigtiff=is_big, ome=False) as file:
        file.write(work.images(), shape=shape, dtype=np.uint16, **tiff_tags(work, description))
