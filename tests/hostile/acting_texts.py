"""Texts that would act if a file's text became code, a call, a shell word, a path or a control.

A folder of canaries stands beside the files: a file that is to stay as it is, and names that must
never come to be.
"""

from __future__ import annotations

import json
import pickle
import random
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from forging import forge, replace_text

from hostile.hdf5_files import changed_copy
from hostile.mutated_texts import as_text, parsed, places

KEPT, MADE = "kept", "made"

PAYLOADS = (
    "os:system@touch {made}", "os:system", "subprocess:getoutput@touch {made}", "posix:system",
    "spy://loop://?file={kept}", "spy:///dev/null?file={kept}", "alt://{kept}?class=os.system",
    "hwgrep://{kept}&skip_busy", "loop://?logging=debug", "file://{kept}", "{kept}", "{made}",
    "$(touch {made})", "`touch {made}`", "; touch {made};", "| touch {made}", "-o{made}",
    "--out={made}", "canaries/kept", "x/../canaries/made", "~/made", "http://127.0.0.1:9/x",
    "!!python/object/apply:os.system ['touch {made}']", "@{kept}", "{program}",
    "__import__('os').system('touch {made}')", "%(kept)s %n %s", "{{0.__class__.__init__}}",
    "\x1b]0;title\x07\x1b[2J\x1b[31m", "a\x9b2Jb\x08\x08\x7f", "a\nlabapp: \u202edenots",
    "n" * 5000,
    "C:\\\\{made}", "//{made}", "{made}\n", "{kept}/../made", "/proc/self/mem", "/dev/stdout",
)  # fmt: skip

_SLOTS: dict[str, Any] = {"slots_nm": [[500, 10], [550, 10]]}

_DEVICES: Sequence[tuple[str, str, str, dict[str, Any]]] = (
    ("filter", "starlight-wheel", "backend", _SLOTS), ("filter", "zwo-wheel", "backend", _SLOTS),
    ("filter", "varispec", "port", {}), ("filter", "thorlabs-wheel", "port", _SLOTS),
    ("camera", "uvc-camera", "source", {}), ("camera", "uvc-camera", "device", {}),
    ("camera", "aravis-camera", "device", {}), ("slm", "screen-slm", "screen", {}),
    ("slm", "screen-slm", "display", {}),
)  # fmt: skip
"""Real drivers, with an option of theirs that takes a text."""


@dataclass(frozen=True)
class Canaries:
    """The folder whose files tell that a text has acted."""

    folder: Path

    @property
    def words(self) -> dict[str, str]:
        names = {"kept": KEPT, "made": MADE, "program": "program"}
        return {name: str(self.folder / file) for name, file in names.items()}

    def lay(self) -> None:
        """Lay them out anew."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        (self.folder / KEPT).write_text("kept")
        program = self.folder / "program"
        program.write_text(f"#!/bin/sh\ntouch {self.folder / MADE}\n")
        program.chmod(0o755)

    def text(self, payload: str) -> str:
        for name, value in self.words.items():
            payload = payload.replace(f"{{{name}}}", value)
        return payload

    def harm(self) -> str:
        """What has happened to them; empty if nothing."""
        found = {one.name for one in self.folder.iterdir()}
        if found != {KEPT, "program"}:
            return f"files in the folder are {sorted(found)}"
        kept = (self.folder / KEPT).read_text()
        return "" if kept == "kept" else f"a file now holds {kept[:40]!r}"


@dataclass(frozen=True)
class CraftedText:
    """A file of the bench with a text that would act. name: of the file that is replaced."""

    what: str
    name: str
    write: Callable[[Path], None]


def crafted_texts(
    folder: Path, texts: dict[str, str], canaries: Canaries, count: int, seed: int
) -> Iterator[CraftedText]:
    """Those by hand, then drawn ones until there are `count`."""
    made = list(_by_hand(folder, texts, canaries))
    rng = random.Random(seed)
    while len(made) < count:
        draw = _drawn_device if rng.random() < 0.35 else _drawn_place
        made.append(draw(texts, canaries, rng))
    yield from made[:count]


def _as_file(what: str, name: str, data: Any) -> CraftedText:
    text = as_text(data, name.rpartition(".")[2])
    return CraftedText(
        what, name, lambda path: path.write_text(text, errors="surrogatepass") and None
    )


def _drawn_place(texts: dict[str, str], canaries: Canaries, rng: random.Random) -> CraftedText:
    """A text of a file, or a key of it, is replaced by one that would act."""
    name = rng.choice([one for one in texts if not one.endswith("csv")])
    data = parsed(texts[name], name.rpartition(".")[2])
    payload = canaries.text(rng.choice(PAYLOADS))
    found = [one for one in places(data) if isinstance(_at(data, one), str)]
    place = rng.choice(found)
    table = _at(data, place[:-1])
    if rng.random() < 0.15 and isinstance(table, dict):
        table[payload] = table.pop(place[-1])
    else:
        table[place[-1]] = payload
    return _as_file(f"{name} {place[-1]} {payload[:30]!r}", name, data)


def _drawn_device(texts: dict[str, str], canaries: Canaries, rng: random.Random) -> CraftedText:
    """A real driver's option is a text that would act."""
    role, driver, option, others = rng.choice(_DEVICES)
    data = parsed(texts["bench.toml"], "toml")
    payload = canaries.text(rng.choice(PAYLOADS))
    own = {"own_process": True} if rng.random() < 0.2 else {}
    data["devices"][role] = {"driver": driver, "options": others | {option: payload}} | own
    return _as_file(f"{driver} {option} {payload[:30]!r}", "bench.toml", data)


