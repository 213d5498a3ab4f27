"""What is left of a record of which a disk has lost a page: what must be saved, and what was.

The pictures are those that the camera gave while the run went on, and they are looked for in the
file's bytes, so nothing of the record's own account of itself is believed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from labapp.bench.opening import BenchSetup, open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.salvaging import salvage
from optics.progress import Progress

SIZES = (512, 1024, 2048, 4096)
"""Bytes of the pages that disks lose."""

_SETTINGS = ("exposure", "wavelength", "gain", "time", "timestamp", "number", "attempts")


@dataclass(frozen=True)
class Page:
    """A page of a file, and what stands there once it is lost."""

    offset: int
    content: bytes

    def in_file(self, data: bytes) -> bytes:
        end = min(self.offset + len(self.content), len(data))
        return data[: self.offset] + self.content[: end - self.offset] + data[end:]


@dataclass
class Salvaged:
    """Frames that weren't saved though their bytes are whole, and that were saved wrong."""

    lost: set[int] = field(default_factory=set)
    wrong: set[int] = field(default_factory=set)
    unexpected: str = ""

    @property
    def is_right(self) -> bool:
        return not (self.lost or self.wrong or self.unexpected)


class LostPages:
    """A record whose pages are lost one by one. frames: taken of the plan; the run ends there."""

    def __init__(self, setup: BenchSetup, plan: PlanFile, path: Path, frames: int) -> None:
        self.path, self.images = path, {}
        progress = Progress()

        def keep(shot, frame) -> None:
            self.images[shot.index] = frame.image.astype("<u2").tobytes()
            if len(self.images) == frames:
                progress.cancel()

        with open_bench(setup) as bench:
            run_plan(bench, plan, path, Attendance(progress=progress, on_frame=keep))
        self.data = path.read_bytes()
        size = len(self.images[0])
        begin = self.data.find(b"".join(self.images[n] for n in range(len(self.images))))
        assert begin >= 0
        self.places = {n: begin + n * size for n in self.images}
        with h5py.File(path) as file:
            self._settings = {name: file[f"entry/data/{name}"][()] for name in _SETTINGS}

    def pages(self, size: int, rng: np.random.Generator) -> Iterator[Page]:
        """Every page of that size, zeroed and with what stood there before, if that changes it."""
        for offset in range(0, len(self.data), size):
            old = self.data[offset : offset + size]
            for content in (bytes(len(old)), rng.bytes(len(old))):
                if content != old:
                    yield Page(offset, content)

    def whole(self, data: bytes) -> set[int]:
        """Frames whose pictures are still there, byte for byte."""
        return {n for n, image in self.images.items() if data.startswith(image, self.places[n])}

    def salvage(self, page: Page) -> Salvaged:
        """Lose a page, save what is whole, and judge the record that it was saved into."""
        data, new = page.in_file(self.data), self.path.with_name("saved.h5")
        self.path.write_bytes(data)
        try:
            done = salvage(self.path, new, force=True)
        except UserError:
            return Salvaged(lost=self.whole(data))
        except Exception as error:
            return Salvaged(lost=self.whole(data), unexpected=f"{type(error).__name__}: {error}")
        return self.judge(new, self.whole(data), settings_told=" ".join(done.lacks))

    def judge(
        self, new: Path, whole: set[int], settings_told: str, *, taken_again: bool = False
    ) -> Salvaged:
        """Compare a record with the pictures that were whole, and with how they were taken.

        taken_again: whether others than these may have been taken since.
        """
        found = Salvaged()
        planned = "measured settings" in settings_told
        with h5py.File(new) as file:
            data = file["entry/data"]
            saved = set(np.flatnonzero(data["stored"][()]).tolist())
            for n in saved & whole if taken_again else saved:
                same = data["images"][n].tobytes() == self.images.get(n)
                as_taken = all(data[k][n] == v[n] for k, v in self._settings.items())
                if not same or not (as_taken or planned):
                    found.wrong.add(n)
        found.lost = whole - saved
        return found
