"""Modules that stand elsewhere now: scripts that import them by their old names still run."""

from __future__ import annotations

import importlib
from functools import partial
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from importlib.util import find_spec, spec_from_loader
from types import ModuleType

_NEW = {
    "optics.alignment": "optics.measuring",
    "optics.calibration": "optics.measuring",
    "optics.camera_noise": "optics.measuring",
    "optics.chain": "optics.psf",
    "optics.deconvolution": "optics.inverse",
    "optics.demosaicing": "optics.inverse",
    "optics.field_aberrations": "optics.camera.field_aberrations",
    "optics.ghost": "optics.camera.ghost",
    "optics.operators": "optics.inverse",
    "optics.psf_engines": "optics.psf",
    "optics.pupil": "optics.camera.pupil",
    "optics.slanted_edge": "optics.measuring.slanted_edge",
    "optics.stop": "optics.camera",
    "optics.stop.aperture": "optics.camera.stop",
    "optics.system_mtf": "optics.camera.system_mtf",
    "optics.throughput": "optics.camera.system_mtf",
}


def find_moved(name: str) -> ModuleSpec | None:
    """Return the specification of a module under an old name; None if it never had that name.

    Raises ModuleNotFoundError, with the package to look in, for a module that was divided.
    """
    if name in _NEW:
        return spec_from_loader(name, _Forwarding(_NEW[name]))
    room, _, module = name.rpartition(".")
    if room not in _NEW:
        return None
    new = f"{_NEW[room]}.{module}"
    if find_spec(new) is None:
        raise ModuleNotFoundError(f"{name} is no more; look in {_NEW[room]}", name=name)
    return spec_from_loader(name, _Forwarding(new))


class _Forwarding(Loader):
    def __init__(self, new: str) -> None:
        self._new = new

    def exec_module(self, module: ModuleType) -> None:
        new = importlib.import_module(self._new)
        module.__doc__ = new.__doc__
        module.__path__ = []
        module.__dict__["__getattr__"] = partial(getattr, new)
        if hasattr(new, "__all__"):
            module.__dict__["__all__"] = new.__all__
