"""Common parts of records and designs: NeXus groups, and the versions of programs."""

from __future__ import annotations

import platform
from importlib.metadata import version

import h5py

import labapp
from labapp.common.program_version import source_commit

_PACKAGES = ("numpy", "scipy", "torch", "h5py")


def create_group(parent: h5py.Group, name: str, kind: str) -> h5py.Group:
    """Create a group of a NeXus class."""
    made = parent.create_group(name)
    made.attrs["NX_class"] = kind
    return made


def program_versions() -> dict[str, str]:
    """Return labapp's version and commit, and the versions of what computed results depend on."""
    found = {name: version(name) for name in _PACKAGES}
    own = {"labapp": labapp.__version__, "commit": source_commit() or "unknown"}
    return {**own, "python": platform.python_version(), **found}
