"""The command lines of README and guide are run, page by page, with the files that they name."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from pathlib import Path

import cv2
import forked
import numpy as np
import pytest
import test_readme

ROOT = test_readme.ROOT
PAGES = [page for page in test_readme.PAGES if page.name in test_readme.TEXTS]

NOT_RUN = {
    "labapp gui": "opens a window: tests/window does that",
    "labapp devices screens": "asks an X server: tests/drivers does that",
    "labapp virtual-bench serve": "serves until Ctrl-C: test_virtual_bench.py does that",
    "labapp explain bricks --tol 1e-3 --audit": "takes more memory than a test may",
    "labapp accuracy simulate": "takes gigabytes: test_simulate_accuracy.py does it, smaller",
    "labapp simulate labapp/data/scenes/bricks.toml": "takes gigabytes: the bricks at full size",
    "labapp calibrate --bench mine.toml --star-um 70 --star-m 2 --out calibration": "takes minutes",
    "labapp calibrate --bench mine.toml --wavelength-nm 452": "takes minutes",
    "labapp calibrate --out calibration": "takes two minutes: test_calibration.py does it, smaller",
    "labapp run coded-snapshot --bench colour.toml": "takes a minute: the records of "
    "test_spectral_records.py are smaller",
    "labapp calibrate --spectra --bench colour.toml": "takes a minute: "
    "test_spectral_calibration.py does it, smaller",
    "labapp reconstruct snapshot.h5 --bands": "needs that run: test_spectral_records.py does it",
    "labapp design edof": "takes minutes: test_design_edof.py does it, smaller",
    "labapp train edof": "takes minutes: test_training_edof.py does it, smaller",
    "torchrun": "takes minutes: test_training_processes.py trains in processes, smaller",
    "labapp pattern edof": "needs the panel of its bench: test_decoding.py does it",
    "labapp reconstruct run.h5 --decoder": "takes a run of minutes: test_decoding.py does it",
    "labapp reconstruct photograph.tiff --decoder": "needs such a photograph: test_decoding.py",
    "labapp study psf-stability": "takes minutes: test_studies.py does it, smaller",
    "labapp study refocus": "takes half a minute: test_studies.py does it, smaller",
    "labapp study cubic-edof": "takes half a minute: test_edof_studies.py does its parts",
    "labapp study edof": "takes minutes: test_edof_study.py does it, smaller",
    "labapp study deconvolution": "takes half a minute: test_edof_studies.py does its parts",
    "labapp beam --camera": "takes a minute: test_beam_command.py does it, smaller",
    "labapp accuracy chain": "takes half a minute: test_chain_accuracy.py does it, smaller",
    "labapp accuracy edof": "takes a quarter of a minute: test_accuracy_edof.py does it, smaller",
    "labapp accuracy multispectral": "takes half a minute: test_multispectral_accuracy.py does it",
    "labapp study multispectral": "takes minutes: test_spectral_studies.py does it, smaller",
    "labapp study psf-designs": "takes minutes: test_spectral_studies.py does it, smaller",
    "make": "make run, make test and make figures are what runs this, or take an hour",
    "PYTHONPATH=tests": "takes an hour",
}
"""Beginnings of lines that aren't run, and why."""

SHORTER = {"labapp study ": ["--quick"]}
"""What is added to long ones, where their help offers it."""


def command_lines(page: Path) -> list[str]:
    blocks = test_readme.code_blocks(page.read_text(), "console", "sh")
    return [line.strip() for block in blocks for line in block.splitlines() if line.strip()]


def is_run(line: str) -> bool:
    return not any(line.startswith(beginning) for beginning in NOT_RUN)


@pytest.fixture(scope="module")
def first_light(tmp_path_factory) -> Path:
    """The demo's folder, which most pages start from."""
    folder = tmp_path_factory.mktemp("demo") / "first-light"
    run_line(f"labapp demo --out {folder}", folder.parent)
    return folder


@pytest.fixture
def folder(tmp_path, first_light, page) -> Path:
    """What a reader has by the time a page is read: records, benches, plans, pictures."""
    text = page.read_text()
    if "--out first-light" not in text:
        shutil.copytree(first_light, tmp_path / "first-light")
    if "--out run.h5" not in text:
        shutil.copy(first_light / "run.h5", tmp_path / "run.h5")
    if "--pattern cubic.png" in text:
        run_line("labapp pattern cubic strength_rad=80 --out cubic.png", tmp_path)
    (tmp_path / "labapp").mkdir()
    (tmp_path / "labapp/data").symlink_to(ROOT / "labapp/data")
    for name, source in {
        "bench.toml": "bench.toml", "mine.toml": "bench.toml", "faults.toml": "faults.toml",
        "plan.toml": "plans/photon-transfer.toml",
    }.items():  # fmt: skip
        shutil.copy(ROOT / "labapp/data" / source, tmp_path / name)
    if "--psf psf.png" in text:
        write_pictures(tmp_path)
    return tmp_path


def write_pictures(folder: Path) -> None:
    """A reader's own photograph and PSF."""
    chance = np.random.default_rng(0)
    photograph = cv2.GaussianBlur(chance.integers(0, 255, (96, 128, 3), np.uint8), (0, 0), 3)
    cv2.imwrite(str(folder / "mine.jpg"), photograph)
    spot = np.zeros((15, 15), np.uint8)
    cv2.circle(spot, (7, 7), 3, 255, -1)
    cv2.imwrite(str(folder / "psf.png"), spot)


def run_line(line: str, folder: Path) -> None:
    words = shlex.split(line)
    assert words[0] == "labapp"
    for beginning, more in SHORTER.items():
        if line.startswith(beginning) and "list" not in words and more[0] not in words:
            words += more
    command = [sys.executable, "-m", "labapp", *words[1:]]
    done = forked.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"


def test_only_lines_that_are_there_are_left_out():
    lines = [line for page in PAGES for line in command_lines(page)]
    unused = [one for one in NOT_RUN if not any(line.startswith(one) for line in lines)]
    assert not unused


@pytest.mark.sweep
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "page", [page for page in PAGES if any(map(is_run, command_lines(page)))], ids=lambda p: p.stem
)
def test_the_commands_of_a_page_work_as_they_stand(page, folder):
    done: set[str] = set()
    for line in filter(is_run, command_lines(page)):
        # A page may show a result's making twice; its files are replaced on purpose then.
        out = re.search(r"--out (\S+)", line)
        if out and out[1] in done:
            line += " --force"
        if out:
            done.add(out[1])
        run_line(line, folder)
