"""The phase of grey levels, seen as a bench sees it: by gratings, in the middle of a star."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from labapp.bench.opening import open_bench
from labapp.files.grey_table import GratingPattern
from labapp.files.plan_file import PlanFile
from labapp.patterns.grey_levels import compute_pattern
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from optics.camera import Camera
from optics.progress import Progress

LEVELS = (0, 19, 38, 57, 76, 114, 190, 255)
MIDDLE = (slice(32 - 6, 32 + 7), slice(48 - 6, 48 + 7))


def test_the_middle_of_a_star_follows_the_cosine_of_half_the_phase_step(small, tmp_path):
    """Fourier series of a binary phase grating: cos²(p/2) stays in order zero.

    The bench file gives 6.7 pi at 532 nm for grey 255, and 5 % unmodulated light.
    """
    gratings = {f"{g}": {"kind": "grating", "period_px": 16, "high": g} for g in LEVELS}
    block = {
        "targets": ["dark", "star"],
        "patterns": list(gratings),
        "wavelengths_nm": [532],
        "exposures_ms": [16],
        "repeats": 4,
    }
    plan = PlanFile.model_validate(
        {"version": 1, "title": "Response", "patterns": gratings, "acquire": [block]}
    )
    with open_bench(small.bench_files) as bench:
        path = run_plan(bench, plan, tmp_path / "run.h5").path
    with Record(path) as record:

        def light(target, level):
            taken = record.select(target=target, pattern=f"{level}")
            return np.mean([record.image(i)[MIDDLE] for i in taken], axis=0, dtype=float).sum()

        seen = np.array([light("star", g) - light("dark", g) for g in LEVELS])
    phase = 6.7 * math.pi * np.array(LEVELS) / 255
    expected = 0.05 + 0.95 * np.cos(phase / 2) ** 2
    np.testing.assert_allclose(seen / seen[0], expected, atol=0.04)
    assert expected.min() < 0.1 < 0.9 < expected.max()


@pytest.mark.parametrize("axis", ["x", "y"])
def test_stripes_are_equally_wide_and_lie_along_their_axis(axis):
    spec = GratingPattern(kind="grating", period_px=6, low=10, high=200, axis=axis)
    grey = compute_pattern(spec, Camera(), 0, Progress(), folder=None)
    along = grey if axis == "x" else grey.T
    assert along[0, :12].tolist() == [10] * 3 + [200] * 3 + [10] * 3 + [200] * 3
    assert (along == along[0]).all()


@pytest.mark.parametrize(
    ("key", "value"), [("period_px", 7), ("period_px", 0), ("high", 256), ("axis", "z")]
)
def test_a_grating_that_cannot_be_is_refused(key, value):
    table = {"kind": "grating", "period_px": 6, "high": 9} | {key: value}
    with pytest.raises(ValidationError, match=key):
        TypeAdapter(GratingPattern).validate_python(table)
