"""Cache the operations that effects add to a plan, by the levels that they depend on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise

from simulator.planning.effect import Effect
from simulator.situation import Situation


class _RecordingLevels(Mapping[str, int]):
    """Effect levels that record which of them are read, in order."""

    def __init__(self, levels: Mapping[str, int]) -> None:
        self._levels = levels
        self.reads: dict[str, int] = {}

    def __getitem__(self, name: str) -> int:
        level = self._levels[name]
        self.reads[name] = level
        return level

    def __iter__(self) -> Iterator[str]:
        return iter(self._levels)

    def __len__(self) -> int:
        return len(self._levels)


class CachedWork:
    """The operations of one effect as a cached function of the levels of all effects.

    The operations depend only on the levels that the effect reads. So they are cached in a tree,
    which branches first by the level that was read first, and so on. levels_read: the names of all
    effects whose level was read so far.
    """

    def __init__(self, effect: Effect, situation: Situation) -> None:
        self._effect, self._s = effect, situation
        self._kept: _LevelNode | float | None = None
        self.levels_read: set[str] = set()

    def __call__(self, levels: Mapping[str, int]) -> float:
        found = self._kept
        while isinstance(found, _LevelNode):
            found = found.children.get(levels[found.name])
        if found is None:
            watched = _RecordingLevels(levels)
            found = self._effect.added_operations(self._s, watched)
            self.levels_read.update(watched.reads)
            self._keep(list(watched.reads.items()), found)
        return found

    def _keep(self, seen: list[tuple[str, int]], work: float) -> None:
        """Store the operations that a planned effect adds in the tree, under the levels it read."""
        if not seen:
            self._kept = work
            return
        if not isinstance(self._kept, _LevelNode):
            self._kept = _LevelNode(seen[0][0])
        held = self._kept
        for (_, level), (name, _) in pairwise(seen):
            following = held.children.get(level)
            if not isinstance(following, _LevelNode):
                following = held.children[level] = _LevelNode(name)
            held = following
        held.children[seen[-1][1]] = work


class _LevelNode:
    """A node of the cache: the effect whose level was read next, and a child for each level."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.children: dict[int, _LevelNode | float] = {}
