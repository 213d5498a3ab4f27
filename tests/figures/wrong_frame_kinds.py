"""Kinds of wrong frames of a GigE Vision camera, drawn by seed, and a camera that sends them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from judges import wire_frames as made

from drivers.aravis import AravisCamera
from drivers.clock import RealClock
from drivers.interfaces import Surroundings
from simulator.wire.fake_gige import CameraFault, FakeGigECamera

ADDRESS = "127.0.0.1"

_WORDS, _DEEP = ("Mono10", "Mono12", "Mono14"), ("Mono12", "Mono12p", "Mono12Packed", "Mono16")
_LIT = ("flat", "bars", "shading")
_ANY = (*_LIT, "stars", "dark")
SOUND = ("Mono8", "Mono10Packed", "Mono10p", *_WORDS, *_DEEP, "Mono16")


class Wire:
    """One camera on the wire, whose frames are made here.

    how: makes a picture's bytes, from the picture and the frames before. light: what is in front.
    """

    def __init__(self, rng: np.random.Generator, names: tuple[str, ...], scenes: tuple[str, ...]):
        self.rng = rng
        self.name = str(rng.choice(names))
        self.shape = tuple(int(size) for size in rng.choice([32, 48, 64, 96, 128], 2))
        self.sensor = made.Sensor.drawn(rng, made.bits_of(self.name))
        self.light = made.scene(rng, str(rng.choice(scenes)), self.shape)  # type: ignore[arg-type]
        self.how: Callable[[made.Picture], made.Bytes] = lambda p: made.sent(p, self.name)
        self.before: list[made.Bytes] = []
        self.last = np.zeros(self.shape, np.uint16)
        self.step = 1
        self.camera: dict[str, Any] = {}
        self.options: dict[str, Any] = {}
        self.then: Callable[[FakeGigECamera], object] | None = None

    def open(self) -> FakeGigECamera:
        return FakeGigECamera(
            self._picture,
            self.shape,
            self.name,
            address=ADDRESS,
            pack=lambda picture, form: self._bytes(picture),
            **self.camera,
        )

    def driver(self) -> AravisCamera:
        around = Surroundings(RealClock())
        given = {"pixel_format": self.name, "latency_frames": 0, **self.options}
        return AravisCamera(around, ADDRESS, **given)

    def draw_sound(self) -> None:
        """Draw what a sound camera may do: fewer bits, padding that it tells, or a stated order."""
        bits = made.bits_of(self.name)
        if self.name in _WORDS and self.rng.random() < 0.5:
            self.options = {"byte_order": "big"}
            self.how = lambda picture: made.words(picture, big=True)
        elif self.name in _WORDS and self.rng.random() < 0.5:
            self.options = {"justification": "left"}
            self.how = lambda picture: made.words(picture, left=16 - bits)
        elif self.name == "Mono16":
            self.step = 2 ** int(self.rng.choice([0, 2, 4, 6, 8]))
            self.sensor = made.Sensor.drawn(self.rng, 16 - self.step.bit_length() + 1)
        elif self.rng.random() < 0.4:
            length = 4 * int(self.rng.integers(1, 9))
            self.how = lambda picture: made.padded(picture, self.name, length)
            self.camera = {"leader": {"padding": length}, "more_bytes": length * self.shape[0]}

    def _picture(self, exposure: float, gain_db: float) -> made.Picture:
        light = self.light * 10 ** (gain_db / 20)
        self.last = self.sensor.numbers(self.rng, light) * np.uint16(self.step)
        return self.last

    def _bytes(self, picture: made.Picture) -> made.Bytes:
        data = self.how(picture)
        self.before.append(data)
        return data


Kind = Callable[[Wire], None]


def _sends(how: Callable[[Wire, made.Picture], made.Bytes], **camera: Any) -> Kind:
    def set_up(wire: Wire) -> None:
        wire.how = lambda picture: how(wire, picture)
        wire.camera = camera

    return set_up


_BIG = _sends(lambda wire, picture: made.words(picture, big=True))


def _sends_as(name: str) -> Kind:
    return _sends(lambda wire, picture: made.sent(picture, name))


def _cut(wire: Wire, picture: made.Picture) -> made.Bytes:
    return made.sent(picture, wire.name)[:-40]


def _left(wire: Wire) -> int:
    return 16 - made.bits_of(wire.name)


def _becomes(**values: float) -> Kind:
    def set_up(wire: Wire) -> None:
        wire.then = lambda fake: fake.set_features(**values)

    return set_up


def _leads(**told: float) -> Kind:
    def set_up(wire: Wire) -> None:
        wire.camera = {"leader": told}

    return set_up


def _repeats(back: int) -> Kind:
    def set_up(wire: Wire) -> None:
        def begin(fake: FakeGigECamera) -> None:
            kept = wire.before[-back]
            wire.how = lambda picture: kept

        wire.then = begin

    return set_up


def _sheared(wire: Wire, picture: made.Picture) -> made.Bytes:
    """Padded lines in a frame that isn't larger."""
    length = 4 * int(wire.rng.integers(1, 5))
    wire.how = lambda one: made.padded(one, wire.name, length)[: made.sent(one, wire.name).size]
    return wire.how(picture)


def _drawn_pattern(wire: Wire, picture: made.Picture) -> made.Bytes:
    top = 2 ** made.bits_of(wire.name) - 1
    return made.sent(made.pattern(wire.rng, picture.shape, top), wire.name)


