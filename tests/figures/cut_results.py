"""Power cuts while commands write their results: exports, reports, merged light, pictures."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from disks.disk import snapshot
from disks.replacing import spoiled_files
from disks.trace import STRACE, trace
from small_bench.files import SmallFiles, write_small

from figures import Figure
from figures.cut_runs import AROUND, PROGRAM, command
from labapp.common.console import print_message

_CUTS = 100
"""Cuts of each command; a model of a disk is asked, which takes no time."""

_OLD = b"what was here before"


@dataclass(frozen=True)
class _Written:
    """What a command left: whether it succeeded, its last words, and files that cuts spoiled."""

    words: str
    succeeded: bool
    said: str
    spoiled: list[str]


def cut_results(folder: Path) -> list[Figure]:
    """Each command into a new folder, and once more over older files."""
    name = "files of results that a power cut leaves neither old nor new, or that a command's end "
    name += "does"
    if STRACE is None:
        return [Figure(name, "0", "strace isn't here", None)]
    files = write_small(folder / "bench")
    record = folder / "run.h5"
    command("run", files.plan, *files.arguments(), "--out", record)
    found = [
        _write(folder / f"{number}", words, again, number)
        for number, words in enumerate(_commands(record, files))
        for again in (False, True)
    ]
    spoiled = [f"{one.words}: {name}" for one in found for name in one.spoiled]
    failed = [f"{one.words}: {one.said}" for one in found if not one.succeeded]
    first = f"; first: {(failed or spoiled)[0]}" if failed or spoiled else ""
    measured = f"{len(spoiled)} of {len(found) * (_CUTS + 1)} cuts, {len(failed)} commands failed"
    return [Figure(name, "0", measured + first, not spoiled and not failed)]


def _commands(record: Path, files: SmallFiles) -> list[list[str | Path]]:
    """Commands without their --out, of which the name of the file follows."""
    kinds = ("tiff", "png", "npy", "ome-tiff")
    of_star = ("--target", "star", "--pattern", "neutral")
    return [
        *(["export", record, "--to", kind, "--out", "new/exported"] for kind in kinds),
        ["report", record, "--out", "."],
        ["merge", record, *of_star, "--wavelength-nm", "550", "--out", "merged.h5"],
        ["pattern", "lens", "focal_length_m=50", "--bench", files.bench, "--out", "lens.png"],
        ["simulate", files.scene, "--bench", files.bench, "--out", "seen.tiff"],
    ]


def _write(folder: Path, words: list[str | Path], again: bool, seed: int) -> _Written:
    """Write a command's results, again: over files of the same names; and cut the power."""
    out = folder / words[-1]
    given = [*words[:-1], out]
    if not again:
        folder.mkdir()
    else:
        for path in folder.rglob("*"):
            if path.is_file():
                path.write_bytes(_OLD)
        given.append("--force")
    before = snapshot(folder)
    events, done = trace([*PROGRAM, *given], folder, environment=AROUND)
    after = snapshot(folder)
    spoiled = spoiled_files(folder, before, events, after, _CUTS, seed)
    print_message(f"  {words[0]}: {len(events)} calls, {len(spoiled)} spoiled")
    if again:
        shutil.rmtree(folder)
    shown = f"{words[0]} {words[3] if words[0] == 'export' else ''}{' --force' if again else ''}"
    return _Written(shown, done.returncode == 0, (done.stdout + done.stderr)[-200:], spoiled)


MEASUREMENTS = {"cut results": cut_results}
