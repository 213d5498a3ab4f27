"""The line between window and engine, message by message."""

import socket
from threading import Event

import pytest

from drivers.hosted.message_socket import MessageSocket
from labapp.window.commands import Cancel, PlaceTarget, SetExposure, SetWavelength
from labapp.window.engine.channel import Channel
from labapp.window.exposure_bracket import ExposureBracket
from labapp.window.messages import CancelAcknowledged


def test_a_bracket_grows_by_its_ratio():
    assert ExposureBracket(1, 8, 4).exposures_ms == (1, 8, 64, 512)
    assert ExposureBracket(0.02, 2.5, 3).exposures_ms == (0.02, 0.05, 0.125)


@pytest.fixture
def ends():
    """An engine's channel and the window's end of the line to it."""
    engine, window = (MessageSocket(end.detach()) for end in socket.socketpair())
    yield Channel(engine), window
    window.close()


def test_only_the_newest_of_a_setting_is_obeyed_and_cancel_at_once(ends):
    channel, window = ends
    channel.immediate_handlers = {Cancel: lambda _: channel.send(CancelAcknowledged())}
    settings = [SetWavelength(nm * 1e-9) for nm in range(500, 600)]
    for message in [PlaceTarget("star"), *settings, SetExposure(0.1), Cancel()]:
        window.send(message)
    # Nobody has taken a command from the line yet.
    assert window.receive(5) == CancelAcknowledged()
    assert [channel.take_command(0) for _ in range(4)] == [
        PlaceTarget("star"),
        settings[-1],
        SetExposure(0.1),
        None,
    ]


def test_the_end_of_the_window_is_heard(ends):
    channel, window = ends
    ended = Event()
    channel.end_handlers.append(ended.set)
    window.send(PlaceTarget("star"))
    assert channel.take_command(5) == PlaceTarget("star")
    window.close()
    assert ended.wait(5)
    assert channel.closed
