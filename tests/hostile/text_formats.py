"""The text formats that labapp reads, with a good text of each, and seeded damage to it."""

from __future__ import annotations

import json
import random
import re
import time
import tomllib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from small_bench.files import PLAN, SmallFiles, bench_text, scene_text, write_small

from labapp.bench.opening import BenchFiles, BenchSetup, build_world, open_bench, read_scene
from labapp.common.errors import UserError
from labapp.files.bench_file import read_bench
from labapp.files.cubes import read_cube
from labapp.files.fault_file import read_faults
from labapp.files.lut_file import read_lut
from labapp.files.panel_file import PanelTable, read_panel
from labapp.files.plan_file import read_plan
from labapp.files.reading import bundled_path
from labapp.files.sensor_file import SensorTable, read_sensor
from labapp.files.spectrum_file import read_spectra
from labapp.runs.acquisition.feasibility import feasible_shots
from labapp.runs.capabilities import BenchCapabilities
from labapp.training.edof.config import read_edof_config
from simulator.clock import VirtualClock

_PLAN = (
    PLAN
    + """repeats = 2
order = ["exposure"]
together = [["wavelength", "exposure"]]
[[acquire.interleave]]
role = "dark"
every = 2
frames = 2
[patterns.both]
kind = "video"
frames = ["neutral", "lens"]
[targets.star]
prompt = "place it"
distance_m = 2.0
[metadata]
sample = 1
"""
)
_ENVI = """ENVI
samples = 3
lines = 2
bands = 2
header offset = 0
data type = 4
interleave = bsq
byte order = 0
wavelength = {450, 550}
wavelength units = Nanometers
data gain values = {1, 2}
reflectance scale factor = 2
pixel size = {1e-5, 1e-5, units=Meters}
"""
_FAULT = 'version = 1\n[[fault]]\ndevice = "camera"\nkind = "slow"\nframe = 3\nseconds = 1.5\n'

_INTRUDERS = (
    "nan", "inf", "-inf", "1e999", "-1", "0", "1e-320", "9" * 5000, "0x" + "F" * 200,
    '"\\u0000"', '"\\ud800"', "[]", "{}", "[[[[", "{a={a={", '"""', "true", '""', "1979-05-27",
    "a.b.c", "\0", "\x1b[2J", "\u202e", "=", "\n", "[x]", "[[acquire]]", ",", '"', "#", "1_0",
    "..", "10000", "100000", "1000000000", "4294967295", "1e300", '"/dev/zero"', "a" * 300,
    '"' + "a" * 5000 + '"', "\ufeff", "\r", "\t", ";", "{", "}", "[nan]", "[1e300]", "." * 90,
    "a" + ".a" * 3000, " " * 3000, "[" * 3000,
)  # fmt: skip
"""What damage puts into a text: numbers at the ends of their ranges, brackets, controls."""

_NUMBER, _TEXT, _VALUE = (
    re.compile(r"-?\d+\.?\d*(?:e-?\d+)?"), re.compile(r'"[^"\n]*"'), re.compile(r"(?<== )[^\n]+"),
)  # fmt: skip


@dataclass(frozen=True)
class TextFormat:
    """A format of text. name: of the file. read: reads a file and builds what it describes."""

    name: str
    text: str
    read: Callable[[Path], object]


@dataclass
class Damaged:
    """What became of damaged texts: how many were read all the same, and what went wrong.

    longest: the most processor time that one took, in seconds.
    """

    read: int = 0
    named: int = 0
    longest: float = 0.0
    unexpected: dict[str, str] = field(default_factory=dict)


def text_formats(folder: Path) -> Mapping[str, TextFormat]:
    """The formats by name; a small bench is written to the folder for those that need one."""
    small = write_small(folder / "small")
    (folder / "cube.raw").write_bytes(np.ones(12, np.float32).tobytes())
    bundled = bundled_path("panels"), bundled_path("sensors")
    panel, sensor = (next(iter(sorted(one.glob("*.toml"), reverse=True))) for one in bundled)
    plans, grey = _Plans(small), "\n".join(f"{k}, {k / 10}, {k / 12}" for k in range(16))
    lines = "\n".join(f"{400 + 20 * k}, {k / 10}, {k / 12}" for k in range(16))
    found = (
        TextFormat("plan.toml", _PLAN, plans.expand),
        TextFormat("plan.json", json.dumps(tomllib.loads(_PLAN), indent=1), plans.expand),
        TextFormat("bench.toml", bench_text(), lambda path: read_bench(path).build_camera()),
        TextFormat("scene.toml", _scene(small), plans.stage),
        TextFormat("scene2.toml", _charts(), plans.stage),
        TextFormat("panel.toml", panel.read_text(), lambda path: _panel(path).build()),
        TextFormat("sensor.toml", sensor.read_text(), lambda path: _sensor(path).build()),
        TextFormat("faults.toml", _FAULT, read_faults),
        TextFormat("lut.csv", f"grey, 532, 633\n{grey}\n", plans.respond),
        TextFormat("spectra.csv", f"nm,a,b\n{lines}\n", read_spectra),
        TextFormat("cube.hdr", _ENVI, read_cube),
        TextFormat(
            "training.toml", bundled_path("edof-training.toml").read_text(), read_edof_config
        ),
    )
    return {one.name: one for one in found}


