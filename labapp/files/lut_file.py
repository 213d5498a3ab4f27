"""The phase response of a panel as a look-up table, from a vendor or a measurement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.files.quantities import Nanometres
from labapp.files.reading import FileModel, read_file
from labapp.files.text_table import (
    is_level,
    is_voltage,
    parse_numbers,
    read_phase_heading,
    table_lines,
)
from labapp.files.wavelengths import require_nanometres
from optics.slm import Panel, PhaseResponse


class LutTable(FileModel):
    """Phases of the panel's grey levels in units of pi, at wavelengths in nm.

    phase_pi holds, for every wavelength, the phases of all levels, or nested lists [rows][columns]
    of such curves. These belong to regions of equal size that cover the panel.
    """

    wavelengths_nm: Annotated[list[Nanometres], Field(min_length=1)]
    phase_pi: list[Any]

    def build(self, panel: Panel) -> PhaseResponse:
        """Return the phase response; ValueError if it doesn't fit the panel."""
        try:
            phases = np.array(self.phase_pi, dtype=np.float64) * np.pi
        except (TypeError, ValueError):
            raise ValueError(
                "phase_pi must hold equally long lists of numbers, one for every wavelength"
            ) from None
        return PhaseResponse.from_phases(panel, [nm * 1e-9 for nm in self.wavelengths_nm], phases)


class LutFile(LutTable):
    """A phase response of the panel in a TOML or JSON file of its own."""

    version: int = Field(ge=1, le=1)


def read_lut(path: Path, levels: int) -> LutTable:
    """Read a panel's phase response from a look-up table.

    TOML and JSON files hold a LutFile. Other files are text: the first line is `grey` and the
    wavelengths in nm, and each further line is a level and its phases in units of pi, separated by
    semicolons, tabs, commas or blanks. A heading as `532 nm (rad)` names another unit. Missing
    levels are interpolated linearly, but the first and the last level must be given. `#` begins a
    comment. Raises UserError with the file and, in text files, the line.
    """
    if path.suffix.lower() in (".toml", ".json"):
        return LutTable(**read_file(path, LutFile).model_dump(exclude={"version"}))
    lines = table_lines(path)
    if not lines:
        raise UserError(f"{path}: is empty. Give a line of grey levels and phases a level.")
    (number, head), *rest = lines
    wavelengths, units = _read_headings(path, number, head)
    rows = []
    for line, parts in rest:
        values = parse_numbers(parts)
        if values is None or len(values) != len(head):
            raise UserError(
                f"{path}: line {line} is {quote(' '.join(parts))}; it must hold {len(head)} finite "
                "numbers, a grey level and its phases in units of pi."
            )
        rows.append(values)
    level, phases = np.array([r[0] for r in rows]), np.array([r[1:] for r in rows])
    if len(rows) < 2 or level[0] != 0 or level[-1] != levels - 1 or (np.diff(level) <= 0).any():
        raise UserError(
            f"{path}: the grey levels must rise from 0 in the first line to {levels - 1}, the "
            "panel's last, in the last."
        )
    every = np.arange(levels)
    columns = (unit * column for unit, column in zip(units, phases.T, strict=True))
    curves = [np.interp(every, level, column).tolist() for column in columns]
    return LutTable(wavelengths_nm=wavelengths, phase_pi=curves)


def _read_headings(path: Path, number: int, head: list[str]) -> tuple[list[float], list[float]]:
    """Return the columns' wavelengths in nm, and the units of their phases in pi."""
    wanted = (
        f"{path}: line {number} must say 'grey' and the wavelengths in nm, as in 'grey, 532' over "
        "phases in units of pi, or 'grey; 532 nm (rad)'."
    )
    if any(is_voltage(one) for one in head):
        raise UserError(
            f"{path}: line {number} names voltages: they say how the panel is driven, not which "
            "phase it shows. Measure the phase, by labapp calibrate, or give a table of it."
        )
    if parse_numbers(head) is not None:
        raise UserError(f"{wanted} Its numbers have no headings, and may be phases or voltages.")
    if not is_level(head[0]) or len(head) < 2:
        raise UserError(wanted)
    try:
        found = [read_phase_heading(one) for one in head[1:]]
    except ValueError as error:
        raise UserError(f"{wanted} There, {error}.") from error
    if min(nanometres for nanometres, _ in found) <= 0:
        raise UserError(wanted)
    for nanometres, _ in found:
        require_nanometres(f"{path}: line {number}: a wavelength", nanometres)
    return [nanometres for nanometres, _ in found], [unit for _, unit in found]
