"""The stream between window and engine, piece by piece."""

import os
from threading import Event

import numpy as np
import pytest

from labapp.window.bracket import Bracket
from labapp.window.engine.channel import Channel
from labapp.window.messages import Cancel, CancelHeard, Expose, LiveFrame, Place, Tune
from labapp.window.stream import Unpacker, pack


@pytest.mark.parametrize("piece", [1, 7, 64, 10_000])
def test_messages_survive_any_cutting(piece):
    image = np.arange(600, dtype=np.uint16).reshape(20, 30)
    sent = [Place("star"), LiveFrame(image, "star", "neutral", 5e-7, 0.1, 3), Tune(6e-7)]
    data = b"".join(pack(message) for message in sent)
    unpacker, got = Unpacker(), []
    for start in range(0, len(data), piece):
        got += unpacker.feed(data[start : start + piece])
    assert got[0] == sent[0]
    assert got[2] == sent[2]
    np.testing.assert_array_equal(got[1].image, image)


def test_a_bracket_grows_by_its_ratio():
    assert Bracket(1, 8, 4).exposures_ms == (1, 8, 64, 512)
    assert Bracket(0.02, 2.5, 3).exposures_ms == (0.02, 0.05, 0.125)


@pytest.fixture
def ends():
    """An engine's channel and the window's two ends of it."""
    commands, engine_in = os.pipe()
    engine_out, reports = os.pipe()
    yield Channel(commands, reports), engine_in, engine_out
    os.close(engine_in)
    os.close(engine_out)


def hear(end, count):
    unpacker, got = Unpacker(), []
    while len(got) < count:
        got += unpacker.feed(os.read(end, 1 << 16))
    return got


def test_only_the_newest_of_a_setting_is_obeyed_and_cancel_at_once(ends):
    channel, engine_in, engine_out = ends
    channel.at_once = {Cancel: lambda _: channel.send(CancelHeard())}
    settings = [Tune(nm * 1e-9) for nm in range(500, 600)]
    for message in [Place("star"), *settings, Expose(0.1), Cancel()]:
        os.write(engine_in, pack(message))
    # Nobody has taken a command from the line yet.
    assert hear(engine_out, 1) == [CancelHeard()]
    assert [channel.take(0) for _ in range(4)] == [Place("star"), settings[-1], Expose(0.1), None]


def test_the_end_of_the_window_is_heard(ends):
    channel, engine_in, _ = ends
    ended = Event()
    channel.on_end.append(ended.set)
    os.write(engine_in, pack(Place("star")))
    assert channel.take(5) == Place("star")
    os.dup2(os.open(os.devnull, os.O_RDONLY), engine_in)
    assert ended.wait(5)
    assert channel.closed
