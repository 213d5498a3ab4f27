"""Connection to the engine process: start it, exchange messages, notice its end."""

from __future__ import annotations

import contextlib
import select
import sys
import threading
import time
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Unpack

from PySide6.QtCore import QObject, QSocketNotifier, QTimer, Signal

from drivers.hosted.calls import CallResult
from drivers.hosted.child_process import ChildProcess
from labapp.common.plain_text import printable
from labapp.window.bench_options import BenchOptions
from labapp.window.commands import AcknowledgeFrame, Command
from labapp.window.frame_memory import FrameMemoryReader, SlotHeader
from labapp.window.started_engine import StartedEngine, start_engine


@dataclass(frozen=True)
class EngineConnectionSettings:
    """Tune how messages are read and how the engine's end is handled.

    turn: seconds of reading after which the window's event loop has its turn, before anything is
        reported. Chosen: some messages hold pictures.
    kept_characters: characters of the last line of the engine's error output that are kept for the
        message about its end. Chosen.
    reading_time: seconds to wait for the rest of the error output of an engine that has ended.
        Chosen.
    """

    turn: float = 5e-3
    kept_characters: int = 2000
    reading_time: float = 1.0


_SETTINGS = EngineConnectionSettings()


class EngineConnection(QObject):
    """Run the engine in a child process and exchange messages with it; only close() waits.

    `report_received` is emitted with every report; of live frames that arrive together, only the
    newest is emitted. `engine_died` is emitted with an explanation if the engine ended without
    being told to.
    options: files of the bench, the scene, the image and the faults, where given, and the memory
        for simulated pictures.
    engine: one that was started with these options, if it was already.
    """

    report_received = Signal(object)
    engine_died = Signal(str)

    def __init__(
        self, engine: StartedEngine | None = None, **options: Unpack[BenchOptions]
    ) -> None:
        super().__init__()
        self._options = options
        self._engine = engine
        self._process: ChildProcess | None = None
        self.has_failed = False
        """Whether the engine that ended last crashed, or couldn't leave the bench safe."""
        self._frames: FrameMemoryReader | None = None
        self._slot = 0
        self._notifiers: list[QSocketNotifier] = []
        self._arrived: list[object] = []
        self._waiting: SimpleQueue[Command | None] = SimpleQueue()

    @property
    def is_running(self) -> bool:
        return self._process is not None

    @property
    def bench_name(self) -> str:
        """Return the path of the bench's file, by which runs on several benches are kept apart."""
        file = self._options.get("bench")
        return str(file.absolute()) if file else "virtual bench"

    @property
    def process_id(self) -> int:
        """Return the engine's process id; 0 if there is none."""
        return self._process.pid if self._process else 0

    def start(self) -> None:
        """Listen to the engine; start one, after closing the one that is running."""
        self.close()
        self._last_words = ""
        engine, self._engine = self._engine, None
        try:
            engine = engine or start_engine(self._options)
        except OSError as error:
            self.engine_died.emit(f"The engine could not be started: {error}.")
            return
        errors = engine.error_output
        self._passing = threading.Thread(target=self._forward_stderr, args=(errors,), daemon=True)
        self._passing.start()
        process = engine.process
        self._process, self._waiting = process, SimpleQueue()
        self._frames = FrameMemoryReader(process.line.memory)
        threading.Thread(target=_send, args=(process, self._waiting), daemon=True).start()
        for end, obey in (
            (process.line.fileno(), self._read),
            (process.exit_descriptor, self._end),
        ):
            notifier = QSocketNotifier(end, QSocketNotifier.Type.Read, self)
            notifier.activated.connect(obey)
            self._notifiers.append(notifier)

    def send(self, command: Command) -> None:
        """Send a command; it is lost if no engine is running, which the window shows."""
        if self._process is not None:
            self._waiting.put(command)

    def acknowledge_frame(self) -> None:
        """Tell the engine that the last frame is on the screen: the next one may come."""
        self.send(AcknowledgeFrame(self._slot))

    def close(self) -> None:
        """End the engine process, which leaves the bench safe when it is disconnected."""
        process, self._process = self._process, None
        if process is None:
            return
        while self._notifiers:
            notifier = self._notifiers.pop()
            notifier.setEnabled(False)
            notifier.deleteLater()
        self._waiting.put(None)
        self._arrived.clear()
        if self._frames is not None:
            self._frames.close()
        process.close()
        self.has_failed = process.exit_code() != 0

    def _read(self) -> None:
        """Read the engine's messages, and report them unless that has taken its time.

        What isn't read stays in the socket, which calls again.
        """
        late = time.monotonic() + _SETTINGS.turn
        with contextlib.suppress(EOFError, OSError):  # The engine's end is told by another end.
            while (
                self._process is not None
                and (message := self._process.line.receive_nowait()) is not None
            ):
                self._arrived.append(message)
                if time.monotonic() > late:
                    QTimer.singleShot(0, self._report)
                    return
        self._report()

    def _read_rest(self, process: ChildProcess) -> None:
        """Read all that the engine had sent when it ended, large messages too."""
        waiting = select.poll()
        waiting.register(process.line.fileno(), select.POLLIN)
        with contextlib.suppress(EOFError, OSError):
            while self._process is process and waiting.poll(0):
                if (message := process.line.receive_nowait()) is not None:
                    self._arrived.append(message)

    def _report(self) -> None:
        """Report what has arrived, in order; of the live frames, only the newest."""
        messages = list(self._arrived)
        self._arrived.clear()
        frames = [message for message in messages if isinstance(message, SlotHeader)]
        for message in messages:
            if isinstance(message, CallResult) and message.failure is not None:
                for line in message.failure.trace.splitlines(keepends=True):
                    self._note(line)
            elif not isinstance(message, SlotHeader):
                self.report_received.emit(message)
            elif message is frames[-1] and self._frames is not None:
                self._slot = message.slot
                self.report_received.emit(self._frames.read(message))

    def _forward_stderr(self, end: int) -> None:
        """Pass on the engine's error output, in a thread of its own."""
        with open(end, errors="replace") as printed:
            for line in printed:
                self._note(line)

    def _note(self, line: str) -> None:
        sys.stderr.write(printable(line))
        # The lines that follow a fatal error are only its traceback.
        if line.strip() and not self._last_words.startswith("Fatal Python error"):
            self._last_words = line.strip()[: _SETTINGS.kept_characters]

    def _end(self) -> None:
        """Report that the engine ended by itself, after reading its last messages."""
        process = self._process
        if process is None:
            return
        self._read_rest(process)
        self._report()
        if self._process is not process:
            return
        self.close()
        self._passing.join(_SETTINGS.reading_time)
        code = process.exit_code()
        crashed = code is None or code < 0
        how = "was killed or crashed" if crashed else f"ended with code {code}"
        last = self._last_words
        self.engine_died.emit(f"The engine {how}." + (f" Its last words: {last}." if last else ""))


def _send(process: ChildProcess, waiting: SimpleQueue[Command | None]) -> None:
    """Send commands from a thread, so that a hung engine doesn't block the window."""
    while (command := waiting.get()) is not None:
        process.send(command)
