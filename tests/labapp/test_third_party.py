"""A device of somebody else's package, by its entry point."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import forked
import pytest

from labapp.files.reading import bundled_path

PACKAGE = Path(__file__).parent / "third_party"
VIRTUAL = '"simulated-filter"\noptions = { range_nm = [420.0, 720.0], bandwidth_nm = 7.0, settling_ms = 50.0 }'  # noqa: E501


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Of a Python that has the package installed."""
    folder = tmp_path_factory.mktemp("third_party") / "package"
    shutil.copytree(PACKAGE, folder)
    setup = "import setuptools; setuptools.setup()"
    subprocess.run(
        [sys.executable, "-W", "ignore", "-c", setup, "-q", "egg_info"], cwd=folder, check=True
    )
    return {**os.environ, "PYTHONPATH": str(folder)}


def labapp(environment, *words):
    command = [sys.executable, "-m", "labapp", *map(str, words)]
    return forked.run(command, env=environment, capture_output=True, text=True, check=False)


def bench_with(tmp_path, driver, options):
    path = tmp_path / "bench.toml"
    text = bundled_path("bench.toml").read_text()
    assert VIRTUAL in text
    path.write_text(text.replace(VIRTUAL, f'"{driver}"\noptions = {options}'))
    return path


def test_it_is_opened_by_its_name_and_tried_out(environment, tmp_path):
    bench = bench_with(tmp_path, "example-wheel", "{ settling_ms = 1.0 }")
    done = labapp(environment, "devices", "test", "filter", "--bench", bench, "--json")
    found = json.loads(done.stdout)
    assert (done.returncode, found["well"]) == (0, True), done.stderr
    assert found["checks"][0]["detail"] == "example wheel, serial number 1"
    assert found["checks"][1]["detail"] == "colours: 2"


def test_its_complaint_about_an_option_names_the_bench_file(environment, tmp_path):
    bench = bench_with(tmp_path, "example-wheel", "{ settling_ms = -1.0 }")
    done = labapp(environment, "bench", "check", bench)
    assert done.returncode == 1
    words = " ".join(done.stdout.split())
    assert "settling_ms is -1.0; it must not be negative" in words
    assert "bench.toml: key 'devices.filter.options'" in words


def test_a_broken_one_is_reported_and_harms_nobody(environment, tmp_path):
    done = labapp(environment, "devices", "--json")
    drivers = json.loads(done.stdout)["drivers"]
    assert drivers["example-wheel"] == drivers["simulated-slm"] == ""
    assert "a_library_that_nobody_has" in drivers["example-broken"]
    bench = bench_with(tmp_path, "example-broken", "{}")
    done = labapp(
        environment,
        "run",
        bundled_path("first_light.toml"),
        "--bench",
        bench,
        "--out",
        tmp_path / "r.h5",
    )
    assert done.returncode == 1
    assert "example-broken" in done.stderr
    assert "a_library_that_nobody_has" in done.stderr
