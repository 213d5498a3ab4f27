"""labapp's command line that tells each frame as soon as it is stored: `python -m disks.telling`.

In the environment:

END: a signal, and a frame after which the process gets it, as "SIGKILL 12".
CHECKS=here: `verify` has no process of its own, which is what takes longest of it.
RECORD: file that gets what was recorded of the folder in which it is.
FAILS: number of the sync that fails, from 1, and with which error, as "3 EIO".
EVERY: seconds between two syncs.
"""

from __future__ import annotations

import atexit
import errno
import os
import pickle
import signal
from pathlib import Path
from typing import Any

from disks.recording import Recorder
from labapp.cli import main
from labapp.runs import verifying
from labapp.runs.acquisition.frame_storage import FrameStore
from labapp.runs.record import disk_sync
from labapp.runs.record.checks import check_record
from labapp.runs.record.verification import Verification

_END, _LAST = os.environ.get("END", "SIGINT -1").split()
_store_frame = FrameStore.store_frame
_recorder: list[Recorder] = []


def _tell(self: FrameStore, shot: Any, *rest: Any) -> None:
    _store_frame(self, shot, *rest)
    os.write(1, f"frame {shot.index}\n".encode())
    for one in _recorder:
        one.tell(f"frame {shot.index}\n")
    if shot.index == int(_LAST):
        os.kill(os.getpid(), getattr(signal, _END))


def _verify_here(path: Path, progress: Any = None, *, digest: str = "", **_: Any) -> Verification:
    return check_record(path, progress, digest=digest)


def _record(out: Path) -> None:
    number, name = os.environ.get("FAILS", "0 EIO").split()
    recorder = Recorder(out.parent, int(number), getattr(errno, name))
    _recorder.append(recorder)
    recorder.__enter__()

    def keep() -> None:
        recorder.__exit__()
        out.write_bytes(pickle.dumps(recorder.events))

    atexit.register(keep)


if __name__ == "__main__":
    FrameStore.store_frame = _tell  # type: ignore[method-assign]
    disk_sync.EVERY = float(os.environ.get("EVERY", disk_sync.EVERY))
    if os.environ.get("CHECKS") == "here":
        verifying.verify = _verify_here
    if "RECORD" in os.environ:
        _record(Path(os.environ["RECORD"]))
    main()
