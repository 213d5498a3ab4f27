"""`labapp plan`: what a person and a program are told of a plan before it runs."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

import labapp as package
from labapp.bench.opening import BenchFiles, open_bench
from labapp.files.file_lookup import bundled_plans
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.state import State

READY = (
    "coded-snapshot",
    "edof-target",
    "phase-video-stability",
    "photon-transfer",
    "psf-over-wavelengths",
    "slm-response",
    "spectral-stack",
)


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def rows(printed: str) -> list[list[str]]:
    """The lines of what was printed, as words."""
    return [line.split() for line in printed.splitlines() if line.strip()]


def data_of(labapp, *arguments: Any) -> dict[str, Any]:
    code, printed, said = labapp(*arguments, "--json")
    assert (code, said) == (0, "")
    return json.loads(printed)


def place_by_hand(small) -> None:
    change(
        small.bench,
        'driver = "simulated-targets"',
        'driver = "manual-targets"\noptions = { names = ["dark", "star"], settling_ms = 200 }',
    )


def test_check_says_what_a_plan_takes_and_passes_it(labapp, small):
    """16 exposures and read-outs, and 8 times 50 ms until filter or panel stand: 0.6 s."""
    code, printed, _ = labapp("plan", "check", small.plan, *small.arguments())
    assert code == 0
    assert "Small plan" in printed
    assert "On Small bench  SIMULATED: slm, filter, camera, targets" in printed
    assert "16 frames in 16 steps" in printed
    assert "0.6 s of bench time\n" in printed
    assert "1.7 MB on disk" in printed
    assert "PASS. Run it with: labapp run" in printed
    limits = {words[0]: " ".join(words[1:]) for words in rows(printed)}
    assert limits["exposures"] == "1 to 8 ms 0.02 to 30000 ms"
    assert limits["wavelengths"] == "540, 550 nm 420 to 720 nm"
    assert limits["targets"] == "dark, star dark, star, photograph"
    assert limits["patterns"] == "2 192 x 108 pixels, 60 frames a second"


def test_check_as_data(labapp, small):
    data = data_of(labapp, "plan", "check", small.plan, *small.arguments())
    assert (data["frames"], data["steps"], data["prompts"]) == (16, 16, [])
    assert data["seconds"] == pytest.approx(8 * 0.05 + 8 * (0.001 + 0.008) + 16 * 0.008)
    # Sixteen frames of 64 x 96 pixels, two bytes each, and two patterns of 108 x 192.
    assert data["disk_bytes"] >= 16 * 64 * 96 * 2 + 2 * 108 * 192
    assert data["free_bytes"] > 0
    assert [limit["what"] for limit in data["limits"]] == [
        "exposures",
        "wavelengths",
        "targets",
        "patterns",
    ]


def test_nothing_moves_or_is_written_when_a_plan_is_looked_at(labapp, small, monkeypatch):
    def moved(*arguments: object) -> None:
        pytest.fail("a device was asked to do something")

    monkeypatch.chdir(small.folder)
    before = sorted(small.folder.rglob("*"))
    for device, call in (("Camera", "capture"), ("Targets", "place"), ("Camera", "set_exposure")):
        monkeypatch.setattr(f"simulator.devices.Simulated{device}.{call}", moved)
    for command in ("check", "show"):
        code, *_ = labapp("plan", command, small.plan, *small.arguments())
        assert code == 0
    assert sorted(small.folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[540, 550]", "[540, 900]", ["wavelengths_nm", "900", "420 to 720 nm"]),
        ("[1, 8]", "[1, 40000]", ["exposures_ms", "40000", "0.02 to 30000 ms"]),
        ('["dark", "star"]', '["moon"]', ["moon", "dark, star, photograph"]),
        ("wavelengths_nm = [540, 550]", "slots = [1]", ["slots", "wavelengths_nm instead"]),
        ("seed = 3", 'hooks = ["lamp"]', ["hooks", "lamp", "isn't installed"]),
        ("seed = 3", "sede = 3", ["sede", "unknown"]),
        (
            'kind = "constant"',
            'kind = "image"\nfile = "mask.png"',
            ["mask.png", "cannot be read", "Check the path"],
        ),
        ("focal_length_m = 50.0", "focal_length_m = 0.01", ["lens", "focal_length", "at least"]),
        (
            "seed = 3",
            'reconstruct = { coded = "lens", wavelength_nm = 540 }',
            ["reconstruct", "'photograph' with pattern 'neutral' at 540 nm", "[[acquire]]"],
        ),
        (
            "seed = 3",
            'reconstruct = { coded = "lens", photograph = "star" }',
            ["reconstruct", "wavelength_nm", "540, 550 nm"],
        ),
        (
            "seed = 3",
            'reconstruct = { coded = "ring", photograph = "star", wavelength_nm = 550 }',
            ["reconstruct", "'star' with pattern 'ring' at 550 nm"],
        ),
    ],
)
def test_what_a_bench_cannot_do_is_said_in_a_line_or_two(labapp, small, old, new, words):
    change(small.plan, old, new)
    code, printed, said = labapp("plan", "check", small.plan, *small.arguments())
    assert (code, printed) == (1, "")
    assert 1 <= len(said.strip().splitlines()) <= 2
    for word in words:
        assert word in said


def test_a_disk_without_room_is_an_error(labapp, small, monkeypatch):
    monkeypatch.setattr("labapp.runs.acquisition.frame_storage.free_bytes", lambda path: 1000)
    code, _, said = labapp("plan", "check", small.plan, *small.arguments())
    assert code == 1
    assert "Make space" in said


def test_a_plan_that_is_not_there_is_told_the_ready_ones(labapp):
    code, _, said = labapp("plan", "check", "psf-over-wavelength")
    assert code == 1
    assert all(name in said for name in READY)


def test_show_has_a_row_for_frames_that_differ_in_exposure_alone(labapp, small):
    code, printed, _ = labapp("plan", "show", small.plan, *small.arguments())
    assert code == 0
    table = [words for words in rows(printed) if "light" in words]
    assert table[:3] == [
        ["0-1", "light", "dark", "neutral", "540", "1", "8", "2", "0.050"],
        ["2-3", "light", "dark", "neutral", "550", "1", "8", "2", "0.125"],
        ["4-5", "light", "dark", "lens", "540", "1", "8", "2", "0.200"],
    ]
    assert len(table) == 8
    assert "16 frames in 16 steps" in printed
    assert "slot" not in printed


def test_show_of_a_wheel_has_its_slots(labapp, small):
    change(small.bench, "simulated-filter", "simulated-wheel")
    change(small.plan, "wavelengths_nm = [540, 550]", "slots = [4, 1]")
    _, printed, _ = labapp("plan", "show", small.plan, *small.arguments())
    table = [words for words in rows(printed) if "light" in words]
    assert table[0][:6] == ["0-1", "light", "dark", "neutral", "633", "4"]
    assert table[1][:6] == ["2-3", "light", "dark", "neutral", "450", "1"]
    limits = {words[0]: " ".join(words[1:]) for words in rows(printed)}
    assert limits["slots"] == "1, 4 1 to 4: 450, 532, 550, 633 nm"


def test_show_has_prompts_where_they_come(labapp, small):
    place_by_hand(small)
    _, printed, _ = labapp("plan", "show", small.plan, *small.arguments())
    lines = [line.strip() for line in printed.splitlines()]
    dark, star = (lines.index(f"Place {name}, then press Enter.") for name in ("dark", "star"))
    parts = ["\n".join(lines[:dark]), "\n".join(lines[dark:star]), "\n".join(lines[star:])]
    assert [part.count("light") for part in parts] == [0, 4, 4]
    assert "besides what a person takes who is asked 2 times" in printed


def test_show_as_data_has_every_frame(labapp, small, monkeypatch):
    place_by_hand(small)
    # What frames take on this computer isn't known.
    monkeypatch.setattr(
        "labapp.runs.plan_preview.measure_frame_delays", lambda bench, able, *_: able
    )
    data = data_of(labapp, "plan", "show", small.plan, *small.arguments())
    shots = data["shots"]
    assert len(shots) == data["frames"] == 16
    assert [shot["frame"] for shot in shots] == list(range(16))
    assert {shot["frame"]: shot["prompt"] for shot in shots if shot["prompt"]} == {
        0: "Place dark, then press Enter.",
        8: "Place star, then press Enter.",
    }
    last = shots[-1]
    assert [last[key] for key in ("role", "target", "place", "pattern", "slot", "repeat")] == [
        "light", "star", "star", "lens", 0, 0,
    ]  # fmt: skip
    assert (last["wavelength_nm"], last["exposure_ms"]) == (550.0, 8.0)
    assert last["due_s"] + 0.008 + 0.008 == pytest.approx(data["seconds"])


def test_show_ends_a_long_table_unless_all_is_asked_for(labapp, small):
    """25 wavelengths with two patterns and two targets make 100 rows, of which 40 are printed."""
    wavelengths = ", ".join(str(450 + 10 * n) for n in range(25))
    change(small.plan, "[540, 550]", f"[{wavelengths}]")
    arguments = ["plan", "show", small.plan, *small.arguments()]
    _, short, _ = labapp(*arguments)
    _, whole, _ = labapp(*arguments, "--all")
    assert "... and 60 more rows; --all prints them" in short
    assert [text.count(" light ") for text in (short, whole)] == [40, 100]
    assert "more rows" not in whole
    assert "450, 460 ... 690 (25) nm" in " ".join(short.split())


def test_the_list_names_every_ready_plan_with_what_it_is_for(labapp):
    code, printed, _ = labapp("plan", "list")
    assert code == 0
    text = " ".join(printed.split())
    for name in READY:
        assert name in text
    assert "Photon transfer." in text
    data = {one["name"]: one for one in json.loads(labapp("plan", "list", "--json")[1])}
    assert tuple(data) == READY
    assert data["edof-target"]["prompts"] == 5
    assert data["psf-over-wavelengths"]["targets"] == ["star", "dark"]
    assert data["phase-video-stability"]["periods"]
    for one in data.values():
        assert one["comment"].endswith((".", "?"))
        assert read_file(Path(one["path"]), PlanFile).title == one["title"]


def test_ready_plans_are_installed_with_the_application():
    root = Path(package.__file__).parent
    settings = tomllib.loads((root.parent / "pyproject.toml").read_text())
    patterns = settings["tool"]["setuptools"]["package-data"]["labapp"]
    assert tuple(bundled_plans()) == READY
    for path in bundled_plans().values():
        assert any(path.relative_to(root).match(pattern) for pattern in patterns)


@pytest.mark.parametrize("name", READY)
def test_a_ready_plan_passes_on_the_bundled_bench(labapp, name):
    code, printed, said = labapp("plan", "check", name)
    assert (code, said) == (0, "")
    assert f"PASS. Run it with: labapp run {name} --out run.h5" in printed


ALWAYS = ("photon-transfer", "spectral-stack")
SWEPT = [pytest.param(name, marks=pytest.mark.sweep) for name in READY if name not in ALWAYS]


@pytest.mark.parametrize("name", [*ALWAYS, *SWEPT])
def test_a_ready_plan_runs_on_a_small_bench_with_the_bundled_scene(small, tmp_path, name):
    plan = read_file(bundled_plans()[name], PlanFile)
    asked: list[str] = []
    with open_bench(BenchFiles.with_defaults(small.bench)) as bench:
        outcome = run_plan(
            bench,
            plan,
            tmp_path / "run.h5",
            Attendance(ask=lambda text, progress: asked.append(text)),
        )
    assert (outcome.state, outcome.missing) == (State.COMPLETE, [])
    assert len(asked) == (5 if name == "edof-target" else 0)
