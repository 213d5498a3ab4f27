"""Which test files could notice a change of a module: by what they import, nearest first."""

from __future__ import annotations

import ast
import re
import warnings
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

TESTS = "tests"
_DOTTED = r"[a-z_]\w*(\.\w+)+"


@dataclass(frozen=True)
class Imported:
    """`from module import name`, with the name that the importing file uses for it."""

    module: str
    name: str = ""
    alias: str = ""


def related(root: Path, module: Path) -> list[Path]:
    """Test files that reach a module through their imports.

    A step from a test to a helper of tests is free, and so is a step through a package's face;
    every module of the product on the way counts one, and so does a conftest, of which few tests
    use all.
    """
    sources = _Sources(root)
    users: dict[Path, list[Path]] = {}
    for file in sources.files:
        for used in sources.used_by(file):
            users.setdefault(used, []).append(file)
    distance, waiting = {module: 0}, deque([module])
    while waiting:
        file = waiting.popleft()
        for user in users.get(file, []):
            helper = sources.of_tests(file) and file.name != "conftest.py"
            step = 0 if helper else 1
            away = distance[file] + step
            if away < distance.get(user, away + 1):
                distance[user] = away
                # Free steps first, so that every file is first met by its shortest way.
                (waiting.append if step else waiting.appendleft)(user)
    tests = [file for file in distance if file.name.startswith("test_")]
    return sorted(tests, key=lambda file: (distance[file], -_mentions(file, module), str(file)))


def _mentions(test: Path, module: Path) -> int:
    """How often a test names the module, or its package where it's one's face."""
    name = module.parent.name if module.name == "__init__.py" else module.stem
    return test.stem.count(name) * 100 + test.read_text().count(name)


class _Sources:
    """All Python files below a folder, and what they import of each other."""

    def __init__(self, root: Path):
        self.root = root
        tops = [one for one in root.iterdir() if one.is_dir() and any(one.glob("*.py"))]
        tops = [one for one in tops if not one.name.startswith(".")]
        self.files = sorted(file for top in tops for file in top.rglob("*.py"))
        self._known = set(self.files)
        self._imports = {file: list(_imports(file)) for file in self.files}

    def of_tests(self, file: Path) -> bool:
        return file.is_relative_to(self.root / TESTS)

    def used_by(self, file: Path) -> set[Path]:
        used = {place for one in self._imports[file] for place in self._places(file, one)}
        if self.of_tests(file):
            folders = [one for one in file.parents if self.of_tests(one)]
            used |= {one / "conftest.py" for one in folders} & self._known
        return used - {file}

    def _places(self, file: Path, one: Imported) -> Iterator[Path]:
        """The files behind an import: the module itself, and what its face has it from."""
        found = self._file(file, one.module)
        if found is None:
            return
        submodule = self._file(file, f"{one.module}.{one.name}") if one.name else None
        if submodule:
            yield submodule
            return
        yield found
        if found.name == "__init__.py" and one.name:
            for behind in self._imports[found]:
                if behind.alias == one.name and behind.module != one.module:
                    yield from self._places(found, behind)

    def _file(self, file: Path, module: str) -> Path | None:
        """A module's file: below the root, or beside the test or above it among the tests."""
        parts = module.split(".")
        places = [self.root]
        if self.of_tests(file):
            places += [one for one in file.parents if self.of_tests(one)]
        for place in places:
            base = place.joinpath(*parts)
            for found in (base.with_suffix(".py"), base / "__init__.py"):
                if found in self._known:
                    return found
        return None


def _imports(file: Path) -> Iterator[Imported]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tree = ast.parse(file.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for one in node.names:
                yield Imported(one.name)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for one in node.names:
                yield Imported(node.module, one.name, one.asname or one.name)
        elif isinstance(node, ast.Constant) and re.fullmatch(_DOTTED, str(node.value)):
            # A module that is run, or loaded when it's called for: "labapp.studies.refocus".
            yield Imported(str(node.value))
