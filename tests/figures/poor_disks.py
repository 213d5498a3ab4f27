"""Records on file systems that lack locks, links or fsync, which a preloaded library plays."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from small_bench.files import write_tiny

from figures import Figure

_SOURCE = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdlib.h>
#define FAIL(name) do { const char *told = getenv(name); \
  if (told) { errno = atoi(told); return -1; } } while (0)
#define NEXT(name, type) ((type) dlsym(RTLD_NEXT, name))
static int locks(int c) {
  return c == F_SETLK || c == F_SETLKW || c == F_GETLK
      || c == F_OFD_SETLK || c == F_OFD_SETLKW || c == F_OFD_GETLK;
}
#define FCNTL(name) int name(int fd, int command, ...) { \
  va_list rest; va_start(rest, command); void *what = va_arg(rest, void *); va_end(rest); \
  if (locks(command)) FAIL("PLAYED_LOCK"); \
  return NEXT(#name, int (*)(int, int, ...))(fd, command, what); }
FCNTL(fcntl)
FCNTL(fcntl64)
int flock(int fd, int how) {
  FAIL("PLAYED_LOCK"); return NEXT("flock", int (*)(int, int))(fd, how); }
int link(const char *old, const char *new) {
  FAIL("PLAYED_LINK"); return NEXT("link", int (*)(const char *, const char *))(old, new); }
int linkat(int a, const char *old, int b, const char *new, int how) {
  FAIL("PLAYED_LINK");
  return NEXT("linkat", int (*)(int, const char *, int, const char *, int))(a, old, b, new, how); }
int fdatasync(int fd) { FAIL("PLAYED_SYNC"); return NEXT("fdatasync", int (*)(int))(fd); }
int fsync(int fd) { FAIL("PLAYED_SYNC"); return NEXT("fsync", int (*)(int))(fd); }
int rename(const char *old, const char *new) {
  FAIL("PLAYED_RENAME"); return NEXT("rename", int (*)(const char *, const char *))(old, new); }
"""

_PLAYED = {
    "PLAYED_LOCK": (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL),
    "PLAYED_LINK": (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL, errno.EACCES),
    "PLAYED_SYNC": (errno.EINVAL, errno.ENOSYS, errno.EIO),
    "PLAYED_RENAME": (errno.EACCES, errno.EBUSY),
}
"""What file systems answer, by call."""

_DRAWN = 4
"""File systems that are drawn beside one of each kind."""

_FAILS = {"PLAYED_SYNC": (errno.EIO,), "PLAYED_RENAME": _PLAYED["PLAYED_RENAME"]}
"""Answers at which a command may fail, if it says so."""


@dataclass(frozen=True)
class _Fate:
    """How a command ended: right, named, or else what it said."""

    command: str
    right: bool
    named: bool
    said: str


def poor_disks(folder: Path) -> list[Figure]:
    """Every command of records on file systems that are drawn by a seed."""
    name = "records without locks, links, fsync or renames: neither right nor named; right"
    compiler = shutil.which("cc")
    if compiler is None:
        return [Figure(name, "0", "no compiler of C is here", None)]
    library = folder / "played.so"
    (folder / "played.c").write_text(_SOURCE)
    command = [compiler, "-shared", "-fPIC", "-o", library, folder / "played.c", "-ldl"]
    subprocess.run(command, check=True)
    fates = [
        fate
        for number, played in enumerate(_drawn())
        for fate in _fates(folder / f"{number}", library, played)
    ]
    wrong = [one for one in fates if not (one.right or one.named)]
    right = sum(one.right for one in fates)
    first = f"; first: {wrong[0].command}: {wrong[0].said}" if wrong else ""
    measured = f"{len(wrong)}; {right} of {len(fates)} commands{first}"
    return [Figure(name, "0", measured, not wrong)]


def _drawn() -> list[dict[str, int]]:
    """What each file system answers: one that lacks one thing, for each, then mixtures."""
    rng = np.random.default_rng(56)
    singles = [{name: int(rng.choice(codes))} for name, codes in _PLAYED.items()]
    mixed = [
        {name: int(rng.choice(codes)) for name, codes in _PLAYED.items() if rng.random() < 0.6}
        for _ in range(_DRAWN)
    ]
    return singles + [one for one in mixed if one]


def _fates(folder: Path, library: Path, played: dict[str, int]) -> list[_Fate]:
    files = write_tiny(folder)
    record, saved, out = folder / "run.h5", folder / "saved.h5", folder / "out"
    surroundings = os.environ | {name: str(code) for name, code in played.items()}
    surroundings["LD_PRELOAD"] = str(library)
    excuses = [os.strerror(code) for name, code in played.items() if code in _FAILS.get(name, ())]

    def call(*words: object) -> _Fate:
        done = subprocess.run(
            [sys.executable, "-m", "labapp", *map(str, words)],
            env=surroundings, capture_output=True, text=True, check=False,
        )  # fmt: skip
        said = done.stdout + done.stderr
        named = done.returncode == 1 and any(excuse in said for excuse in excuses)
        return _Fate(str(words[0]), done.returncode == 0, named, said[-300:])

    fates = [call("run", files.plan, *files.arguments(), "--out", record)]
    if not fates[0].right:
        return fates
    fates += [call("verify", record), call("show", record)]
    fates.append(call("export", record, "--to", "npy", "--out", out))
    fates.append(call("run", files.plan, *files.arguments(), "--out", record, "--force"))
    with h5py.File(record, "r+") as file:
        before = file["entry/data/images"][()]
        file["entry/data/images"][3, 0, 0] ^= 1
    fates.append(call("salvage", record, "--out", saved))
    fates += [call("resume", one) for one in (record, saved) if one.exists()]
    fates.append(call("verify", record))
    for one in (record, saved):
        if one.exists():
            with h5py.File(one, "r") as file:
                same = np.array_equal(file["entry/data/images"][()], before)
            fates.append(_Fate(f"frames of {one.name}", same, False, "frames differ"))
    return fates


MEASUREMENTS = {"poor disks": poor_disks}
