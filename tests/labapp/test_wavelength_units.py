"""A wavelength in another unit than nanometres, or metres in Python, is asked about in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from labapp.cli import _error_message, build_command_line
from labapp.common.errors import UserError
from labapp.files.light_table import MonochromaticTable
from labapp.files.lut_file import read_lut
from labapp.files.phase_table import LensPattern
from labapp.files.plan_file import Acquisition
from labapp.files.sensor_file import InlineCurve
from labapp.files.spectrum_file import read_spectra
from labapp.files.wavelengths import doubt_nanometres, require_nanometres


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (0.55, r"is 0\.55 nm, which is no light: did you mean 550 nm, 0\.55 in micrometres\?"),
        (5.5e-7, "did you mean 550 nm, 5.5e-07 in metres"),
        (1.55, "did you mean 1550 nm, 1.55 in micrometres"),
        (550e3, "did you mean 550 nm, 550000 in picometres"),
        (math.nan, "is nan: give a wavelength in nanometres"),
        (-550, "is -550: give"),
        (1e9, "is 1e[+]09: give"),
    ],
)
def test_a_wavelength_in_another_unit_is_asked_about(number, words):
    with pytest.raises(UserError, match=rf"--wavelength-nm .*{words}"):
        require_nanometres("--wavelength-nm", number)


@pytest.mark.parametrize("number", [121.6, 193, 550, 1550, 10_600])
def test_light_that_lamps_and_lasers_have_is_believed(number):
    assert not doubt_nanometres(number)


LENS = TypeAdapter(LensPattern)

ACQUISITION = {"targets": ["star"], "patterns": ["neutral"], "exposures_ms": [1]}


def commands(group: Any, prefix: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The words of each command that has an option for a wavelength."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*prefix, name))
        elif any("--wavelength-nm" in option.opts for option in command.params):
            yield (*prefix, name)


def test_every_command_asks_about_the_unit(labapp):
    """The option is looked at before anything is opened, so that no other is needed."""
    found = list(commands(build_command_line()))
    assert len(found) > 12
    for words in found:
        code, _, complaint = labapp(*words, "--wavelength-nm", "0.55")
        assert code == 1, words
        assert "did you mean 550 nm, 0.55 in micrometres?" in complaint, words


@pytest.mark.parametrize(
    "make",
    [
        lambda nm: MonochromaticTable(kind="monochromatic", wavelength_nm=nm),
        lambda nm: LENS.validate_python({"kind": "lens", "focal_length_m": 1, "wavelength_nm": nm}),
        lambda nm: Acquisition.model_validate(ACQUISITION | {"wavelengths_nm": [550, nm]}),
        lambda nm: TypeAdapter(InlineCurve).validate_python({f"{nm}": 0.5}),
    ],
)
def test_keys_of_files_ask_about_the_unit(make):
    make(550)
    with pytest.raises(ValidationError, match=r"did you mean 550 nm, 0\.55 in micrometres"):
        make(0.55)


def test_tables_of_files_ask_about_the_unit(tmp_path):
    table = tmp_path / "spectrum.csv"
    table.write_text("0.4,1\n0.7,2\n")
    with pytest.raises(UserError, match=r"spectrum\.csv: a wavelength is 0\.4 nm.*mean 400 nm"):
        read_spectra(table)
    table.write_text("grey,0.55\n0,0\n255,2\n")
    with pytest.raises(UserError, match=r"spectrum\.csv: line 1: a wavelength is 0\.55 nm"):
        read_lut(table, 256)


@pytest.mark.parametrize(
    "error",
    [
        MemoryError("Unable to allocate 26 GiB"),
        MemoryError(),
        RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate 3 bytes"),
    ],
)
def test_too_little_memory_is_told_in_words(error):
    words = _error_message(error)
    assert words.startswith("there isn't enough memory: ")
    assert "unexpected" not in words
