"""Plans as people write them: what is accepted, and what a wrong key is told."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from labapp.common.errors import UserError
from labapp.files.file_lookup import bundled_plans, find_plan
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file, validate

PLAN = """
version = 1
title = "Everything that a plan may say"
seed = 4
hooks = ["lamp"]

[metadata]
operator = "A. Person"
temperature = 21.5
humid = true

[targets.near]
place = "star"
prompt = "Move the star to 1 m."
distance_m = 1.0

[patterns.neutral]
kind = "constant"

[patterns.ring]
kind = "ring"
radius_um = 30
width_um = 5
start = "random"

[patterns.lens]
kind = "lens"
focal_length_m = -2.0

[patterns.film]
kind = "video"
frames = ["ring", "neutral"]

[patterns.many]
kind = "video"
count = 3
pattern = { kind = "ring", radius_um = 30, width_um = 5, start = "random" }

[[acquire]]
targets = ["near"]
patterns = ["ring", "film"]
slots = [1, 2]
periods = [1, 2]
repeats = 2
order = ["repeat", "wavelength"]
together = [["wavelength", "exposure"]]
interleave = [
    { role = "dark", every = 4, frames = 2 },
    { role = "flat", target = "sheet", pattern = "lens" },
    { role = "neutral" },
]

[[acquire]]
targets = ["near"]
patterns = ["lens"]
wavelengths_nm = [450, 532.5]
exposures_ms = [0.5, 8]

[retry]
attempts = 2
then = "pause"

