"""What a calibration is asked for, as its plan carries it, and where its bands come from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from labapp.common.errors import UserError
from labapp.files.plain_data import parse_json
from labapp.files.plan_file import NamedPlan, read_plan
from labapp.files.quantities import Amount, Nanometres, Positive
from labapp.files.reading import FileModel, validate
from labapp.runs.record.reader import Record
from labapp.spectral.roles import FLAT

REQUEST_KEY = "spectra_request"
"""Key of a plan's metadata under which the request is stored as JSON."""

DEFAULT_PLAN = "coded-snapshot"
"""Bundled plan whose coded pattern is calibrated, and whose bands, if nothing else is asked for."""


class SpectraRequest(FileModel):
    """Hold what a user asks a spectral calibration to measure.

    bands_nm: centres of the bands, rising. star, flat, dark: names of the targets; dark may be "".
    neutral, coded: names of the patterns. exposure_ms: of the neutral star, unclipped, and
    flat_ms: of the white sheet; found by trial if None. star_diameter_um, star_distance_m: of the
    pinhole. window_px: side of the PSFs' windows.
    """

    bands_nm: Annotated[tuple[Nanometres, ...], Field(min_length=2)]
    star: str = "star"
    flat: str = FLAT
    dark: str = "dark"
    neutral: str = "neutral"
    coded: str
    exposure_ms: Positive | None = None
    flat_ms: Positive | None = None
    star_diameter_um: Amount = 0.0
    star_distance_m: Positive | None = None
    window_px: Annotated[int, Field(ge=15, le=4096)] = 128

    @property
    def wavelengths(self) -> tuple[float, ...]:
        """Return the bands in metres."""
        return tuple(one / 1e9 for one in self.bands_nm)


def read_snapshot_plan(name: str | None) -> NamedPlan:
    """Read the plan whose coded pattern is to be calibrated; the bundled one if None.

    Raises UserError if its table [reconstruct] doesn't name a coded pattern.
    """
    found = read_plan(Path(name or DEFAULT_PLAN))
    if found.plan.reconstruct is None:
        raise UserError(
            f"--plan {found.name}: has no table [reconstruct], which names the coded pattern. Add "
            'one, as in coded-snapshot: coded = "ring".'
        )
    for role in (found.plan.reconstruct.coded, found.plan.reconstruct.neutral):
        if role not in found.plan.patterns:
            raise UserError(
                f"--plan {found.name}: [reconstruct] names the pattern {role!r}, and the plan has "
                f"{', '.join(found.plan.patterns)}. Name one of these."
            )
    return found


def bands_of_plan(found: NamedPlan) -> tuple[float, ...]:
    """Return the wavelengths in nm at which a plan takes its coded pictures, rising.

    Raises UserError if there are fewer than two.
    """
    roles = found.plan.reconstruct
    assert roles is not None
    blocks = [one for one in found.plan.acquire if roles.coded in one.patterns]
    bands = {nm for one in blocks for nm in one.wavelengths_nm or ()}
    if len(bands) < 2:
        raise UserError(
            f"--plan {found.name}: takes {roles.coded!r} at {len(bands)} wavelengths. Name the "
            "bands: --wavelength-nm 450 --wavelength-nm 550, and so on."
        )
    return tuple(sorted(bands))


def request_of_record(record: Record) -> SpectraRequest:
    """Return the request that a record's plan carries.

    Raises UserError if the record is of another kind.
    """
    text = record.plan.metadata.get(REQUEST_KEY)
    if not isinstance(text, str):
        raise UserError(
            f"{record.path}: is no record of a spectral calibration. Give one that `labapp "
            "calibrate --spectra` made, or the run of a plan that it wrote."
        )
    source = f"{record.path}: {REQUEST_KEY}"
    return validate(parse_json(text, source), SpectraRequest, source)
