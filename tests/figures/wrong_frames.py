"""Frames that can't be, on the wire of a GigE Vision camera: named, or taken without a word."""

from __future__ import annotations

import re
import time
from collections import Counter
from pathlib import Path

import numpy as np
from judges import wire_frames as made

from drivers.errors import DeviceError
from figures import Figure
from figures.wrong_frame_kinds import KINDS, SOUND, Wire
from labapp.common.console import print_message

_EXPOSURE = 1e-3
_EACH = 4
"""Cases that are drawn of each kind."""

_SOUND, _PER_CAMERA = 300, 10
_LATEST = 1.0


def wrong_frames_figure(folder: Path) -> list[Figure]:
    """Every kind of wrong frame some times over, and sound ones of the same cameras."""
    try:
        return [_wrong(), _sound()]
    except OSError as error:
        return [Figure("wrong frames", "0", f"no camera behind the wire: {error}", None)]


def _wrong(seed: int = 0) -> Figure:
    found: Counter[str] = Counter()
    times = []
    for number, kind in enumerate(KINDS):
        for case in range(_EACH):
            came, seconds = taken(kind, np.random.default_rng([seed, number, case]))
            found[came] += 1
            times.append(seconds)
            if came in ("accepted", "misnamed") or seconds > _LATEST:
                print_message(f"  {kind}, case {case}: {came}, {seconds:.2f} s")
    measured = f"{found['accepted']} accepted, {found['misnamed']} with another cause, "
    measured += f"{found['named']} named, {found['alike']} alike by chance; "
    measured += f"{np.median(times):.2f} s, slowest {max(times):.2f} s"
    name = f"{len(KINDS)} kinds of wrong frames x {_EACH} on the GigE wire"
    goal = f"accepted without a word: 0; named within {_LATEST:g} s"
    return Figure(name, goal, measured, not found["accepted"] and max(times) <= _LATEST)


def taken(kind: str, rng: np.random.Generator) -> tuple[str, float]:
    """What becomes of a wrong frame, and after how many seconds.

    One whose pixels are right by chance, as of a clipped picture, is as good as named.
    """
    words, names, scenes, set_up = KINDS[kind]
    wire = Wire(rng, names, scenes)
    set_up(wire)
    with wire.open() as fake:
        began = time.monotonic()
        try:
            with wire.driver() as camera:
                camera.set_exposure(_EXPOSURE)
                if wire.then is not None:
                    for _ in range(4):
                        camera.capture(_never)
                    wire.then(fake)
                began = time.monotonic()
                for _ in range(2):
                    image = camera.capture(_never).image
                if np.array_equal(image, wire.last):
                    return "alike", time.monotonic() - began
        except DeviceError as error:
            named = re.search(words, str(error)) is not None
            if not named:
                print_message(f"    {error}")
            return "named" if named else "misnamed", time.monotonic() - began
    return "accepted", time.monotonic() - began


def _sound(seed: int = 1) -> Figure:
    """Frames of drawn sensors, scenes, formats and options, compared with what was sent."""
    right = refused = wrong = 0
    for number in range(_SOUND // _PER_CAMERA):
        wire = Wire(np.random.default_rng([seed, number]), SOUND, made.SCENES)
        wire.draw_sound()
        with wire.open() as fake, wire.driver() as camera:
            camera.set_exposure(_EXPOSURE)
            for frame in range(_PER_CAMERA):
                wire.light = made.scene(wire.rng, made.SCENES[frame % 5], wire.shape)
                fake.mark_scene_changed()
                try:
                    image = camera.capture(_never).image
                except DeviceError as error:
                    print_message(f"  {wire.name} {wire.shape}: {error}")
                    refused += 1
                    continue
                same = np.array_equal(image, wire.last)
                right, wrong = right + same, wrong + (not same)
    measured = f"{refused} refused, {wrong} read wrong, {right} right"
    return Figure(f"{_SOUND} sound frames on the GigE wire", "0 refused", measured, right == _SOUND)


def _never() -> bool:
    return False


MEASUREMENTS = {"wrong-frames": wrong_frames_figure}
