"""What digests cost a run: time that a frame takes until it is stored."""

from __future__ import annotations

import os
import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest.mock import patch

import h5py
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Frame, Identity
from figures import TOLD, Figure
from labapp.runs.record import digests
from labapp.runs.record.creation import RecordContents, create_record
from labapp.runs.record.writer import RecordWriter
from labapp.runs.shots import Shot

_SMALL, _LARGE = (512, 512), (3000, 4096)
"""Sensors, (rows, columns): half a megabyte a frame, and 12 megapixels."""

_SMALL_FRAMES, _LARGE_FRAMES = 400, 24

_ROUNDS = 3

_MOST_MILLISECONDS, _MOST_RATIO = 0.4, 1.4

Store = Callable[[int, Frame], None]
"""Stores a frame at an index."""


def storing(folder: Path) -> list[Figure]:
    """Frames stored in turns, each writer in a file of its own."""
    with ExitStack() as stack:
        stores = {
            "without": stack.enter_context(_without_digests(folder / "without.h5")),
            "with": stack.enter_context(_record(folder / "with.h5", _SMALL, _SMALL_FRAMES)),
        }
        took = _times(stores, _SMALL, _SMALL_FRAMES)
    more = 1e3 * float(np.median(took["with"] - took["without"]))
    small = Figure(
        "512² frame: the writer's time over that of the same writer without digests, in turns",
        f"≤ +{_MOST_MILLISECONDS:g} ms",
        f"{more:+.2f} ms, to {1e3 * np.median(took['with']):.2f} ms, medians",
        more <= _MOST_MILLISECONDS,
    )
    # The disk is quick or slow for many frames on end, so that one round tells too little.
    rounds = [(f"on the disk, round {number + 1}", True) for number in range(_ROUNDS)]
    cases = [*rounds, ("in the system's memory", False)]
    return [small, *(_beside_hdf5(folder / where, where, synced) for where, synced in cases)]


def _beside_hdf5(folder: Path, where: str, synced: bool) -> Figure:
    """12 megapixels beside h5py alone, which stores the same pictures and nothing else."""
    folder.mkdir()
    with ExitStack() as stack:
        stores = {
            "h5py": stack.enter_context(_plain(folder / "plain.h5", synced)),
            "labapp": stack.enter_context(
                _record(folder / "record.h5", _LARGE, _LARGE_FRAMES, synced)
            ),
        }
        took = _times(stores, _LARGE, _LARGE_FRAMES)
    plain, ours = (float(np.median(took[name])) for name in ("h5py", "labapp"))
    ratio = float(np.median(took["labapp"] / took["h5py"]))
    for file in folder.iterdir():
        file.unlink()
    return Figure(
        f"12-megapixel frame: the writer's time over that of h5py alone, in turns, both {where}",
        f"≤ {_MOST_RATIO:g}" if synced else TOLD,
        f"{ratio:.2f}, {1e3 * ours:.0f} ms and {1e3 * plain:.0f} ms, medians",
        ratio <= _MOST_RATIO if synced else None,
    )


def _times(
    stores: Mapping[str, Store], shape: tuple[int, int], frames: int
) -> dict[str, NDArray[np.float64]]:
    """Seconds of each frame. The first two, which find memory and files cold, are left out."""
    rng = np.random.default_rng(0)
    took: dict[str, list[float]] = {name: [] for name in stores}
    for index in range(frames):
        image = rng.integers(0, 4096, shape, np.uint16)
        frame = Frame(image, 0.01, 1.0, 0.1 * index, index, zlib.crc32(image.data))
        # Who comes second finds the picture in the processor's memory.
        for name in sorted(stores, reverse=index % 2 == 1):
            began = time.perf_counter()
            stores[name](index, frame)
            took[name].append(time.perf_counter() - began)
    return {name: np.array(times[2:]) for name, times in took.items()}


def new_record(path: Path, shape: tuple[int, int], frames: int) -> tuple[RecordWriter, list[Shot]]:
    """A record that waits for so many frames, and their shots."""
    shots = [Shot(i, i, 0, "star", "neutral", 550e-9, 0.01) for i in range(frames)]
    contents = RecordContents(
        title="What a record costs",
        seed=0,
        plan={},
        bench={},
        scene=None,
        effect_plan=None,
        identities={"camera": Identity("none", "0", simulated=True)},
        targets=("star",),
        patterns={"neutral": np.zeros((4, 6), np.uint8)},
        shots=shots,
        frame_shape=shape,
        pixel_pitch=1e-6,
    )
    return RecordWriter(path, create_record(path, contents)), shots


@contextmanager
def _record(
    path: Path, shape: tuple[int, int], frames: int, synced: bool = False
) -> Iterator[Store]:
    writer, shots = new_record(path, shape, frames)
    with writer:

        def store(index: int, frame: Frame) -> None:
            writer.store(shots[index], frame, 550e-9, start_time=frame.time)
            if synced:
                os.fsync(writer.handle)

        yield store


@contextmanager
def _without_digests(path: Path) -> Iterator[Store]:
    """The same writer, which computes no digest and appends no link."""

    def nothing(data: NDArray[np.uint16]) -> bytes:
        return b""

    with _record(path, _SMALL, _SMALL_FRAMES) as store:

        def without(index: int, frame: Frame) -> None:
            with (
                patch.object(digests, "image_digest", nothing),
                patch.object(RecordWriter, "_append_link", lambda *_: None),
            ):
                store(index, frame)

        yield without


@contextmanager
def _plain(path: Path, synced: bool) -> Iterator[Store]:
    with h5py.File(path, "w") as file:
        images = file.create_dataset("images", (_LARGE_FRAMES, *_LARGE), np.uint16)

        def store(index: int, frame: Frame) -> None:
            images[index] = frame.image
            file.flush()
            if synced:
                os.fsync(file.id.get_vfd_handle())

        yield store


MEASUREMENTS = {"digest cost": storing}
