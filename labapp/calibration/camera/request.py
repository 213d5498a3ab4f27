"""What a camera is to be measured for, as its plan carries it."""

from __future__ import annotations

import json
from typing import Annotated

from pydantic import Field

from labapp.common.errors import UserError
from labapp.files.quantities import Amount, Nanometres, Positive
from labapp.files.reading import FileModel, validate
from labapp.runs.record.reader import Record
from optics.measuring.paired_frames import MIN_EXPOSURES

REQUEST_KEY = "camera_request"
"""Key of a plan's metadata under which the request is stored as JSON."""

DEFAULT_EXPOSURES = 50
"""Exposure times of the light: as many as EMVA 1288 asks for."""

DEFAULT_DARK_S = 2.0
"""Longest dark exposure in seconds. Chosen: a dark current of an electron per second then shows to
a percent on a megapixel."""

NEUTRAL_NAME = "neutral"
"""Name of the pattern through which frames are taken."""


class CameraRequest(FileModel):
    """Hold what a user asks a camera's calibration to measure.

    flat, dark: names of the targets. wavelength_nm: of the filter. exposures: number of exposure
    times of the light. flat_ms: the longest, at which all pixels are full; found by trial if None.
    dark_s: longest exposure of darkness, for the dark current. trials: trial frames that were
    taken.
    """

    flat: str = "flat"
    dark: str = "dark"
    wavelength_nm: Nanometres = 532.0
    exposures: Annotated[int, Field(ge=MIN_EXPOSURES, le=1000)] = DEFAULT_EXPOSURES
    flat_ms: Positive | None = None
    dark_s: Amount = DEFAULT_DARK_S
    trials: Annotated[int, Field(ge=0)] = 0


def camera_request_of(record: Record) -> CameraRequest | None:
    """Return the request that a record's plan carries; None for another plan's record."""
    text = record.plan.metadata.get(REQUEST_KEY)
    if not isinstance(text, str):
        return None
    try:
        data = json.loads(text)
    except ValueError as error:
        raise UserError(
            f"{record.path}: its request is damaged: {error}. Run its plan again."
        ) from error
    return validate(data, CameraRequest, f"{record.path}: {REQUEST_KEY}")
