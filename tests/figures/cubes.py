"""Memory that the cubes of ENVI files take: whole, and by windows, beyond what the program has."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

from figures import Figure

_WHOLE_GOAL = 1.2
_WINDOWS_GOAL = 500e6

_SCRIPT = """
import sys
from pathlib import Path
import numpy as np
from figures.own_memory import own_memory
from labapp.files.cubes import read_cube

small, large, how = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
read_cube(small).values.sum(dtype=float)
before = own_memory("VmHWM")
cube = read_cube(large)
if how == "whole":
    total = np.asarray(cube.values).sum(dtype=float)
elif how == "rows":
    total = sum(cube.values[:, rows].sum(dtype=float) for rows in cube.row_blocks())
else:
    middle = [slice(n // 2 - 128, n // 2 + 128) for n in cube.shape[1:]]
    total = cube.values[(slice(None), *middle)].sum(dtype=float)
print(own_memory("VmHWM") - before, total)
"""

_HEADER = """ENVI
samples = {columns}
lines = {rows}
bands = {bands}
data type = {code}
interleave = {interleave}
byte order = 0
wavelength units = Nanometers
wavelength = {{{wavelengths}}}
"""


def cubes_figure(folder: Path) -> list[Figure]:
    """Two cubes of 100 MB, in a byte and in single precision, and one of 4 GB."""
    _write(folder, "small", 1, "bsq", (4, 32, 32))
    bytes_, singles = (100, 1000, 1000), (25, 1000, 1000)
    _write(folder, "bytes", 1, "bip", bytes_)
    _write(folder, "singles", 4, "bil", singles)
    rows = [
        _share(folder, "bytes", "rows", "all of a 100 MB ENVI cube of bytes, by blocks of rows"),
        _share(folder, "singles", "rows", "all of a 100 MB ENVI cube of floats, by blocks of rows"),
        _share(folder, "singles", "whole", "a 100 MB ENVI cube of floats as one array"),
        _share(
            folder,
            "bytes",
            "whole",
            "a 100 MB ENVI cube of bytes as one array of floats, four times as large",
            4.2,
        ),
    ]
    _write(folder, "large", 4, "bil", (200, 2500, 2000))
    for how, words in (("rows", "all of it by blocks of rows"), ("middle", "256 x 256 pixels")):
        taken = _measure(folder, "large", how)
        rows.append(
            Figure(
                f"a 4 GB ENVI cube, {words}: memory",
                f"≤ {_WINDOWS_GOAL / 1e6:g} MB",
                f"{taken / 1e6:.0f} MB",
                taken <= _WINDOWS_GOAL,
            )
        )
    return rows


def _share(folder: Path, name: str, how: str, words: str, goal: float = _WHOLE_GOAL) -> Figure:
    """The memory that a cube takes, over the size of its file."""
    share = _measure(folder, name, how) / (folder / f"{name}.raw").stat().st_size
    return Figure(
        f"{words}: memory over the file's size", f"≤ {goal:g}", f"{share:.2f}", share <= goal
    )


def _measure(folder: Path, name: str, how: str) -> int:
    """Bytes of memory at most in a process that reads a cube, beyond what it had before."""
    files = (folder / f"{one}.hdr" for one in ("small", name))
    command = [sys.executable, "-c", _SCRIPT, *map(str, files), how]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return int(done.stdout.split()[0])


def _write(
    folder: Path, name: str, code: int, interleave: str, shape: tuple[int, int, int]
) -> None:
    """Write a cube of numbers by chance, whose file has no holes."""
    bands, rows, columns = shape
    random = np.random.default_rng(0)
    with (folder / f"{name}.raw").open("wb") as file:
        for _ in range(rows):
            numbers = random.integers(0, 200, bands * columns, np.uint8)
            file.write(numbers.astype({1: "u1", 4: "<f4"}[code]).tobytes())
    listed = ", ".join(f"{400 + k}" for k in range(bands))
    (folder / f"{name}.hdr").write_text(
        _HEADER.format(
            columns=columns, rows=rows, bands=bands, code=code, interleave=interleave,
            wavelengths=listed,
        )
    )  # fmt: skip


MEASUREMENTS = {"cubes": cubes_figure}
