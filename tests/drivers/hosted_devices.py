"""Devices that behave badly, for processes of their own. Nothing here is run in the tests'."""

from __future__ import annotations

import ctypes
import os
import select
import sys
import threading
import time
from pathlib import Path

import numpy as np

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Identity, Setting

FULL = (3000, 4000)
"""Twelve million pixels: 24 MB a picture."""


class Modest:
    """A camera that does as it is told. notes: a file that it writes down its life in."""

    full_scale = 4095
    reply_time = 1.0
    Kind = Identity

    def __init__(self, surroundings, notes="", shape=(3, 4)):
        if shape[0] < 1:
            raise ValueError(f"shape is {shape}; it must have rows")
        self.clock = surroundings.clock
        self.shape = tuple(shape)
        self._notes = notes
        self._number = 0
        self._shown = None

    def _note(self, word):
        if self._notes:
            with Path(self._notes).open("a") as file:
                file.write(word + "\n")

    def __enter__(self):
        self.entered = True
        self._note("entered")
        return self

    def __exit__(self, *error):
        self._note("left")

    def make_safe(self):
        self._note("safe")

    @property
    def identity(self):
        return Identity("modest", "7", simulated=False)

    @property
    def process(self):
        return os.getpid()

    @property
    def frame_time(self):
        raise DeviceError("modest", "frame time", "not known", "Set an exposure")

    @staticmethod
    def twice(number):
        return 2 * number

    @classmethod
    def called(cls):
        return cls.__name__

    def now(self):
        return self.clock.now()

    def loaded(self, names):
        return [name for name in names if name in sys.modules]

    def line(self):
        return sys.argv, sys.path

    def in_main_thread(self):
        return threading.current_thread() is threading.main_thread()

    def speak(self, words):
        print(words)

    def image(self, number):
        """What picture `number` shows, from which no two pixels can be swapped unseen."""
        count = self.shape[0] * self.shape[1]
        return ((np.arange(count) * 40503 + number) % 65521).astype(np.uint16).reshape(self.shape)

    def capture(self, cancelled):
        self._number += 1
        return Frame(self.image(self._number), 0.5, 2.0, self.clock.now(), self._number)

    def show(self, identifier, grey):
        self._shown = grey
        return Setting(identifier, identifier, 0.0)

    def shown(self):
        return self._shown

    def keep_exposing(self, cancelled, *, paused=None):
        """Until it is cancelled: how often `paused` was heard before."""
        self._note("exposing")
        while not cancelled():
            time.sleep(0.001)
        self._heard = cancelled
        return bool(paused and paused())

    def heard_afterwards(self):
        return self._heard()

    def type_of(self, value):
        return str(value)


class Hung(Modest):
    """Its calls end never, in C."""

    def capture(self, cancelled):
        self._note("hung")
        time.sleep(1e6)

    def capture_with_the_lock(self):
        """As a library does that never lets go of the interpreter."""
        self._note("hung")
        ctypes.PyDLL(None).sleep(10**6)


class Busy(Modest):
    """It has something to do between two calls: it counts."""

    done = 0

    def _attend_until_readable(self, end):
        while not select.select([end], [], [], 0.01)[0]:
            self.done += 1


class HungOnTheWayIn(Modest):
    def __enter__(self):
        time.sleep(1e6)


class HungOnTheWayOut(Modest):
    """It leaves, and then a thread of its library's keeps the process."""

    def __exit__(self, *error):
        threading.Thread(target=time.sleep, args=(1e6,)).start()


class Brittle(Modest):
    def capture(self, cancelled):
        ctypes.string_at(0)

    def end(self, status):
        os._exit(status)

    def leave_somebody(self):
        """A process forked without exec keeps all that this one has open."""
        child = os.fork()
        if not child:
            time.sleep(60)
            os._exit(0)
        return child


class Refusal(Exception):
    """Can be pickled, but not be made again: it needs two arguments and keeps one."""

    def __init__(self, word, more):
        super().__init__(word)


class Unwilling(Modest):
    """Everything fails in a way of its own."""

    def capture(self, cancelled):
        raise DeviceError("unwilling", "capture", "no", "Ask nicely")

    def set_exposure(self, exposure):
        raise ValueError(f"exposure is {exposure}")

    def refuse(self):
        raise Refusal("no", "never")

    def lambdas(self):
        raise RuntimeError(lambda: 0)

    def quit(self):
        sys.exit(3)

    def answer_with_a_lock(self):
        return threading.Lock()

    def answer_with_a_stranger(self):
        import hosted_stranger

        return hosted_stranger.Thing()

    def fail_with_a_stranger(self):
        import hosted_stranger

        raise hosted_stranger.Problem("odd")


class UnwillingToOpen(Modest):
    def __enter__(self):
        raise DeviceError("unwilling", "open", "no such camera", "Plug it in")


class UnwillingToClose(Modest):
    def __exit__(self, *error):
        raise DeviceError("unwilling", "close", "stuck", "Pull the plug")


class Another(Modest):
    """What is entered isn't what was made."""

    def __enter__(self):
        return Entered()


class Entered:
    word = "entered"

    def make_safe(self):
        pass


def slow(surroundings):
    time.sleep(1e6)


number = 7
