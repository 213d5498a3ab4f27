"""Exceptions on their way from one process to another."""

from __future__ import annotations

import contextlib
import io
import pickle
import sys
import traceback
from typing import Any, NamedTuple


class RemoteFailure(NamedTuple):
    """An exception on its way: pickled if it can be, in words, and how it came about."""

    pickled: bytes | None
    message: str
    trace: str

    @staticmethod
    def from_exception(error: BaseException) -> RemoteFailure:
        pickled = None
        # SystemExit and its kind would end the process that asked.
        if isinstance(error, Exception):
            with contextlib.suppress(Exception):
                pickled = pickle.dumps(error)
                # Many can be pickled but not made again, for want of their arguments.
                if type(pickle.loads(pickled)) is not type(error):
                    pickled = None
        return RemoteFailure(pickled, repr(error), "".join(traceback.format_exception(error)))

    def to_exception(self) -> Exception | None:
        """The exception itself; None if nobody here could expect it."""
        with contextlib.suppress(Exception):
            return (
                None
                if self.pickled is None
                else _LoadedModulesUnpickler(io.BytesIO(self.pickled)).load()
            )
        return None


class _LoadedModulesUnpickler(pickle.Unpickler):
    """Makes only what this process knows: a library's own errors would load the library."""

    def find_class(self, module: str, name: str) -> Any:
        if module not in sys.modules:
            raise pickle.UnpicklingError(f"{module} isn't loaded")
        return super().find_class(module, name)
