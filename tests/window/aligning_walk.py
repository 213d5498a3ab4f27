"""A person before a star that is out of focus: found, focused, exposed, bracketed and restored.

As a script, `python aligning_walk.py FOLDER` walks on the virtual bench, in a window of its own on
an X server in memory, and prints what was found as one JSON line.
"""

from __future__ import annotations

import json
import math
import os
import re
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

from person import Person
from PySide6.QtCore import Qt
from window_bench import Bench

from labapp.files.reading import bundled_path
from labapp.window.measuring_messages import BracketProposal, ExposureFound, PictureMeasured
from labapp.window.messages import ReconstructionResult, RunEnded

NEAR, FOCUSED = 1.9, 2.0
"""Metres to star and photograph, and at which the lens is focused."""

ILLUMINATED_RADIUS = math.hypot(8.64e-3, 15.36e-3) / 2
"""Metres from the middle of the panel to its corners, within the stop: where Zernike polynomials
have their radius."""

_FIRST_STEP, _LAST_STEP = 300.0, 75.0
"""Steps of the search for focus, nm rms of Zernike defocus."""

_PATIENCE = 100.0
"""Seconds for what is computed on the virtual bench, however busy the machine is."""


def defocus_nm() -> float:
    """Zernike defocus that brings what stands nearer into focus, nm rms.

    By the sag of its wave over a thin lens, r²/2 (1/d - 1/d₀), of which the polynomial √3 (2ρ² - 1)
    has 1/2√3 as its rms. The panel takes away what is too much.
    """
    path = ILLUMINATED_RADIUS**2 / 2 * (1 / NEAR - 1 / FOCUSED)
    return -path / (2 * math.sqrt(3)) * 1e9


@dataclass
class Walked:
    """What was found on the way. seconds: at the end of each step since the window was shown."""

    seconds: dict[str, float] = field(default_factory=dict)
    first_fwhm: float = 0.0
    fwhm: float = 0.0
    defocus: float = 0.0
    level: float = 0.0
    exposures: tuple[int, int] = (0, 0)
    scores: tuple[tuple[float, float], tuple[float, float]] | None = None
    residual: float | None = None


def bring_nearer(scene: str) -> str:
    """A scene file's text with star and photograph nearer than the lens is focused."""
    for name in ("star", "photograph"):
        whole = re.search(rf"\[targets\.{name}\].*?distance_m = 2\.0", scene, re.DOTALL)
        assert whole is not None
        scene = scene.replace(whole[0], whole[0].replace("= 2.0", f"= {NEAR}"))
    return scene.replace('"photograph.jpg"', f'"{bundled_path("photograph.jpg")}"')


