"""What the README and the guide say is so."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib
from pathlib import Path

import forked
import pytest
from _pytest.mark import ParameterSet

import labapp.cli
from drivers.clock import RealClock
from drivers.interfaces import Surroundings
from labapp.bench.driver_loading import device_maker, installed_drivers
from labapp.common.guide import list_topics
from labapp.files.bench_file import DevicesTable
from labapp.files.pattern_table import STILL_PATTERNS
from labapp.files.plan_file import PlanFile
from labapp.patterns.designing.kinds import TARGETS
from labapp.studies import STUDIES

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "labapp/docs").glob("*.md"))]
# The steps of how-to-add pages speak of what they add: test_how_to_pages.py carries them out.
# Commands for those who change the code are looked at in test_work_page.py.
OTHERS = ("extend-", "work-")
TEXTS = {path.name: path.read_text() for path in PAGES if not path.stem.startswith(OTHERS)}
GUIDE = {path.stem: path.read_text() for path in PAGES[1:]}


def code_blocks(text: str, *languages: str) -> list[str]:
    """The code of a page in some languages, in its order."""
    fence = rf"^ *```(?:{'|'.join(languages)})\n(.*?)^ *```"
    return re.findall(fence, text, re.DOTALL | re.MULTILINE)


def blocks(*languages: str) -> list[ParameterSet]:
    """Code of all pages, as parameters that are named after the page."""
    return [
        pytest.param(code, id=f"{name}-{number}")
        for name, text in TEXTS.items()
        for number, code in enumerate(code_blocks(text, *languages), 1)
    ]


def tables(key: str) -> list[ParameterSet]:
    """TOML of all pages that has a key."""
    return [block for block in blocks("toml") if key in tomllib.loads(block.values[0])]


@pytest.mark.parametrize("code", blocks("python"))
def test_what_the_python_examples_import_is_there(code):
    imports = re.findall(r"^(?:import|from) (?:[^(\n]*\([^)]*\)|[^(\n]*)$", code, re.MULTILINE)
    compile(code, "page.md", "exec")
    exec("\n".join(imports), {})


@pytest.mark.sweep
@pytest.mark.parametrize("code", blocks("python"))
def test_the_python_examples_run_as_they_stand(code, tmp_path):
    command = [sys.executable, "-c", f"import warnings; warnings.simplefilter('error')\n{code}"]
    done = forked.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


@pytest.mark.parametrize("text", tables("acquire"))
def test_a_plan_example_is_a_plan(text):
    assert PlanFile.model_validate(tomllib.loads(text)).title


@pytest.mark.parametrize("text", tables("devices"))
def test_the_devices_of_a_bench_example_can_be_made(text):
    """Made only: nothing is touched before a device is opened."""
    named = DevicesTable.model_validate(tomllib.loads(text)["devices"]).tables
    for role, table in named.items():
        device_maker(role, table, Surroundings(RealClock()), "page.md")()


def test_the_guide_has_a_plan_and_a_bench():
    assert tables("acquire")
    assert tables("devices")


def test_every_driver_of_the_table_is_installed_and_in_it():
    rows = re.findall(r"^\| (`.*?`) \|", GUIDE["real-devices"], re.MULTILINE)
    named = re.findall(r"`([a-z0-9-]+)`", " ".join(rows))
    real = {name for name in installed_drivers() if not name.startswith(("simulated-", "manual-"))}
    assert set(named) == real


def commands() -> list[str]:
    lines = [line for block in blocks("console", "sh") for line in block.values[0].splitlines()]
    for text in TEXTS.values():
        lines += re.findall(r"`(?:\.venv/bin/)?(labapp [a-z-][^`]*)`", text)
    return sorted({" ".join(line.split()) for line in lines if line.strip().startswith("labapp ")})


def names_after(word: str) -> set[str]:
    """What may follow a command that takes a name from a list."""
    known = {
        "help": {topic.name for topic in list_topics()},
        "study": {"list", *STUDIES},
        "pattern": {"list", *STILL_PATTERNS},
        "retrieve": {"list", *TARGETS},
    }
    return known.get(word, set())


@pytest.mark.parametrize("command", commands())
def test_every_command_exists_with_its_options(command):
    words = shlex.split(command)[1:]
    group = labapp.cli.build_command_line()
    if words[0].startswith("-"):
        known = {name for parameter in group.params for name in parameter.opts} | {"--help"}
        assert words[0] in known
        return
    assert words[0] in group.commands
    if names_after(words[0]) and len(words) > 1 and not words[1].startswith("-"):
        assert words[1] in names_after(words[0])
    command = group.commands[words[0]]
    if len(words) > 1 and words[1] in getattr(command, "commands", {}):
        command = command.commands[words[1]]
    options = {name for p in command.params for name in p.opts}
    assert {word for word in words if word.startswith("--")} <= options


def make_targets() -> list[str]:
    found = re.findall(r"make ([a-z-]+)[^`\n]*`|^ *make ([a-z-]+)", "\n".join(TEXTS.values()), re.M)
    return sorted({one or other for one, other in found})


@pytest.mark.parametrize("target", make_targets())
def test_every_make_target_exists(target):
    assert re.search(rf"^{target}(?: [a-z-]+)*:", (ROOT / "Makefile").read_text(), re.M)


def test_the_map_of_the_house_is_right():
    plan = re.search(r"```\noptics  .*?```", GUIDE["architecture"], re.DOTALL).group()
    room = ""
    drawn = set()
    for line in plan.splitlines()[1:-1]:
        if not line.startswith(" "):
            room = line.split()[0]
            continue
        names = re.split(r"\s{2,}", line.strip())[0]
        for name in names.rstrip(",").split(", "):
            path = ROOT / room / name.rstrip("/")
            assert path.is_dir() if name.endswith("/") else path.with_suffix(".py").is_file(), name
            drawn.add(path)
    for room in ("optics", "drivers", "simulator", "labapp"):
        modules = {p.with_suffix("") for p in (ROOT / room).glob("*.py")}
        packages = {p.parent for p in (ROOT / room).glob("*/__init__.py")}
        missing = {p for p in modules | packages if not p.name.startswith("_")} - drawn
        assert not missing, "the map leaves rooms out"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_links_and_files_that_are_named_are_there(path):
    """Links from the page's own folder; paths in backquotes from the checkout's."""
    text = path.read_text()
    linked = [link.partition("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text)]
    for name in linked:
        assert name.startswith("https://") or (path.parent / name).exists(), name
    for name in re.findall(r"`((?:labapp|drivers|optics|simulator|tests)/[\w./-]+)`", text):
        assert (ROOT / name).exists(), name


def test_the_readme_shows_a_picture_and_is_short():
    text = TEXTS["README.md"]
    assert re.search(r"^!\[.+\]\(.+\.jpg\)$", text, re.MULTILINE)
    assert len(text.encode()) <= 10_000
