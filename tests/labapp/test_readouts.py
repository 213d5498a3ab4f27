"""Plans whose frames are read in several ways: gain, region, binning and averages, end to end."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from plans import abilities, block, plan_of
from small_bench.files import SmallFiles, write_tiny

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file, validate
from labapp.pictures.analysis.brackets import merge_all
from labapp.runs.acquisition.feasibility import feasible_shots
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.export import export_frames
from labapp.runs.readouts import MeanImage, steps_per_dn
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.runs.verifying import verify
from optics.progress import Progress

REGIONS = [[0, 0, 24, 16], [8, 4, 16, 24]]

BLOCK = """
[[acquire]]
targets = ["dark", "star"]
patterns = ["neutral"]
wavelengths_nm = [550]
exposures_ms = [0.2]
"""

PLAN = f"""
version = 1
title = "Readouts"
seed = 5
[patterns.neutral]
kind = "constant"
{BLOCK}
{BLOCK}
regions_px = {REGIONS}
binnings = [1, 2]
gains_db = [0, 12]
{BLOCK}
average = 6
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> SmallFiles:
    files = write_tiny(tmp_path_factory.mktemp("readouts"))
    files.plan.write_text(PLAN)
    with open_bench(files.bench_files) as bench:
        plan = read_file(files.plan, PlanFile)
        ended = run_plan(bench, plan, files.folder / "run.h5")
        assert bench.camera.shape == (40, 45)
        assert bench.camera.gain_db == 0
    assert ended.state is State.COMPLETE, ended.message
    return files


@pytest.fixture
def record(files: SmallFiles) -> Path:
    return files.folder / "run.h5"


def test_the_record_is_in_order_and_tells_each_way_of_reading(record: Path) -> None:
    assert verify(record).is_in_order
    with Record(record) as opened:
        words = [one.describe() for one in opened.readouts]
    assert len(words) == 10
    assert words[0] == ""
    assert words[2] == "12 dB, 24x16+0+0, bin 1"
    assert words[-1] == "mean of 6 in 1/8 DN"


