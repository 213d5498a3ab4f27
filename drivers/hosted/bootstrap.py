"""How a child process begins: signals, watchdog and message socket, before its function is called.

The child may run on another Python than its parent, such as the system's. What this module and the
package import must exist there.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import pkgutil
import signal
import sys

from drivers.hosted.calls import CallResult
from drivers.hosted.failures import RemoteFailure
from drivers.hosted.message_socket import MessageSocket
from drivers.hosted.watchdog import start_watchdog

IGNORED_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that a child process ignores, because they reach its whole process group: it ends by
itself, after its parent."""

BOOTSTRAP_CODE = """
import sys
own = sys.path if sys.argv[5] else sys.argv[6:]
sys.path = [*own, *sys.argv[6:]]
from drivers.hosted.bootstrap import run_child
run_child(*sys.argv[1:5], own)
"""
"""Code that the child's Python runs. Its arguments are those of `run_child`, then "lent" or an
empty string, then folders of packages. The folders are the child's whole sys.path or, with "lent",
are on it only until the function is loaded."""


def run_child(end: str, memory: str, grace: str, target: str, path: list[str]) -> None:
    """Call target(line, *arguments) in this child process, guarded by a watchdog until it returns.

    The first message on the line contains the arguments. An exception of the target is sent as a
    result, even if no request is pending. end, memory: descriptors of the socket and of the shared
    memory. grace: seconds in which this process must end after the other end was closed. target:
    "module:function". path: sys.path after the target was loaded.
    """
    for number in IGNORED_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, IGNORED_SIGNALS)
    faulthandler.enable()
    # Both are the same file, but stderr writes every line at once.
    sys.stdout = sys.stderr
    # Some libraries read sys.argv, and these arguments aren't meant for them.
    del sys.argv[1:]
    for descriptor in (int(end), int(memory)):
        os.set_inheritable(descriptor, False)
    start_watchdog(int(end), float(grace))
    line = MessageSocket(int(end), int(memory))
    try:
        function = pkgutil.resolve_name(target)
        sys.path = path
        function(line, *line.receive())
    except Exception as error:
        # A parent that has ended, say by Ctrl-C, needs no result, and its terminal no traceback.
        with contextlib.suppress(OSError):
            line.send(CallResult(failure=RemoteFailure.from_exception(error)))
        sys.exit(1)
