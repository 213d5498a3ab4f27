"""Who types to a virtual bench that is served, and who doesn't."""

from __future__ import annotations

import os
import pty
import select
import signal
import sys
import time

PATIENCE = 60.0

LISTENER = """
from labapp.bench.virtual_bench.command_interpreter import read_commands

class Talk:
    is_over = False
    def execute(self, line):
        print("heard", line, flush=True)
        self.is_over = True
        return ""

print("listening", flush=True)
read_commands(Talk(), lambda: False, until_eof=False)
print("ended", flush=True)
"""

SHELL = """
import os, signal, subprocess, sys
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
job = subprocess.Popen([sys.executable, "-c", sys.argv[1]], process_group=0)
print("job", job.pid, flush=True)
signal.sigwait({signal.SIGUSR1})
sys.stdin.readline()
signal.signal(signal.SIGTTOU, signal.SIG_IGN)
os.tcsetpgrp(0, job.pid)
job.wait()
"""


class Terminal:
    """A terminal with a shell, more or less: it has its job in the background, then before it."""

    def __init__(self) -> None:
        self.shell, self._end = pty.fork()
        if not self.shell:
            os.execv(sys.executable, [sys.executable, "-c", SHELL, LISTENER])
        self.said = ""

    def wait_for(self, words: str) -> None:
        late = time.monotonic() + PATIENCE
        while words not in self.said:
            assert time.monotonic() < late, f"never {words!r}: {self.said!r}"
            if select.select([self._end], [], [], 0.1)[0]:
                self.said += os.read(self._end, 4096).decode()

    def type(self, words: str) -> None:
        os.write(self._end, words.encode())

    def close(self) -> None:
        os.close(self._end)
        os.waitpid(self.shell, 0)


def state_of(process: int) -> str:
    with open(f"/proc/{process}/stat", encoding="ascii") as told:
        return told.read().rpartition(")")[2].split()[0]


def test_in_the_background_of_a_shell_it_goes_on_and_leaves_the_terminal_alone():
    """Whoever reads a terminal from there is stopped by the system, instruments and all."""
    terminal = Terminal()
    try:
        terminal.wait_for("listening")
        job = int(terminal.said.partition("job ")[2].split()[0])
        # The shell hasn't read yet: the line lies there for whoever reads first.
        terminal.type("not for it\r")
        late = time.monotonic() + 1.0
        while time.monotonic() < late:
            assert state_of(job) != "T", "it was stopped"
            time.sleep(0.02)
        assert "heard" not in terminal.said
        os.kill(terminal.shell, signal.SIGUSR1)
        terminal.type("for it\r")
        terminal.wait_for("ended")
        assert "heard for it" in terminal.said
    finally:
        terminal.close()