def test_frames_are_the_pixels_and_gains_that_were_asked_for(record: Path) -> None:
    with Record(record) as opened:
        star = opened.column("target") == opened.target_names.index("star")
        whole = opened.image(int(np.flatnonzero(star)[0])).astype(float) - 64
        for index in np.flatnonzero(star)[1:-1].tolist():
            read, image = opened.readout_of(index), opened.image(index).astype(float) - 64
            x, y, width, height = read.region
            part = whole[y : y + height, x : x + width]
            each = read.binning
            part = part.reshape(height // each, each, width // each, each).mean(axis=(1, 3))
            assert image.shape == part.shape == opened.frame_size(index)
            gain = 10 ** (read.gain_db / 20)
            assert opened.column("gain")[index] == pytest.approx(2.6 * each**2 / gain)
            # Both frames have their own noise, of some electrons and the light's.
            deviation = np.sqrt((2.4**2 + np.maximum(part, 0) * 2.6) * 2) / 2.6 / each + 0.5
            assert np.all(np.abs(image / gain - part) < 6 * deviation)


def test_a_mean_has_the_noise_of_its_frames_together(record: Path) -> None:
    with Record(record) as opened:
        dark = np.flatnonzero(opened.column("target") == opened.target_names.index("dark"))
        single, mean = (opened.image(int(dark[place])) for place in (0, -1))
    assert mean.dtype == np.float32
    assert np.any(mean % 1)
    assert mean.mean() == pytest.approx(64, abs=0.1)
    # The mean's own steps of an eighth add a twelfth of them squared.
    expected = np.sqrt(single.var() / 6 + 1 / 8**2 / 12)
    assert mean.std() == pytest.approx(expected, rel=5 * np.sqrt(1 / mean.size))


def test_one_way_is_merged_at_a_time_and_the_rate_is_the_same_in_all(record: Path) -> None:
    with Record(record) as opened, pytest.raises(UserError, match=r"--readout NUMBER.*12 dB"):
        merge_all(opened, Progress())
    rates = []
    for number in range(10):
        with Record(record, readout=number) as opened:
            (merged,) = merge_all(opened, Progress(), {"star"})
            rates.append((opened.readouts[number], merged.rate, merged.variance))
    told: list[float] = []
    _, whole, spread = rates[0]
    for read, rate, variance in rates[1:]:
        x, y, width, height = read.region or (0, 0, 44, 40)
        part = slice(y, y + height), slice(x, x + width)
        found, expected = rate.sum() / read.averaged, whole[part].sum()
        error = np.sqrt(variance.sum() / read.averaged**2 + spread[part].sum())
        assert abs(found - expected) < 5 * error
        told.append(error / expected)
    # The region without the star has hardly any light to compare; a wrong gain is off by 4.
    assert sorted(told)[4] < 0.3


def test_frames_that_were_lost_are_taken_again_as_they_were(
    files: SmallFiles, record: Path
) -> None:
    with Record(record) as opened:
        before = [opened.stored_image(index) for index in range(opened.frame_count)]
        place = opened.structure.table.places["entry/data/images"]
    damaged = files.folder / "damaged.h5"
    data = bytearray(record.read_bytes())
    for index in (3, 12, 19):
        data[place.offset + index * place.row_bytes] ^= 1
    damaged.write_bytes(data)
    assert verify(damaged).damaged == [3, 12, 19]
    with open_bench(files.bench_files) as bench:
        assert resume_run(bench, damaged).state is State.COMPLETE
    with Record(damaged) as opened:
        for index, image in enumerate(before):
            np.testing.assert_array_equal(opened.stored_image(index), image)


def test_an_export_has_the_frames_own_size_and_says_how_they_were_read(
    record: Path, tmp_path: Path
) -> None:
    import tifffile

    export_frames(record, "tiff", tmp_path / "each")
    with Record(record) as opened:
        for index, path in enumerate(sorted((tmp_path / "each").glob("*.tiff"))):
            with tifffile.TiffFile(path) as written:
                np.testing.assert_array_equal(written.asarray(), opened.stored_image(index))
                told = json.loads(written.pages[0].description)["readout"]
            assert told == (opened.readout_of(index).describe() or "whole frame")
    with pytest.raises(UserError, match="--readout"):
        export_frames(record, "npy", tmp_path / "stack")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("gains_db = [3, 40]", "gains_db' has 40"),
        ("regions_px = [[40, 0, 6, 4]]", "regions_px' has"),
        ("regions_px = [[1, 0, 6, 4]]\nbinnings = [2]", "multiples of 2"),
        ("binnings = [41]", "binnings' has 41"),
        ("average = 0", "average"),
        ("gains_db = [nan]", "gains_db"),
        ("gains_db = [0, 6]\nbracket = { snr_db = 20 }", "bracket"),
        ("average = 4\nbracket = { snr_db = 20 }", "bracket"),
    ],
)
def test_what_the_camera_does_not_have_is_refused_before_anything_moves(
    files: SmallFiles, tmp_path: Path, line: str, words: str
) -> None:
    block = BLOCK.replace("exposures_ms = [0.2]", "") if "bracket" in line else BLOCK
    path = tmp_path / "plan.toml"
    path.write_text(PLAN.split(BLOCK)[0] + block + line)
    with pytest.raises(UserError, match=words), open_bench(files.bench_files) as bench:
        run_plan(bench, read_file(path, PlanFile), tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ({"binnings": [1, 2]}, "mix the colours"),
        ({"regions_px": [[1, 0, 8, 8]]}, "x must be a multiple of 2"),
        ({"regions_px": [[0, 3, 8, 8]]}, "y of 2"),
    ],
)
def test_colours_are_never_mixed_or_shifted(key: dict, words: str) -> None:
    able = abilities(has_regions=True, frame_shape=(40, 44), mosaic=(2, 2))
    with pytest.raises(UserError, match=words):
        feasible_shots(plan_of(block(wavelengths_nm=None, slots=[1], **key)), able, "plan")
    even = block(wavelengths_nm=None, slots=[1], binnings=[1], regions_px=[[2, 4, 8, 8]])
    assert len(feasible_shots(plan_of(even), able, "plan")) == 1


def test_a_million_means_have_no_more_steps_than_sixteen_bits() -> None:
    assert steps_per_dn(1, 4095) == 1
    assert steps_per_dn(5, 4095) == 8
    assert steps_per_dn(65_536, 4095) == 16
    assert steps_per_dn(100, 65_535) == 1
    mean = MeanImage(np.array([[10, 4095]], np.uint16), 4095)
    mean.add(np.array([[11, 100]], np.uint16))
    np.testing.assert_array_equal(mean.stored(2), [[21, 8190]])


def test_axes_that_step_together_pair_gains_with_exposures() -> None:
    data = {
        "targets": ["star"], "patterns": ["a"], "wavelengths_nm": [550], "gains_db": [0, 6],
        "exposures_ms": [8, 4], "together": [["gain", "exposure"]],
    }  # fmt: skip
    plan = validate(
        {
            "version": 1, "title": "t", "patterns": {"a": {"kind": "constant"}}, "acquire": [data],
        },
        PlanFile,
        "plan",
    )  # fmt: skip
    assert plan.acquire[0].frame_limit() == 2
