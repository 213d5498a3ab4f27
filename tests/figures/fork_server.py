"""A process that has its libraries loaded and forks others, so that these begin at once."""

from __future__ import annotations

import subprocess
import sys
from types import TracebackType
from typing import Self

from figures.where import ENVIRONMENT, ROOT


class ForkServer:
    """A context manager; runs a module that prints a line when its libraries are loaded.

    The module then answers lines with lines until its input ends.
    """

    def __init__(self, module: str) -> None:
        self._module = module

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            [sys.executable, "-m", self._module],
            cwd=ROOT,
            # Threads that compute would be missing after a fork, and waited for.
            env=ENVIRONMENT | {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self._read_line()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._process as process:
            assert process.stdin is not None
            process.stdin.close()

    def ask(self, line: str) -> str:
        """Return what the process answers to a line; empty if it has ended."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        return self._read_line()

    def _read_line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()
