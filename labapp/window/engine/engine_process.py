"""The main function of the process that labapp.window.engine_connection starts."""

from __future__ import annotations

import sys

from drivers.hosted.message_socket import MessageSocket
from labapp.common.command_end import unsafe_devices
from labapp.common.memory import keep_freed_memory, lasting_objects
from labapp.window.bench_options import BenchOptions
from labapp.window.engine.channel import Channel
from labapp.window.messages import OpeningFailed


def run_engine(line: MessageSocket, options: BenchOptions) -> None:
    """Open a bench, and serve the window until it is gone."""
    keep_freed_memory()
    channel = Channel(line)
    with lasting_objects():
        from drivers.errors import DeviceError
        from labapp.bench.opening import BenchFiles, open_bench
        from labapp.common.errors import UserError
        from labapp.window.engine.engine_loop import Engine

    try:
        with open_bench(BenchFiles.with_defaults(**options)) as opened:
            Engine(opened, channel).run()
    except (DeviceError, UserError, ValueError) as error:
        channel.send(OpeningFailed(str(error)))
        sys.exit(1)
    # The window's process then doesn't end with 0 either.
    sys.exit(1 if unsafe_devices() else 0)
