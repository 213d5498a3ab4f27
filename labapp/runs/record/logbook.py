"""Write the application's log messages during a run into its record, with the bench's time."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from drivers.interfaces import Clock
from labapp.runs.record.writer import RecordWriter

_ROOMS = ("labapp", "simulator", "drivers", "optics")


class Logbook(logging.Handler):
    """Log handler that writes messages into a record.

    Lines that the disk refuses wait in memory, and are written before the next one.
    """

    def __init__(self, writer: RecordWriter, clock: Clock) -> None:
        super().__init__(logging.INFO)
        self._writer, self._clock = writer, clock
        self._waiting: deque[tuple[float, str]] = deque()
        # Messages come from several threads.
        self._turn = threading.RLock()

    def emit(self, record: logging.LogRecord) -> None:
        self._waiting.append((self._clock.now(), record.getMessage()))
        with suppress(OSError):
            self.write_waiting()

    def write_waiting(self) -> None:
        """Write the lines that wait; raise OSError if the disk refuses them."""
        with self._turn:
            while self._waiting:
                self._writer.log(*self._waiting[0])
                self._waiting.popleft()


@contextmanager
def logbook(writer: RecordWriter, clock: Clock) -> Iterator[Logbook]:
    """Write log messages of level INFO and above to the record while the block lasts."""
    handler = Logbook(writer, clock)
    loggers = [logging.getLogger(room) for room in _ROOMS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        yield handler
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)
