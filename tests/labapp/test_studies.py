"""Studies as a user gets them, on a bench whose panel has few, large pixels.

What is expected comes from the targets that were asked for, from the thin-lens equation, from
the law of averages, and from the published patterns.
"""

from __future__ import annotations

import json
import re
import signal
import sys
import time
from pathlib import Path

import cv2
import forked
import numpy as np
import pytest

from labapp.files.bench_file import read_bench
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled_path
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.studies import STUDIES
from labapp.studies.command import StudyRequest, carry_out_study
from labapp.studies.focusing import mean_square_pupil_radius
from labapp.studies.psf_shapes import (
    RING_BAND,
    RING_ENERGY,
    published_ring_sizes,
    read_published_ring,
)
from labapp.studies.psf_stability import independent_frames_error
from labapp.studies.psf_video import rms_radius
from labapp.studies.refocus import edge_steepness
from labapp.studies.study_lookup import find_study, read_study_settings
from optics.camera import Camera, Lens, Panel

FILES = {"run.h5", "study.png", "study.html", "study.json"}


def coarse(
    folder: Path, pitch: float = 3.45, shape: tuple[int, int] = (128, 160), coarser: int = 10
) -> Path:
    """The virtual bench with fewer, larger pixels of the panel, and a small sensor."""
    text = bundled_path("bench.toml").read_text()
    changes = {
        "width = 1920": f"width = {1920 // coarser}",
        "height = 1080": f"height = {1080 // coarser}",
        "pitch_um = 8.0": f"pitch_um = {8 * coarser}.0",
        "width = 768": f"width = {shape[1]}",
        "height = 512": f"height = {shape[0]}",
        "pitch_um = 3.45": f"pitch_um = {pitch}",
    }
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / "coarse.toml"
    path.write_text(text)
    return path


def done(folder: Path, asked: StudyRequest) -> dict:
    """A study's account as programs read it."""
    carry_out_study(asked, folder)
    assert {path.name for path in folder.iterdir()} == FILES
    return json.loads((folder / "study.json").read_text())


def values(said: dict, words: str) -> list[float]:
    return [row["value"] for row in said["rows"] if words in row["what"]]


@pytest.fixture(scope="module")
def shapes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shapes")
    keys = ('shapes=["heart","ring"]', "iterations=30", "exposures_ms=[1, 16, 256]")
    return folder / "out", done(
        folder / "out", StudyRequest("psf-shapes", keys, bench=coarse(folder))
    )


def test_shapes_have_the_light_that_modulation_leaves_them(shapes):
    """5 % can't be modulated; of the rest a good retrieval puts more than nine tenths there."""
    _, said = shapes
    for name in ("heart", "ring"):
        figures = said["data"][name]
        assert 0.8 < figures["light"] <= 0.955
        assert figures["correlation"] > 0.85
    (share,) = values(said, "no pattern moves")
    assert share == pytest.approx(0.05, abs=0.005)


def test_the_ring_holds_as_much_light_as_published_even_from_few_pixels(shapes):
    _, said = shapes
    (share,) = values(said, "modulated light at 20 to 40")
    assert RING_ENERGY[10] <= share <= 1


def test_the_published_ring_is_where_it_is_compared_with_ours():
    """30 samples of 1920 pixels of 8 µm: 550 nm x 133 mm / 15.36 mm each."""
    radius, width = published_ring_sizes(Camera(lens=Lens(0.125, 5.0, 2.0)), 550e-9)
    assert radius == pytest.approx(30 * 550e-9 * (1 / (8 - 0.5)) / 15.36e-3, rel=1e-9)
    ring = read_published_ring().astype(float)
    y, x = np.indices(ring.shape) - 50
    distance = np.hypot(y, x)
    assert (ring * distance).sum() / ring.sum() == pytest.approx(30, abs=0.3)
    near = np.abs(distance - 30) < 4
    around = np.sqrt((ring * (distance - 30) ** 2)[near].sum() / ring[near].sum())
    assert around * radius / 30 == pytest.approx(width, rel=0.1)


PUBLISHED = (
    Path(__file__).parents[3]
    / "shared/data/thesis/phase_retrieval/results/phase_pattern_images/r_30p"
)


@pytest.mark.shared
@pytest.mark.skipif(not PUBLISHED.is_dir(), reason="the patterns aren't beside the checkout")
@pytest.mark.parametrize(("name", "iterations"), [("1", 1), ("569(min_constraint)", 569)])
def test_the_published_energies_are_those_of_the_published_patterns(name, iterations):
    grey = cv2.imread(str(PUBLISHED / f"slmPhase_gaussianRing_iter_{name}.png"), 0)
    pupil = np.zeros((1920, 1920), np.complex64)
    pupil[420:1500] = np.exp(2j * np.pi * grey / 255)
    light = np.abs(np.fft.fftshift(np.fft.fft2(pupil))) ** 2
    y, x = np.indices(light.shape) - 960
    radius = np.hypot(y, x)
    share = light[(radius > RING_BAND[0]) & (radius < RING_BAND[1])].sum() / light.sum()
    assert RING_ENERGY[iterations] == pytest.approx(share, abs=6e-4)


