"""The coded snapshot of a record: its bands, and one photograph of all, or the sum of narrow ones.

Light of different wavelengths adds. Where a filter is always in the beam, the sum of the
photographs that were taken through it, one band after the other, is what one photograph of all
bands would show, but for its noise: each of them has read noise of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.plan_file import Reconstruction
from labapp.files.wavelengths import list_nanometres
from labapp.pictures.analysis.brackets import WAVELENGTH_TOLERANCE, Bracket, find_bracket
from labapp.pictures.analysis.colour_filters import passband_at
from labapp.runs.record.reader import Record

Picture = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CodedSnapshot:
    """A photograph of several bands at once through the coded pattern.

    rate: (rows, columns), electrons per second and pixel.
    clipped: (rows, columns), pixels that were clipped in every exposure of a band: there the light
        is at least `rate`.
    noise: the pixels' rms noise from photons and readout alone, electrons per second; 0 if all
        pixels are clipped.
    pictures: the photographs that were added, one for each band; a single one in broad light.
    source: what was photographed, and how, in words.
    """

    rate: Picture
    clipped: NDArray[np.bool_]
    noise: float
    pictures: tuple[Bracket, ...]
    source: str


@dataclass(frozen=True)
class SnapshotBands:
    """The bands of a coded snapshot, and the photographs that it consists of.

    wavelengths: bands in metres, rising.
    photographed: wavelengths of the photographs in metres: those of the bands, or one in broad
        light.
    is_broad: whether it is one photograph in broad light.
    """

    wavelengths: tuple[float, ...]
    photographed: tuple[float, ...]
    is_broad: bool


def recorded_wavelengths(record: Record, target: str, pattern: str) -> tuple[float, ...]:
    """Return the wavelengths in metres at which a target was recorded with a pattern, rising."""
    frames = record.select(target=target, pattern=pattern)
    return tuple(np.unique(record.column("wavelength")[frames]).tolist())


def choose_bands(
    record: Record, roles: Reconstruction, wanted: Sequence[float] | None, known: Sequence[float]
) -> SnapshotBands:
    """Choose the bands and the photographs of a record; no picture is read for that.

    If the photograph was taken at a single wavelength, through a filter that passes all bands, it
    is the snapshot. Otherwise it is the sum of the photographs of the wanted bands. Raises
    UserError if there is no such photograph, or a band is missing.

    wanted: bands in metres, rising; None for all.
    known: bands in metres whose PSFs are known, for a photograph in broad light.
    """
    target, pattern = roles.photograph, roles.coded
    _require_single_slots(record, target, pattern)
    recorded = recorded_wavelengths(record, target, pattern)
    if not recorded:
        raise UserError(
            f"{record.path}: has no frames of {target!r} with pattern {pattern!r}. Its targets are "
            f"{', '.join(record.target_names)}, and its patterns "
            f"{', '.join(record.pattern_names)}: name one by --target or --pattern."
        )
    if len(recorded) == 1:
        bands = _broad_bands(record, recorded[0], wanted, known)
        return SnapshotBands(bands, recorded, is_broad=True)
    what = f"{target!r} with pattern {pattern!r}"
    bands = recorded if wanted is None else require_recorded_bands(wanted, recorded, what, record)
    return SnapshotBands(bands, bands, is_broad=False)


def require_recorded_bands(
    wanted: Sequence[float], recorded: Sequence[float], what: str, record: Record
) -> tuple[float, ...]:
    """Return the recorded wavelengths of wanted bands; raise UserError if one is missing.

    Both are in metres. `what` says in words what was recorded, and the error names the range of the
    record's filter.
    """
    found = []
    for one in wanted:
        at = [own for own in recorded if abs(own - one) < WAVELENGTH_TOLERANCE]
        if not at:
            has = list_nanometres(recorded) if recorded else "no wavelength"
            raise UserError(
                f"--bands {one * 1e9:g}: {record.path} has {what} at {has}"
                f"{_filter_range(record, one)}. Choose among these, or run a plan with that band."
            )
        found.append(at[0])
    return tuple(found)


def add_photographs(
    brackets: list[Bracket], roles: Reconstruction, bands: SnapshotBands, path: Path
) -> CodedSnapshot:
    """Add the coded photographs of all bands among the merged pictures of the record at `path`."""
    parts = [
        find_bracket(brackets, roles.photograph, roles.coded, one, path)
        for one in bands.photographed
    ]
    clipped = np.any([~np.isfinite(one.variance) for one in parts], axis=0)
    known = np.sum([one.variance for one in parts], axis=0)[~clipped]
    how = f"the sum of {len(parts)} photographs in narrow light"
    if bands.is_broad:
        how = "one photograph in broad light"
    return CodedSnapshot(
        np.sum([one.rate for one in parts], axis=0),
        clipped,
        float(np.sqrt(known.mean())) if known.size else 0.0,
        tuple(parts),
        f"{parts[0].target}, {parts[0].pattern}, {how}",
    )


def _require_single_slots(record: Record, target: str, pattern: str) -> None:
    """Raise UserError if frames of one wavelength came through different filter slots.

    Two slots with the same centre, one open and one narrow, would be merged into one picture.
    """
    frames = record.select(target=target, pattern=pattern)
    wavelengths, slots = (record.column(name)[frames] for name in ("wavelength", "slot"))
    for one in np.unique(wavelengths):
        through = np.unique(slots[wavelengths == one]).tolist()
        if len(through) > 1:
            raise UserError(
                f"{record.path}: has {target!r} at {one * 1e9:g} nm through the slots "
                f"{' and '.join(map(str, through))}. In the bench file, give the open slot a "
                "centre of its own."
            )


def _broad_bands(
    record: Record, photographed: float, wanted: Sequence[float] | None, known: Sequence[float]
) -> tuple[float, ...]:
    """Return the bands in metres of a photograph in broad light.

    Raises UserError if its light lacks one, or has fewer than two with known PSFs.
    """
    span = passband_at(record, photographed)
    # Without a description of the filter, it is taken to be out of the beam.
    passed = "all light" if span is None else list_nanometres(span).replace(", ", " to ")
    inside = [one for one in known if span is None or span[0] <= one <= span[1]]
    if wanted is None and len(inside) < 2:
        raise UserError(
            f"{record.path}: the photograph is in light of one filter, which passes {passed}, and "
            f"there are PSFs at {list_nanometres(known) if known else 'no wavelength'}. A snapshot "
            "needs two bands or more: photograph it at each wavelength, or through an open slot."
        )
    bands = tuple(inside) if wanted is None else tuple(wanted)
    outside = [one for one in bands if span is not None and not span[0] <= one <= span[1]]
    if outside:
        raise UserError(
            f"--bands {outside[0] * 1e9:g}: {record.path} has the photograph at "
            f"{photographed * 1e9:g} nm alone, through a filter that passes {passed}. Photograph "
            "it at that band as well, or through an open slot."
        )
    return bands


def _filter_range(record: Record, wavelength: float) -> str:
    """Say what the filter can be tuned to, if a wavelength (metres) lies outside; else nothing."""
    table = record.bench.devices.tables.get("filter")
    span = None if table is None else dict(table.options).get("range_nm")
    if span is None or span[0] <= wavelength * 1e9 <= span[1]:
        return ""
    return f"; the filter can be tuned from {span[0]:g} to {span[1]:g} nm only"
