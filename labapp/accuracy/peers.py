"""Loads adapters to other libraries, which are then measured beside our own methods.

A package that has adapters declares them as entry points in the group `labapp.peers`. The name of
the entry point is that of the operation:

    psf         adapter(case) -> Candidates for a `labapp.prediction.lens_options.LensCase`
    propagate   adapter(case, seen) -> Candidates for a `labapp.accuracy.propagate.FieldCase`; their
                calls give seen(answer)
    deconvolve  adapter(case) -> (name, iterations, call) for a
                `labapp.accuracy.blurs.SimulatedPhotograph`

A checkout has adapters to prysm, poppy, hcipy, torchoptics, DeepLens and scikit-image in
tests/peers; they serve as examples.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any

from labapp.common.errors import UserError

GROUP = "labapp.peers"


def installed_peers(operation: str) -> list[Callable[..., Any]]:
    """Load the installed adapters for an operation, such as "psf".

    Raises UserError if there is no adapter, or one doesn't load. The message says what to install
    or mend.
    """
    entries = entry_points(group=GROUP, name=operation)
    if not entries:
        raise UserError(
            f"--peers: no adapter to another library is installed for {operation!r}; a checkout "
            "of labapp has some: pip install -e tests/peers."
        )
    found = []
    for entry in entries:
        try:
            found.append(entry.load())
        except Exception as error:
            raise UserError(
                f"--peers: the adapter {entry.value} doesn't load: {error}. Mend or remove it."
            ) from error
    return found
