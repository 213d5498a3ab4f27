"""The process of the engine, as it is started, before the window itself is loaded."""

from __future__ import annotations

import os
from dataclasses import dataclass

from drivers.hosted.child_process import ChildProcess
from labapp.window.bench_options import BenchOptions

_ENGINE = "labapp.window.engine.engine_process:run_engine"

_GRACE = 10.0
"""Seconds that the engine has to leave the bench safe once the window is gone. Chosen."""


@dataclass(frozen=True)
class StartedEngine:
    """An engine that ends by itself when this process does.

    error_output: descriptor from which its error output is read, until its end.
    """

    process: ChildProcess
    error_output: int


def start_engine(options: BenchOptions) -> StartedEngine:
    """Start an engine on a bench; OSError if no process can be started.

    It imports for seconds, while the window loads on another core.
    """
    reading, theirs = os.pipe()
    try:
        process = ChildProcess(_ENGINE, options, grace=_GRACE, errors=theirs)
    except OSError:
        os.close(reading)
        raise
    finally:
        os.close(theirs)
    return StartedEngine(process, reading)
