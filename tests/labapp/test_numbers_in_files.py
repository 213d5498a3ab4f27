"""Numbers in files are written as numbers: texts, true and false in their place are refused."""

from __future__ import annotations

import copy
import random
import tomllib

import pytest
from pydantic import AwareDatetime, TypeAdapter

from labapp.bench.driver_loading import device_maker
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile, DeviceTable
from labapp.files.camera_file import CameraFile
from labapp.files.fault_file import FaultFile
from labapp.files.panel_file import PanelFile
from labapp.files.pattern_table import Pattern
from labapp.files.plan_file import PlanFile
from labapp.files.reading import FileModel, bundled_path, validate
from labapp.files.scene_file import SceneFile
from labapp.files.sensor_file import SensorFile
from labapp.training.edof.config import EdofTrainingConfig

FILES = {
    "bench.toml": BenchFile,
    "thesis-camera.toml": CameraFile,
    "edof-training.toml": EdofTrainingConfig,
    "faults.toml": FaultFile,
    "scene.toml": SceneFile,
    "panels": PanelFile,
    "plans": PlanFile,
    "scenes": SceneFile,
    "sensors": SensorFile,
}


def bundled():
    for name, model in FILES.items():
        path = bundled_path(name)
        for one in sorted(path.glob("*.toml")) if path.is_dir() else [path]:
            yield one, model


def places(data, place=()):
    """Where the numbers, truths and texts of plain data stand."""
    if isinstance(data, dict):
        for key, one in data.items():
            yield from places(one, (*place, key))
    elif isinstance(data, list):
        for key, one in enumerate(data):
            yield from places(one, (*place, key))
    elif not isinstance(data, str):
        yield place


def put(data, place, value):
    changed = copy.deepcopy(data)
    table = changed
    for key in place[:-1]:
        table = table[key]
    table[place[-1]] = value
    return changed


def at(data, place):
    for key in place:
        data = data[key]
    return data


def test_a_text_for_a_number_or_a_truth_is_refused_in_every_bundled_file():
    rng = random.Random(3)
    for path, model in bundled():
        data = tomllib.loads(path.read_text())
        validate(data, model, "file")
        found = list(places(data))
        for place in rng.sample(found, min(8, len(found))):
            right = at(data, place)
            texts = ["yes", 1] if isinstance(right, bool) else [f"{right}", f" {right}", True]
            for wrong in texts:
                require_refused(data, place, wrong, model)


def require_refused(data, place, wrong, model):
    """Refused by name and with a remedy; what may be a text, as a note, stays one."""
    said = ""
    try:
        made = validate(put(data, place, wrong), model, "file")
    except UserError as error:
        said = str(error)
    if said:
        assert str(place[-1]) in said, (place, wrong)
        assert any(one in said for one in ("quotes", "a number", "should be")), said
    else:
        kept = at(TypeAdapter(model).dump_python(made, mode="json"), place)
        assert (kept, type(kept)) == (wrong, type(wrong)), place


def test_no_number_of_any_table_is_read_from_a_text():
    """Of every table there is, also those of kinds of files that don't come with labapp."""
    tables = list(all_of(FileModel))
    assert len(tables) > 60
    for table in [*tables, Pattern]:
        schema = TypeAdapter(table).core_schema
        assert not list(loose(schema, guarded=False)), table


def all_of(model):
    for one in model.__subclasses__():
        if one.__module__.startswith("labapp") and "[" not in one.__name__:
            yield one
        yield from all_of(one)


def loose(schema, *, guarded):
    """The numbers of a schema of pydantic's that are neither strict nor behind a check."""
    if isinstance(schema, list | tuple):
        for one in schema:
            yield from loose(one, guarded=False)
    elif isinstance(schema, dict):
        kind = schema.get("type")
        if kind in ("float", "bool") and not schema.get("strict"):
            yield schema
        if kind == "int" and not guarded:
            yield schema
        for key, one in schema.items():
            if key not in ("metadata", "default", "config", "serialization", "keys_schema"):
                yield from loose(one, guarded=kind == "function-before" and key == "schema")


@pytest.mark.parametrize("number", [2, 2.0])
def test_whole_numbers_may_have_a_point(number):
    lens = {"kind": "lens", "focal_length_m": 1, "orders": number}
    assert validate(lens, Pattern, "plan").orders == 2


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("1_000", "is '1_000': it is a text. Write a number, without quotes"),
        (" 5 ", "Write 5, without quotes"),
        ("0,5", "Write 0.5, without quotes"),
        (True, "true and false are no numbers"),
        (None, "write a number"),
        ([1], "write a number"),
    ],
)
def test_what_is_no_number_is_refused_with_what_to_write(value, words):
    with pytest.raises(UserError) as refused:
        validate({"kind": "lens", "focal_length_m": value}, Pattern, "plan")
    assert words in str(refused.value)
    assert "focal_length_m" in str(refused.value)


class Dated(FileModel):
    date: AwareDatetime


def test_a_number_of_seconds_is_no_date():
    for seconds in (5, "5", 5.5):
        with pytest.raises(UserError, match="2026-01-31"):
            validate({"date": seconds}, Dated, "file")


@pytest.mark.parametrize(
    ("driver", "options"),
    [
        ("simulated-camera", {"readout_ms": "5"}),
        ("simulated-filter", {"range_nm": [400, "720"]}),
        ("thorlabs-wheel", {"port": "sim", "slots_nm": [[550, "10"]]}),
        ("screen-slm", {"width": "1920"}),
        ("screen-slm", {"allow_primary": "no"}),
        ("varispec", {"port": "sim", "exercise": 0}),
    ],
)
def test_options_of_devices_are_of_the_type_that_the_driver_declares(driver, options):
    table = DeviceTable(driver=driver, options=options)
    with pytest.raises(UserError, match="without quotes"):
        device_maker("device", table, None, "bench.toml")
