"""The window's end of the line to its engine: starts it, hears it, notices its death."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from pathlib import Path
from queue import SimpleQueue

from PySide6.QtCore import QObject, QSocketNotifier, Signal

from drivers.hosted.calls import CallResult
from drivers.hosted.child_process import ChildProcess
from labapp.window.messages import AcknowledgeFrame, Command, LiveFrame

_ENGINE = "labapp.window.engine.engine_process:run_engine"

_GRACE = 10.0
"""Seconds in which the engine must have left the bench safe once the window is gone."""

_KEPT = 2000
"""Characters of a line of its error output that are kept for the message about its death."""

_READING = 1.0
"""Seconds in which the last words of an engine that has ended must have come."""


class EngineConnection(QObject):
    """A child process and messages with it; nothing here ever waits, but close().

    files: bench, scene, image and faults, where there are any. report_received: every report, but
    of frames that came together only the newest. engine_died: the engine ended and nobody had
    asked it to; the text says how.
    """

    report_received = Signal(object)
    engine_died = Signal(str)

    def __init__(self, **files: Path | None) -> None:
        super().__init__()
        self._files = files
        self._process: ChildProcess | None = None
        self._notifiers: list[QSocketNotifier] = []
        self._waiting: SimpleQueue[Command | None] = SimpleQueue()

    @property
    def is_running(self) -> bool:
        return self._process is not None

    @property
    def process_id(self) -> int:
        """Of the engine; 0 if there is none."""
        return self._process.pid if self._process else 0

    def start(self) -> None:
        """Start an engine, in place of the one before."""
        self.close()
        self._last_words = ""
        reading, theirs = os.pipe()
        self._passing = threading.Thread(target=self._forward_stderr, args=(reading,), daemon=True)
        self._passing.start()
        try:
            process = ChildProcess(_ENGINE, self._files, grace=_GRACE, errors=theirs)
        except OSError as error:
            self.engine_died.emit(f"The engine could not be started: {error}.")
            return
        finally:
            os.close(theirs)
        self._process, self._waiting = process, SimpleQueue()
        threading.Thread(target=_send, args=(process, self._waiting), daemon=True).start()
        for end, obey in (
            (process.line.fileno(), self._read),
            (process.exit_descriptor, self._end),
        ):
            notifier = QSocketNotifier(end, QSocketNotifier.Type.Read, self)
            notifier.activated.connect(obey)
            self._notifiers.append(notifier)

    def send(self, command: Command) -> None:
        """Hand a command over; without an engine it is lost, and the window says so."""
        if self._process is not None:
            self._waiting.put(command)

    def close(self) -> None:
        """End the engine in order: it leaves the bench safe when the line closes."""
        process, self._process = self._process, None
        if process is None:
            return
        while self._notifiers:
            notifier = self._notifiers.pop()
            notifier.setEnabled(False)
            notifier.deleteLater()
        self._waiting.put(None)
        process.close()

    def _read(self) -> None:
        messages = self._messages()
        frames = [message for message in messages if isinstance(message, LiveFrame)]
        for message in messages:
            if isinstance(message, LiveFrame):
                self.send(AcknowledgeFrame())
            if isinstance(message, CallResult) and message.failure is not None:
                for line in message.failure.trace.splitlines(keepends=True):
                    self._note(line)
            elif not isinstance(message, LiveFrame) or message is frames[-1]:
                self.report_received.emit(message)

    def _messages(self) -> list[object]:
        """All that have come."""
        messages: list[object] = []
        # Whether the engine has ended is noticed elsewhere.
        with contextlib.suppress(EOFError, OSError):
            while (
                self._process is not None
                and (message := self._process.line.receive_nowait()) is not None
            ):
                messages.append(message)
        return messages

    def _forward_stderr(self, end: int) -> None:
        """In a thread: what the engine prints."""
        with open(end, errors="replace") as printed:
            for line in printed:
                self._note(line)

    def _note(self, line: str) -> None:
        sys.stderr.write(line)
        # What follows such a line only says where.
        if line.strip() and not self._last_words.startswith("Fatal Python error"):
            self._last_words = line.strip()[:_KEPT]

    def _end(self) -> None:
        """It has ended by itself: take in what it still said, and say so."""
        self._read()
        process = self._process
        if process is None:
            return
        self.close()
        self._passing.join(_READING)
        code = process.exit_code()
        crashed = code is None or code < 0
        how = "was killed or crashed" if crashed else f"ended with code {code}"
        last = self._last_words
        self.engine_died.emit(f"The engine {how}." + (f" Its last words: {last}." if last else ""))


def _send(process: ChildProcess, waiting: SimpleQueue[Command | None]) -> None:
    """In a thread: an engine that hangs doesn't read, and the window must not wait for it."""
    while (command := waiting.get()) is not None:
        process.send(command)
