"""What the README says is so."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib
from pathlib import Path

import forked
import pytest

import labapp.cli
from drivers.clock import RealClock
from drivers.interfaces import Surroundings
from labapp.bench.opening import device_maker, installed_drivers
from labapp.files.bench_file import DevicesTable
from labapp.files.plan_file import PlanFile

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("code", blocks("python"))
def test_what_the_python_examples_import_is_there(code):
    imports = [line for line in code.splitlines() if line.startswith(("import ", "from "))]
    compile(code, "README.md", "exec")
    exec("\n".join(imports), {})


@pytest.mark.sweep
@pytest.mark.parametrize("code", blocks("python"))
def test_the_python_examples_run_as_they_stand(code, tmp_path):
    command = [sys.executable, "-c", f"import warnings; warnings.simplefilter('error')\n{code}"]
    done = forked.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_the_plan_example_is_a_plan():
    text, _ = blocks("toml")
    assert PlanFile.model_validate(tomllib.loads(text)).title


def test_the_devices_of_the_bench_example_can_be_made(tmp_path):
    """Made only: nothing is touched before a device is opened."""
    _, text = blocks("toml")
    tables = DevicesTable.model_validate(tomllib.loads(text)["devices"]).tables
    for role, table in tables.items():
        device_maker(role, table, Surroundings(RealClock()), "README.md")()


def test_every_driver_of_the_table_is_installed_and_in_it():
    section = README.split("## Real devices")[1].split("## The virtual bench")[0]
    named = re.findall(r"`([a-z0-9-]+)`", " ".join(re.findall(r"^\| (`.*?`) \|", section, re.M)))
    real = {name for name in installed_drivers() if not name.startswith(("simulated-", "manual-"))}
    assert set(named) == real


def commands() -> list[str]:
    lines = [line for block in blocks("console") for line in block.splitlines()]
    lines += re.findall(r"`(?:\.venv/bin/)?(labapp [a-z-][^`]*)`", README)
    return sorted({line.strip() for line in lines if line.startswith("labapp ")})


@pytest.mark.parametrize("command", commands())
def test_every_command_exists_with_its_options(command):
    words = shlex.split(command)[1:]
    group = labapp.cli.build_command_line()
    if words[0].startswith("-"):
        known = {name for parameter in group.params for name in parameter.opts} | {"--help"}
        assert words[0] in known
        return
    assert words[0] in group.commands
    command = group.commands[words[0]]
    if len(words) > 1 and words[1] in getattr(command, "commands", {}):
        command = command.commands[words[1]]
    options = {name for p in command.params for name in p.opts}
    assert {word for word in words if word.startswith("--")} <= options


@pytest.mark.parametrize("target", re.findall(r"make ([a-z]+)`|^make ([a-z]+)$", README, re.M))
def test_every_make_target_exists(target):
    name = next(filter(None, target))
    assert re.search(rf"^{name}:", (ROOT / "Makefile").read_text(), re.M)


def test_the_map_of_the_house_is_right():
    plan = re.search(r"```\noptics  .*?```", README, re.DOTALL).group()
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


def test_pictures_and_files_that_are_named_are_there():
    linked = re.findall(r"\]\(([^)]+)\)", README)
    named = re.findall(r"`((?:labapp|drivers|optics|simulator|tests)/[\w./]+)`", README)
    assert linked
    for name in linked + named:
        assert (ROOT / name).exists(), name
