"""Brackets taken through a real GigE Vision link: no frame of another exposure than told."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from judges.wire_frames import telling, tells
from numpy.typing import NDArray

from drivers.aravis import AravisCamera
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from figures import Figure
from labapp.common.console import print_message
from simulator.wire.fake_gige import FakeGigECamera

_SHAPE = (64, 64)
_BRACKETS = 100
_EXPOSURES = 8
_SHORTEST = 2e-4
_STEP = 1.6
_PAUSE = 0.6
_PAUSES = 0.15
"""Part of the frames before which the reader pauses."""

_NAME = "bracket of 8 exposures x 100, latency 0-3 frames, pauses to 0.6 s"
_GOAL = "0 frames of a wrong exposure accepted"


class Brackets(NamedTuple):
    """What came of brackets: frames taken, those of another exposure, and refusals."""

    taken: int
    wrong: int
    refused: int


def wrong_exposures_figure(folder: Path) -> list[Figure]:
    """A camera that obeys late, a reader that sleeps: triggered and free-running."""
    found = []
    for trigger in ("software", "free"):
        print_message(f"  {trigger}")
        name = f"{_NAME}, {trigger}"
        try:
            came = brackets(trigger, _BRACKETS)
        except (OSError, DeviceError) as error:
            found.append(Figure(name, _GOAL, f"no camera behind the wire: {error}", None))
            continue
        asked = _BRACKETS * _EXPOSURES
        measured = f"{came.wrong} of {came.taken}; {came.refused} of {asked} refused by name"
        found.append(Figure(name, _GOAL, measured, not came.wrong and came.taken > asked // 2))
    return found


def brackets(trigger: Literal["software", "free"], count: int, seed: int = 0) -> Brackets:
    """Take brackets of a camera whose pictures tell how long they really were exposed."""
    rng = np.random.default_rng(seed)
    rate = 100.0 if trigger == "free" else 0.0
    taken = wrong = refused = 0
    with (
        FakeGigECamera(_picture, _SHAPE, "Mono16") as fake,
        AravisCamera(
            Surroundings(RealClock()), fake.address, trigger=trigger, frame_rate=rate
        ) as camera,
    ):
        for _ in range(count):
            fake.set_latency(int(rng.integers(4)))
            for exposure in _SHORTEST * _STEP ** rng.permutation(_EXPOSURES):
                if rng.random() < _PAUSES:
                    time.sleep(rng.uniform(0, _PAUSE))
                try:
                    setting = camera.set_exposure(float(exposure))
                    frame = camera.capture(lambda: False)
                except DeviceError as error:
                    print_message(f"  {error}")
                    refused += 1
                    continue
                taken += 1
                told = round(frame.exposure * 1e6)
                right = told == round(setting.actual * 1e6)
                wrong += not right or not tells(frame.image, told * 1e-6)
    return Brackets(taken, wrong, refused)


def _picture(exposure: float, gain_db: float) -> NDArray[np.uint16]:
    return telling(np.random.default_rng(), _SHAPE, exposure)


MEASUREMENTS = {"wrong-exposures": wrong_exposures_figure}
