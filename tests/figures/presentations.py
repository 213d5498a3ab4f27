"""Whether every frame of a video comes in order, and every one that comes late is told."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np

from drivers.clock import RealClock
from drivers.interfaces import Surroundings
from drivers.screen import ScreenSLM
from drivers.screen.identify import list_screens
from drivers.screen.screen_choice import ScreenRequest, choose_screen
from figures import Figure
from figures.screen import TROUBLES
from figures.video_eye import Verdict, judge, watch
from simulator.screens import XServer, xorg

_FRAMES = 60
_SECONDS = 10.0
_STOPPED = (5e-3, 0.2)
"""Seconds for which the player is held up, from and to."""

_PLAYS = (0.1, 0.6)
"""Seconds between two times."""

_AFTERWARDS = 0.2
"""Seconds between the last look and the account."""


def presentations_figures(folder: Path) -> list[Figure]:
    """A video of 60 frames at 60 Hz left to itself, and one whose player is held up."""
    name = "60-frame video at 60 Hz, 10 s, seen by an eye on the screen"
    held = "the same with its player held up at random moments"
    goal = "all frames in order; 0 missed presentations unreported"
    try:
        with xorg(folder) as server:
            alone, _ = watched_video(server, _SECONDS)
            disturbed, times = watched_video(server, _SECONDS, hold_up=True)
    except TROUBLES as error:
        why = f"not measured: {error}"
        return [Figure(name, goal, why, None), Figure(held, goal, why, None)]
    return [
        Figure(name, goal, _words(alone), alone.good),
        Figure(held, goal, f"held up {times} times: {_words(disturbed)}", disturbed.good),
    ]


def watched_video(
    server: XServer, seconds: float, *, hold_up: bool = False, seed: int = 0
) -> tuple[Verdict, int]:
    """The verdict on a video of noise, and how often its player was held up."""
    rng = np.random.default_rng(seed)
    # Its times are time.monotonic()'s, as the eye's.
    surroundings = Surroundings(RealClock(0.0))
    with ScreenSLM(surroundings, display=server.display) as slm:
        height, width = slm.shape
        wanted = ScreenRequest("", width, height, 1 / slm.frame_time, allow_primary=False)
        region = choose_screen(wanted, list_screens(server.display)).region
        video = rng.integers(0, 256, (_FRAMES, *slm.shape), np.uint8)
        window = int(slm.health()["window's process"])
        slm.play("video", video)
        brake = Brake(window, rng)
        try:
            meanwhile = brake.look if hold_up else _leave_alone
            seen = watch(server.display, region, video, seconds, meanwhile)
        finally:
            brake.let_go()
        # No frame is overdue when it is asked.
        time.sleep(_AFTERWARDS)
        told = slm.presentations()
    return judge(seen, told, _FRAMES), brake.times


class Brake:
    """Holds a process up at random moments, for a random time, as a busy computer does."""

    def __init__(self, process: int, rng: np.random.Generator) -> None:
        self._process, self._rng = process, rng
        self._next = time.monotonic() + rng.uniform(*_PLAYS)
        self._holds = False
        self.times = 0

    def look(self, now: float) -> None:
        """Hold it up, or let it go, if it is time for that."""
        if now < self._next:
            return
        if self._holds:
            self.let_go()
        else:
            os.kill(self._process, signal.SIGSTOP)
            self._holds = True
            self.times += 1
        self._next = now + self._rng.uniform(*(_STOPPED if self._holds else _PLAYS))

    def let_go(self) -> None:
        if self._holds:
            os.kill(self._process, signal.SIGCONT)
            self._holds = False


def _leave_alone(now: float) -> None:
    pass


def _words(found: Verdict) -> str:
    if not found.frames:
        return "no frame seen"
    order = f"{found.backwards} out of" if found.backwards else "in"
    words = (
        f"{found.frames} frames {order} order at {1 / found.period:.2f} Hz, {found.missed} "
        f"misses seen, {found.reported} reported, {found.unreported} unreported"
    )
    more = {
        "looks at no frame": found.torn,
        "not there when told": found.untrue,
        "gone between two looks": found.unseen,
    }
    return ", ".join([words, *(f"{n} {what}" for what, n in more.items() if n)])


MEASUREMENTS = {"presentations": presentations_figures}
