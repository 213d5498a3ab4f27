"""Write the application's log messages during a run into its record, with the bench's time."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.interfaces import Clock
from labapp.runs.record.writer import RecordWriter

_ROOMS = ("labapp", "simulator", "drivers", "optics")


class _Logbook(logging.Handler):
    def __init__(self, writer: RecordWriter, clock: Clock) -> None:
        super().__init__(logging.INFO)
        self._writer, self._clock = writer, clock

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._writer.log(self._clock.now(), record.getMessage())
        except OSError:
            # A disk that fails here also fails for frames, and the run reports that.
            self.handleError(record)


@contextmanager
def logbook(writer: RecordWriter, clock: Clock) -> Iterator[None]:
    """Write the run's log messages of level INFO and above to its record while the block lasts."""
    handler = _Logbook(writer, clock)
    loggers = [logging.getLogger(room) for room in _ROOMS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)
