"""Holds a reader of pictures against files of known truth."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from judges.picture_files.truth import Numbers, PictureFile, make_file
from labapp.common.errors import UserError

RIGHT, NAMED, UNNAMED = "right", "refused by name", "refused without name"
WRONG, CRASHED = "silently wrong", "crashed"
VERDICTS = (RIGHT, NAMED, UNNAMED, WRONG, CRASHED)

Read = Callable[[Path, int | None], Any]
"""Reads a page (None: as the reader chooses) as an object with levels, light, encoding, ..."""

_EXACT, _CURVE = 3e-6, 1e-4
"""Share of white that single precision may take from light, and a curve given as a table."""


@dataclass(frozen=True)
class Finding:
    """What became of a file. untold: right, but something that concerns the user isn't said.

    leaked: what libraries wrote to the terminal meanwhile. valid: whether the file holds one
    picture that a reader of everything would read.
    """

    kind: str
    seed: int
    verdict: str
    reason: str = ""
    untold: str = ""
    leaked: str = ""
    page: int | None = None
    valid: bool = True

    @property
    def counted(self) -> str:
        """The verdict; text of a library on the terminal counts as a crash."""
        return CRASHED if self.leaked else self.verdict


def judge_kinds(
    read: Read, kinds: Iterable[str], folder: Path, seeds: Iterable[int] = (0,)
) -> list[Finding]:
    """Judge a file of each kind for each seed, and each page of those that have several."""
    found = []
    for seed in seeds:
        for kind in kinds:
            file = make_file(kind, seed, folder)
            for one in (file, *_single_pages(file)):
                found.append(replace(_judge(read, one), kind=kind, seed=seed, page=one.page))
    return found


def judge_reader(read: Read, files: Iterable[PictureFile]) -> list[Finding]:
    """Judge files that are there."""
    return [_judge(read, one) for file in files for one in (file, *_single_pages(file))]


def counts(found: Iterable[Finding]) -> dict[str, int]:
    """How many files met each fate, the texts on the terminal counted as crashes."""
    counted = Counter(one.counted for one in found)
    return {verdict: counted[verdict] for verdict in VERDICTS}


def table(found: Iterable[Finding]) -> str:
    """A line for each file that wasn't read rightly or isn't told of."""
    lines = []
    for one in found:
        if one.counted == RIGHT and not one.untold:
            continue
        page = "" if one.page is None else f", page {one.page}"
        line = f"{one.counted:22}{one.kind}{page} [{one.seed}]: {one.reason}"
        line += f" UNTOLD {one.untold}" if one.untold else ""
        line += f" TEXT {one.leaked!r}" if one.leaked else ""
        lines.append(line)
    return "\n".join(lines)


def _single_pages(file: PictureFile) -> Iterator[PictureFile]:
    """A page that was named is read without a word."""
    for number, page in enumerate(file.pages):
        kind = "linear" if page.dtype != np.uint8 else "srgb"
        white = np.iinfo(page.dtype).max if page.dtype.kind == "u" else None
        yield replace(
            file, numbers=page, encodings=(kind,), white=white, pages=(), must_tell=(), page=number
        )


def _judge(read: Read, file: PictureFile) -> Finding:
    """Read a file, and class what comes."""
    # Of several pages, none is the picture: to ask for one is as right as to take one.
    finding = Finding("", 0, RIGHT, valid=file.valid and not file.pages)
    with _listening() as heard:
        try:
            photograph = read(file.path, file.page)
        except UserError as error:
            finding = replace(finding, **_of_refusal(str(error), file))
        except Exception as error:
            finding = replace(finding, verdict=CRASHED, reason=repr(error)[:200])
        else:
            finding = replace(finding, **_of_reading(photograph, file))
    return replace(finding, leaked="".join(heard).strip()[:200])


def _of_refusal(message: str, file: PictureFile) -> dict[str, str]:
    said = message.replace(str(file.path), "").replace(file.path.name, "")
    # What to do instead names formats too, and says nothing of the file.
    about = said.split(" Give ")[0].split(" Save ")[0].lower()
    named = any(word in about for word in file.must_name)
    if file.valid and not file.must_name:
        return {"verdict": UNNAMED, "reason": f"a usual file: {said[:160]}"}
    if file.valid and "damaged" in about and "damaged" not in file.must_name:
        return {"verdict": UNNAMED, "reason": f"a sound file: {said[:160]}"}
    return {"verdict": NAMED if named else UNNAMED, "reason": said[:160]}


def _of_reading(photograph: Any, file: PictureFile) -> dict[str, str]:
    notes = " ".join(getattr(photograph, "remarks", ()))
    words = notes.lower()
    if not file.valid:
        if any(word in words for word in file.must_name):
            return {"verdict": RIGHT, "reason": f"read with a note: {notes[:120]}"}
        return {"verdict": WRONG, "reason": "read, though it isn't sound or no photograph"}
    wrong = _difference(photograph, file)
    if wrong:
        return {"verdict": WRONG, "reason": wrong + (f"; notes: {notes[:90]}" if notes else "")}
    return {"verdict": RIGHT, "untold": ", ".join(_unsaid(photograph, file, words))}


def _difference(photograph: Any, file: PictureFile) -> str:
    """What is wrong with a picture that was read, in words; "" if nothing."""
    light = np.asarray(photograph.light, np.float64)
    levels = np.asarray(photograph.levels)
    if not np.isfinite(light).all():
        return "light isn't finite"
    encoding = getattr(photograph.encoding, "name", photograph.encoding)
    by_curve = encoding not in ("linear", "srgb")
    if file.encodings and encoding not in file.encodings and not by_curve:
        return f"encoding {encoding!r}, which is {' or '.join(file.encodings)}"
    if file.numbers is not None:
        wrong = _level_difference(levels, getattr(photograph, "white", None), file)
        if wrong:
            return wrong
    names = file.encodings if by_curve and file.encodings else (encoding,)
    errors = [_error(light, truth, file) for name in names for truth in file.lights(name)]
    loss = 2.5 * max(file.loss, file.also_loss)
    if min(errors) > max(loss, _CURVE if by_curve else _EXACT):
        return f"light differs by {min(errors):.2g} of white under {encoding!r}"
    return ""


def _level_difference(levels: Numbers, white: float | None, file: PictureFile) -> str:
    assert file.numbers is not None
    truths = [file.numbers, *file.also]
    if file.white and file.white < 255:
        # Fewer bits than 8 may come spread over 8, if the white level says so.
        spread = [t * ((white or 255) / file.white) for t in truths]
        truths += [t for t in spread if white in (None, 255)]
    shapes = {_alike(levels, t).shape for t in truths}
    if not any(_alike(levels, t).shape == t.shape for t in truths):
        return f"levels {levels.shape}, in truth {shapes}"
    errors = [_error(levels.astype(np.float64), t, file) for t in truths]
    others = range(1, 1 + len(file.also))
    allowed = [max(file.loss, file.also_loss if i in others else 0) for i in range(len(truths))]
    if all(error > most for error, most in zip(errors, allowed, strict=True)):
        top = float(np.abs(file.numbers.astype(float)).max()) or 1.0
        ratio = float(np.abs(levels.astype(float)).max()) / top
        return f"levels differ by {min(errors):.2g} of white (largest: {ratio:.3g} times)"
    if white is not None and file.white is not None and file.white >= 255:
        whites = {file.white} | ({file.white / 257} if file.also else set())
        if not any(abs(white - one) < 1e-6 * one for one in whites):
            return f"white is {white}, in truth {file.white:g}"
    return ""


def _error(found: Numbers, truth: Numbers, file: PictureFile) -> float:
    """Rms difference of lossy files, else the largest one, in shares of the truth's largest."""
    found = _alike(found, truth)
    if found.shape != truth.shape:
        return np.inf
    off = np.abs(found - truth.astype(np.float64))
    top = float(np.abs(truth.astype(np.float64)).max()) or 1.0
    return float(np.sqrt((off**2).mean()) if file.loss else off.max()) / top


