"""What plans cost, without asking an effect twice for the same."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise

from simulator.planning.effect import Effect
from simulator.situation import Situation


class _Watched(Mapping[str, int]):
    """Levels that remember which of them are looked at, in order."""

    def __init__(self, levels: Mapping[str, int]) -> None:
        self._levels = levels
        self.seen: dict[str, int] = {}

    def __getitem__(self, name: str) -> int:
        level = self._levels[name]
        self.seen[name] = level
        return level

    def __iter__(self) -> Iterator[str]:
        return iter(self._levels)

    def __len__(self) -> int:
        return len(self._levels)


class Work:
    """Operations of one effect by the levels of all.

    It follows from those levels alone that the effect looks at, so what it said is kept under
    these: first by the level that it looked at first, and so on. looked_at: all of them so far.
    """

    def __init__(self, effect: Effect, situation: Situation) -> None:
        self._effect, self._s = effect, situation
        self._kept: _Asked | float | None = None
        self.looked_at: set[str] = set()

    def __call__(self, levels: Mapping[str, int]) -> float:
        found = self._kept
        while isinstance(found, _Asked):
            found = found.answers.get(levels[found.name])
        if found is None:
            watched = _Watched(levels)
            found = self._effect.work(self._s, watched)
            self.looked_at.update(watched.seen)
            self._keep(list(watched.seen.items()), found)
        return found

    def _keep(self, seen: list[tuple[str, int]], work: float) -> None:
        if not seen:
            self._kept = work
            return
        if not isinstance(self._kept, _Asked):
            self._kept = _Asked(seen[0][0])
        held = self._kept
        for (_, level), (name, _) in pairwise(seen):
            following = held.answers.get(level)
            if not isinstance(following, _Asked):
                following = held.answers[level] = _Asked(name)
            held = following
        held.answers[seen[-1][1]] = work


class _Asked:
    """Which level was looked at next, and what followed for each that it had."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.answers: dict[int, _Asked | float] = {}
