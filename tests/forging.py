"""Make all digests of a changed record anew, as somebody who wants to deceive would."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import numpy as np

from labapp.runs.record import digests, layout
from labapp.runs.record.place_table import encode, rebuild_table
from labapp.runs.record.second_copy import renew_copy


def replace_text(file: h5py.File, name: str, text: str) -> None:
    """Replace a text of a record by another one, of fixed length as all of its texts."""
    del file[name]
    encoded = text.encode()
    kind = h5py.string_dtype("utf-8", len(encoded))
    file.create_dataset(name, data=np.array(encoded, dtype=kind))


def forge(path: Path) -> None:
    """Compute table, structure, links, log and closing digest of a record as it is now."""
    handle = os.open(path, os.O_RDWR)
    try:
        table = rebuild_table(path, handle)
        os.pwrite(handle, encode(table), 0)
        structure = digests.structure_digest(handle, table)

        def read(name):
            return table.read(handle, name)

        def write(name, row, data):
            place = table.places[name]
            os.pwrite(handle, data, place.offset + row * place.row_bytes)

        write(f"{layout.DIGESTS}/structure", 0, structure)
        link = digests.first_link(structure)
        rows = read(f"{layout.DIGESTS}/chain").copy()
        frames = [n for n in range(len(rows)) if rows[n]["link"].any()]
        images = read(f"{layout.DATA}/images")
        columns = {name: read(f"{layout.DATA}/{name}") for name in digests.SETTINGS}
        for number in frames:
            frame = int(rows[number]["frame"])
            image = digests.image_digest(images[frame])
            own = digests.pack_settings({k: v[frame] for k, v in columns.items()})
            packed = b"".join(own.values())
            settings = digests.packed_digest(packed)
            link = digests.link_digest(link, frame, image, settings)
            values = (np.frombuffer(one, np.uint8) for one in (image, settings, link, packed))
            row = np.array((frame, *values), layout.CHAIN_ROW)
            write(f"{layout.DIGESTS}/chain", number, row.tobytes())
        line = digests.first_line(structure)
        lines = read("entry/log")
        used = [n for n in range(len(lines)) if lines[n]["text"]]
        for number in used:
            time, text = lines[number]["time"], bytes(lines[number]["text"])
            line = digests.line_digest(line, time, text)
            row = np.array((time, text, np.frombuffer(line, np.uint8)), layout.LOG_ROW)
            write("entry/log", number, row.tobytes())
        ending = [read(f"entry/{name}").tobytes() for name in digests.ENDING]
        closing = digests.closing_digest(structure, len(frames), link, len(used), line, ending)
        write(f"{layout.DIGESTS}/closing", 0, closing)
        renew_copy(handle, table)
    finally:
        os.close(handle)
