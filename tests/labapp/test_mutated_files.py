"""Mutated files, texts of strangers and little memory: words that a person can act on, or success.

A handful is tried with every change of labapp, more in sweeps, all by `make figures`.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import forked
import numpy as np
import pytest
from small_bench.files import SmallFiles

from drivers.roles import misfit
from labapp.common.memory_shortage import explain_shortage
from labapp.common.number_ranges import require_range
from simulator.devices import SimulatedCamera, SimulatedFilter

_PATHS = os.pathsep.join([str(Path(__file__).parents[2]), str(Path(__file__).parents[1])])


def figured(words: str) -> Any:
    """What an expression of the figures' modules gives, in a process of its own."""
    program = "import json; from pathlib import Path; from figures import mutated_files, "
    program += f"strangers_files; print(json.dumps({words}))"
    command = [sys.executable, "-c", program]
    environment = os.environ | {"PYTHONPATH": _PATHS}
    done = forked.run(command, stdout=forked.PIPE, text=True, check=True, env=environment)
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.timeout(300)
@pytest.mark.parametrize("count", [21, pytest.param(500, marks=pytest.mark.sweep)])
def test_a_mutated_file_is_read_or_refused_in_words(tmp_path: Path, count: int) -> None:
    tries = f"mutated_files.try_mutations(Path({str(tmp_path / 'files')!r}), 7, {count})"
    found = figured(f"[(one[0], one[2]) for one in {tries}]")
    assert len(found) == count
    assert [one for one in found if one[1] not in ("refused", "checked")] == []


@pytest.mark.sweep
@pytest.mark.timeout(1200)
def test_a_text_of_a_stranger_does_nothing(tmp_path: Path) -> None:
    tries = f"strangers_files.try_texts(Path({str(tmp_path / 'files')!r}), 17, 3)"
    found = figured(f"list({tries})")
    assert len(found) > 50
    assert [one for one in found if one[2] not in ("well", "refused")] == []


@pytest.mark.parametrize("key", ["focal_length_mm", "pitch_um", "radiance", "distance_m"])
def test_a_number_that_nobody_means_is_told_with_its_key(
    labapp, tiny: SmallFiles, key: str
) -> None:
    for path in (tiny.bench, tiny.scene):
        lines = path.read_text().splitlines()
        path.write_text(
            "\n".join(f"{key} = 1e308" if one.startswith(key) else one for one in lines)
        )
    code, _, errors = labapp("plan", "check", tiny.plan, *tiny.arguments())
    assert code == 1
    assert f"{key}' is 1e+308: give a size of at most" in errors


def test_typed_numbers_have_the_range_of_their_unit(labapp, tiny: SmallFiles) -> None:
    words = ("psf", "--camera", tiny.bench, "--out", tiny.folder / "psf.npy")
    code, _, errors = labapp(*words, "--distance", "1e-300")
    assert code == 1
    assert "--distance is 1e-300: give a size of at least" in errors


def test_minus_zero_is_zero_and_infinity_is_left_to_who_declares_it() -> None:
    assert str(require_range("offset_mm", -0.0)) == "0.0"
    assert require_range("distance_m", float("inf")) == float("inf")
    assert require_range("seed", 2**64 - 1) == 2**64 - 1


def test_a_driver_in_the_role_of_another_is_told(labapp, tiny: SmallFiles) -> None:
    text = tiny.bench.read_text()
    tiny.bench.write_text(text.replace('"simulated-filter"', '"simulated-camera"'))
    code, said, _ = labapp("bench", "check", tiny.bench, "--json")
    assert code == 1
    assert "is a driver for the role camera, not for filter" in said
    assert misfit(SimulatedCamera, "camera") == misfit(SimulatedFilter, "filter") == ""


def test_a_lack_of_memory_is_told_whatever_library_lacks_it() -> None:
    with pytest.raises(MemoryError) as numpy_error:
        np.empty((10**9, 10**8))
    torch_error = RuntimeError(
        "[enforce fail at alloc_cpu.cpp:127] err == 0. DefaultCPUAllocator: can't allocate memory: "
        "you tried to allocate 71276800 bytes. Error code 12 (Cannot allocate memory)"
    )
    thread = RuntimeError("can't start new thread")
    library = ImportError("/lib/cv2.abi3.so: failed to map segment from shared object")
    refused = OSError(12, "Cannot allocate memory")
    for error, need in (
        (numpy_error.value, "an array with shape (1000000000, 100000000)"),
        (torch_error, "an array needs 71 MB"),
        (thread, "a thread needs"),
        (library, "the library cv2.abi3.so needs more than is left"),
        (refused, "needs more than is left"),
    ):
        told = explain_shortage(error)
        assert need in told
        assert told.startswith("there isn't enough memory: ")
    assert explain_shortage(RuntimeError("no")) == explain_shortage(OSError(2, "no file")) == ""
