"""Live pictures that a person keeps: each as a TIFF file with its settings."""

from __future__ import annotations

import io
import json
import threading
from collections import deque
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import labapp
from labapp.bench.opening import Bench
from labapp.common.errors import UserError
from labapp.files.writing import make_folder, write_atomically
from labapp.window.messages import LiveFrame

_HELD = 4
"""Pictures from which a person can still choose one. Chosen: the window shows the last but two at
the oldest, since no more are on their way."""

_UNITS = {"wavelength": "m", "exposure": "s", "full_scale": "DN", "black_level": "DN"}


@dataclass(frozen=True, eq=False)
class _HeldPicture:
    """A live picture with the time at which it came."""

    frame: LiveFrame
    moment: datetime


class KeptPictures:
    """Hold the last live pictures, and write those that a person keeps.

    Any thread may call the methods.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._lock = threading.Lock()
        self._held: deque[_HeldPicture] = deque(maxlen=_HELD)

    def offer(self, frame: LiveFrame) -> None:
        """Hold a picture that is sent to the window, in the place of the oldest one."""
        with self._lock:
            self._held.append(_HeldPicture(frame, datetime.now().astimezone()))

    def keep(self, number: int, folder: Path) -> Path:
        """Write the picture of a number to a new file, and return its path.

        The file is a TIFF of the raw digital numbers, with the settings as JSON in its description.
        Raises UserError if the picture is gone, or can't be written.
        """
        with self._lock:
            found = next((one for one in self._held if one.frame.number == number), None)
        if found is None:
            raise UserError(
                f"Picture {number} isn't there any more. Stop live view (F5), then keep it."
            )
        make_folder(folder)
        path = _new_path(folder, found.moment)
        write_atomically(path, self._encode(found))
        return path

    def _encode(self, held: _HeldPicture) -> bytes:
        # Loaded with the first picture that is kept.
        import tifffile

        buffer = io.BytesIO()
        tifffile.imwrite(
            buffer,
            held.frame.image,
            photometric="minisblack",
            description=json.dumps(self._settings(held)),
            software=f"labapp {labapp.__version__}",
            metadata=None,
        )
        return buffer.getvalue()

    def _settings(self, held: _HeldPicture) -> dict[str, Any]:
        """Return what a picture's file says about it, in SI units."""
        frame, sensor = held.frame, self._bench.description.sensor
        return {
            "target": frame.target,
            "pattern": frame.pattern,
            "wavelength": frame.wavelength,
            "exposure": frame.exposure,
            "number": frame.number,
            "time": held.moment.isoformat(timespec="milliseconds"),
            "black_level": sensor.black_level,
            "full_scale": sensor.full_scale,
            "bench": self._bench.file.name,
            "camera": self._bench.camera.identity.model,
            "simulated": self._bench.simulated_devices,
            "units": _UNITS,
        }


def _new_path(folder: Path, moment: datetime) -> Path:
    """Return an unused path, named after the time of the picture."""
    stem = f"{moment:%Y-%m-%d_%H%M%S}_picture"
    path, number = folder / f"{stem}.tiff", 1
    while path.exists():
        number += 1
        path = folder / f"{stem}-{number}.tiff"
    return path
