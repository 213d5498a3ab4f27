"""Carry exceptions from a child process to its parent."""

from __future__ import annotations

import contextlib
import io
import pickle
import sys
import traceback
from typing import Any, NamedTuple


class RemoteFailure(NamedTuple):
    """An exception of another process: pickled if possible, as text, and with its traceback."""

    pickled: bytes | None
    message: str
    trace: str

    @staticmethod
    def from_exception(error: BaseException) -> RemoteFailure:
        pickled = None
        # SystemExit and other BaseExceptions would end the process that receives them.
        if isinstance(error, Exception):
            with contextlib.suppress(Exception):
                pickled = pickle.dumps(error)
                # Many exceptions can be pickled but not unpickled, because arguments are missing.
                if type(pickle.loads(pickled)) is not type(error):
                    pickled = None
        return RemoteFailure(pickled, repr(error), "".join(traceback.format_exception(error)))

    def to_exception(self) -> Exception | None:
        """Return the exception; None if this process can't unpickle it.

        It is unpickled only if its module is already loaded in this process.
        """
        with contextlib.suppress(Exception):
            return (
                None
                if self.pickled is None
                else _LoadedModulesUnpickler(io.BytesIO(self.pickled)).load()
            )
        return None


class _LoadedModulesUnpickler(pickle.Unpickler):
    """Unpickle only classes of loaded modules, so that no device library is imported here."""

    def find_class(self, module: str, name: str) -> Any:
        if module not in sys.modules:
            raise pickle.UnpicklingError(f"{module} isn't loaded")
        return super().find_class(module, name)
