"""Questions that nobody means: an answer, or a refusal in words, in no time and little memory."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import torch
from judges.absurd_questions import ANSWERED, REFUSED, Finding, ask_all

from figures import Figure
from optics.accuracy import Budget

_SEEDS = range(1, 241)

_SECONDS = 2.0


def absurd_questions_figure(folder: Path) -> list[Figure]:
    """Each in a forked process, which has loaded what the product needs. folder: not used."""
    for name in ("optics.patterns", "optics.propagation", "optics.psf", "simulator.imaging"):
        importlib.import_module(name)
    torch.set_num_threads(1)
    return list(_figures(list(ask_all(_SEEDS))))


def _figures(found: list[Finding]) -> Iterable[Figure]:
    fates = Counter(one.fate for one in found)
    bad = [one for one in found if one.fate not in (ANSWERED, REFUSED)]
    name = f"{len(found)} absurd questions"
    first = f"; first {bad[0].question}: {bad[0].fate} {bad[0].told[:80]}" if bad else ""
    yield Figure(
        f"{name}: neither answered nor refused in words",
        "0",
        f"{len(bad)} ({', '.join(f'{n} {fate}' for fate, n in sorted(fates.items()))}){first}",
        not bad,
    )
    slow = [one for one in found if one.seconds > _SECONDS]
    slowest = max(found, key=lambda one: one.seconds)
    yield Figure(
        f"{name}: processor time",
        f"≤ {_SECONDS:g} s each",
        f"{len(slow)} longer; slowest {slowest.seconds:.1f} s ({slowest.question})",
        not slow,
    )
    largest = max(found, key=lambda one: one.bytes)
    allowed = Budget().memory
    yield Figure(
        f"{name}: memory",
        f"≤ {allowed / 1e9:.1f} GB each",
        f"at most {largest.bytes / 1e9:.2f} GB ({largest.question})",
        largest.bytes <= allowed,
    )


MEASUREMENTS = {"absurd questions": absurd_questions_figure}
