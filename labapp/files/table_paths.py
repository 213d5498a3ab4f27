"""Paths in the tables of a scene: find them, and make them absolute."""

from __future__ import annotations

from os.path import normpath
from pathlib import Path
from typing import Any, TypeVar

from labapp.files.reading import FileModel

M = TypeVar("M", bound=FileModel)

PATH_KEYS = frozenset({"file", "disparity", "depth"})
"""Names of the keys in a scene's tables whose values are paths."""


def with_absolute_paths(table: M, folder: Path) -> M:
    """Return a table with absolute paths, those within its own tables included.

    Relative paths start at `folder`.
    """
    changes = {
        name: _make_absolute(name, getattr(table, name), folder)
        for name in type(table).model_fields
    }
    return table.model_copy(update=changes)


def referenced_files(table: FileModel) -> list[Path]:
    """Return all paths that a table, and those within it, name, each once, sorted."""
    return sorted(set(_collect_paths("", table)))


def _make_absolute(name: str, value: Any, folder: Path) -> Any:
    if isinstance(value, FileModel):
        return with_absolute_paths(value, folder)
    if isinstance(value, dict):
        return {key: _make_absolute("", one, folder) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(_make_absolute("", one, folder) for one in value)
    return normpath(folder / value) if name in PATH_KEYS and isinstance(value, str) else value


def _collect_paths(name: str, value: Any) -> list[Path]:
    if isinstance(value, FileModel):
        fields = type(value).model_fields
        return [path for field in fields for path in _collect_paths(field, getattr(value, field))]
    if isinstance(value, dict | list | tuple):
        items = value.values() if isinstance(value, dict) else value
        return [path for one in items for path in _collect_paths("", one)]
    return [Path(value)] if name in PATH_KEYS and isinstance(value, str) else []
