"""Frames in shared memory: they arrive as they are, and outlive either process."""

import os
import socket
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.hosted.child_process import ChildProcess
from drivers.hosted.message_socket import MessageSocket
from labapp.window.commands import AcknowledgeFrame
from labapp.window.engine.channel import Channel
from labapp.window.engine.frame_sender import FrameSender
from labapp.window.frame_memory import SLOT_COUNT, FrameMemoryReader, FrameMemoryWriter
from labapp.window.messages import LiveFrame
from labapp.window.tone_mapping import DigitalScale


def frame(number, shape=(40, 60), dtype=np.uint16):
    image = np.full(shape, number, dtype)
    return LiveFrame(image, "star", "neutral", 550e-9, 0.1, number)


@pytest.fixture
def memory():
    descriptor = os.memfd_create("test")
    yield descriptor
    os.close(descriptor)


def test_slots_keep_their_frames_while_others_are_written(memory):
    writer, reader = FrameMemoryWriter(memory), FrameMemoryReader(memory)
    read = [reader.read(writer.write(slot, frame(slot + 1))) for slot in range(SLOT_COUNT)]
    # Larger frames need more room, which lies behind that of the smaller ones.
    large = reader.read(writer.write(0, frame(9, (300, 500))))
    assert [int(one.image[0, 0]) for one in read] == [1, 2, 3]
    assert (large.image == 9).all()
    assert large.image.shape == (300, 500)
    with pytest.raises(ValueError, match="read-only"):
        large.image[0, 0] = 1
    reader.close()


def test_a_written_slot_shows_in_the_arrays_that_were_read_before(memory):
    """Nothing is copied."""
    writer, reader = FrameMemoryWriter(memory), FrameMemoryReader(memory)
    first = reader.read(writer.write(0, frame(1)))
    writer.write(0, frame(2))
    assert (first.image == 2).all()
    reader.close()


class Window:
    """The window's end of the line to a sender."""

    def __init__(self):
        self.memory = os.memfd_create("test")
        engine, window = socket.socketpair()
        self.line = MessageSocket(window.detach())
        self.channel = Channel(MessageSocket(engine.detach(), self.memory))
        self.sender = FrameSender(self.channel, DigitalScale(4095))
        self.channel.immediate_handlers = {AcknowledgeFrame: self.sender.acknowledge}
        self.channel.end_handlers.append(self.sender.close)
        self.reader = FrameMemoryReader(self.memory)

    def receives(self, timeout=5.0):
        header = self.line.receive(timeout)
        return header, self.reader.read(header)

    def shows(self, header):
        self.line.send(AcknowledgeFrame(header.slot))


@pytest.fixture
def window():
    made = Window()
    yield made
    made.line.close()
    made.reader.close()


def until(seen):
    late = time.monotonic() + 5
    while not seen():
        assert time.monotonic() < late
        time.sleep(1e-3)


def test_one_frame_is_on_its_way_and_only_the_newest_waits(window):
    for number in range(1, 3):
        window.sender.offer(frame(number))
        until(lambda: window.sender.has_room)
    header, first = window.receives()
    assert first.frame.number == 1
    # The second is ready, but the first isn't on the screen yet: newer ones replace each other.
    for number in (3, 4, 7):
        window.sender.offer(frame(number))
    window.shows(header)
    header, second = window.receives()
    assert second.frame.number == 2
    # What is on the screen stays as it is until the next one was shown there.
    assert (first.frame.image == 1).all()
    window.shows(header)
    _, last = window.receives()
    assert (last.frame.number, last.dropped, last.missed) == (7, 2, 2)
    assert (last.frame.image == 7).all()


def test_after_a_stop_no_frame_of_before_comes(window):
    window.sender.offer(frame(1))
    header, _ = window.receives()
    for number in (2, 3):
        window.sender.offer(frame(number))
    window.sender.discard()
    window.sender.offer(frame(40))
    window.shows(header)
    _, next_one = window.receives()
    assert (next_one.frame.number, next_one.dropped, next_one.missed) == (40, 0, 0)


def test_a_frame_that_cannot_be_reduced_is_told_and_the_next_one_comes(window):
    failures = []
    window.sender.on_failure = failures.append
    window.sender.offer(frame(1, (0, 5)))
    until(lambda: failures)
    window.sender.offer(frame(2))
    assert window.receives()[1].frame.number == 2


def test_frames_that_are_not_shown_count_as_dropped(window):
    for number in range(1, 11):
        window.sender.skip(number)
    window.sender.offer(frame(11))
    assert window.receives()[1].dropped == 10


def send_one(line):
    """The function of a child process: it sends one picture, and waits."""
    channel = Channel(line)
    sender = FrameSender(channel, DigitalScale(4095))
    sender.offer(frame(5))
    time.sleep(60)


def test_a_frame_stays_readable_after_its_engine_was_killed_and_nothing_is_left():
    before = set(Path("/dev/shm").iterdir()) if Path("/dev/shm").exists() else set()
    child = ChildProcess(f"{__name__}:send_one", grace=0.1)
    reader = FrameMemoryReader(child.line.memory)
    picture = reader.read(child.receive(30))
    child.kill()
    child.close()
    reader.close()
    assert (picture.frame.image == 5).all()
    after = set(Path("/dev/shm").iterdir()) if Path("/dev/shm").exists() else set()
    assert after <= before
