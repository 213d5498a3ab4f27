"""What it costs that a record's bytes are brought to the disk each second."""

from __future__ import annotations

import os
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import h5py
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Frame
from figures import Figure
from figures.digest_cost import Store, new_record
from labapp.runs.record import disk_sync
from labapp.runs.state import State

_MOST_CPU, _MOST_WALL = 1.3, 1.5

Storing = Callable[[Path, tuple[int, int], int], AbstractContextManager[tuple[Store, Callable]]]
"""Opens a file of so many frames; gives what stores a frame, and what ends the run."""


@dataclass(frozen=True)
class _Case:
    """Sensor (rows, columns); frames, enough for some seconds; rounds; the clock that counts."""

    shape: tuple[int, int]
    frames: int
    rounds: int
    clock: Callable[[], float]


_SMALL = _Case((512, 512), 800, 7, time.process_time)
_LARGE = _Case((3000, 4096), 20, 7, time.perf_counter)


def syncing(folder: Path) -> list[Figure]:
    """Records stored with and without syncing, and h5py's with the same syncing, in turns."""
    synced, unsynced = _in_turns(folder, _SMALL, _record, _without_syncing)
    ours, plain = _in_turns(folder, _LARGE, _record, _plain)
    more, wall = float(np.median(synced / unsynced)), float(np.median(ours / plain))
    return [
        Figure(
            "512² frame: CPU time of storing it with syncing each second over that without, in "
            "turns",
            f"≤ {_MOST_CPU:g}",
            f"{more:.2f}, {np.median(synced):.2f} ms and {np.median(unsynced):.2f} ms, medians",
            more <= _MOST_CPU,
        ),
        Figure(
            "12-megapixel frame: wall time over that of h5py alone, both synchronised each second "
            "and at the end, in turns",
            f"≤ {_MOST_WALL:g}",
            f"{wall:.2f}, {np.median(ours):.0f} ms and {np.median(plain):.0f} ms, medians",
            wall <= _MOST_WALL,
        ),
    ]


def _in_turns(folder: Path, case: _Case, *kinds: Storing) -> list[NDArray[np.float64]]:
    """Milliseconds of a frame by kind and round; the first, which finds all cold, is left out."""
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 4096, case.shape, np.uint16) for _ in range(4)]
    frames = [Frame(one, 0.01, 1.0, 0.0, n, zlib.crc32(one.data)) for n, one in enumerate(images)]
    took: list[list[float]] = [[] for _ in kinds]
    for number in range(case.rounds + 1):
        for place in sorted(range(len(kinds)), reverse=number % 2 == 1):
            path = folder / "run.h5"
            # What was written before isn't this one's to wait for.
            os.sync()
            with kinds[place](path, case.shape, case.frames) as (store, end):
                began = case.clock()
                for index in range(case.frames):
                    store(index, frames[index % len(frames)])
                end()
                took[place].append(1e3 * (case.clock() - began) / case.frames)
            path.unlink()
    return [np.array(one[1:]) for one in took]


@contextmanager
def _record(
    path: Path, shape: tuple[int, int], frames: int
) -> Iterator[tuple[Store, Callable[[], object]]]:
    writer, shots = new_record(path, shape, frames)
    with writer:
        yield (
            lambda index, frame: writer.store(shots[index], frame, 550e-9, start_time=0.1 * index),
            lambda: writer.set_state(State.COMPLETE),
        )


@contextmanager
def _without_syncing(
    path: Path, shape: tuple[int, int], frames: int
) -> Iterator[tuple[Store, Callable[[], object]]]:
    """The same writer, which asks the disk for nothing."""
    with (
        patch.object(disk_sync, "sync_handle", lambda _: True),
        _record(path, shape, frames) as storing,
    ):
        yield storing


@contextmanager
def _plain(
    path: Path, shape: tuple[int, int], frames: int
) -> Iterator[tuple[Store, Callable[[], object]]]:
    """h5py alone, with a thread that synchronises as the record's does."""
    with h5py.File(path, "w") as file:
        images = file.create_dataset("images", (frames, *shape), np.uint16)
        handle, ended = os.open(path, os.O_RDONLY), threading.Event()

        def synchronise() -> None:
            while not ended.wait(disk_sync.EVERY):
                os.fdatasync(handle)

        thread = threading.Thread(target=synchronise)
        thread.start()

        def store(index: int, frame: Frame) -> None:
            images[index] = frame.image
            file.flush()

        def end() -> None:
            file.flush()
            os.fdatasync(handle)

        yield store, end
        ended.set()
        thread.join()
        os.close(handle)


MEASUREMENTS = {"sync cost": syncing}
