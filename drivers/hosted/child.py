"""The first and the last of a process that was started from here: it begins with this file.

It may run on another Python than the one that started it, such as the system's: what is
imported here, and by this package, must be there.
"""

from __future__ import annotations

import faulthandler
import io
import os
import pkgutil
import signal
import sys

from drivers.hosted.guard import guard
from drivers.hosted.line import Line

IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""They reach a whole process group; such a process ends by itself, after its parent."""

BOOT = """
import sys
own = sys.path if sys.argv[4] else sys.argv[5:]
sys.path = [*own, *sys.argv[5:]]
from drivers.hosted.child import run
run(*sys.argv[1:4], own)
"""
"""What Python is told to do. Its words: those of `run`, then "lent" or nothing, then folders
that packages are found in. They are its whole path, or only lent until the function is loaded."""


def run(end: str, grace: str, target: str, path: list[str]) -> None:
    """Call target(line, *what the first message gives), guarded until it returns.

    end: descriptor of a socket. grace: seconds in which this process must have ended after
    the other end was closed. target: "module:function". path: the modules' from then on.
    """
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, IGNORED)
    faulthandler.enable()
    # What is printed comes out at once, as it would in the parent.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)
    # Some libraries read it, and these words aren't for them.
    del sys.argv[1:]
    os.set_inheritable(int(end), False)
    guard(int(end), float(grace))
    function = pkgutil.resolve_name(target)
    sys.path = path
    line = Line(int(end))
    try:
        given = line.receive()
    except EOFError:
        return
    function(line, *given)
