"""The calls by which a command changed a folder, in their order, as strace saw them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

STRACE = shutil.which("strace")

_CALLS = (
    "open,openat,creat,write,pwrite64,writev,pwritev,truncate,ftruncate,fallocate,"
    "copy_file_range,sendfile,fsync,fdatasync,rename,renameat,renameat2,link,linkat,"
    "symlink,symlinkat,unlink,unlinkat,mkdir,mkdirat,rmdir,lseek,mmap"
)
_LINE = re.compile(r"(?P<thread>\d+) +(?P<moment>[\d.]+) (?P<rest>.*)")
_WHOLE = re.compile(r"(?P<name>\w+)\((?P<words>.*)\) += (?P<result>-?\d+|0x\w+)(?P<more>.*)")
_HANDLE = re.compile(r"(?P<number>-?\d+|AT_FDCWD)(?:<(?P<path>[^>]*)>)?(?P<gone>\(deleted\))?")
_BYTES = re.compile(r'"((?:\\x[0-9a-f]{2})*)"')


@dataclass(frozen=True)
class Event:
    """A change of a folder's files, or what was told of them.

    moment: seconds. kind: open, write, size, begin or end of a sync, told, or the name of a call
    that changes names. size: that of the file or where the write begins; of the end of a sync,
    whether it succeeded. number: that of a sync.
    """

    moment: float
    kind: str
    path: str = ""
    other: str = ""
    data: bytes = b""
    size: int = 0
    number: int = 0


def trace(
    command: Sequence[str | Path], folder: Path, *, fail: str = "", environment: dict[str, str]
) -> tuple[list[Event], subprocess.CompletedProcess[str]]:
    """Run a command, and return what it changed in a folder, with its end.

    What the command prints is among the events. fail: what strace injects, as it takes it.
    """
    assert STRACE is not None
    told, log = folder.with_name(f"{folder.name}.told"), folder.with_name(f"{folder.name}.calls")
    asked = ["-e", f"trace={_CALLS}", *(("-e", f"inject={fail}") if fail else ())]
    with told.open("w") as out:
        done = subprocess.run(
            [STRACE, "-f", "-y", "-ttt", "-xx", "-s", f"{1 << 28}", "--seccomp-bpf",
             "-o", log, *asked, "--", *command],
            stdout=out, stderr=subprocess.PIPE, text=True, check=False, env=environment,
        )  # fmt: skip
    with log.open() as lines:
        events = list(_Reader(folder, told).read(lines))
    log.unlink()
    done.stdout = told.read_text()
    return events, done


class _Reader:
    """Reads strace's lines; knows where each open file is read and written next."""

    def __init__(self, folder: Path, told: Path) -> None:
        self._folder, self._told = str(folder), str(told)
        self._begun: dict[str, tuple[str, float, int]] = {}
        self._places: dict[tuple[int, str], int] = {}
        self._appends: set[tuple[int, str]] = set()
        self._syncs = 0

    def read(self, lines: Iterable[str]) -> Iterator[Event]:
        for line in lines:
            if not (found := _LINE.fullmatch(line.rstrip("\n"))):
                continue
            thread, moment, rest = found["thread"], float(found["moment"]), found["rest"]
            if rest.endswith("<unfinished ...>"):
                begin = rest.removesuffix("<unfinished ...>").rstrip()
                yield from self._begin(thread, moment, begin)
                continue
            if again := re.match(r"<\.\.\. \w+ resumed>(.*)", rest):
                begin, moment, number = self._begun.pop(thread, ("", 0.0, 0))
                rest = begin + again[1]
            elif whole := _WHOLE.match(rest):
                yield from self._sync_begins(whole["name"], whole["words"], moment)
                number = self._syncs
            if whole := _WHOLE.match(rest):
                yield from self._ended(whole, moment, number)

    def _begin(self, thread: str, moment: float, rest: str) -> Iterator[Event]:
        name, _, words = rest.partition("(")
        yield from self._sync_begins(name, words, moment)
        self._begun[thread] = rest, moment, self._syncs

    def _sync_begins(self, name: str, words: str, moment: float) -> Iterator[Event]:
        if name in ("fsync", "fdatasync") and self._is_inside(path := _path(words)):
            self._syncs += 1
            yield Event(moment, "begin", path, number=self._syncs)

    def _ended(self, call: re.Match[str], moment: float, number: int) -> Iterator[Event]:
        name, words, result = call["name"], call["words"].split(", "), int(call["result"], 0)
        if name in ("fsync", "fdatasync"):
            if self._is_inside(path := _path(words[0])):
                # fdatasync(2) needn't write what isn't needed to read a file: a folder's names.
                yield Event(moment, "end", path, name, size=int(result == 0), number=number)
        elif result < 0:
            return
        elif name in ("open", "openat", "creat"):
            yield from self._opened(name, call, moment, result)
        elif name in ("write", "pwrite64", "writev", "pwritev"):
            yield from self._written(name, call["words"], moment, result)
        elif name == "lseek":
            self._places[_key(words[0])] = result
        elif name in ("ftruncate", "truncate"):
            path = _path(words[0]) if name == "ftruncate" else _text(words[0])
            if self._is_inside(path):
                yield Event(moment, "size", path, size=int(words[1]))
        elif name == "mmap":
            shared = "MAP_SHARED" in call["words"] and "PROT_WRITE" in call["words"]
            if shared and self._is_inside(_path(words[4])):
                raise ValueError(f"{_path(words[4])} is written through memory, which isn't seen")
        elif name in ("fallocate", "copy_file_range", "sendfile"):
            if any(self._is_inside(_path(word)) for word in words):
                raise ValueError(f"{name} isn't known here: {call['words'][:80]}")
        else:
            yield from self._renamed(name, words, moment)

    def _opened(
        self, name: str, call: re.Match[str], moment: float, number: int
    ) -> Iterator[Event]:
        path = _decode((re.match(r"<([^>]*)>", call["more"]) or [""] * 2)[1])
        key, words = (number, path), call["words"]
        self._places[key] = 0
        self._appends.discard(key)
        if "O_APPEND" in words:
            self._appends.add(key)
        if self._is_inside(path) and ("O_CREAT" in words or "O_TRUNC" in words or name == "creat"):
            yield Event(moment, "open", path, size=int("O_TRUNC" in words or name == "creat"))

    def _written(self, name: str, words: str, moment: float, count: int) -> Iterator[Event]:
        parts = (bytes.fromhex(one.replace("\\x", "")) for one in _BYTES.findall(words))
        key, data = _key(words), b"".join(parts)[:count]
        if key[1] == self._told:
            yield Event(moment, "told", data=data)
        if not self._is_inside(key[1]):
            return
        if name.startswith("p"):
            place = int(words.rpartition(", ")[2])
        elif key in self._appends:
            place = -1
        else:
            place = self._places.get(key, 0)
            self._places[key] = place + count
        yield Event(moment, "write", key[1], data=data, size=place)

    def _renamed(self, name: str, words: list[str], moment: float) -> Iterator[Event]:
        """Names that change: each is an absolute path, or a handle of a folder and a path."""
        paths = []
        for number, word in enumerate(words):
            if word.startswith('"'):
                at = (
                    _path(words[number - 1]) if number and "<" in words[number - 1] else os.getcwd()
                )
                paths.append(os.path.normpath(os.path.join(at, _text(word))))
        if not any(self._is_inside(path) for path in paths):
            return
        kind = re.sub("at2?$", "", name)
        if kind == "symlink":
            raise ValueError(f"symlink isn't known here: {paths}")
        if kind == "unlink" and "AT_REMOVEDIR" in words[-1]:
            kind = "rmdir"
        yield Event(moment, kind, paths[0], paths[-1])

    def _is_inside(self, path: str) -> bool:
        return path == self._folder or path.startswith(self._folder + "/")


def _decode(hexadecimal: str) -> str:
    text = re.sub(r"\\x([0-9a-f]{2})", lambda one: chr(int(one[1], 16)), hexadecimal)
    return text.encode("latin-1").decode().removesuffix(" (deleted)")


def _text(word: str) -> str:
    return _decode(word.strip('"'))


def _path(word: str) -> str:
    """The path of an open file as strace shows it; empty if it has none."""
    found = _HANDLE.match(word)
    return _decode(found["path"]) if found and found["path"] else ""


def _key(word: str) -> tuple[int, str]:
    found = _HANDLE.match(word)
    number = int(found["number"]) if found and found["number"] != "AT_FDCWD" else -1
    return number, _path(word)
