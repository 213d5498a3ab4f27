"""The first and the last of a process that was started from here: it begins with this file.

It may run on another Python than the one that started it, such as the system's: what is
imported here, and by this package, must be there.
"""

from __future__ import annotations

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
"""They reach a whole process group; such a process ends by itself, after its parent."""

BOOTSTRAP_CODE = """
import sys
own = sys.path if sys.argv[5] else sys.argv[6:]
sys.path = [*own, *sys.argv[6:]]
from drivers.hosted.bootstrap import run_child
run_child(*sys.argv[1:5], own)
"""
"""What Python is told to do. Its words: those of `run_child`, then "lent" or nothing, then folders
that packages are found in. They are its whole path, or only lent until the function is loaded."""


def run_child(end: str, memory: str, grace: str, target: str, path: list[str]) -> None:
    """Call target(line, *what the first message gives), guarded until it returns.

    What it raises is sent as an answer, asked or not. end, memory: descriptors of a socket,
    and of memory that the other process sees, too. grace: seconds in which this process must
    have ended after the other end was closed. target: "module:function". path: the modules'
    from then on.
    """
    for number in IGNORED_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, IGNORED_SIGNALS)
    faulthandler.enable()
    # They are the same file, but here every line comes out at once.
    sys.stdout = sys.stderr
    # Some libraries read it, and these words aren't for them.
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
        line.send(CallResult(failure=RemoteFailure.from_exception(error)))
        sys.exit(1)
