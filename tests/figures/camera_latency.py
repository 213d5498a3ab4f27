"""Cameras that obey a new exposure late, with and without chunks that tell what is set."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from drivers.aravis import AravisCamera
from drivers.aravis import camera as aravis_camera
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from figures import Figure
from labapp.common.console import print_message
from simulator.wire.fake_gige import FakeGigECamera

Chunks = Literal["none", "register", "honest"]

_SHAPE = (48, 64)
_BLACK = 30.0
_LATENCIES = range(9)
_BRACKETS = 4
_EXPOSURES = 6
_SHORTEST, _LONGEST = 4e-4, 6e-3
_WRONG = 0.1
"""Deviation of a frame's light from that of its exposure, relative, from which on it is wrong."""

_ALIKE = 1.4
"""Ratio of two exposures in a bracket, at least."""


@dataclass
class Scene:
    """What the camera sees: an uneven light that changes; each picture tells its microseconds."""

    rng: np.random.Generator
    rate: float = 3e5

    def render(self, exposure: float, gain_db: float) -> NDArray[np.uint16]:
        light = np.linspace(0.3, 1.7, _SHAPE[1]) * self.rate * exposure
        image = self.rng.poisson(np.broadcast_to(light, _SHAPE)) + self.rng.normal(
            _BLACK, 2.0, _SHAPE
        )
        picture = np.clip(np.rint(image), 0, 65535).astype(np.uint16)
        picture[0, 0] = round(exposure * 1e6)
        return picture

    def is_wrong(self, image: NDArray[np.uint16], exposure: float) -> bool:
        """Return whether the light of a frame isn't that of an exposure in this scene."""
        light = float(image[1:].mean()) - _BLACK
        return abs(light / (self.rate * exposure) - 1) > _WRONG


class ChunkLink:
    """Aravis' process, with a camera that tells an exposure with every frame.

    "register": it tells what is set; "honest": what the frame was exposed with.
    """

    def __init__(self, link: Any, kind: Chunks) -> None:
        self._link, self._kind = link, kind

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def ask(self, name: str, *given: Any, timeout: float) -> Any:
        if name == "set_chunks":
            return True
        answer = self._link.ask(name, *given, timeout=timeout)
        if name == "facts":
            return {**answer, "chunks": True}
        if name == "start":
            self._length = answer["length"]
        if name == "pop" and answer is not None and answer["status"] == "success":
            told = self._link.ask("exposure", timeout=timeout)
            if self._kind == "honest":
                pixel = self._link.shared_bytes(answer["place"], 2, self._length)
                told = float(pixel.view("<u2")[0])
            answer["exposure_us"] = told
        return answer


@contextmanager
def late_camera(fake: FakeGigECamera, chunks: Chunks, **options: Any) -> Iterator[AravisCamera]:
    """Open the camera on the wire, with chunks of a kind."""
    opening = aravis_camera.open_camera

    def open_with_chunks(*given: Any, **named: Any) -> Any:
        link = opening(*given, **named)
        return link if chunks == "none" else ChunkLink(link, chunks)

    with (
        mock.patch.object(aravis_camera, "open_camera", open_with_chunks),
        AravisCamera(Surroundings(RealClock()), fake.address, **options) as camera,
    ):
        yield camera


class Came(NamedTuple):
    """Frames taken, those of another exposure, refusals, and the latency that was measured."""

    taken: int
    wrong: int
    refused: int
    latency: int | None


def take_brackets(
    fake: FakeGigECamera, scene: Scene, chunks: Chunks, latency: int, measured: bool
) -> Came:
    """Take brackets of random exposures of a scene that changes, after a measurement or without."""
    rng, taken, wrong, refused, told = scene.rng, 0, 0, 0, None
    fake.set_latency(latency)
    with late_camera(fake, chunks) as camera:
        if measured:
            told = camera.measure_latency((1e-3, 4e-3))
        for _ in range(_BRACKETS):
            scene.rate = 3e5 * rng.uniform(0.4, 1.5)
            fake.mark_scene_changed()
            exposures = np.geomspace(_SHORTEST, _LONGEST, _EXPOSURES)
            for exposure in rng.permutation(exposures):
                if rng.random() < 0.3:
                    scene.rate = 3e5 * rng.uniform(0.4, 1.5)
                    fake.mark_scene_changed()
                try:
                    camera.set_exposure(float(exposure))
                    frame = camera.capture(lambda: False)
                except DeviceError as error:
                    print_message(f"  {error}")
                    refused += 1
                    continue
                taken += 1
                wrong += scene.is_wrong(frame.image, frame.exposure)
    return Came(taken, wrong, refused, told)


def camera_latency_figure(folder: Path) -> list[Figure]:
    """Exposures late by 0 to 8 frames: measured by the light, or found while frames are taken."""
    figures = []
    kinds: dict[Chunks, str] = {
        "none": "without chunks",
        "register": "chunks tell what is set",
        "honest": "chunks tell the truth",
    }
    for chunks, words in kinds.items():
        for measured in (True, False):
            how = "measured before" if measured else "not measured"
            name = f"late by 0 to 8 frames, {words}, {how}"
            goal = "0 frames of a wrong exposure" + (", latency right" if measured else "")
            try:
                figures.append(_figure(name, goal, chunks, measured))
            except (OSError, DeviceError) as error:
                figures.append(Figure(name, goal, f"no camera behind the wire: {error}", None))
    return figures


def _figure(name: str, goal: str, chunks: Chunks, measured: bool) -> Figure:
    scene = Scene(np.random.default_rng([_LATENCIES[-1], measured, len(chunks)]))
    with FakeGigECamera(scene.render, _SHAPE, "Mono16") as fake:
        came = [take_brackets(fake, scene, chunks, late, measured) for late in _LATENCIES]
    taken, wrong = sum(one.taken for one in came), sum(one.wrong for one in came)
    refused = sum(one.refused for one in came)
    # Frames that tell the truth are refused until the camera obeys: none is left to be counted.
    right = [0 if chunks == "honest" else late for late in _LATENCIES]
    off = sum(one.latency != late for one, late in zip(came, right, strict=True))
    text = f"{wrong} of {taken} wrong, {refused} refused"
    if measured:
        text += f"; {off} of {len(came)} latencies measured wrong"
    # A frame that is refused by name is none of a wrong exposure.
    good = not wrong and refused < taken and not (measured and off)
    return Figure(name, goal, text, good)


MEASUREMENTS = {"camera latency": camera_latency_figure}
