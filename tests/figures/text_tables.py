"""Tables of text in many encodings, and of panels' makers: right, refused by name, or wrong."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from judges.text_tables import TextTable, broken_tables, spectra_tables, vendor_tables

from figures import Figure
from labapp.common.errors import UserError
from labapp.files.lut_file import read_lut
from labapp.files.spectrum_file import read_spectra

_SEED = 55

Rows = list[tuple[float, ...]]


def rows_of_spectra(path: Path) -> Rows:
    found = list(read_spectra(path).values())
    wavelengths = [1e9 * one for one in found[0].wavelengths]
    return list(zip(wavelengths, *(one.values for one in found), strict=True))


def rows_of_lut(path: Path) -> Rows:
    table = read_lut(path, 256)
    assert table.wavelengths_nm == [532.0]
    return [(level, table.phase_pi[0][level]) for level in range(0, 256, 15)]


def judge(
    tables: Iterable[TextTable], read: Callable[[Path], Rows], folder: Path
) -> dict[str, str]:
    """The fate of each table: right, named, wrong, refused though sound, or a wrong cause."""
    return {one.name: _fate(one, read, folder / "table.csv") for one in tables}


def _fate(table: TextTable, read: Callable[[Path], Rows], path: Path) -> str:
    path.write_bytes(table.data)
    try:
        rows = read(path)
    except UserError as error:
        named = not table.words or any(word in str(error) for word in table.words)
        if table.rows is not None and not (table.refusable and named):
            return f"sound, but refused: {error}"
        return "named" if named else f"wrong cause: {error}"
    if table.rows is None:
        return "wrong: read"
    same = np.shape(rows) == np.shape(table.rows) and np.allclose(rows, table.rows, rtol=1e-5)
    return "right" if same else "wrong: other numbers"


def text_table_figures(folder: Path) -> list[Figure]:
    """Spectra in 17 encodings, 8 layouts and 3 ends of line; look-up tables; broken ones."""
    found = {
        "tables of spectra by encoding, layout and end of line": judge(
            spectra_tables(_SEED), rows_of_spectra, folder
        ),
        "look-up tables of panels, of phase or voltage": judge(
            vendor_tables(_SEED), rows_of_lut, folder
        ),
        "tables whose numbers can't be told, and files that are no text": judge(
            broken_tables(), rows_of_spectra, folder
        ),
    }
    return [_figure(what, fates) for what, fates in found.items()]


def _figure(what: str, fates: dict[str, str]) -> Figure:
    counts = Counter(fate.partition(":")[0] for fate in fates.values())
    bad = [f"{name}: {fate}" for name, fate in fates.items() if fate not in ("right", "named")]
    said = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    return Figure(
        f"{len(fates)} {what}: neither right nor refused by name",
        "0",
        f"{len(bad)} ({said})" + "".join(f"; {one}" for one in bad[:3]),
        not bad,
    )


MEASUREMENTS = {"text tables": text_table_figures}
