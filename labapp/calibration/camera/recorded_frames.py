"""Pairs of flat and dark frames, read from a record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.calibration.camera.plan_design import CameraRequest, camera_request_of
from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.files.plan_file import ROLES
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from optics.measuring import PairedFrames

_PLAN_HINT = "Run the ready plan photon-transfer, or labapp calibrate --camera"


@dataclass(frozen=True)
class RecordedFrame:
    """A frame of a record, of which parts are read when they are asked for."""

    record: Record
    index: int
    shape: tuple[int, int]

    def __getitem__(self, part: tuple[slice, slice]) -> NDArray[np.uint16]:
        return self.record.image(self.index, *part)


@dataclass(frozen=True, eq=False)
class RecordedPairs:
    """Pairs of frames, what was asked for, and the light's wavelength in metres."""

    frames: PairedFrames
    request: CameraRequest
    wavelength: float


def read_pairs(record: Record, flat: str | None = None) -> RecordedPairs:
    """Read the pairs of flat and dark frames of a record.

    flat: name of the flat target; None for the only one that isn't dark, or that of the record's
    own request. Raises UserError if frames of several targets, patterns or wavelengths could be
    meant, and if pairs are missing.
    """
    if record.state is not State.COMPLETE:
        raise UserError(
            f"{record.path}: the run is {record.state}, and a calibration needs all of its frames. "
            f"Take them with: labapp resume {shell_word(record.path)}"
        )
    own = camera_request_of(record)
    request = own or CameraRequest()
    targets = np.array(record.target_names)[record.column("target")]
    dark = (record.column("role") == ROLES.index("dark")) | (targets == request.dark)
    flat = _flat_target(record, targets[~dark], own.flat if own and flat is None else flat)
    lit = ~dark & (targets == flat)
    wavelength = _require_alike(record, lit, flat)
    chosen = np.flatnonzero(lit | dark).tolist()
    sensor = record.bench.sensor
    if words := record.readouts[record.chosen_readout].describe():
        raise UserError(
            f"{record.path}: its frames are read otherwise than the bench opens the camera: "
            f"{words}. {_PLAN_HINT}."
        )
    shape = record.frame_shape
    exposures = _exposures(record, lit | dark)
    filters = sensor.colour.pattern if sensor.colour else ("M",)
    try:
        frames = PairedFrames(
            [RecordedFrame(record, index, shape) for index in chosen],
            exposures[chosen],
            lit[chosen],
            sensor.build().top_number,
            (len(filters), len(filters[0])),
            record.column("time")[chosen],
        )
    except ValueError as error:
        raise UserError(f"{record.path}: {error}. {_PLAN_HINT}.") from error
    return RecordedPairs(frames, request.model_copy(update={"flat": flat}), wavelength)


def _flat_target(record: Record, names: NDArray[Any], wanted: str | None) -> str:
    """Return the flat target's name; raise UserError if none or several could be meant."""
    there = sorted(set(names.tolist()))
    if not there:
        raise UserError(f"{record.path}: all frames are dark. {_PLAN_HINT}.")
    name = wanted or there[0]
    if name not in there:
        raise UserError(
            f"{record.path}: has no frames of {name!r}. Name the evenly lit target with --flat, "
            f"among {', '.join(there)}."
        )
    if wanted is None and len(there) > 1:
        raise UserError(
            f"{record.path}: has frames of {', '.join(there)}, of which one may be evenly lit. "
            "Name it with --flat."
        )
    return name


def _require_alike(record: Record, lit: NDArray[np.bool_], flat: str) -> float:
    """Return the wavelength of the flat frames in metres; UserError if they differ beyond time."""
    patterns = sorted({record.pattern_names[n] for n in record.column("pattern")[lit]})
    asked = sorted(set(record.column("wavelength_asked")[lit].tolist()))
    if len(patterns) > 1 or len(asked) > 1:
        listed = ", ".join(f"{one * 1e9:g} nm" for one in asked)
        raise UserError(
            f"{record.path}: the frames of {flat!r} are of the patterns {', '.join(patterns)} at "
            f"{listed}, and photon transfer needs light that differs in exposure time alone. "
            f"{_PLAN_HINT}."
        )
    return float(np.median(record.column("wavelength")[lit]))


def _exposures(record: Record, chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return all exposure times in seconds, the same for all that were asked for alike.

    Cameras may report times that differ in their last digits.
    """
    asked, real = record.column("exposure_asked"), record.column("exposure").copy()
    for time in np.unique(asked[chosen]):
        same = chosen & (asked == time)
        real[same] = np.median(real[same])
    return np.asarray(real, dtype=np.float64)
