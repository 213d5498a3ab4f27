"""Files of strangers through all commands that take them: what runs, is written or shown raw."""

from __future__ import annotations

import os
import pwd
import re
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from hostile.acting_texts import Canaries, CraftedText, crafted_texts
from hostile.mutated_files import mutated_files, write_whole_files
from hostile.running import _prepare
from hostile.watched_tries import DIED, HUNG, Watch, allow_seconds, watched

from figures import Figure
from figures.mutated_files import prepare, run_command

_COUNT, _SEED = 200, 56

_SECONDS = 30.0
"""Processor time of a command that hangs."""

_BENCH = ("--bench", "{folder}/bench.toml")
_SCENE = ("--scene", "{folder}/scene.toml")
_OUT = ("--out", "{folder}/out/picture.png", "--force")
_PLANNED = ("{folder}/plan.toml", *_BENCH, *_SCENE)

Command = Sequence[str]

_OF_BENCHES: Sequence[Command] = (
    ("bench", "check", "{folder}/bench.toml", *_SCENE),
    ("bench", "check", "{folder}/bench.toml", *_SCENE, "--open", "--json"),
    ("plan", "check", *_PLANNED),
    ("plan", "show", *_PLANNED),
    ("plan", "list"),
    ("devices", "list", *_BENCH, *_SCENE),
    ("devices", "test", "filter", *_BENCH, *_SCENE),
    ("run", *_PLANNED, "--out", "{folder}/out/new.h5", "--force", "--yes"),
    ("explain", "{folder}/scene.toml", *_BENCH),
    ("simulate", "{folder}/scene.toml", *_BENCH, *_OUT),
    ("psf", "--camera", "{folder}/bench.toml", "--size", "16", *_OUT),
    ("pattern", "cubic", "strength_rad=9", *_BENCH, "--out", "{folder}/out/d.h5", "--force"),
    ("virtual-bench", "serve", *_BENCH, *_SCENE, "--folder", "{folder}/out", "--until-eof",
     "--slm", "none"),
)  # fmt: skip
_OF_RECORDS: Sequence[Command] = (
    ("show", "{folder}/run.h5"),
    ("show", "{folder}/run.h5", "--json"),
    ("verify", "{folder}/run.h5"),
    ("report", "{folder}/run.h5", "--out", "{folder}/out", "--force"),
    ("export", "{folder}/run.h5", "--to", "npy", "--out", "{folder}/out/frames", "--force"),
    ("salvage", "{folder}/run.h5", "--out", "{folder}/out/saved.h5", "--force"),
    ("reconstruct", "{folder}/run.h5", *_OUT),
    ("resume", "{folder}/run.h5"),
)
_RESTORE = ("reconstruct", "{folder}/picture.png", "--psf", "{folder}/psf.npy", *_OUT)
_OF_FILES: dict[str, Sequence[Command]] = {
    "run.h5": _OF_RECORDS,
    "psf.npy": (_RESTORE,),
    "picture.png": (_RESTORE, *_OF_BENCHES[2:3], *_OF_BENCHES[8:10]),
    "state.pt": (("reconstruct", "{folder}/picture.png", "--decoder", "{folder}/state.pt", *_OUT),),
}

_RAW = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Controls that must not reach a terminal."""

_STARTS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "pty.spawn")
_CHANGES: dict[str, tuple[int, int | None]] = {
    "os.remove": (0, 1), "os.rename": (1, 3), "os.truncate": (0, None), "os.mkdir": (0, 2),
    "os.rmdir": (0, 1), "os.link": (1, 3), "os.symlink": (1, 2), "os.chmod": (0, 2),
}  # fmt: skip
"""Places of path and folder among what the audit events of Python's documentation tell."""

_ACTING = ("os", "posix", "subprocess", "builtins")
"""Modules of which a pickle must take nothing, but for the errors that a device's process tells."""

_LOCK = re.compile(
    r"(/run/user/\d+|" + re.escape(pwd.getpwuid(os.geteuid()).pw_dir) + r"/\.local(/state)?)"
    r"(/labapp(/locks(/[\w.-]+-labapp-(device|file)-[0-9a-f-]+)?)?)?"
)
"""Locks of devices and files, which lie where no variable of the environment moves them: by digest
or inode, and the folders around them."""

_HANDLERS = tuple(f"serial.urlhandler.protocol_{one}" for one in ("spy", "alt", "hwgrep", "loop"))
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


def strangers_files_figure(folder: Path) -> list[Figure]:
    """The 200 texts through their commands."""
    found = list(try_texts(folder / "files", _COUNT, _SEED))
    harmed = {text for text, _, fate in found if fate.startswith("harm")}
    counted = Counter(fate.split(":")[0] for *_, fate in found)
    shown = [one for one in found if one[2] not in ("well", "refused")]
    said = ", ".join(f"{count} {name}" for name, count in sorted(counted.items()))
    return [
        Figure(
            f"{_COUNT} texts of strangers, {len(found)} commands: files that run code, or write "
            "another file than an option names; controls on the terminal; unexpected, hung",
            "0; 0",
            f"{len(harmed)}; {len(shown)} commands ({said})" + (f"; {shown[0]}" if shown else ""),
            not shown,
        )
    ]


