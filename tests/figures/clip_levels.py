"""Cameras whose numbers end elsewhere than their pixel format: what the self-test and metering say.

A converter is modelled here: electrons by chance, a whole number of so many bits, shifted to the
upper end of its container or not.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typer.testing import CliRunner

from drivers.errors import DeviceError
from figures import Figure
from labapp.cli import app
from labapp.common.console import print_message
from simulator.wire.fake_gige import FakeGigECamera

_SHAPE = (96, 128)
_FULL_WELL = 12000.0
_READ = 3.0
_SCENES = ("star", "patch")

_OFF = 0.05
"""Deviation of the metered brightest light from the true one, relative, that is allowed."""


@dataclass(frozen=True)
class Converter:
    """Bits of a camera's converter, the pixel format that its numbers are sent in, and the shift.

    black: number without light, before the shift.
    """

    bits: int
    form: str
    shift: int
    black: float

    @property
    def gain(self) -> float:
        """Electrons per number as it is sent."""
        return _FULL_WELL / 2**self.bits / 2**self.shift

    @property
    def clip(self) -> int:
        """Return the number at which the camera clips, as it is sent."""
        return (2**self.bits - 1) << self.shift

    @property
    def container(self) -> int:
        """Return the bits of the numbers in this pixel format."""
        return int("".join(letter for letter in self.form if letter.isdigit()))


@dataclass
class Bench:
    """A lit patch, or a star and its halo, before a converter. rates: electrons per second."""

    converter: Converter
    rates: NDArray[np.float64]
    rng: np.random.Generator

    def render(self, exposure: float, gain_db: float) -> NDArray[np.uint16]:
        c = self.converter
        electrons = self.rng.poisson(self.rates * exposure) + self.rng.normal(0, _READ, _SHAPE)
        number = np.rint(electrons / (c.gain * 2**c.shift) + c.black)
        return (np.clip(number, 0, 2**c.bits - 1).astype(np.uint16) << c.shift).astype(np.uint16)


def converters(rng: np.random.Generator) -> list[Converter]:
    """Draw a converter of each kind: 8, 10, 12 bits in containers of 8, 16 bits, or packed."""
    kinds = [
        (8, "Mono8", 0), (8, "Mono10", 0), (8, "Mono10p", 2), (8, "Mono16", 0), (8, "Mono16", 8),
        (10, "Mono10", 0), (10, "Mono10Packed", 0), (10, "Mono12", 0), (10, "Mono12p", 2),
        (10, "Mono12Packed", 0), (10, "Mono16", 0), (10, "Mono16", 6),
        (12, "Mono12", 0), (12, "Mono12p", 0), (12, "Mono12Packed", 0), (12, "Mono16", 0),
        (12, "Mono16", 4),
    ]  # fmt: skip
    return [
        Converter(bits, form, shift, float(np.rint(2**bits * rng.uniform(0.008, 0.06))))
        for bits, form, shift in kinds
    ]


def draw_scene(rng: np.random.Generator, kind: str) -> NDArray[np.float64]:
    """Draw what is before the camera, in electrons per second: its brightest clips it or nearly."""
    y, x = np.mgrid[: _SHAPE[0], : _SHAPE[1]]
    cy, cx = rng.uniform(30, 60), rng.uniform(30, 90)
    peak = 10 ** rng.uniform(6.0, 7.5)
    if kind == "star":
        width = rng.uniform(2.5, 5.0)
        return 30.0 + peak * np.exp(-((y - cy) ** 2 + (x - cx) ** 2) / (2 * width**2))
    return peak * (0.02 + 0.98 * (x / x.max()) ** rng.uniform(1, 3) * (0.5 + y / y.max() / 2))


_BENCH = """version = 1
name = "bench behind a converter"
transmission = 0.8
panel = {{ file = "pluto-vis-016-hr", unmodulated = 0.1 }}
[lens]
focal_length_mm = 125.0
f_number = 8.0
focus_distance_m = 2.0
[sensor]
model = "converter"
width = {width}
height = {height}
pitch_um = 3.45
bits = {bits}
full_well_electrons = 1e6
gain_electrons_per_dn = {gain}
read_noise_electrons = {read}
dark_current_electrons_per_s = 0.0
black_level_dn = {black}
quantum_efficiency = 0.6
shortest_exposure_us = 20.0
longest_exposure_s = 5.0
{clip}
[devices.slm]
driver = "simulated-slm"
[devices.filter]
driver = "simulated-filter"
options = {{ range_nm = [420.0, 720.0], bandwidth_nm = 7.0, settling_ms = 0.0 }}
[devices.camera]
driver = "aravis-camera"
options = {{ address = "127.0.0.1", pixel_format = "{form}"{latency} }}
[devices.targets]
driver = "simulated-targets"
"""


def write_bench(path: Path, converter: Converter, told: dict[str, Any]) -> None:
    """Write the bench file of a camera; `told` is what the self-test said that it should say."""
    clip = f"clip_level_dn = {told['clip_level_dn']:.0f}" if "clip_level_dn" in told else ""
    latency = f", latency_frames = {told['latency_frames']:.0f}" if "latency_frames" in told else ""
    text = _BENCH.format(
        width=_SHAPE[1], height=_SHAPE[0], bits=converter.container, gain=converter.gain,
        read=_READ, black=told.get("black_level_dn", converter.black * 2**converter.shift),
        clip=clip, form=converter.form, latency=latency,
    )  # fmt: skip
    path.write_text(text)


def run_labapp(*words: object) -> tuple[int, Any, str]:
    """Run a command of labapp; return its exit code, its JSON if it printed some, and its text."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    text = done.output + (str(done.exception) if done.exception else "")
    start = done.output.find("{")
    data = None
    if start >= 0:
        try:
            data = json.loads(done.output[start:])
        except ValueError:
            data = None
    return done.exit_code, data, text


