"""Reconstructing a record, as a report to the window."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.pictures.analysis import analyse
from labapp.window.messages import Reconstructed
from optics.progress import Progress


def reconstruct(path: Path, progress: Progress) -> Reconstructed:
    """Pictures, measured PSF and scores of a complete record; UserError if it has none."""
    result = analyse(path, progress)
    if result.psf_measured is None:
        raise UserError(
            f"{path}: its plan has no [reconstruct] table, so nothing says what to undo. "
            "Choose a run that this window or `labapp demo` took."
        )
    return Reconstructed(
        path=path,
        images={name: np.asarray(i, dtype=np.float32) for name, i in result.images.items()},
        psf=np.asarray(result.psf_measured, dtype=np.float32),
        scores={name: (float(s.psnr), float(s.ssim)) for name, s in result.scores.items()},
    )
