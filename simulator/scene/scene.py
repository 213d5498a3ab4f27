"""A scene: targets by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from simulator.scene.dark import Dark
from simulator.scene.target import Target


@dataclass(frozen=True)
class Scene:
    """Set of named targets, of which one stands before the camera at a time.

    Parameters
    ----------
    targets : mapping of str to Target, default a dark target
        The targets by name, at least one.

    Raises
    ------
    ValueError
        If there is no target.
    """

    targets: Mapping[str, Target] = field(default_factory=lambda: {"dark": Dark()})

    def __post_init__(self) -> None:
        if not self.targets:
            raise ValueError("targets is empty; a scene needs at least one")
