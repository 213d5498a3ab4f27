"""One run of a million small frames, with what is done with its record; asked for by name only.

It takes an hour and 18 GB of disk. Memory and processor time are compared with a short run's.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from figures import TOLD, Figure
from figures.long_runs import Cost, cost, damage, run_files, sample

_FEW, _MANY = 10_000, 1_000_000

_DAMAGED = 3_000
"""Frames that lose a bit before the record is resumed."""

_MOST_GROWTH, _MOST_MILLISECONDS = 300e6, 2.0
"""Memory beyond a short run's, and processor time of a frame."""

_BYTES_PER_FRAME = 18_500
"""Of disk: in the record, and as exported to one array."""


def million_frames(folder: Path) -> list[Figure]:
    """Run, verify, damage, resume and export; the record is in order after each."""
    return many_frames(folder, _MANY)


def many_frames(folder: Path, frames: int) -> list[Figure]:
    """The same of any number of frames, to try it with fewer."""
    free = shutil.disk_usage(folder).free
    if free < 1.1 * frames * _BYTES_PER_FRAME:
        why = f"{free / 1e9:.1f} GB are free in {folder.parent}, and {frames:,} frames need more"
        return [Figure(f"{frames:,} frames of 64²", TOLD, why, None)]
    few, _ = _costs(folder, _FEW)
    many, size = _costs(folder, frames)
    found = [_figure(name, frames, few[name], many[name]) for name in few]
    told = f"{size / 1e9:.2f} GB, {size / frames:.0f} bytes a frame"
    return [*found, Figure(f"{frames:,} frames of 64²: size of the record", TOLD, told, None)]


def _figure(name: str, frames: int, few: Cost, many: Cost) -> Figure:
    growth = many.memory - few.memory
    milliseconds = 1e3 * (many.seconds - few.seconds) / (frames - _FEW)
    return Figure(
        f"{name} of {frames:,} frames of 64²: memory beyond that of {_FEW:,}; processor time",
        f"≤ {_MOST_GROWTH / 1e6:.0f} MB; ≤ {_MOST_MILLISECONDS:g} ms a frame",
        f"{growth / 1e6:.0f} MB; {milliseconds:.2f} ms; {many.wall / 60:.1f} minutes in all",
        growth <= _MOST_GROWTH and milliseconds <= _MOST_MILLISECONDS,
    )


def _costs(folder: Path, frames: int) -> tuple[dict[str, Cost], int]:
    """Costs by command, and the record's bytes; each command must say that all is in order."""
    record, out = folder / f"{frames}.h5", folder / "arrays"
    found = {"run": cost("run", *run_files(folder, frames), "--out", record)}
    found["verify"] = cost("verify", record)
    drawn = np.random.default_rng(57).choice(frames, min(_DAMAGED, frames // 10), replace=False)
    before = damage(record, sorted(drawn.tolist()))
    found[f"resume of {_DAMAGED:,} damaged"] = cost("resume", record)
    assert np.array_equal(sample(record), before), "frames that were taken again differ"
    cost("verify", record)
    found["export"] = cost("export", record, "--to", "npy", "--out", out)
    array = np.load(out / "frames.npy", mmap_mode="r")
    assert len(array) == frames
    assert np.array_equal(array[:: frames // 100], before), "exported frames differ"
    size = record.stat().st_size
    shutil.rmtree(out)
    record.unlink()
    return found, size


MEASUREMENTS = {"million frames": million_frames}
