"""The fault file: a script of what goes wrong on a virtual bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from labapp.common.errors import UserError
from labapp.files.reading import FileModel, read_file
from simulator.faults import Fault, Kind, Role


class FaultTable(FileModel):
    """One fault in a fault file; see simulator.faults.Fault.

    The fault happens at the device's first call from planned frame number `frame` on, and at
    `times` calls in all. seconds is the extra duration of a slow call, or the time for which a
    device stays disconnected, in bench time.
    """

    device: Role
    kind: Kind
    frame: Annotated[int, Field(ge=0)] = 0
    times: Annotated[int, Field(ge=1)] = 1
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 1.0


class FaultFile(FileModel):
    version: Literal[1]
    fault: Annotated[tuple[FaultTable, ...], Field(min_length=1)]


def read_faults(path: Path) -> tuple[Fault, ...]:
    """Read a script of faults; raise UserError if it is wrong."""
    tables = read_file(path, FaultFile).fault
    faults = []
    for number, table in enumerate(tables):
        try:
            faults.append(Fault(**table.model_dump()))
        except ValueError as error:
            raise UserError(f"{path}: key 'fault.{number}': {error}.") from error
    return tuple(faults)