def self_test(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return what `devices test camera` says that the bench file should say, and its checks."""
    _, data, text = run_labapp("devices", "test", "camera", "--bench", path, "--json")
    if data is None:
        raise OSError(text[-300:])
    lines = [line.split("#")[0].split("=") for line in data["should_say"]]
    return {name.strip(): float(value) for name, value in lines}, data["checks"]


def meter(path: Path) -> tuple[float | None, str]:
    """Return the brightest light that `labapp bracket` meters, electrons/s, and its words."""
    words = ("--target", "star", "--snr-db", 40, "--decades", 4, "--most-frames", 200, "--json")
    code, data, text = run_labapp("bracket", "--bench", path, *words)
    if code or data is None:
        return None, text[-400:]
    return data["electrons_per_s"][1], data["metered"][0]["remark"]


@dataclass
class Counts:
    """What came of the cameras: how many, and how many of them were wrong, and unknown."""

    cameras: int = 0
    wrong: int = 0
    unknown: int = 0
    clip_levels: int = 0
    latencies: int = 0

    def add(self, light: float | None, words: str, true: float) -> None:
        """Count a metered light as right, wrong, or told as unknown."""
        self.cameras += 1
        if light is None or "clip level is unknown" in words:
            self.unknown += 1
            print_message(f"  told: {words[:160]}")
        elif abs(light / true - 1) > _OFF:
            self.wrong += 1
            print_message(f"  metered {light:.4g} of {true:.4g} electrons/s; {words}")


def clip_levels_figure(folder: Path) -> list[Figure]:
    """Metered light with the clip level untold, and after what the self-test says is written."""
    cameras = f"{len(converters(np.random.default_rng(0)))} cameras"
    names = (f"{cameras}, clip level untold: light metered", f"{cameras}, after devices test")
    goals = ("within 5 %, or told as unknown", "within 5 %, clip levels and latencies right")
    try:
        untold, told = _measured(folder, np.random.default_rng(0))
    except (OSError, DeviceError) as error:
        return [
            Figure(name, goal, f"no camera behind the wire: {error}", None)
            for name, goal in zip(names, goals, strict=True)
        ]
    words = f"{untold.wrong} of {untold.cameras} off, {untold.unknown} told as unknown"
    after = f"{told.wrong} of {told.cameras} off, {told.unknown} told as unknown; clip levels of "
    after += f"{told.clip_levels} wrong, latencies of {told.latencies}"
    well = not (told.wrong or told.unknown or told.clip_levels or told.latencies)
    return [
        Figure(names[0], goals[0], words, not untold.wrong),
        Figure(names[1], goals[1], after, well),
    ]


def _measured(folder: Path, rng: np.random.Generator) -> tuple[Counts, Counts]:
    untold, told = Counts(), Counts()
    for number, converter in enumerate(converters(rng)):
        kind = _SCENES[number % len(_SCENES)]
        print_message(f"  {converter.bits} bits in {converter.form}, {kind}")
        bench = Bench(converter, draw_scene(rng, kind), rng)
        late, true = int(rng.integers(9)), float(bench.rates.max())
        path = folder / "bench.toml"
        with FakeGigECamera(bench.render, _SHAPE, converter.form, latency=late):
            write_bench(path, converter, {})
            untold.add(*meter(path), true)
            said, _ = self_test(path)
            told.clip_levels += said.get("clip_level_dn") != converter.clip
            told.latencies += said.get("latency_frames") != late
            write_bench(path, converter, said)
            told.add(*meter(path), true)
    return untold, told


MEASUREMENTS = {"clip levels": clip_levels_figure}