def try_texts(folder: Path, count: int, seed: int) -> Iterator[tuple[str, str, str]]:
    """Yield text, command and fate: "well", "refused", "harm: …", "raw: …" or what else was bad."""
    folder.mkdir()
    canaries = Canaries(folder / "canaries")
    kinds, texts = mutated_files(), write_whole_files(folder)
    canaries.lay()
    _prepare(folder)
    for name, text in texts.items():
        (folder / name).write_text(text)
    prepare(folder, kinds)
    shutil.copyfile(folder / "run.h5", folder / "whole.h5")
    whole = {one.name: one.read_bytes() for one in folder.iterdir() if one.is_file()}
    tries = [
        (text, command)
        for text in crafted_texts(folder, texts, canaries, count, seed)
        for command in _OF_FILES.get(text.name, _OF_BENCHES)
    ]

    def attempt(one: tuple[CraftedText, Command]) -> str:
        return _in_fork(lambda: _try(folder, canaries, whole, *one))

    for (text, command), fate in watched(tries, attempt, Watch(memory=1 << 32)):
        yield text.what, " ".join(command[:2]), fate


def _in_fork(work: Callable[[], str]) -> str:
    """An audit hook can't be taken away again: each try is made in a fork of its own."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(writing, work().encode("utf-8", "replace")[:4000])
        finally:
            os._exit(0)
    os.close(writing)
    with open(reading, "rb") as told:
        fate = told.read().decode()
    _, status = os.waitpid(child, 0)
    if fate:
        return fate
    ended = os.WTERMSIG(status)
    return HUNG if ended == 27 else f"{DIED} {ended}"


def _try(
    folder: Path, canaries: Canaries, whole: dict[str, bytes], text: CraftedText, command: Command
) -> str:
    """Lay out the folder anew, write the text's file, run the command, and look at what's there."""
    for name, content in whole.items():
        if name == "said":
            continue
        path = folder / name
        if path.is_symlink() or not path.exists() or path.read_bytes() != content:
            path.unlink(missing_ok=True)
            path.write_bytes(content)
    canaries.lay()
    for name in ("out", "home"):
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).mkdir()
    os.environ |= {"HOME": str(folder / "home"), "XDG_CACHE_HOME": str(folder / "home")}
    tempfile.tempdir = str(folder / "home")
    path = folder / text.name
    path.unlink(missing_ok=True)
    text.write(path)
    before = _state(folder)
    seen: list[str] = []
    _watch_acts(folder, seen)
    allow_seconds(_SECONDS)
    with open(os.devnull) as sys.stdin:
        code, said = run_command(command, folder)
    found = [
        *seen,
        canaries.harm(),
        *_changed(before, _state(folder), resumed=command[0] == "resume"),
    ]
    if harm := [one for one in found if one]:
        return f"harm: {harm[:3]}"
    if raw := _RAW.search(said):
        return f"raw: {raw[0]!r} in {said[max(raw.start() - 60, 0) :][:120]!r}"
    if code not in (0, 1) or re.search(r"unexpected \w+|Traceback", said):
        return f"unexpected: {code}: {said[-300:]}"
    return "well" if code == 0 else "refused"


def _state(folder: Path) -> dict[str, tuple[int, int]]:
    """When each file of the folder was changed, and its bytes; without what commands may write."""
    kept = ("out", "home", "said")
    files = (one for one in folder.iterdir() if one.name not in kept)
    return {one.name: (one.lstat().st_mtime_ns, one.lstat().st_size) for one in files}


def _changed(before: Any, after: Any, *, resumed: bool) -> Iterator[str]:
    for name in before.keys() | after.keys():
        if before.get(name) != after.get(name) and not (resumed and name == "run.h5"):
            yield f"{name} was made, changed or removed"


def _is_error(module: str, name: str) -> bool:
    found = getattr(sys.modules[module], name, None)
    return isinstance(found, type) and issubclass(found, Exception)


def _watch_acts(folder: Path, seen: list[str]) -> None:
    """Note what Python does in this process from now on that a text of a file must not cause."""
    names = ("out", "home", "said", "run.h5")
    free = (*(str(folder / name) for name in names), "/dev/", "/proc/self/")

    def is_free(path: Any, within: Any = -1) -> bool:
        if isinstance(path, int):
            return True
        base = os.readlink(f"/proc/self/fd/{within}") if within not in (-1, None) else ""
        whole = os.path.abspath(os.path.join(base, os.fsdecode(path)))
        return whole.startswith(free) or _LOCK.fullmatch(whole) is not None

    def look(event: str, given: tuple[Any, ...]) -> None:
        if event in _STARTS and "drivers.hosted" not in str(given):
            seen.append(f"{event} {str(given)[:200]}")
        elif event == "open" and isinstance(given[2], int) and given[2] & _WRITING:
            # A device's path is opened to write without being made; nothing happens to none.
            makes = given[2] & (os.O_CREAT | os.O_TRUNC)
            if not is_free(given[0]) and (makes or os.path.isfile(given[0])):
                seen.append(f"wrote {given[0]}")
        elif event in _CHANGES:
            place, folder_place = _CHANGES[event]
            within = given[folder_place] if folder_place is not None else -1
            if not is_free(given[place], within):
                seen.append(f"{event} {given[place]}")
        elif event == "pickle.find_class" and given[0] in _ACTING and not _is_error(*given):
            seen.append(f"unpickled {given}")
        elif event == "import" and given[0] in _HANDLERS:
            seen.append(f"imported {given[0]}")

    sys.addaudithook(look)


MEASUREMENTS = {"strangers files": strangers_files_figure}