def _alike(found: Numbers, truth: Numbers) -> Numbers:
    """Grey as one band or as three equal ones is the same."""
    if len(found) == 1 and len(truth) == 3 and (truth == truth[:1]).all():
        return np.broadcast_to(found, truth.shape)
    if len(found) == 3 and len(truth) == 1 and (found == found[:1]).all():
        return found[:1]
    return found


def _unsaid(photograph: Any, file: PictureFile, words: str) -> Iterator[str]:
    """What a user has to know and isn't told."""
    if file.must_tell and not any(word in words for word in file.must_tell):
        yield file.must_tell[0]
    if getattr(photograph, "orientation", 1) != file.orientation:
        yield f"orientation {file.orientation}"
    if file.is_mosaic and getattr(photograph, "mosaic", None) is None:
        yield "mosaic"
    told = getattr(photograph, "exposure", None)
    for name, value in file.exposure.items():
        seen = getattr(told, name, None)
        if seen is None or abs(seen - value) > 1e-3 * value:
            yield name


@contextlib.contextmanager
def _listening() -> Iterator[list[str]]:
    """Collect what is written to the terminal by anybody, C libraries among them."""
    heard: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        kept = os.dup(1), os.dup(2)
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        # What is logged reaches a log, where a program has one, and else the terminal.
        text, handler = io.StringIO(), logging.NullHandler()
        logging.getLogger().addHandler(handler)
        try:
            with (
                warnings.catch_warnings(record=True) as warned,
                contextlib.redirect_stdout(text),
                contextlib.redirect_stderr(text),
            ):
                warnings.simplefilter("always")
                yield heard
        finally:
            logging.getLogger().removeHandler(handler)
            for number, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, number)
                os.close(copy)
            file.seek(0)
            heard += [file.read().decode(errors="replace"), text.getvalue()]
            heard += [str(one.message) for one in warned]
