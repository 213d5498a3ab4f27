"""The guide's how-to-add pages: a test does what they say, in a copy of the project.

A page's blocks are steps. Python and TOML that begin with `# PATH` are new files, a diff that
begins with `--- PATH` edits one that is there, and console lines are run in the copy's folder.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "labapp/docs").glob("extend-*.md"))
COPIED = ("optics", "drivers", "simulator", "labapp", "tests", "Makefile", "pyproject.toml")


class Step(NamedTuple):
    """language: of a block of a page."""

    language: str
    text: str


def read_steps(page: Path) -> list[Step]:
    found = re.findall(r"^```(\w+)\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE)
    return [Step(*one) for one in found]


def is_new_file(step: Step) -> bool:
    return step.language in ("python", "toml")


def new_file_path(step: Step) -> Path:
    first = step.text.partition("\n")[0]
    found = re.fullmatch(r"# ([\w/.-]+)", first)
    assert found, f"a block says first which file it is, not {first!r}"
    return Path(found[1])


def edited_path(step: Step) -> Path:
    first = step.text.partition("\n")[0]
    assert first.startswith("--- "), f"a diff says first which file it edits, not {first!r}"
    return Path(first.removeprefix("--- "))


def apply_diff(step: Step, text: str) -> str:
    """Replace each hunk's old lines, which must stand once in the text, by its new ones."""
    for hunk in re.split(r"^@@\n", step.text.partition("\n")[2], flags=re.MULTILINE):
        lines = hunk.splitlines(keepends=True)
        assert all(line[0] in " +-\n" for line in lines), hunk
        old = "".join(line[1:] or "\n" for line in lines if line[0] != "+")
        new = "".join(line[1:] or "\n" for line in lines if line[0] != "-")
        assert text.count(old) == 1, f"stands {text.count(old)} times in the file:\n{old}"
        text = text.replace(old, new)
    return text


def carry_out(step: Step, folder: Path) -> None:
    """One step of a page, in a copy of the project."""
    if is_new_file(step):
        path = folder / new_file_path(step)
        assert not path.exists()
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(step.text)
    elif step.language == "diff":
        path = folder / edited_path(step)
        path.write_text(apply_diff(step, path.read_text()))
    else:
        assert step.language == "console"
        for line in step.text.splitlines():
            run(line, folder)


def run(line: str, folder: Path) -> None:
    """A console line with the copy's code; fails with what it printed."""
    words = shlex.split(line)
    if words[0] == "cp":
        shutil.copy(folder / words[1], folder / words[2])
        return
    if words[:2] == ["pip", "install"]:
        install(folder / words[-1])
        return
    programs = {
        "labapp": [sys.executable, "-m", "labapp"],
        "python": [sys.executable],
        "make": ["make", f"BIN={Path(sys.executable).parent}", "-o", ".venv/dev"],
    }
    command = [*programs[words[0]], *words[1:]]
    # Installed packages of the copy lie in folders of their own.
    paths = [folder, *folder.glob("*-installed")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


def install(package: Path) -> None:
    """What `pip install` of a package without dependencies does, without asking the network."""
    project = tomllib.loads((package / "pyproject.toml").read_text())["project"]
    target = package.parent / f"{package.name}-installed"
    shutil.copytree(package, target)
    facts = target / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    groups = project.get("entry-points", {}).items()
    lines = [f"[{group}]\n" + entry_lines(entries) for group, entries in groups]
    (facts / "entry_points.txt").write_text("\n".join(lines))


def entry_lines(entries: dict[str, str]) -> str:
    return "".join(f"{name} = {place}\n" for name, place in entries.items())


def files_after(page: Path) -> dict[Path, str]:
    """The files that a page makes or edits, as its steps leave them."""
    texts: dict[Path, str] = {}
    for step in read_steps(page):
        if is_new_file(step):
            texts[new_file_path(step)] = step.text
        elif step.language == "diff":
            path = edited_path(step)
            texts[path] = apply_diff(step, texts.get(path) or (ROOT / path).read_text())
        else:
            for source, copy in re.findall(r"^cp (\S+) (\S+)$", step.text, re.MULTILINE):
                texts[Path(copy)] = (ROOT / source).read_text()
    return texts


def test_there_is_a_page_for_each_kind_of_extension():
    kinds = {page.stem.removeprefix("extend-") for page in PAGES}
    assert kinds == {"pattern", "restoration", "effect", "driver", "study", "verb", "figure"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_edits_of_a_page_fit_the_files_as_they_are(page):
    for path, text in files_after(page).items():
        if path.suffix == ".py":
            compile(text, str(path), "exec")
        elif path.suffix == ".toml":
            tomllib.loads(text)


@pytest.mark.sweep
@pytest.mark.timeout(300)
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_person_who_follows_a_page_gets_what_it_promises(page, tmp_path):
    for name in COPIED:
        if (ROOT / name).is_dir():
            unneeded = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, tmp_path / name, ignore=unneeded)
        else:
            shutil.copy(ROOT / name, tmp_path / name)
    for step in read_steps(page):
        carry_out(step, tmp_path)
    wrong = style_errors(page, tmp_path)
    assert not wrong


def style_errors(page: Path, folder: Path) -> str:
    """What ruff says of the Python files that a page makes or edits."""
    files = [str(path) for path in files_after(page) if path.suffix == ".py"]
    found = ""
    for check in (["check"], ["format", "--check", "--diff"]):
        command = [sys.executable, "-m", "ruff", *check, *files]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        found += "" if done.returncode == 0 else done.stdout
    return found
