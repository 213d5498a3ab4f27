"""Texts that become an import, a call, an object or a shell word: every place where one does."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]

DOORS = {
    "drivers/hosted/bootstrap.py: pkgutil.resolve_name": "the function that HostedDevice names",
    "drivers/hosted/failures.py: pickle.loads": "what this process has pickled itself",
    "drivers/hosted/message_socket.py: pickle.loads": "messages of a child, and of own sockets",
    "drivers/hosted/parcels.py: pickle.loads": "messages of a child process",
    "drivers/hosted/guard.py: pkgutil.resolve_name": "an installed driver",
    "drivers/hosted/serving.py: pkgutil.resolve_name": "the entry point of a driver",
    "drivers/serial_line.py: serial.serial_for_url": "a port that require_port() has let pass",
    "drivers/usb_link/backend.py: entry.load": "an installed USB backend",
    "labapp/accuracy/peers.py: entry.load": "an installed adapter",
    "labapp/bench/device_listing.py: entry.load": "an installed driver",
    "labapp/bench/driver_loading.py: entry.load": "an installed driver",
    "labapp/runs/acquisition/hooks.py: known[name].load": "an installed hook",
    "labapp/studies/contract.py: import_module": "the module that a study of labapp names",
    "labapp/studies/study_lookup.py: import_module": "a study in labapp's own list",
    "labapp/window/frame_memory.py: pickle.loads": "messages of the window's engine",
    "optics/inverse/choice.py: import_module": "a method in a list of names",
    "optics/late_names.py: importlib.import_module": "a module in a list of names",
    "optics/moved.py: importlib.import_module": "the name that a module of ours has now",
}
"""Where names become code or objects, with what the name can be."""

ACTING = re.compile(
    r"(^|\.)(resolve_name|import_module|__import__|popen|load_module|run_path|run_module"
    r"|serial_for_url)$|^(eval|exec|os\.system|yaml\.load|pickle\.loads?|marshal\.loads?)$"
    r"|^(dill|joblib|shelve)\."
)

HINTS = (
    "resolve_name|import_module|__import__|popen|load|run_path|run_module|serial_for_url"
    "|eval|exec|system|dill|joblib|shelve|shell"
)
"""What the source of a module has that makes such a call."""

TELLING = ("shell", "weights_only", "allow_pickle")
"""Keywords that decide whether a call acts on a text."""

COMMAND = re.compile(r"\blabapp [a-z][a-z-]+ ")


def trees(words: str) -> Iterator[tuple[str, ast.AST]]:
    """Name and syntax tree of every module whose source has one of these words (a pattern)."""
    for room in ("labapp", "drivers", "simulator", "optics"):
        for path in sorted((ROOT / room).rglob("*.py")):
            source = path.read_text(encoding="utf-8")
            if re.search(words, source):
                yield str(path.relative_to(ROOT)), ast.parse(source)


def written(node: ast.expr) -> str:
    """The source of an expression; for names with dots sooner than `ast.unparse` gives it."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return f"{written(node.value)}.{node.attr}"
    return ast.unparse(node)


def acting_calls(tree: ast.AST) -> Iterator[str]:
    """Calls of what turns texts into code, entry points, and processes behind a shell."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = written(node.func)
        keywords = {one.arg: written(one.value) for one in node.keywords if one.arg in TELLING}
        loads = bool(re.search(r"(entry|known\[name\])\.load$", name))
        fixed = name.endswith("import_module") and isinstance(node.args[0], ast.Constant)
        if (
            (ACTING.search(name) and not fixed)
            or loads
            or keywords.get("shell", "False") != "False"
        ):
            yield name
        if name == "torch.load" and keywords.get("weights_only") != "True":
            yield name
        if name == "np.load" and keywords.get("allow_pickle", "False") != "False":
            yield name


def unquoted_words(tree: ast.AST) -> Iterator[str]:
    """What stands after a command in a text for a person, without being a shell's word."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.JoinedStr):
            continue
        inside = False
        for part in node.values:
            if isinstance(part, ast.Constant):
                text = str(part.value)
                found = list(COMMAND.finditer(text))
                if found:
                    inside = "\n" not in text[found[-1].end() :]
                elif "\n" in text or ". " in text:
                    inside = False
            elif inside and isinstance(part, ast.FormattedValue):
                word = part.value
                if not (isinstance(word, ast.Call) and ast.unparse(word.func) == "shell_word"):
                    yield ast.unparse(word)


def test_texts_become_code_only_at_known_doors() -> None:
    found = {f"{path}: {name}" for path, tree in trees(HINTS) for name in acting_calls(tree)}
    assert found == set(DOORS)


def test_words_of_commands_that_people_are_told_are_quoted_for_the_shell() -> None:
    found = [f"{path}: {word}" for path, tree in trees("labapp ") for word in unquoted_words(tree)]
    assert found == []


def test_what_would_be_found_is_found() -> None:
    bad = 'import pkgutil\npkgutil.resolve_name(x)()\nf"labapp resume {path}"\nrun(a, shell=True)'
    tree = ast.parse(bad)
    assert list(acting_calls(tree)) == ["run", "pkgutil.resolve_name"]
    assert list(unquoted_words(tree)) == ["path"]
