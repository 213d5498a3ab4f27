"""Opening of a record: what it holds, one of its frames, and if it can be restored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.files.plan_file import Reconstruction
from labapp.pictures.analysis.brackets import RecordedBracket, dark_target, find_brackets
from labapp.runs.record.reader import Record
from labapp.window.messages import RecordOpened

_BLACK, _WHITE = 0.5, 99.99
"""Percentiles of a frame that are shown as black and as white, as live view does."""


def open_record(path: Path) -> RecordOpened:
    """Read what is shown of a record; raise UserError if it can't be read."""
    with Record(path) as record:
        missing = set(record.frames_not_stored())
        stored = [index for index in range(record.frame_count) if index not in missing]
        found = [] if len(record.readouts) > 1 else find_brackets(record)
        shown = _frame_to_show(record, stored)
        return RecordOpened(
            path=path,
            summary=_summary(record, len(stored)),
            frame="" if shown is None else _frame_words(record, shown),
            picture=None if shown is None else _screen_picture(record.image(shown)),
            why_not_restored=_why_not_restored(record, found),
        )


def _frame_to_show(record: Record, stored: list[int]) -> int | None:
    """Return the record's last frame that isn't dark, or else its last one; None without any."""
    dark = dark_target(record.plan)
    names, targets = record.target_names, record.column("target")
    lit = [index for index in stored if names[int(targets[index])] != dark]
    return next(iter((lit or stored)[-1:]), None)


def _summary(record: Record, stored: int) -> str:
    """Describe a record: state, frames, targets, patterns, wavelengths."""
    wavelengths = sorted(set(record.column("wavelength_asked").tolist()))
    listed = ", ".join(f"{one * 1e9:g}" for one in wavelengths)
    return (
        f"{record.text('title')}: {record.state.value}, {stored} of {record.frame_count} frames; "
        f"targets {', '.join(record.target_names)}; patterns {', '.join(record.pattern_names)}; "
        f"{listed} nm."
    )


def _frame_words(record: Record, index: int) -> str:
    target = record.target_names[int(record.column("target")[index])]
    pattern = record.pattern_names[int(record.column("pattern")[index])]
    nm = float(record.column("wavelength")[index]) * 1e9
    ms = float(record.column("exposure_asked")[index]) * 1e3
    read = record.readout_of(index).describe()
    return f"frame {index}: {target}, {pattern}, {nm:.2f} nm, {ms:g} ms{read and ', '}{read}"


def _screen_picture(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a raw frame with the grey values of a screen, stretched."""
    black, white = np.percentile(image, [_BLACK, _WHITE])
    share = (image - black) / max(white - black, 1.0)
    return np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)


def _why_not_restored(record: Record, found: list[RecordedBracket]) -> str:
    """Return why F7 alone can't restore a record's photograph; "" if it can.

    A restoration needs a photograph, and a star with the same pattern and wavelength.
    """
    if (ways := len(record.readouts)) > 1:
        return f"its sensor is read in {ways} ways. Choose one: labapp reconstruct --readout NUMBER"
    plan = record.plan.reconstruct
    roles = plan or Reconstruction(coded="")
    photographs = [one for one in found if one.target != roles.star]
    if plan is not None:
        photographs = [one for one in photographs if one.target == plan.photograph]
        photographs = [one for one in photographs if one.pattern == plan.coded] or photographs
    if not photographs:
        return "it has no photograph, which could be restored"
    stars = {(one.pattern, one.wavelength) for one in found if one.target == roles.star}
    pairs = [one for one in photographs if (one.pattern, one.wavelength) in stars]
    if not pairs:
        return (
            f"it has no star {roles.star!r} with the pattern of a photograph, which would be its "
            "PSF. Give one: labapp reconstruct --psf FILE"
        )
    if len({one.wavelength for one in pairs}) > 1 and not roles.wavelength:
        return "it has several wavelengths: tick Bands to restore a spectral cube, then press F7"
    return ""
