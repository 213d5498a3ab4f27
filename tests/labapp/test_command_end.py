"""How commands end: 0 only if all was done and the bench is safe, 130 after Ctrl-C."""

from __future__ import annotations

import json
import signal
import subprocess

import pytest
from figures.ctrl_c import command_with, interrupt_often
from figures.where import ENVIRONMENT, ROOT

from drivers.errors import DeviceError
from labapp.common.command_end import begin_command, delay_interrupts, end_code, note_interrupt
from simulator.devices import SimulatedSLM


@pytest.mark.parametrize(
    ("moments", "latest"), [(6, 1.5), pytest.param(60, 5.0, marks=pytest.mark.sweep)]
)
def test_ctrl_c_ends_every_command_at_any_moment(tmp_path, moments, latest):
    """Another seed than the figure's: these are other moments."""
    found = interrupt_often(tmp_path, moments, seed=1, latest=latest)
    assert len(found) == moments
    assert [one for one in found if one.wrong] == []


_PRESS_AND_SWALLOW = """\
try:
    os.kill(os.getpid(), 2)
except BaseException:
    pass
"""


def test_ctrl_c_is_not_lost_where_python_swallows_exceptions_of_an_import():
    """As Python does in callbacks of its own, a few microseconds long, that no wait can hit."""
    command = command_with(_PRESS_AND_SWALLOW)
    ended = subprocess.run(
        [*command, "devices", "list", "--json"],
        capture_output=True,
        text=True,
        env=ENVIRONMENT | {"PYTHONPATH": str(ROOT)},
    )
    assert ended.returncode == 130
    assert json.loads(ended.stdout)["exit_code"] == 130
    assert ended.stderr == "cancelled\n"


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        (["run", "nowhere.toml", "--out", "run.h5"], 1, "nowhere.toml"),
        (["verify", "nowhere.h5"], 1, "nowhere.h5"),
        (["show", "nowhere.h5"], 1, "nowhere.h5"),
        (["devices", "list", "--bench", "nowhere.toml"], 1, "nowhere.toml"),
        (["show", "--no-such-option"], 2, "standard error"),
    ],
)
def test_json_is_one_document_also_after_an_error(
    labapp, tmp_path, monkeypatch, words, code, error
):
    monkeypatch.chdir(tmp_path)
    ended, printed, said = labapp(*words, "--json")
    document = json.loads(printed)
    assert (ended, document["exit_code"]) == (code, code)
    assert error in document["error"]
    assert said


def test_a_document_that_was_printed_is_the_only_one(labapp, tmp_path, small):
    path = tmp_path / "run.h5"
    files = ["--bench", small.bench, "--scene", small.scene]
    code, printed, _ = labapp("run", small.plan, *files, "--out", path, "--json")
    assert (code, json.loads(printed)["state"]) == (0, "COMPLETE")
    with path.open("r+b") as record:
        record.seek(-8, 2)
        record.write(b"\xff" * 8)
    code, printed, _ = labapp("verify", path, "--json")
    assert (code, json.loads(printed)["is_well"]) == (1, False)


@pytest.fixture
def stuck_panel(monkeypatch):
    """A panel that can't be made to show the neutral pattern."""

    def stick(self):
        raise DeviceError("the panel", "make safe", "is stuck", "Look at it")

    monkeypatch.setattr(SimulatedSLM, "make_safe", stick)


@pytest.mark.parametrize(
    "words", [["run", "PLAN", "--out", "run.h5"], ["plan", "check", "PLAN"], ["devices", "list"]]
)
def test_who_does_not_leave_the_bench_safe_does_not_end_with_0(
    labapp, small, tmp_path, monkeypatch, stuck_panel, words
):
    monkeypatch.chdir(tmp_path)
    chosen = [small.plan if word == "PLAN" else word for word in words]
    code, _, said = labapp(*chosen, "--bench", small.bench, "--scene", small.scene)
    assert code == 1
    assert "not left safe: the panel" in said.replace("\n", " ")


def test_ctrl_c_takes_effect_after_a_bench_was_made_safe():
    done = []

    def make_safe():
        with delay_interrupts():
            signal.raise_signal(signal.SIGINT)
            done.append("safe")

    with pytest.raises(KeyboardInterrupt):
        make_safe()
    assert done == ["safe"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_was_done_in_spite_of_ctrl_c_does_not_count_as_0():
    begin_command([])
    assert end_code(0) == 0
    note_interrupt()
    assert (end_code(0), end_code(1)) == (130, 1)
    begin_command([])