class _Plans:
    """What a plan, a scene and a look-up table are built with: a small bench."""

    def __init__(self, small: SmallFiles) -> None:
        self._small = small
        self._bench = read_bench(small.bench)
        self._camera = self._bench.build_camera()
        setup = self._setup(small.scene)
        with open_bench(setup, speed=1e9) as opened:
            self._capabilities = BenchCapabilities.of(opened)

    def _setup(self, scene: Path) -> BenchSetup:
        read = read_scene(BenchFiles(self._small.bench, scene))
        return BenchSetup(self._bench, read, str(self._small.bench), str(scene))

    def expand(self, path: Path) -> object:
        return feasible_shots(read_plan(path).plan, self._capabilities, str(path))

    def stage(self, path: Path) -> object:
        return build_world(self._camera, self._setup(path), VirtualClock(1e9))

    def respond(self, path: Path) -> object:
        """Whoever builds a panel turns its ValueErrors into errors that name the file."""
        table = read_lut(path, 16)
        with suppress(ValueError):
            return table.build(self._camera.panel)
        return None


def _panel(path: Path) -> PanelTable:
    return read_panel(path.name, path.parent).resolve_files(path.parent)


def _sensor(path: Path) -> SensorTable:
    return read_sensor(path.name, path.parent).resolve_files(path.parent)


def _scene(small: SmallFiles) -> str:
    return scene_text(5.0).replace("picture.png", str(small.folder / "picture.png"))


def _charts() -> str:
    """A bundled scene of many kinds of targets, which needs no other file."""
    return bundled_path("scenes").joinpath("charts.toml").read_text()


def read_damaged(form: TextFormat, count: int, seed: int, folder: Path) -> Damaged:
    """Damage a format's text `count` times and read it. Other exceptions than UserError count."""
    rng, found, path = random.Random(f"{seed} {form.name}"), Damaged(), folder / form.name
    for number in range(count):
        text = _damage(form.text, rng)
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        begun = time.process_time()
        try:
            form.read(path)
            found.read += 1
        except UserError as error:
            found.named += 1
            if len(str(error)) > 2100:
                found.unexpected.setdefault("an error of more than 2000 characters", text)
        except Exception as error:
            told = f"{form.name}, number {number}: {type(error).__name__}: {error}"
            found.unexpected.setdefault(told[:300], text)
        found.longest = max(found.longest, time.process_time() - begun)
    return found


def _damage(text: str, rng: random.Random) -> str:
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        text = rng.choice(_DAMAGES)(text, rng)
    return text


def _overwrite(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + chr(rng.randrange(0x250)) + text[at + 1 :]


def _cut(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + text[at + rng.randrange(1, 40) :]


def _insert(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice(_INTRUDERS) + text[at:]


def _repeat_line(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    lines.insert(rng.randrange(len(lines)), rng.choice(lines))
    return "\n".join(lines)


def _drop_line(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    del lines[rng.randrange(len(lines))]
    return "\n".join(lines)


def _replace(pattern: re.Pattern[str]) -> Callable[[str, random.Random], str]:
    def damage(text: str, rng: random.Random) -> str:
        found = list(pattern.finditer(text))
        if not found:
            return text
        one = rng.choice(found)
        return text[: one.start()] + rng.choice(_INTRUDERS) + text[one.end() :]

    return damage


def _swap_values(text: str, rng: random.Random) -> str:
    found = list(_VALUE.finditer(text))
    if not found:
        return text
    one, other = rng.choice(found), rng.choice(found)
    return text[: one.start()] + other[0] + text[one.end() :]


_DAMAGES = (
    _overwrite, _cut, _insert, _repeat_line, _drop_line, _replace(_NUMBER), _replace(_TEXT),
    _replace(_VALUE), _swap_values,
)  # fmt: skip