[reconstruct]
coded = "ring"
wavelength_nm = 450
"""

RING = {"kind": "ring", "radius_um": 30, "width_um": 5, "start": "random"}


def simple(**changes: Any) -> dict[str, Any]:
    """A plan of one frame, with keys of its only block changed; None leaves a key out."""
    block = {
        "targets": ["star"],
        "patterns": ["neutral"],
        "wavelengths_nm": [550],
        "exposures_ms": [1],
    } | changes
    return {
        "version": 1,
        "title": "Simple",
        "patterns": {"neutral": {"kind": "constant"}, "ring": RING},
        "acquire": [{key: value for key, value in block.items() if value is not None}],
    }


def with_pattern(**patterns: dict[str, Any]) -> dict[str, Any]:
    plan = simple()
    return plan | {"patterns": plan["patterns"] | patterns}


def with_key(**keys: Any) -> dict[str, Any]:
    return simple() | keys


def test_a_plan_of_everything_is_read():
    plan = PlanFile.model_validate(tomllib.loads(PLAN))
    assert plan.metadata == {"operator": "A. Person", "temperature": 21.5, "humid": True}
    assert plan.targets["near"].place == "star"
    assert [block.length("wavelength") for block in plan.acquire] == [2, 2]
    assert list(plan.videos(plan.acquire[0])) == ["film"]
    assert [plan.patterns[name].length for name in ("film", "many")] == [2, 3]
    assert plan.reconstruct.wavelength == pytest.approx(450e-9)


def test_a_json_plan_is_the_same_as_a_toml_plan(tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN)
    (tmp_path / "plan.json").write_text(json.dumps(tomllib.loads(PLAN)))
    plans = [read_file(tmp_path / f"plan.{kind}", PlanFile) for kind in ("toml", "json")]
    assert plans[0] == plans[1]


def test_a_plan_survives_being_written_and_read():
    plan = PlanFile.model_validate(tomllib.loads(PLAN))
    assert PlanFile.model_validate_json(plan.model_dump_json()) == plan
    assert PlanFile.model_validate(json.loads(json.dumps(plan.model_dump(mode="json")))) == plan


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (simple(slots=[1]), "key 'acquire.0': a block has either wavelengths_nm or slots."),
        (
            simple(wavelengths_nm=None),
            "key 'acquire.0': a block has either wavelengths_nm or slots.",
        ),
        (
            simple(periods=[1]),
            "key 'acquire.0': a block has either exposures_ms, periods or bracket.",
        ),
        (
            simple(exposures_ms=None),
            "key 'acquire.0': a block has either exposures_ms, periods or bracket.",
        ),
        (
            simple(exposures_ms=None, periods=[1]),
            "a block with periods needs a pattern of kind 'video'.",
        ),
        (
            simple(wavelengths_nm=[450, 550], together=[["wavelength", "exposure"]]),
            "key 'acquire.0': axes that step together are two or more and equally long; here: "
            "wavelength 2, exposure 1.",
        ),
        (
            simple(together=[["wavelength"]]),
            "key 'acquire.0': axes that step together are two or more and equally long; here: "
            "wavelength 1.",
        ),
        (
            simple(together=[["wavelength", "target"], ["wavelength", "exposure"]]),
            "key 'acquire.0': together names an axis twice.",
        ),
        (simple(order=["pattern", "pattern"]), "key 'acquire.0': order names an axis twice."),
        (
            simple(order=["colour"]),
            "key 'acquire.0.order.0' is 'colour': input should be 'target', 'pattern', "
            "'wavelength', 'region', 'binning', 'gain', 'exposure' or 'repeat'.",
        ),
        (
            simple(exposures_ms=[1, 0]),
            "key 'acquire.0.exposures_ms.1' is 0: input should be greater than 0.",
        ),
        (
            simple(slots=[0], wavelengths_nm=None),
            "key 'acquire.0.slots.0' is 0: input should be greater than or equal to 1.",
        ),
        (
            simple(repeats=0),
            "key 'acquire.0.repeats' is 0: input should be greater than or equal to 1.",
        ),
        (
            simple(exposure_ms=[1]),
            "key 'acquire.0.exposure_ms' is unknown. Remove it, or check its spelling.",
        ),
        (
            simple(patterns=["spiral"]),
            "acquire asks for pattern 'spiral', and the patterns are neutral, ring.",
        ),
        (
            simple(interleave=[{"role": "dark", "pattern": "grey"}]),
            "acquire asks for pattern 'grey', and the patterns are neutral, ring.",
        ),
        (
            simple(interleave=[{"role": "bright"}]),
            "key 'acquire.0.interleave.0.role' is 'bright': input should be 'dark', 'flat' or "
            "'neutral'.",
        ),
        (
            simple(interleave=[{"role": "neutral", "target": "star"}]),
            "key 'acquire.0.interleave.0': neutral frames are of the block's own targets; "
            "remove 'target'.",
        ),
        (
            with_pattern(
                film={"kind": "video", "frames": ["neutral", "ring"]},
                cinema={"kind": "video", "frames": ["film", "ring"]},
            ),
            "pattern 'cinema' has the video 'film' as a frame.",
        ),
        (
            with_pattern(film={"kind": "video", "frames": ["ring", "spiral"]}),
            "pattern 'film' asks for pattern 'spiral', and the patterns are neutral, ring, film.",
        ),
        (
            with_pattern(film={"kind": "video", "frames": ["ring"]}),
            "key 'patterns.film.video': a video has two frames at least; show the still pattern "
            "itself.",
        ),
        (
            with_pattern(film={"kind": "video", "pattern": RING, "count": 1}),
            "key 'patterns.film.video.count' is 1: input should be greater than or equal to 2.",
        ),
        (
            with_pattern(film={"kind": "video"}),
            "key 'patterns.film.video': a video has either frames, or a pattern with a count.",
        ),
        (
            with_pattern(film={"kind": "video", "frames": ["ring", "neutral"], "count": 2}),
            "key 'patterns.film.video': a video has either frames, or a pattern with a count.",
        ),
        (
            with_pattern(film={"kind": "video", "pattern": RING}),
            "key 'patterns.film.video': a video has either frames, or a pattern with a count.",
        ),
        (
            with_pattern(
                film={"kind": "video", "pattern": RING | {"start": "quadratic"}, "count": 5}
            ),
            "key 'patterns.film.video': its frames would all be alike; give a ring with start = "
            "'random'.",
        ),
        (
            with_pattern(flat={"kind": "lens", "focal_length_m": float("inf")}),
            "key 'patterns.flat.lens.focal_length_m' is inf: input should be a finite number.",
        ),
        (
            with_key(targets={"near": {"distance_m": -1}}),
            "key 'targets.near.distance_m' is -1: input should be greater than 0.",
        ),
        (
            with_key(retry={"attempts": 0}),
            "key 'retry.attempts' is 0: input should be greater than or equal to 1.",
        ),
        (with_key(version=2), "key 'version' is 2: input should be 1."),
        (
            with_key(acquire=[]),
            "key 'acquire' is []: tuple should have at least 1 item after validation, not 0.",
        ),
    ],
)
def test_a_wrong_key_gives_one_clear_message(plan, message):
    with pytest.raises(UserError) as caught:
        validate(plan, PlanFile, "plan.toml")
    assert str(caught.value) == f"plan.toml: {message}"


def test_metadata_that_no_file_can_keep_is_refused():
    with pytest.raises(UserError, match=r"metadata\.temperature"):
        validate(with_key(metadata={"temperature": float("nan")}), PlanFile, "plan.toml")


def test_a_file_wins_over_a_ready_plan_and_a_folder_does_not(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ready = bundled_plans()["photon-transfer"]
    assert find_plan("photon-transfer") == ready
    (tmp_path / "photon-transfer").mkdir()
    assert find_plan("photon-transfer") == ready
    (tmp_path / "photon-transfer").rmdir()
    (tmp_path / "photon-transfer").write_text(PLAN)
    assert find_plan("photon-transfer") == Path("photon-transfer")


def test_an_unknown_plan_is_told_the_ready_ones():
    with pytest.raises(UserError, match=r"^nothing: there is no such file.*photon-transfer"):
        find_plan("nothing")


def test_a_bracket_counts_with_the_most_frames_that_it_may_get():
    block = {
        "targets": ["star"], "patterns": ["neutral"], "wavelengths_nm": [550],
        "bracket": {"snr_db": 30, "decades": 2, "most_frames": 8},
        "interleave": [{"role": "dark", "frames": 4}],
    }  # fmt: skip
    plan = PlanFile.model_validate(
        {
            "version": 1,
            "title": "Chosen",
            "patterns": {"neutral": {"kind": "constant"}},
            "acquire": [block],
        }
    )
    assert plan.acquire[0].frame_limit() == 8 + 8 * 4
