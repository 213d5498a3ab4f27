"""Other libraries beside ours: each at its best, and whatever goes wrong in one is a row."""

from __future__ import annotations

import math
import re
import sys
from types import ModuleType

import numpy as np
import pytest
from labapp_peers import psf as peers
from labapp_peers.psf import candidates as peer_candidates

from labapp.accuracy.psf import exact_psf
from labapp.accuracy.work_precision import Row, measure
from labapp.prediction.lens_options import LensCase
from optics.camera import Lens
from optics.plane import Plane
from optics.progress import Progress

NAMES = ("prysm", "poppy", "hcipy", "torchoptics")


def small_case(size: int = 32, f_number: float = 32.0) -> LensCase:
    return LensCase(
        Lens(0.1, f_number, math.inf), 2.0, 520e-9, Plane((size, size), (3.45e-6, 3.45e-6))
    )


@pytest.fixture
def no_peers(monkeypatch):
    for name in NAMES:
        monkeypatch.setitem(sys.modules, name, None)


def stand_in(monkeypatch, name: str, **contents) -> None:
    module = ModuleType(name)
    vars(module).update(contents)
    monkeypatch.setitem(sys.modules, name, module)


def measured(case: LensCase, pattern: str) -> list[Row]:
    """Those whose method begins as the pattern says."""
    found = [one for one in peer_candidates(case) if re.match(pattern, one.row.method)]
    return measure(found, exact_psf(case, Progress()), Progress()).rows


@pytest.mark.usefixtures("no_peers")
def test_a_library_that_is_missing_is_one_row_that_says_what_to_install():
    rows = measure(
        list(peer_candidates(small_case())), exact_psf(small_case(), Progress()), Progress()
    ).rows
    assert [row.method for row in rows] == list(NAMES)
    for row in rows:
        assert row.failure == f"{row.method} isn't installed; pip install {row.method}"
        assert (row.tol, row.cpu_s, row.on_front) == (None, None, False)


@pytest.mark.usefixtures("no_peers")
def test_a_library_that_does_not_load_is_one_row_that_says_why(monkeypatch, tmp_path):
    monkeypatch.delitem(sys.modules, "prysm")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "prysm.py").write_text("from pkg_resources import get_distribution")
    monkeypatch.setitem(sys.modules, "pkg_resources", None)
    (row,) = measured(small_case(), "prysm")
    assert "pkg_resources" in row.failure
    assert 'pip install "setuptools<81"' in row.failure


@pytest.mark.usefixtures("no_peers")
@pytest.mark.parametrize("error", [KeyError("grid"), RuntimeError("out of memory"), TypeError("x")])
def test_whatever_a_library_raises_is_a_row_in_words(monkeypatch, error):
    def refuse(*_):
        raise error

    stand_in(monkeypatch, "hcipy", __version__="9.9", make_pupil_grid=refuse)
    rows = measured(small_case(), "hcipy")
    assert len(rows) > 1
    for row in rows:
        assert row.failure == f"hcipy 9.9 failed: {type(error).__name__}: {error}"


@pytest.mark.usefixtures("no_peers")
@pytest.mark.parametrize(
    ("picture", "said"),
    [(np.ones((3, 3)), "(3, 3)"), (np.full((32, 32), np.nan), "finite"), ("none", "ValueError")],
)
def test_a_picture_that_is_none_is_a_row_in_words(monkeypatch, picture, said):
    stand_in(monkeypatch, "hcipy", __version__="9.9")
    one = peers._Method("a method", lambda *_: (lambda: picture, 1), (8,), ("float64",))
    monkeypatch.setattr(peers, "_methods", lambda _: {"hcipy": [one]})
    (row,) = measured(small_case(), "hcipy")
    assert row.method == "hcipy 9.9, a method, 8² pupil, gray edge"
    assert row.failure.startswith("hcipy 9.9")
    assert said in row.failure


# 38 waves of defocus on 512² samples with a gray edge: 1.0e-2, by whoever computes it. A
# pupil or window that is off by half a sample or a pixel gives 5e-2 and more.
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("size", [255, 256])
@pytest.mark.parametrize("name", NAMES[:3])
def test_a_peer_on_a_grid_reaches_what_gray_grids_reach(name, size):
    pytest.importorskip(name, exc_type=ImportError)
    case = LensCase(Lens(0.1, 5.6, math.inf), 2.0, 520e-9, Plane((size, size), (3.45e-6, 3.45e-6)))
    rows = measured(case, f"{name}.* 51[12]² pupil")
    assert "float64" in {row.precision for row in rows}
    for row in rows:
        assert not row.failure
        assert row.error_achieved == pytest.approx(1.05e-2, rel=0.05)
        assert row.peak_bytes > 8 * 511**2


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("size", [32, 33])
def test_torchoptics_reaches_them_where_the_pupil_is_sampled_at_the_pixels(size):
    torchoptics = pytest.importorskip("torchoptics")
    before = torchoptics.get_default_dtype()
    fine, default = (
        measured(small_case(size), f"torchoptics [^,]*, {method},")[0]
        for method in ("DIM_FRESNEL at the pixels", "AUTO")
    )
    assert not fine.failure
    assert fine.error_achieved < 1e-4
    # Its default aliases the lens, and says nothing.
    assert default.error_achieved > 0.3
    assert torchoptics.get_default_dtype() == before


@pytest.mark.usefixtures("no_peers")
def test_what_needs_too_much_memory_is_not_tried(monkeypatch):
    stand_in(monkeypatch, "torchoptics", __version__="9.9")
    (row,) = measured(small_case(f_number=1.0), "torchoptics.*at the pixels")
    assert re.search(r"take 5\d\.\d GB: more than is tried", row.failure)


@pytest.mark.parametrize("operation", ["psf", "propagate", "deconvolve"])
def test_without_adapters_peers_are_refused_before_anything_is_measured(
    labapp, monkeypatch, operation
):
    def measured(*_):
        raise AssertionError("something was measured")

    monkeypatch.setattr("labapp.accuracy.peers.entry_points", lambda **_: ())
    for module in ("command", "propagate", "deconvolve"):
        monkeypatch.setattr(f"labapp.accuracy.{module}.machine_speed", measured)
    code, _, said = labapp("accuracy", operation, "--peers")
    assert code == 1
    assert "pip install -e tests/peers" in said