def test_the_page_needs_nothing_else_and_tells_everything(shapes):
    folder, said = shapes
    page = (folder / "study.html").read_text()
    sources = re.findall(r'(?:src|href)="([^"]{0,40})', page)
    assert len(sources) == 2
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    for words in ("SIMULATED", "Figure 3.3", "Published beside ours", "Settings", "picture only"):
        assert words in page
    assert cv2.imread(str(folder / "study.png")).std() > 20
    assert said["settings"]["iterations"] == 30


def test_a_record_is_evaluated_again_to_the_same_figures(shapes, labapp, tmp_path):
    folder, said = shapes
    record = folder / "run.h5"
    code, printed, _ = labapp(
        "study", "psf-shapes", "--record", record, "--out", tmp_path / "again", "--json"
    )
    assert code == 0
    again = json.loads(printed)
    assert again["rows"] == said["rows"]
    assert again["settings"] == said["settings"]
    code, _, complaint = labapp("study", "psf-video", "--record", record, "--out", tmp_path / "b")
    assert code == 1
    assert "no record of the study 'psf-video'" in complaint
    assert "labapp study psf-shapes" in complaint


def test_the_spiral_of_a_video_shrinks_as_asked(tmp_path):
    keys = ("moments=3", "iterations=20", "exposures_ms=[1, 16, 256]")
    said = done(tmp_path / "out", StudyRequest("psf-video", keys, bench=coarse(tmp_path)))
    seen, asked = said["data"]["radius_measured_um"], said["data"]["radius_asked_um"]
    assert seen == pytest.approx(asked, rel=0.08)
    assert seen[0] > seen[1] > seen[2]
    # Light of different moments adds up: what is left is the camera's noise.
    (left,) = values(said, "the video in one exposure")
    assert left < 0.06
    page = (tmp_path / "out" / "study.html").read_text()
    assert page.count("data:image/gif;base64,") == 1


def test_a_disc_has_the_spread_of_a_disc():
    """Root mean square radius of an even disc: its radius over the root of two."""
    y, x = np.indices((301, 301)) - 150
    assert rms_radius((np.hypot(y, x) < 100).astype(float)) == pytest.approx(100 / 2**0.5, rel=1e-3)


def test_the_error_of_a_video_falls_as_averages_do(tmp_path):
    keys = ("counts=[1,2,4]", "reference=8", "joint=2", "iterations=10")
    said = done(tmp_path / "out", StudyRequest("psf-stability", keys, bench=coarse(tmp_path)))
    errors = {one["frames"]: one["error"] for one in said["data"]["averaged"]}
    assert errors[1] > errors[2] > errors[4] > 0
    for frames in (2, 4):
        expected = (1 / frames - 1 / 8) / (1 - 1 / 8)
        assert errors[frames] / errors[1] == pytest.approx(expected, rel=0.35)
    (alone,) = values(said, "speckle contrast of one frame")
    (long,) = values(said, "speckle contrast of 8")
    assert long < alone / 2


def test_the_law_of_averages_is_that_of_random_numbers():
    rng = np.random.default_rng(1)
    numbers = rng.standard_normal((40, 20_000))
    whole = numbers.mean(0)
    for frames in (1, 5, 20):
        error = ((numbers[:frames].mean(0) - whole) ** 2).mean()
        assert error == pytest.approx(independent_frames_error(frames, 40), rel=0.05)


def test_the_lens_on_the_slm_moves_the_focus_as_the_thin_lens_equation_says(tmp_path):
    bench = coarse(tmp_path, 6.9, (88, 128), 8)
    keys = ("near_m=1.6", "stars_m=[1.4,1.6,2.0]", "bricks=false")
    said = done(tmp_path / "out", StudyRequest("refocus", keys, bench=bench))
    (before,) = values(said, "distance in focus, no pattern")
    (after,) = values(said, "distance in focus, Fresnel lens of 8 m")
    assert before == pytest.approx(2.0, rel=0.02)
    assert after == pytest.approx(1.6, rel=0.02)
    (blur,) = values(said, "blur of a star at 1.6 m")
    # z (1/1.6 - 1/2) sqrt((15.36² + 8.64²)/12) mm, of a rectangle.
    assert blur == pytest.approx(
        (1 / 7.5) * 0.125 * 1e-3 * np.hypot(15.36, 8.64) / 12**0.5, rel=0.1
    )
    (halo,) = values(said, "halo")
    assert halo == pytest.approx(0.05, abs=0.015)