class Walk:
    """By clicks and keys alone, reading what the window shows."""

    def __init__(self, bench: Bench, person: Person) -> None:
        self._bench, self._person, self._window = bench, person, bench.window
        self._align = bench.window.alignment
        self._began = time.monotonic()
        self.found = Walked()

    def go(self) -> Walked:
        self._find()
        self._focus()
        self._expose(60)
        self._bracket("Star")
        self._person.chooses(self._window.settings.target, "photograph")
        self._waits(lambda: self._bench.frame.target == "photograph")
        self._bracket("Photo")
        self._note("bracketed")
        self._acquire()
        self._restore()
        return self.found

    def _waits(self, seen) -> None:
        self._person.waits(seen, patience=_PATIENCE)

    def _note(self, step: str) -> None:
        self.found.seconds[step] = round(time.monotonic() - self._began, 1)

    def _find(self) -> None:
        person, align = self._person, self._align
        person.presses(Qt.Key.Key_F9)
        person.chooses(self._window.settings.target, "star")
        self._waits(lambda: self._bench.frame is not None and self._bench.frame.target == "star")
        # In focus, it will be brighter by far.
        self._expose(10)
        person.clicks(align.find_star)
        self._waits(align.region.isChecked)
        self.found.first_fwhm = self._fwhm()
        self._note("found")

    def _expose(self, percent: int) -> None:
        self._person.types(self._align.level, str(percent))
        self._bench.reports.clear()
        self._person.clicks(self._align.expose)
        self._waits(lambda: self._bench.last(ExposureFound) is not None)
        exposure = self._bench.last(ExposureFound).exposure
        self._waits(lambda: self._bench.frame.exposure == exposure)
        self.found.level = self._bench.last(ExposureFound).level
        self._note("exposed")

    def _focus(self) -> None:
        """Step by step downhill, then with half the step, by the width that the panel shows."""
        form = self._window.pattern.form
        self._person.chooses(form.kind, "Aberrations")
        self._person.types(form.numbers["zernike", "spherical"], "0")
        best, step, seen = 0.0, _FIRST_STEP, {0.0: self.found.first_fwhm}
        while step >= _LAST_STEP:
            for tried in (best - step, best + step):
                if tried not in seen:
                    seen[tried] = self._fwhm_at(tried)
            least = min(seen, key=lambda one: seen[one])
            best, step = least, step if least != best else step / 2
        self.found.fwhm, self.found.defocus = self._fwhm_at(best), best
        self._note("focused")

    def _fwhm_at(self, defocus: float) -> float:
        window, form = self._window, self._window.pattern.form
        before = self._bench.frame.pattern
        self._person.types(form.numbers["zernike", "defocus"], f"{defocus:g}")
        self._person.clicks(window.pattern.show_button)
        self._waits(lambda: self._bench.frame.pattern != before)
        return self._fwhm()

    def _fwhm(self) -> float:
        """Of a picture that was taken after this was asked for, as the panel shows it."""
        number = self._bench.frame.number

        def is_new() -> bool:
            told = self._bench.last(PictureMeasured)
            return told is not None and told.number > number and told.region is not None

        self._waits(is_new)
        shown = re.search(r"FWHM ([\d.]+) px", self._align.star.text())
        return float(shown[1]) if shown else math.inf

    def _bracket(self, row: str) -> None:
        person, align, run = self._person, self._align, self._window.run
        person.chooses(align.row, row)
        self._bench.reports.clear()
        person.clicks(align.propose)
        self._waits(lambda: self._bench.last(BracketProposal) is not None)
        person.clicks(align.accept)
        self.found.exposures = run.star.bracket.count, run.photograph.bracket.count

    def _acquire(self) -> None:
        self._bench.reports.clear()
        self._person.presses(Qt.Key.Key_F6)
        asks = self._window.prompt_bar
        self._waits(lambda: asks.is_asking or self._bench.last(RunEnded) is not None)
        while asks.is_asking:
            # Without its pattern, the star is out of focus: the window doubts it, rightly.
            assert "focus" in asks.text
            self._person.clicks(asks.other_button)
            self._waits(lambda text=asks.text: asks.text != text)
            self._waits(lambda: asks.is_asking or self._bench.last(RunEnded) is not None)
        assert self._bench.last(RunEnded).state == "COMPLETE", self._bench.last(RunEnded)
        self._note("acquired")

    def _restore(self) -> None:
        self._waits(self._window.actions_["reconstruct"].isEnabled)
        self._bench.reports.clear()
        self._person.presses(Qt.Key.Key_F7)
        self._waits(lambda: self._bench.last(ReconstructionResult) is not None)
        result = self._bench.last(ReconstructionResult)
        self._waits(lambda: self._window.tabs.currentWidget() is self._window.reconstruction)
        self.found.scores, self.found.residual = result.scores, result.residual
        self._note("restored")


def walk_on_virtual_bench(folder: Path) -> Walked:
    """On the bundled bench before the nearer scene, from the moment that the window is shown."""
    from PySide6.QtTest import QTest

    scene = folder / "near.toml"
    scene.write_text(bring_nearer(bundled_path("scene.toml").read_text()))
    bench = Bench(folder, scene=scene)
    try:
        walk = Walk(bench, Person(bench, QTest))
        walk._waits(lambda: bench.frame is not None)
        return walk.go()
    finally:
        bench.close()


def main() -> None:
    from simulator.screens import xvfb

    with xvfb(1600, 900) as server:
        os.environ.update(DISPLAY=server.display, QT_QPA_PLATFORM="xcb")
        from PySide6.QtWidgets import QApplication

        from labapp.window import theme

        application = QApplication(["walk"])
        theme.apply_theme(application)
        found = walk_on_virtual_bench(Path(sys.argv[1]))
        print(json.dumps(asdict(found)), flush=True)
        application.shutdown()


if __name__ == "__main__":
    main()
