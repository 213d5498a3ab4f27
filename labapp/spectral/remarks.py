"""Remarks for the user on what a coded snapshot can show."""

from __future__ import annotations

from labapp.runs.record.reader import Record
from labapp.spectral.band_response import mosaic_of
from labapp.spectral.snapshot import CodedSnapshot

_MONO_NOTE = (
    "the sensor has no colour filters: bands are told apart by their PSFs alone, which is poor. A "
    "sensor with colour filters shows more"
)

_SHARE_NOTE = (
    "the share of the light that the coded pattern passes isn't known: bands may be some percent "
    "darker than they are. Neutral photographs at all bands show it"
)

_BROAD_NOTE = (
    "the snapshot is in broad light: the levels of its bands are those that the star has through "
    "the narrow filter, whose transmission they include"
)


def remarks_on(
    snapshot: CodedSnapshot, record: Record, *, knows_share: bool, is_calibrated: bool
) -> list[str]:
    """Say what limits the bands: no colour filters, no dark frames, unknown shares, broad light.

    `knows_share` says whether the coded pattern's share of the light is known, and `is_calibrated`
    whether PSFs and response are from a calibration, which has remarks of its own.
    """
    said = [] if mosaic_of(record) is not None else [_MONO_NOTE]
    pictures = snapshot.pictures
    if lacking := sum(one.dark_frames == 0 for one in pictures):
        said.append(
            f"{lacking} of {len(pictures)} photographs have no dark frames of their exposures: "
            'the sensor\'s black level is subtracted. Add { role = "dark", frames = 4 } to the '
            "plan"
        )
    if not knows_share:
        said.append(_SHARE_NOTE)
    return [*said, _BROAD_NOTE] if snapshot.is_broad and not is_calibrated else said
