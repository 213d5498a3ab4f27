"""Common parts of records and design files: NeXus groups, and the versions of programs."""

from __future__ import annotations

import platform
from importlib.metadata import version

import h5py

import labapp

_PACKAGES = ("numpy", "scipy", "torch", "h5py")


def create_group(parent: h5py.Group, name: str, kind: str) -> h5py.Group:
    """Create an HDF5 group of a NeXus class."""
    made = parent.create_group(name)
    made.attrs["NX_class"] = kind
    return made


def program_versions() -> dict[str, str]:
    """Return the versions of Python and the packages on which computed results depend."""
    found = {name: version(name) for name in _PACKAGES}
    return {"labapp": labapp.__version__, "python": platform.python_version(), **found}
