"""Panels as files: bundled, one's own, named by a bench, with tables and pictures beside."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile, read_bench
from labapp.files.panel_file import PanelTable, read_panel
from labapp.files.reading import bundled_path
from optics.slm import Panel, grey_to_phase, max_phase

BENCH = bundled_path("bench.toml").read_text()
OTHERS = BENCH[BENCH.index("[lens]") :]
HEAD = BENCH[: BENCH.index("[panel]")]

SMALL = """
model = "small"
width = 8
height = 6
pitch_um = 8.0
fill_factor = 0.87
levels = 16
unmodulated = 0.05
reflectivity = 0.6
settling_ms = 50.0
max_phase_pi = { 452 = 9.0, 532 = 6.7, 633 = 5.4 }
"""


def written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def small(folder: Path, more: str = "") -> Panel:
    """A small panel's file with some lines more."""
    written(folder / "small.toml", "version = 1" + SMALL + more)
    return read_panel("small.toml", folder).build()


def bench(folder: Path, panel: str) -> BenchFile:
    return read_bench(written(folder / "bench.toml", f"{HEAD}[panel]\n{panel}\n{OTHERS}"))


# What comes with labapp


@pytest.mark.parametrize("name", ["pluto-vis-006-a", "pluto-vis-016-hr"])
def test_the_thesis_panels_come_with_labapp(name, tmp_path):
    """Tables 2.1 and 2.2: 1920 x 1080 of 8 µm, 15.36 x 8.64 mm, 87 %, 256 levels, 60 Hz."""
    panel = read_panel(name, tmp_path).build()
    assert panel.shape == (1080, 1920)
    assert [n * panel.pitch for n in panel.shape] == pytest.approx([8.64e-3, 15.36e-3])
    assert (panel.fill_factor, panel.levels, panel.frame_rate) == (0.87, 256, 60.0)
    assert panel.reflectivity == 0.6
    for nm, phase in ((452, 9.0), (532, 6.7), (633, 5.4)):
        assert max_phase(panel, nm * 1e-9) == pytest.approx(phase * math.pi, rel=1e-12)
    assert name.upper() in read_panel(name, tmp_path).model


def test_the_bundled_bench_has_the_bundled_panel(tmp_path):
    default = read_bench(bundled_path("bench.toml")).panel
    assert default.build() == read_panel("pluto-vis-006-a", tmp_path).build()


def test_every_bundled_panel_can_be_named_by_a_bench(tmp_path):
    for name in (one.stem for one in bundled_path("panels").glob("*.toml")):
        assert bench(tmp_path, f'file = "{name}"').panel == read_panel(name, tmp_path)


# One's own


def test_every_effect_has_a_key_in_human_units(tmp_path):
    panel = small(
        tmp_path,
        """
frame_rate_hz = 72.0
response_time_ms = 5.0
coupling_um = 1.5
flicker = 0.01
jitter_rad = 0.1
front_reflection = 0.005
gap_reflection = 0.3
""",
    )
    assert (panel.frame_rate, panel.flicker, panel.jitter) == (72.0, 0.01, 0.1)
    assert (panel.front_reflection, panel.gap_reflection) == (0.005, 0.3)
    assert panel.response_time == pytest.approx(5e-3)
    assert panel.coupling == pytest.approx(1.5e-6)


def test_what_a_file_does_not_say_is_off(tmp_path):
    assert small(tmp_path) == Panel((6, 8), levels=16)


def test_a_panels_file_is_found_beside_the_bench_and_its_own_beside_it(tmp_path):
    """And the bench's keys count more."""
    written(tmp_path / "panels" / "lut.csv", "grey, 532\n0, 0\n15, 6.7\n")
    written(tmp_path / "panels" / "own.toml", "version = 1" + SMALL + 'lut = "lut.csv"')
    found = bench(tmp_path, 'file = "panels/own.toml"\nunmodulated = 0.08').panel
    assert (found.model, found.unmodulated, found.levels) == ("small", 0.08, 16)
    assert found.build().response is not None


def test_a_benchs_own_table_counts_more_than_the_panels(tmp_path):
    written(tmp_path / "panels" / "lut.csv", "grey, 532\n0, 0\n15, 6.7\n")
    written(tmp_path / "lut.csv", "grey, 532\n0, 0\n15, 5\n")
    written(tmp_path / "panels" / "own.toml", "version = 1" + SMALL + 'lut = "lut.csv"')
    panel = bench(tmp_path, 'file = "panels/own.toml"\nlut = "lut.csv"').panel.build()
    phase = grey_to_phase(panel, np.array([[15]], dtype=np.uint8), 532e-9)
    assert phase[0, 0] == pytest.approx(5 * math.pi)


