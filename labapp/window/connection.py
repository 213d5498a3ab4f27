"""The window's end of the pipes to its engine: starts it, hears it, notices its death."""

from __future__ import annotations

import sys
from pathlib import Path

from PySide6.QtCore import QObject, QProcess, Signal

from labapp.window.messages import Command, FrameSeen, LiveFrame
from labapp.window.stream import Unpacker, pack

_PATIENCE = 12_000
"""Milliseconds that a closing window gives the engine to leave the bench safe.

More than the engine gives itself, which then ends on its own.
"""

_KEPT = 2000
"""Characters of the engine's error output that are kept for the message about its death."""


class Connection(QObject):
    """A child process and two streams of messages; nothing here ever waits, but close().

    received: every report, but of frames that came together only the newest. died: the
    engine ended and nobody had asked it to; the text says how.
    """

    received = Signal(object)
    died = Signal(str)

    def __init__(
        self,
        bench: Path | None = None,
        scene: Path | None = None,
        image: Path | None = None,
        faults: Path | None = None,
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        files = {"--bench": bench, "--scene": scene, "--image": image, "--faults": faults}
        self._arguments = ["-m", "labapp.window.engine"]
        for option, path in files.items():
            if path is not None:
                self._arguments += [option, str(path)]
        self._process: QProcess | None = None
        self._unpacker = Unpacker()
        self._said = ""

    @property
    def running(self) -> bool:
        return self._process is not None

    @property
    def process_id(self) -> int:
        """Of the engine; 0 if there is none."""
        return int(self._process.processId()) if self._process else 0

    def start(self) -> None:
        """Start an engine, in place of the one before."""
        self.close()
        self._unpacker, self._said = Unpacker(), ""
        process = QProcess(self)
        process.readyReadStandardOutput.connect(self._read)
        process.readyReadStandardError.connect(self._read_errors)
        process.finished.connect(self._end)
        process.errorOccurred.connect(self._fail)
        self._process = process
        process.start(sys.executable, self._arguments)

    def send(self, command: Command) -> None:
        """Hand a command over; without an engine it is lost, and the window says so."""
        if self._process is not None:
            self._process.write(pack(command))

    def close(self) -> None:
        """End the engine in order: it leaves the bench safe when its input closes."""
        process, self._process = self._process, None
        if process is None:
            return
        process.closeWriteChannel()
        if not process.waitForFinished(_PATIENCE):
            process.kill()
            process.waitForFinished(_PATIENCE)
        process.deleteLater()

    def _read(self) -> None:
        if self._process is None:
            return
        messages = self._unpacker.feed(bytes(self._process.readAllStandardOutput().data()))
        frames = [message for message in messages if isinstance(message, LiveFrame)]
        for message in messages:
            if isinstance(message, LiveFrame):
                self.send(FrameSeen())
            if not isinstance(message, LiveFrame) or message is frames[-1]:
                self.received.emit(message)

    def _read_errors(self) -> None:
        if self._process is None:
            return
        text = bytes(self._process.readAllStandardError().data()).decode(errors="replace")
        sys.stderr.write(text)
        self._said = (self._said + text)[-_KEPT:]

    def _fail(self, error: QProcess.ProcessError) -> None:
        if error is QProcess.ProcessError.FailedToStart:
            self._bury("could not be started")

    def _end(self, code: int, status: QProcess.ExitStatus) -> None:
        self._read()
        self._read_errors()
        crashed = status is QProcess.ExitStatus.CrashExit
        self._bury("was killed or crashed" if crashed else f"ended with code {code}")

    def _bury(self, how: str) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.deleteLater()
        last = self._said.strip().rpartition("\n")[2]
        self.died.emit(f"The engine {how}." + (f" Its last words: {last}." if last else ""))
