"""What all adapters share: a library that loads or says why not, its troubles in words."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import metadata
from typing import Any

import numpy as np
import torch

Call = Callable[[], Any]

COMPLEX = {"float32": np.complex64, "float64": np.complex128}
MOST_BYTES = 3 << 30
"""A method that needs more memory is not tried."""


def load_library(name: str) -> tuple[Any, str]:
    """A library, and its name with its version; ValueError if there is none that loads."""
    try:
        # What a library warns about while it loads says nothing about the PSF.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            library = importlib.import_module(name)
        version = getattr(library, "__version__", "") or metadata.version(name)
    except Exception as error:
        missing = error.name if isinstance(error, ModuleNotFoundError) else ""
        if missing == name:
            raise ValueError(f"{name} isn't installed; pip install {name}") from error
        hint = '; pip install "setuptools<81"' if missing == "pkg_resources" else ""
        raise ValueError(f"{name} is installed but can't be loaded: {error}{hint}") from error
    return library, f"{name} {version}"


@contextmanager
def in_words(label: str) -> Iterator[None]:
    """Whatever a library raises, as a ValueError that names it."""
    try:
        yield
    except Exception as error:
        raise ValueError(f"{label} failed: {type(error).__name__}: {error}") from error


@contextmanager
def torchoptics_precision(torchoptics: Any, dtype: torch.dtype) -> Iterator[None]:
    """torchoptics computes in one precision, which is global."""
    before = torchoptics.get_default_dtype()
    torchoptics.set_default_dtype(dtype)
    try:
        yield
    finally:
        torchoptics.set_default_dtype(before)