def test_the_opening_is_that_of_a_rectangle_or_a_disc():
    wide = Camera(Panel(shape=(108, 192), pitch=80e-6), Lens(0.125, 5.0, 2.0))
    assert mean_square_pupil_radius(wide) == pytest.approx(
        (15.36e-3**2 + 8.64e-3**2) / 12, rel=1e-3
    )
    small = Camera(Panel(shape=(108, 192), pitch=80e-6), Lens(0.125, 25.0, 2.0))
    assert mean_square_pupil_radius(small) == pytest.approx(
        (small.lens.stop_diameter / 2) ** 2 / 2, rel=1e-2
    )


def test_a_sharper_edge_is_steeper():
    edge = np.tile(np.clip(np.arange(-20, 20) / 1.0, 0, 1), (40, 1))
    soft = np.tile(np.clip(np.arange(-20, 20) / 10.0, 0, 1), (40, 1))
    assert edge_steepness(edge) > 3 * edge_steepness(soft)


@pytest.mark.parametrize("name", list(STUDIES))
@pytest.mark.parametrize("quick", [False, True])
def test_every_study_has_a_plan_and_words(name, quick):
    found, settings = find_study(name), read_study_settings(name, [], quick=quick)
    camera = read_bench(bundled_path(found.bench)).build_camera()
    assert isinstance(found.plan(settings, camera), PlanFile)
    assert bundled_path(found.scene).is_file()
    assert "Figure" in found.source
    assert all(len(text) > 80 for text in (found.shows, found.method))


def test_help_and_list_teach(labapp):
    code, printed, _ = labapp("study", "--help")
    assert code == 0
    said = " ".join(printed.split())
    for name in STUDIES:
        assert name in said
    code, printed, _ = labapp("study", "list")
    assert code == 0
    assert "near_m" in printed
    assert "µm, " in printed
    code, printed, _ = labapp("study", "list", "--json")
    assert {one["name"] for one in json.loads(printed)} == set(STUDIES)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["telescope"], "study 'telescope' is not known. Choose one of psf-shapes"),
        (["refocus"], "there is no --out"),
        (["refocus", "near_m=-1", "--out", "OUT"], "key 'near_m' is -1"),
        (["refocus", "far_m=3", "--out", "OUT"], "key 'far_m' is unknown"),
        (["refocus", "near_m", "--out", "OUT"], "'near_m' is no KEY=VALUE"),
        (["refocus", "near_m=2.0", "--out", "OUT"], "focused already"),
        (["refocus", "stars_m=[1.45,1.6,2]", "--out", "OUT"], "star-145cm"),
        (["psf-stability", "counts=[5, 50]", "--out", "OUT"], "must be smaller"),
        (["psf-shapes", 'shapes=["cube"]', "--out", "OUT"], "shapes"),
        (["psf-shapes", "--out", "FILE"], "is a file. Name a folder."),
        (["psf-shapes", "--out", "FULL"], "exists already"),
        (["psf-shapes", "--out", "FILE/under"], "cannot be made"),
        (["psf-shapes", "--record", "FILE", "--out", "OUT"], "is not an HDF5 file"),
        (["psf-shapes", "--record", "FILE", "--quick", "--out", "OUT"], "Leave the others out"),
    ],
)
def test_what_cannot_be_is_said_in_words(labapp, tmp_path, words, complaint):
    (tmp_path / "file").write_text("something")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "study.png").write_text("something")
    places = {"OUT": "out", "FILE": "file", "FULL": "full", "FILE/under": "file/under"}
    words = [str(tmp_path / places[word]) if word in places else word for word in words]
    code, _, said = labapp("study", *words)
    assert code == 1
    assert complaint in said
    assert "Traceback" not in said
    assert not (tmp_path / "out" / "run.h5").exists()


def test_ctrl_c_leaves_a_record_that_can_be_finished(labapp, tmp_path):
    out, bench = tmp_path / "out", coarse(tmp_path)
    many = ", ".join(["1"] * 6000)
    words = ["study", "psf-shapes", 'shapes=["heart"]', "iterations=2", f"exposures_ms=[{many}]"]
    command = [sys.executable, "-m", "labapp", *words, "--bench", str(bench), "--out", str(out)]
    with forked.Popen(command, stderr=forked.PIPE, text=True) as process:
        deadline = time.monotonic() + 120
        while not _some_stored(out / "run.h5") and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in said
    with Record(out / "run.h5") as record:
        assert record.state is State.CANCELLED
        assert record.missing_frames()
    code, _, said = labapp("study", "psf-shapes", "--record", out / "run.h5", "--out", out)
    assert code == 1
    assert "labapp resume" in said


def _some_stored(path: Path) -> bool:
    try:
        with Record(path) as record:
            return bool(record.column("stored").any())
    except Exception:
        return False  # not there yet, or looked at between two of the writer's first writes
