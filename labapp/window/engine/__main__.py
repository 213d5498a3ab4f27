"""`python -m labapp.window.engine` is started by the window, never by hand."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from pathlib import Path

from labapp.common.memory import keep_freed_memory
from labapp.window.engine.channel import Channel
from labapp.window.messages import OpeningFailed

_GRACE = 10.0
"""Seconds in which the bench must be left safe after the window is gone."""


def _watch_the_end() -> None:
    """A device that hangs must not leave an engine that nobody talks to."""
    watchdog = threading.Timer(_GRACE, os._exit, (1,))
    watchdog.daemon = True
    watchdog.start()


def main(arguments: list[str]) -> int:
    # Ctrl-C in a terminal reaches both processes; the closing pipe ends this one, in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parser = argparse.ArgumentParser(prog="labapp.window.engine")
    for name in ("bench", "scene", "image", "faults"):
        parser.add_argument(f"--{name}", type=Path)
    asked = parser.parse_args(arguments)
    keep_freed_memory()
    channel = Channel.on_standard_streams()
    channel.on_end.append(_watch_the_end)
    from drivers.errors import DeviceError
    from labapp.bench.opening import BenchFiles, open_bench
    from labapp.common.errors import UserError
    from labapp.window.engine.loop import Engine

    try:
        files = BenchFiles.default(asked.bench, asked.scene, asked.image, asked.faults)
        with open_bench(files) as bench:
            Engine(bench, channel).run()
    except (DeviceError, UserError, ValueError) as error:
        channel.send(OpeningFailed(str(error)))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
