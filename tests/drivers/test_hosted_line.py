"""Messages between two processes, whatever the socket makes of them."""

import pickle
import select
import socket
import struct
import threading
from contextlib import closing

import numpy as np
import pytest

from drivers.hosted.calls import CallResult, capture_result
from drivers.hosted.child_process import ChildProcess, ProcessEnded
from drivers.hosted.message_socket import (
    LineClosed,
    MessageSocket,
    MessageTimeout,
    UnreadableMessage,
)


@pytest.fixture
def ends():
    """A line, and the bare socket at its other end."""
    ours, theirs = socket.socketpair()
    line = MessageSocket(ours.detach())
    with theirs:
        yield line, theirs
    line.close()


def framed(message: object) -> bytes:
    body = pickle.dumps(message)
    return struct.pack("!Q", len(body)) + body


def test_a_large_message_leaves_time_between_its_parts(ends):
    """Who polls gets None until it is whole; what follows waits behind it."""
    line, theirs = ends
    picture = np.random.default_rng(1).integers(0, 255, (2048, 2448), dtype=np.uint8)
    theirs.setblocking(True)
    sending = threading.Thread(
        target=theirs.sendall, args=(framed(picture) + framed("the next"),), daemon=True
    )
    sending.start()
    came = [line.receive_nowait()]
    while came[-1] is None:
        select.select([line], [], [], 10)
        came.append(line.receive_nowait())
    assert np.array_equal(came[-1], picture)
    assert len(came) > 4
    assert line.receive() == "the next"
    sending.join()


def test_a_child_whose_parent_has_gone_ends_without_a_word(tmp_path):
    """Whether it still gets what it was given depends on the moment; either way it fails."""
    with (tmp_path / "said").open("w+") as said:
        for _ in range(3):
            ChildProcess("operator:truediv", 0, errors=said.fileno()).close()
        assert said.seek(0) == 0
        assert not said.read()


@pytest.mark.parametrize("piece", [1, 7, 64, 10_000])
def test_messages_survive_any_cutting(ends, piece):
    line, theirs = ends
    image = np.arange(600, dtype=np.uint16).reshape(20, 30)
    data = b"".join(framed(message) for message in ("star", {"image": image}, (6e-7,)))
    got = []
    for start in range(0, len(data), piece):
        theirs.send(data[start : start + piece])
        while (message := line.receive_nowait()) is not None:
            got.append(message)
    assert (got[0], got[2]) == ("star", (6e-7,))
    np.testing.assert_array_equal(got[1]["image"], image)


def test_half_a_message_is_not_waited_for_longer_than_asked(ends):
    line, theirs = ends
    theirs.send(framed("star")[:-1])
    with pytest.raises(MessageTimeout, match=r"within 0\.05 s"):
        line.receive(0.05)
    theirs.send(framed("star")[-1:])
    assert line.receive() == "star"


def test_what_comes_after_a_message_can_still_be_read_from_the_socket(ends):
    line, theirs = ends
    theirs.send(framed(1) + framed(2))
    assert line.receive_nowait() == 1
    assert select.select([line], [], [], 0)[0]
    assert line.receive_nowait() == 2
    assert not select.select([line], [], [], 0)[0]


def test_threads_send_whole_messages(ends):
    line, theirs = ends
    threads = [threading.Thread(target=line.send, args=((n, bytes(300_000)),)) for n in range(4)]
    for thread in threads:
        thread.start()
    other = MessageSocket(theirs.detach())
    assert sorted(other.receive(20)[0] for _ in threads) == [0, 1, 2, 3]
    for thread in threads:
        thread.join()


@pytest.mark.parametrize("unread", [False, True])
def test_a_closed_end_is_the_end_also_if_it_had_not_read_everything(ends, unread):
    line, theirs = ends
    if unread:
        line.send("nobody reads it")
    theirs.send(framed("last words"))
    theirs.close()
    assert line.receive_nowait() == "last words"
    with pytest.raises(LineClosed):
        line.receive()
    with pytest.raises(OSError):
        line.send("too late")


def test_what_cannot_be_unpickled_does_not_harm_the_next_message(ends):
    line, theirs = ends
    theirs.send(struct.pack("!Q", 3) + b"abc" + framed("star"))
    with pytest.raises(UnreadableMessage):
        line.receive_nowait()
    assert line.receive_nowait() == "star"


def test_an_answer_is_a_value_or_what_was_raised():
    assert capture_result(max, 1, 3) == CallResult(3)
    with pytest.raises(KeyError, match="slit"):
        capture_result({}.__getitem__, "slit").result()


def test_an_exception_that_nobody_here_knows_comes_in_words():
    class Stranger(Exception):
        pass

    def fail():
        raise Stranger("odd")

    with pytest.raises(RuntimeError, match=r"Stranger\('odd'\)"):
        capture_result(fail).result()


def test_what_a_process_raises_comes_as_its_answer_and_how_it_ended_after_that():
    with closing(ChildProcess("operator:truediv", 0)) as process:
        with pytest.raises(TypeError, match="unsupported operand"):
            process.receive(60).result()
        with pytest.raises(ProcessEnded, match=r"its process ended \(exit status 1\)"):
            process.receive(60)


def test_a_process_whose_function_is_not_there_says_so():
    with closing(ChildProcess("no_such_module:run")) as process, pytest.raises(ModuleNotFoundError):
        process.receive(60).result()


def test_who_waits_at_a_line_is_told_that_it_was_disconnected(ends):
    line, _ = ends
    told = []

    def wait() -> None:
        try:
            line.receive(20)
        except LineClosed as closed:
            told.append(closed)

    waiting = threading.Thread(target=wait)
    waiting.start()
    line.disconnect()
    waiting.join(10)
    assert len(told) == 1
    line.disconnect()
