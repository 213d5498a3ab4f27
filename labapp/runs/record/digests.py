"""The digests that protect a record: of its structure, of each frame, of the log, and of all.

All are SHA-256. What is known before the first frame has one digest, "structure": every byte of the
file but those of the datasets that change. Each stored frame appends a link to "chain": the frame's
index, the digest of its image, that of its settings, that of the link before with these, and the
settings themselves. Lines of the log are chained likewise. When a run ends, "closing" is the digest
of all others, of state, message and time. So no byte can change, no frame be exchanged, repeated or
left out unless every digest after it is made anew; and then the closing digest differs from the one
that was printed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.runs.record import layout
from labapp.runs.record.place_table import PlaceTable

_BLOCK = 1 << 20
"""Bytes that are read at once."""

_LOG_BEGIN = b"labapp log\n"
_CHAIN_BEGIN = b"labapp frames\n"
_CLOSING = b"labapp closing\n"

ENDING = ("state", "message", "end_time", "writer", "log_lost")
"""Datasets of the entry that the closing digest covers beside the chains."""

SETTINGS = tuple(name for name in layout.MEASURED if name != "stored")
"""Columns that a frame's link covers. `stored` follows from the link itself."""


def structure_digest(
    handle: int, table: PlaceTable, block: bytes = b"", *, copied: int = 0
) -> bytes:
    """Return the digest of a file without the datasets that change, and of its size.

    The images of the patterns have a digest of their own in the table, which is covered.

    block: stands for the first bytes of the file.
    copied: where the copy begins, to take its bytes for those before the log.
    """
    log = table.places[f"{layout.ENTRY}/log"].offset
    left_out = sorted(
        (place.offset, place.end)
        for name, place in table.places.items()
        if name in (*layout.CHANGING, layout.SHOWN_IMAGES)
    )
    found = sha256(table.size.to_bytes(8, "little") + block)
    position = len(block)
    for begin, end in (*left_out, (table.size, table.size)):
        while position < begin:
            shift = copied if position < log else 0
            data = os.pread(handle, min(_BLOCK, begin - position), position + shift)
            if not data:
                return found.digest()
            found.update(data)
            position += len(data)
        position = max(position, end)
    return found.digest()


def is_structure_proved(handle: int, table: PlaceTable) -> bool:
    """Return whether all that never changes has the digest that was written of it."""
    known = table.read(handle, f"{layout.DIGESTS}/structure").tobytes()
    return structure_digest(handle, table) == known


def image_digest(image: NDArray[Any]) -> bytes:
    """Return the digest of a frame's bytes."""
    return sha256(np.ascontiguousarray(image).data).digest()


def pack_settings(values: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the bytes of a frame's measured columns by name, without `stored`."""
    return {name: np.array(values[name], layout.MEASURED[name]).tobytes() for name in SETTINGS}


def unpack_settings(values: bytes) -> dict[str, Any]:
    """Return a frame's measured columns by name from the bytes in its row of the chain."""
    found, at = {}, 0
    for name in SETTINGS:
        kind = layout.MEASURED[name]
        found[name] = np.frombuffer(values, kind, 1, at)[0]
        at += kind.itemsize
    return found


def packed_digest(values: bytes) -> bytes:
    """Return the digest of all that pack_settings() returned for a frame."""
    return sha256(values).digest()


def next_digest(before: bytes, row: bytes) -> bytes:
    """Return the digest of a row's bytes in a chain, after the row before."""
    return sha256(before + row).digest()


def first_link(structure: bytes) -> bytes:
    """Return what the first frame's link builds on."""
    return sha256(_CHAIN_BEGIN + structure).digest()


def link_digest(before: bytes, frame: int, image: bytes, settings: bytes) -> bytes:
    """Return the digest of a frame's link, which builds on the link before."""
    return next_digest(before, int(frame).to_bytes(4, "little") + image + settings)


def first_line(structure: bytes) -> bytes:
    """Return what the first line of the log builds on."""
    return sha256(_LOG_BEGIN + structure).digest()


def line_digest(before: bytes, time: float, text: bytes) -> bytes:
    """Return the digest of a line of the log, which builds on the line before."""
    return next_digest(before, np.float64(time).tobytes() + text)


def closing_digest(
    structure: bytes, links: int, last_link: bytes, lines: int, last_line: bytes,
    ending: Iterable[bytes],
) -> bytes:  # fmt: skip
    """Return the digest over all once the run has ended.

    links, lines: their numbers.
    ending: bytes of the datasets in ENDING.
    """
    found = sha256(_CLOSING + structure)
    found.update(links.to_bytes(8, "little") + last_link)
    found.update(lines.to_bytes(8, "little") + last_line)
    for part in ending:
        found.update(part)
    return found.digest()