def test_a_record_of_a_bench_can_be_read_again_anywhere(tmp_path, monkeypatch):
    """Tables are in it, pictures by their absolute paths."""
    there = tmp_path / "there"
    np.save(written(there / "flat.npy", ""), np.ones((2, 2)))
    written(there / "lut.csv", "grey, 532\n0, 0\n8, 1\n15, 6.7\n")
    more = 'lut = "lut.csv"\nflatness = { file = "flat.npy", nm_per_grey = 50.0 }'
    found = bench(there, SMALL + more)
    (there / "lut.csv").unlink()
    monkeypatch.chdir(tmp_path)
    again = BenchFile.model_validate(json.loads(json.dumps(found.model_dump(mode="json"))))
    assert again == found
    panel = again.build_camera().panel
    assert np.allclose(panel.flatness.values.numpy(), np.full((2, 2), 5e-8), rtol=1e-12)
    phase = grey_to_phase(panel, np.array([[8]], dtype=np.uint8), 532e-9)
    assert phase[0, 0] == pytest.approx(math.pi)


# Tables of levels


@pytest.mark.parametrize(
    "text",
    [
        "grey, 480, 600\n0, 0, 0\n15, 6.0, 3.0\n",
        "# measured in May\nGrey;480;600\n\n0;0;0 # dark\n15;6;3\n",
        "grey 480 600\n0 0 0\n5 2 1\n15 6 3\n",
        "\ufeffgrey\t480\t600\n0\t0\t0\n15\t6\t3\n",
    ],
)
def test_vendors_tables_come_in_many_shapes(tmp_path, text):
    """Levels between those that are given are interpolated."""
    written(tmp_path / "lut.csv", text)
    panel = small(tmp_path, 'lut = "lut.csv"')
    grey = np.arange(16, dtype=np.uint8)
    for wavelength, highest in ((480e-9, 6.0), (600e-9, 3.0)):
        phase = grey_to_phase(panel, grey, wavelength)
        assert np.allclose(phase, np.arange(16) / 15 * highest * np.pi, rtol=1e-12)


def test_regions_come_in_toml(tmp_path):
    """Two regions side by side, of which the right one reaches half as far."""
    curve = [k / 15 * 6.0 for k in range(16)]
    half = [k / 15 * 3.0 for k in range(16)]
    text = f"version = 1\nwavelengths_nm = [532]\nphase_pi = [[[{curve}, {half}]]]\n"
    written(tmp_path / "lut.toml", text)
    panel = small(tmp_path, 'lut = "lut.toml"')
    phase = grey_to_phase(panel, np.full((6, 8), 15, dtype=np.uint8), 532e-9)
    assert phase[0, 0] == pytest.approx(6 * math.pi)
    assert phase[0, -1] == pytest.approx(3 * math.pi)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("lut.csv", "", ["lut.csv: is empty"]),
        ("lut.csv", "0, 0\n15, 6.7\n", ["lut.csv: line 1 must say 'grey'", "'grey, 532'"]),
        ("lut.csv", "grey\n0\n15\n", ["line 1 must say 'grey'"]),
        ("lut.csv", "grey, red\n0, 0\n15, 1\n", ["line 1 must say 'grey'"]),
        ("lut.csv", "grey, -532\n0, 0\n15, 1\n", ["line 1 must say 'grey'"]),
        ("lut.csv", "grey, 532\n0, 0\n\n15\n", ["line 4 is '15'; it must hold 2 finite numbers"]),
        ("lut.csv", "grey, 532\n0, zero\n15, 1\n", ["line 2 is '0 zero'"]),
        ("lut.csv", "grey, 532\n0, 0\n255, 6.7\n", ["must rise from 0", "15, the panel's last"]),
        ("lut.csv", "grey, 532\n0, 0\n9, 1\n9, 2\n15, 3\n", ["must rise from 0"]),
        ("lut.csv", "grey, 532\n0, 0\n8, 4\n15, 3\n", ["lut.csv: the response falls from level 8"]),
        (
            "lut.csv",
            "grey, 532\n0, 0\n15, nan\n",
            ["lut.csv: line 3", "15 nan", "2 finite numbers"],
        ),
        ("lut.csv", "grey, 900\n0, 0\n15, 5\n", ["lut.csv: wavelength 900 nm is outside"]),
        ("lut.toml", "version = 1\nwavelengths_nm = [532]\n", ["key 'phase_pi' is missing"]),
        (
            "lut.toml",
            "version = 1\nwavelengths_nm = [532]\nphase_pi = [[0, 1], [0]]\n",
            ["lut.toml: phase_pi must hold equally long lists"],
        ),
        (
            "lut.toml",
            "version = 1\nwavelengths_nm = [532]\nphase_pi = [[0, 1, 2]]\n",
            ["lut.toml: response has 3 levels and the panel 16"],
        ),
    ],
)
def test_a_bad_table_is_named_with_its_line(tmp_path, name, text, words):
    written(tmp_path / name, text)
    with pytest.raises(UserError) as caught:
        small(tmp_path, f'lut = "{name}"')
    for word in words:
        assert word in str(caught.value)


# Pictures


def saved(path: Path, values: np.ndarray) -> None:
    assert cv2.imwrite(str(path), values)


