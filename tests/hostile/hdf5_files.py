"""HDF5 files that refer to others, or stand for much more than they store."""

from __future__ import annotations

import shutil
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from hostile.plain_files import pipe
from labapp.runs.record import layout

Change = Callable[[h5py.File, str, Path], None]
"""Replace a dataset of an open file, by its name. The folder has the canary."""


def external_link(file: h5py.File, name: str, folder: Path) -> None:
    del file[name]
    file[name] = h5py.ExternalLink(str(pipe(folder)), "/a")


def soft_link(file: h5py.File, name: str, folder: Path) -> None:
    """A name that leads to itself."""
    del file[name]
    file[name] = h5py.SoftLink(f"/{name}")


def external_storage(file: h5py.File, name: str, folder: Path) -> None:
    """The numbers of the dataset are the bytes of another file."""
    shape, dtype = file[name].shape, file[name].dtype
    del file[name]
    size = max(int(np.prod(shape)) * dtype.itemsize, 1)
    file.create_dataset(name, shape, dtype, external=[(str(pipe(folder)), 0, size)])


def virtual_dataset(file: h5py.File, name: str, folder: Path) -> None:
    """The numbers of the dataset are those of a dataset of another file."""
    shape, dtype = file[name].shape or (1,), file[name].dtype
    del file[name]
    made = h5py.VirtualLayout(shape, dtype)
    made[...] = h5py.VirtualSource(str(pipe(folder)), "a", shape)
    file.create_virtual_dataset(name, made)


def long_text(file: h5py.File, name: str, folder: Path) -> None:
    """2³⁰ bytes that were never written, which HDF5 makes up."""
    del file[name]
    file.create_dataset(name, (), "S1073741824")


def bomb(file: h5py.File, name: str, folder: Path) -> None:
    """A gigabyte in a megabyte."""
    del file[name]
    made = file.create_dataset(
        name, (64, 4096, 4096), np.uint8, chunks=(1, 4096, 4096), compression="gzip"
    )
    stored = zlib.compress(bytes(4096 * 4096))
    for number in range(64):
        made.id.write_direct_chunk((number, 0, 0), stored)


def many_chunks(file: h5py.File, name: str, folder: Path) -> None:
    """Sixty million pieces, none of which is stored."""
    del file[name]
    file.create_dataset(name, (1, 7800, 7800), np.uint8, chunks=(1, 1, 1))


def circle(file: h5py.File, name: str, folder: Path) -> None:
    """A group that holds itself."""
    file["entry/circle"] = file["entry"]


def many_texts(file: h5py.File, name: str, folder: Path) -> None:
    """A hundred thousand references to one text of a megabyte."""
    del file[name]
    count, text = 100_000, "x" * 1_000_000
    made = file.create_dataset(name, (count,), h5py.string_dtype())
    made[0] = text
    file.flush()
    with open(file.filename, "r+b") as raw:
        raw.seek(made.id.get_offset())
        reference = raw.read(16)
        raw.write((count - 1) * reference)


def foreign_filter(file: h5py.File, name: str, folder: Path) -> None:
    """Compressed by a library that HDF5 looks for in folders of the system."""
    del file[name]
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_chunk((1, 8, 8))
    how.set_filter(32_015, h5py.h5z.FLAG_OPTIONAL, ())
    space = h5py.h5s.create_simple((1, 8, 8))
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.STD_U8LE, space, how)


CHANGES: dict[str, Change] = {
    "external-link": external_link,
    "soft-link": soft_link,
    "external-storage": external_storage,
    "virtual-dataset": virtual_dataset,
    "long-text": long_text,
    "bomb": bomb,
    "many-chunks": many_chunks,
    "circle": circle,
    "many-texts": many_texts,
    "foreign-filter": foreign_filter,
}


def changed_copy(whole: Path, name: str, change: str, folder: Path) -> Path:
    """Copy an HDF5 file and change a dataset of it."""
    path = folder / f"{change}-{whole.stem}-{name.rpartition('/')[2]}.h5"
    shutil.copyfile(whole, path)
    with h5py.File(path, "r+") as file:
        CHANGES[change](file, name, folder)
    return path


def unprotected_copy(record: Path, folder: Path) -> Path:
    """A record whose table of places is lost, and which says that it is of the older format."""
    path = folder / f"unprotected-{record.name}"
    shutil.copyfile(record, path)
    with h5py.File(path, "r+") as file:
        file.attrs["labapp_format"] = layout.UNPROTECTED_FORMAT
    with path.open("r+b") as file:
        file.write(bytes(8))
    return path