def _pause(wire: Wire) -> None:
    wire.camera = {"leader": {"clock_rate": float(wire.rng.choice([0.5, 1.5]))}}
    wire.then = lambda fake: time.sleep(0.6)


def _odd(wire: Wire) -> None:
    wire.options = {"roi": [0, 0, 31, 31]}
    wire.how = lambda picture: made.most_significant_first(picture, 12)[:-1]


def _doubled(wire: Wire) -> None:
    wire.then = lambda fake: fake.inject(CameraFault("wrong exposure"))


KINDS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...], Kind]] = {
    "big-endian": ("big-endian", _WORDS, _ANY, _BIG),
    "big-endian 16": (
        "big-endian",
        ("Mono16",),
        _LIT,
        _sends(lambda w, p: made.words(p, big=True)),
    ),
    "justified left": ("left", _WORDS, _ANY, _sends(lambda w, p: made.words(p, left=_left(w)))),
    "left and big": (
        "big-endian and justified left",
        ("Mono10", "Mono12"),
        _LIT,
        _sends(lambda w, p: made.words(p, big=True, left=_left(w))),
    ),
    "p as Packed": (
        "Mono12p",
        ("Mono12Packed",),
        _LIT,
        _sends_as("Mono12p"),
    ),
    "Packed as p": (
        "Mono12Packed",
        ("Mono12p",),
        _LIT,
        _sends_as("Mono12Packed"),
    ),
    "most significant bit first": (
        "most significant",
        ("Mono10p", "Mono12p"),
        _LIT,
        _sends(lambda w, p: made.most_significant_first(p, made.bits_of(w.name))),
    ),
    "12 bits as 10 packed": (
        "leaves zero",
        ("Mono10Packed",),
        _ANY,
        _sends(lambda w, p: made.sent(p * 4 + w.rng.integers(0, 4, p.shape), "Mono12Packed")),
    ),
    "too many bits": (
        "ends at",
        _WORDS,
        _LIT,
        _sends(lambda w, p: made.words(p * 4 + w.rng.integers(0, 4, p.shape))),
    ),
    "padding untold": (
        "padding",
        ("Mono8", *_DEEP),
        _ANY,
        _sends(lambda w, p: made.padded(p, w.name, 12), more_bytes=12 * 128),
    ),
    "padding within the size": ("padding", ("Mono8", *_DEEP), _LIT, _sends(_sheared)),
    "too short": (
        "bytes",
        ("Mono8", *_DEEP),
        _ANY,
        _sends(_cut),
    ),
    "odd region packed": ("pixels in whole bytes", ("Mono12p", "Mono12Packed"), _ANY, _odd),
    "region moved": ("begins at", _DEEP, _ANY, _leads(x=4)),
    "region smaller": ("pixels of format", _DEEP, _ANY, _leads(height=16)),
    "other format told": ("of format", _DEEP, _ANY, _leads(code=0x01080001)),
    "offset x by itself": ("begins at", _DEEP, _ANY, _becomes(OffsetX=4)),
    "offset y by itself": ("begins at", _DEEP, _ANY, _becomes(OffsetY=4)),
    "stale": ("came again", _DEEP, (*_LIT, "stars"), _repeats(1)),
    "older stale": ("came again", _DEEP, (*_LIT, "stars"), _repeats(3)),
    "gain": ("Gain from", _DEEP, _ANY, _becomes(Gain=20)),
    "gain by a hair": ("Gain from", _DEEP, _ANY, _becomes(Gain=0.1)),
    "automatic gain": ("GainAuto", _DEEP, _ANY, _becomes(GainAuto=2)),
    "automatic exposure": ("ExposureAuto", _DEEP, _ANY, _becomes(ExposureAuto=1)),
    "exposure doubled": ("exposes", _DEEP, _ANY, _doubled),
    "reversed across": ("ReverseX", _DEEP, _ANY, _becomes(ReverseX=1)),
    "reversed down": ("ReverseY", _DEEP, _ANY, _becomes(ReverseY=1)),
    "gamma": ("GammaEnable", _DEEP, _ANY, _becomes(GammaEnable=1, Gamma=0.45)),
    "LUT": ("LUTEnable", _DEEP, _ANY, _becomes(LUTEnable=1)),
    "test pattern": ("test pattern|TestPattern", _DEEP, _ANY, _becomes(TestPattern=1)),
    "test pattern untold": ("test pattern", ("Mono8", *_DEEP), _ANY, _sends(_drawn_pattern)),
    "decimated": ("Decimation", _DEEP, _ANY, _becomes(DecimationHorizontal=2)),
    "binned": ("Binning", _DEEP, _ANY, _becomes(BinningHorizontal=2)),
    "shifted": ("DigitalShift", _DEEP, _ANY, _becomes(DigitalShift=2)),
    "black level": ("BlackLevel", _DEEP, _ANY, _becomes(BlackLevel=30)),
    "black clamped": ("BlackLevelClamp", _DEEP, _ANY, _becomes(BlackLevelClampingEnable=1)),
    "sharpened": ("Sharpening", _DEEP, _ANY, _becomes(SharpeningEnable=1)),
    "clock stands still": ("stands still", _DEEP, _ANY, _leads(stamp=7)),
    "clock drifts": ("clock counted", _DEEP, _ANY, _pause),
}
"""Kind to what its refusal must say, pixel formats, scenes, and how the camera comes to send it."""