@pytest.mark.parametrize(
    ("name", "dtype"), [("m.png", np.uint8), ("m.png", np.uint16), ("m.tiff", np.float32)]
)
def test_maps_are_pictures_as_they_are(tmp_path, name, dtype):
    """Half the grey level is half the light: nothing of sRGB."""
    values = np.array([[0, 100, 200], [50, 150, 250]], dtype=dtype)
    saved(tmp_path / name, values)
    panel = small(
        tmp_path,
        f'illumination = {{ file = "{name}" }}\n'
        f'flatness = {{ file = "{name}", nm_per_grey = -2.0 }}',
    )
    assert panel.illumination.values.tolist() == values.tolist()
    assert np.allclose(panel.flatness.values.numpy(), -2e-9 * values)


def test_a_vendors_wrapped_correction_is_unwrapped(tmp_path):
    """A bowl of three waves at 633 nm, kept modulo one wave in 256 levels, to be added to
    patterns: the panel has its negative."""
    y, x = np.mgrid[-1:1:60j, -1:1:80j]
    bowl = 3 * 633e-9 * (y**2 + x**2) / 2
    levels = np.round(bowl / 633e-9 * 256).astype(int) % 256
    saved(tmp_path / "c.png", levels.astype(np.uint8))
    panel = small(
        tmp_path,
        f'flatness = {{ file = "c.png", nm_per_grey = {-633 / 256}, wrapped_nm = 633 }}',
    )
    wrong = panel.flatness.values.numpy() + bowl
    assert np.ptp(wrong) <= 633e-9 / 256 * 1.01


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("gone.png", None, "gone.png: cannot be read: there is no such file"),
        ("bad.png", b"no picture", "bad.png: is not a picture that can be read: it is text"),
        ("empty.png", b"", "empty.png: is empty"),
        ("bad.npy", b"no array", "bad.npy: cannot be read as a NumPy array"),
    ],
)
def test_a_bad_map_is_named(tmp_path, name, data, words):
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(UserError, match=words):
        small(tmp_path, f'illumination = {{ file = "{name}" }}')


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.ones(3), "m.npy: is 3; give rows x columns"),
        (np.full((2, 2), np.nan), "m.npy: has no finite value"),
        (np.zeros((2, 2)), "small: illumination goes from 0 to 0"),
        (np.array([["a"]]), "m.npy: holds <U1 values. Give real numbers"),
        (np.ones((2, 2), dtype=complex), "m.npy: holds complex128 values"),
    ],
)
def test_a_map_of_nonsense_is_refused(tmp_path, values, words):
    np.save(tmp_path / "m.npy", values)
    with pytest.raises(UserError, match=words):
        small(tmp_path, 'illumination = { file = "m.npy" }')


# Bad input


@pytest.mark.parametrize(
    ("panel", "words"),
    [
        ('file = "nowhere.toml"', ["nowhere.toml: there is no such panel", "pluto-vis-016-hr"]),
        ("file = 3", ["bench.toml: key 'panel.file' is 3", "string"]),
        ('file = "pluto-vis-006-a"\ncolour = 1', ["bench.toml: key 'panel.colour' is unknown"]),
        ('file = "pluto-vis-006-a"\nlevels = 1', ["bench.toml: key 'panel.levels' is 1"]),
        (SMALL + "coupling_um = 9.0", ["bench.toml: key 'panel'", "coupling is 9e-06 m"]),
        (SMALL + "front_reflection = 0.7", ["key 'panel'", "front_reflection is 0.7"]),
        (SMALL + "flicker = 2.0", ["key 'panel.flicker' is 2.0"]),
        (SMALL + 'flatness = { file = "x.png" }', ["key 'panel.flatness.nm_per_grey' is missing"]),
        (SMALL + 'lut = "lut.csv"', ["lut.csv: cannot be read"]),
        (
            SMALL.replace("452 = 9.0", "532.0 = 9.0").replace("532.0 =", '"532.0" ='),
            ["key 'panel'", "max_phase has 532 nm more than once"],
        ),
    ],
)
def test_a_bad_panel_of_a_bench_is_named_with_its_key(tmp_path, panel, words):
    with pytest.raises(UserError) as caught:
        bench(tmp_path, panel)
    for word in words:
        assert word in str(caught.value)


def test_a_panels_file_that_is_wrong_is_named_itself(tmp_path):
    written(tmp_path / "own.toml", "version = 1" + SMALL.replace("0.87", "1.87"))
    with pytest.raises(UserError, match=r"own.toml: key 'fill_factor' is 1.87"):
        bench(tmp_path, 'file = "own.toml"')


def test_a_table_and_a_response_at_once_are_refused():
    table = read_panel("pluto-vis-006-a", Path()).model_dump()
    curve = {"wavelengths_nm": [532], "phase_pi": [[k / 255 * 6 for k in range(256)]]}
    with pytest.raises(ValueError, match="give lut or response, not both"):
        PanelTable.model_validate(table | {"lut": "lut.csv", "response": curve})