def _at(data: Any, place: Sequence[Any]) -> Any:
    for key in place:
        data = data[key]
    return data


class _Acting:
    """What runs a program when it's unpickled."""

    def __init__(self, command: str) -> None:
        self._command = command

    def __reduce__(self) -> Any:
        import os

        return os.system, (self._command,)


def _by_hand(folder: Path, texts: dict[str, str], canaries: Canaries) -> Iterator[CraftedText]:
    kept, made = canaries.words["kept"], canaries.words["made"]
    acting = _Acting(f"touch {made}")
    plan = parsed(texts["plan.toml"], "toml")
    for hook in ("os:system", "posixpath", "labapp.runs", canaries.words["program"]):
        yield _as_file(f"hook {hook}", "plan.toml", plan | {"hooks": [hook]})
    picture = {"kind": "file", "file": kept}
    yield _as_file("pattern of a file", "plan.toml", plan | {"patterns": {"neutral": picture}})
    for name in ("calibration", "camera_calibration"):
        data = parsed(texts["bench.toml"], "toml") | {name: kept}
        yield _as_file(f"{name} of a path", "bench.toml", data)
    for what, write in {
        "pickled .npy": lambda path: np.save(
            path.open("wb"), np.array([acting]), allow_pickle=True
        ),
        "pickled .npz": lambda path: np.savez(path.open("wb"), a=np.array([acting], dtype=object)),
        "pickle": lambda path: path.write_bytes(pickle.dumps(acting)),
        "weights of torch": lambda path: torch.save({"a": acting}, path),
    }.items():
        yield CraftedText(what, "psf.npy", write)
        yield CraftedText(what, "state.pt", write)
    for name in ("picture.png", "spectra.csv", "panel.toml", "calibration.json", "psf.npy"):
        yield CraftedText("a link to a canary", name, lambda path: path.symlink_to(kept))
    yield from _records(folder, canaries)


def _records(folder: Path, canaries: Canaries) -> Iterator[CraftedText]:
    """Records whose digests are as they should be, with texts that would act."""
    for change in ("external-link", "external-storage", "virtual-dataset", "foreign-filter"):
        yield CraftedText(change, "run.h5", lambda path, change=change: _changed(path, change))
    for payload in PAYLOADS[24:36]:
        yield CraftedText(
            f"title {payload[:20]!r}", "run.h5", _forged("title", canaries.text(payload))
        )
    for role, driver, option, others in _DEVICES:
        with h5py.File(folder / "run.h5") as file:
            bench = json.loads(file["entry/bench"][()])
        options = others | {option: canaries.text(PAYLOADS[4] if option == "port" else PAYLOADS[0])}
        bench["devices"][role] |= {"driver": driver, "options": options}
        yield CraftedText(f"record of {driver}", "run.h5", _forged("bench", json.dumps(bench)))


def _changed(path: Path, change: str) -> None:
    whole = path.with_name("whole.h5")
    made = changed_copy(whole, "entry/title", change, path.parent)
    shutil.move(made, path)


def _forged(name: str, text: str) -> Callable[[Path], None]:
    """Replace a text of the record, lose a frame, so that it's resumed, and seal it again."""

    def write(path: Path) -> None:
        shutil.copyfile(path.with_name("whole.h5"), path)
        with h5py.File(path, "r+", libver="latest") as file:
            replace_text(file["entry"], name, text)
            file["entry/data/stored"][3] = 0
        forge(path)

    return write
