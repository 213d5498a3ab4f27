"""Files of strangers whose texts would run a program or write a file, through the commands."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import pytest
from forging import forge, replace_text
from small_bench.files import SmallFiles

from labapp.runs.record.reader import Record

SLOTS = "slots_nm = [[500, 10], [550, 10]]"

CRAFTED = {
    "backend": ("filter", "starlight-wheel", SLOTS + ', backend = "os:system@touch {}"'),
    "zwo": ("filter", "zwo-wheel", SLOTS + ', backend = "subprocess:getoutput@touch {}"'),
    "source": ("camera", "uvc-camera", 'source = "os:system", device = "touch {}"'),
    "spy": ("filter", "varispec", 'port = "spy://loop://?file={}"'),
    "wheel": ("filter", "thorlabs-wheel", SLOTS + ', port = "spy:///dev/null?file={}"'),
    "driver": ("filter", "os:system", 'port = "touch {}"'),
}

COMMANDS = (
    ("bench", "check", "{bench}"),
    ("bench", "check", "{bench}", "--open"),
    ("plan", "check", "{plan}", "--bench", "{bench}", "--scene", "{scene}"),
    ("plan", "show", "{plan}", "--bench", "{bench}", "--scene", "{scene}"),
    ("run", "{plan}", "--bench", "{bench}", "--scene", "{scene}", "--out", "{folder}/run.h5"),
    ("devices", "test", "{role}", "--bench", "{bench}"),
)  # fmt: skip


@pytest.mark.parametrize("kind", CRAFTED)
def test_a_bench_file_runs_nothing_and_writes_nothing(
    labapp, tiny: SmallFiles, tmp_path: Path, kind: str
) -> None:
    role, driver, options = CRAFTED[kind]
    made, kept = tmp_path / "made", tmp_path / "kept"
    kept.write_text("kept")
    path = kept if kind in ("spy", "wheel") else made
    text = tiny.bench.read_text()
    table = f'[devices.{role}]\ndriver = "{driver}"\noptions = {{ {options.format(path)} }}\n'
    before = f'[devices.{role}]\ndriver = "simulated-{role}"\n'
    assert before in text
    tiny.bench.write_text(text.replace(before, table))
    words = {"bench": tiny.bench, "plan": tiny.plan, "scene": tiny.scene, "role": role}
    for command in COMMANDS:
        code, _, errors = labapp(*(one.format(**words, folder=tmp_path) for one in command))
        assert code != 0
        assert "unexpected" not in errors
    assert not made.exists()
    assert kept.read_text() == "kept"
    assert not (tmp_path / "run.h5").exists()


def test_a_record_of_real_devices_is_resumed_only_when_somebody_says_so(
    labapp, tiny: SmallFiles, tmp_path: Path
) -> None:
    path = tmp_path / "run.h5"
    code, _, errors = labapp("run", tiny.plan, *tiny.arguments(), "--out", path)
    assert code == 0, errors
    with Record(path) as record:
        bench = json.loads(record.text("bench"))
    options = {"port": "/dev/nothing", "bandwidth_nm": 7.0}
    bench["devices"]["filter"] |= {"driver": "varispec", "options": options}
    with h5py.File(path, "r+", libver="latest") as file:
        replace_text(file["entry"], "bench", json.dumps(bench))
        file["entry/data/stored"][3] = 0
    forge(path)
    code, said, errors = labapp("resume", path)
    assert code == 1
    assert "filter: varispec (port = '/dev/nothing', bandwidth_nm = 7.0)" in said + errors
    assert "Give the bench file by --bench, or --yes" in errors
