"""Puts a mutant where a module is imported, and notes which of its lines run.

Every Python that is started with this folder in PYTHONPATH loads this file first, so that a
mutant holds in the child processes of a test, too. What to do stands in the environment:

    MUTANT_MODULE   the module's name, its file, and the file with the mutant's text
    MUTANT_REACHED  the module's file, and the log to which lines are added as they are reached
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import importlib.util
import os
import sys
import threading

MODULE, REACHED = "MUTANT_MODULE", "MUTANT_REACHED"


class _Text(importlib.machinery.SourceFileLoader):
    """Loads a module from another text than its file's."""

    def __init__(self, name: str, path: str, text: str):
        super().__init__(name, path)
        self._text = text

    def get_code(self, fullname):
        with open(self._text, encoding="utf-8") as text:
            return compile(text.read(), self.path, "exec", dont_inherit=True)


class _Finder(importlib.abc.MetaPathFinder):
    def __init__(self, name: str, path: str, text: str):
        self._name, self._path, self._text = name, path, text

    def find_spec(self, fullname, path=None, target=None):
        if fullname != self._name:
            return None
        loader = _Text(fullname, self._path, self._text)
        inside = [os.path.dirname(self._path)] if self._path.endswith("__init__.py") else None
        return importlib.util.spec_from_file_location(
            fullname, self._path, loader=loader, submodule_search_locations=inside
        )


def replace() -> None:
    """From now on, importing the module gives the mutant."""
    sys.meta_path.insert(0, _Finder(*os.environ[MODULE].split(os.pathsep)))


class Watch:
    """Notes each line of a file when it first runs, in this process and its forks."""

    def __init__(self, path: str, log: str):
        self._path, self._log = path, os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        self.of("")
        threading.settrace(self._called)
        sys.settrace(self._called)

    def of(self, test: str) -> None:
        """From now on, lines are noted as reached by this test."""
        self._test, self._seen = test, set()

    def _called(self, frame, event, argument):
        return self._ran if frame.f_code.co_filename == self._path else None

    def _ran(self, frame, event, argument):
        line = frame.f_lineno
        if line not in self._seen:
            self._seen.add(line)
            os.write(self._log, f"{line} {self._test}\n".encode())
        return self._ran


def watch() -> Watch:
    return Watch(*os.environ[REACHED].split(os.pathsep))


if __name__ == "sitecustomize":
    if MODULE in os.environ:
        replace()
    if REACHED in os.environ:
        watch()
