"""`labapp accuracy chain`, and the slow judge behind it, against sums that are written out."""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
from figures.chains import ChainProblem

from labapp.accuracy.chain import build_reference, chain_case_from_options
from labapp.accuracy.references import chain_integral
from labapp.accuracy.references.chain_integral import chain_density, chain_field
from labapp.accuracy.references.panel_integral import ImagingChain
from labapp.accuracy.work_precision import Row
from labapp.common.errors import UserError
from labapp.prediction.lens_options import LensCase
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Circle, Stop, rectangle
from optics.plane import Plane

SMALL = ["--panel", "12x14x8", "--separation-mm", "20", "--f-number", "100", "--size", "12"]


def gauss(count: int, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (low + high) / 2 + (high - low) / 2 * nodes, (high - low) / 2 * weights


def on_panel(panel: Panel, modulation: np.ndarray) -> tuple[np.ndarray, ...]:
    """Nodes (y, x) in all pixels, and the modulation times the node's area."""
    side, found = math.sqrt(panel.fill_factor) * panel.pitch, []
    for (j, i), value in np.ndenumerate(modulation):
        y0, x0 = (
            (n - size // 2) * panel.pitch for n, size in zip((j, i), panel.shape, strict=True)
        )
        y, wy = gauss(10, y0 - side / 2, y0 + side / 2)
        x, wx = gauss(10, x0 - side / 2, x0 + side / 2)
        for a, b in np.ndindex(10, 10):
            found.append((y[a], x[b], value * wy[a] * wx[b]))
    return tuple(np.array(column) for column in zip(*found, strict=True))


def in_stop(lens: Lens) -> tuple[np.ndarray, ...]:
    """Nodes (y, x) and weights of a rectangular or a round stop."""
    radius = lens.focal_length / lens.f_number / 2
    if isinstance(lens.stop.opening, Circle):
        r, wr = gauss(40, 0, radius)
        angle = 2 * np.pi * np.arange(120) / 120
        area = np.repeat(wr * r * 2 * np.pi / 120, angle.size)
        return np.outer(r, np.sin(angle)).ravel(), np.outer(r, np.cos(angle)).ravel(), area
    corners = np.array(lens.stop.opening.corners) * radius
    y, wy = gauss(44, corners[:, 0].min(), corners[:, 0].max())
    x, wx = gauss(44, corners[:, 1].min(), corners[:, 1].max())
    return np.repeat(y, 44), np.tile(x, 44), np.outer(wy, wx).ravel()


def written_out(
    chain: ImagingChain, modulation: np.ndarray, y: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Thesis Eq. 5.1 to 5.6 as four sums, without any algebra; |field|."""
    camera, lens, wavelength, d = chain.camera, chain.camera.lens, chain.wavelength, chain.distance
    z1, k = camera.separation, 2 * np.pi / wavelength
    z2 = 1 / (1 / lens.focal_length - 1 / lens.focus_distance)
    py, px, light = on_panel(camera.panel, modulation)
    if chain.sphere:
        sines = np.array(chain.field) / z2
        oy, ox = -z1 * sines - d * sines / math.sqrt(1 - sines @ sines)
        r = np.sqrt((py - oy) ** 2 + (px - ox) ** 2 + d * d)
        light = light * d / r * np.exp(1j * k * (r - d))
    else:
        oy, ox = (-place * (d + z1) / z2 for place in chain.field)
        light = light * np.exp(1j * k / (2 * d) * ((py - oy) ** 2 + (px - ox) ** 2))
    ly, lx, area = in_stop(lens)
    away = (ly[:, None] - py) ** 2 + (lx[:, None] - px) ** 2
    at_lens = np.exp(1j * k / (2 * z1) * away) @ light / (1j * wavelength * z1) * area
    path = -(ly**2 + lx**2) / (2 * lens.focal_length)
    radius = lens.focal_length / lens.f_number / 2
    for degree, order, strength in lens.aberrations:
        assert (degree, order) == (3, 1)  # coma along x: sqrt(8) (3 r³ - 2 r) cos
        r2 = (ly**2 + lx**2) / radius**2
        path = path + strength * math.sqrt(8) * (3 * r2 - 2) * lx / radius
    at_lens = at_lens * np.exp(1j * k * path)
    y, x = y + chain.field[0], x + chain.field[1]
    away = (y[:, None, None] - ly) ** 2 + (x[:, None] - lx) ** 2
    return np.abs(np.exp(1j * k / (2 * z2) * away) @ at_lens / (wavelength * z2))


RECTANGLE, ROUND = Stop(rectangle(1.1, 0.9)), Stop()
COMA = ((3, 1, 90e-9),)


@pytest.mark.parametrize(
    ("stop", "bent", "distance", "field", "sphere", "error"),
    [
        (RECTANGLE, (), 1.0, (0.0, 0.0), False, 1e-11),
        (RECTANGLE, COMA, 0.3, (2e-4, -3e-4), False, 1e-11),
        (ROUND, COMA, 0.3, (2e-4, -3e-4), False, 1e-11),
        (RECTANGLE, (), 0.12, (1e-4, -3e-4), True, 1e-9),
        (ROUND, (), 1e6, (0.0, 3e-4), False, 1e-6),
    ],
)
def test_the_judge_is_the_thesis_equations(stop, bent, distance, field, sphere, error):
    lens = Lens(0.05, 0.05 / 0.3e-3, 1.5, stop, aberrations=bent)
    camera = Camera(Panel((3, 4), 40e-6, 0.8), lens, separation=0.04)
    modulation = np.exp(1j * np.random.default_rng(0).uniform(0, 6, (3, 4)))
    y, x = np.array([-50e-6, 3e-6, 70e-6]), np.array([-20e-6, 33e-6])
    truth = written_out(ImagingChain(camera, distance, 550e-9, field, sphere), modulation, y, x)
    if distance == 1e6:
        distance = math.inf
    chain = ImagingChain(camera, distance, 550e-9, field, sphere)
    found = np.abs(chain_field(chain, [modulation], y, x)[0])
    assert np.abs(found - truth).max() <= error * truth.max()


def test_denser_nodes_change_nothing():
    """Blades, an obscuration off the axis, aberrations; two modulations at once."""
    stop = Stop(Circle(), (Circle(0.3, (0.2, 0.1)), rectangle(0.05, 2.2)))
    lens = Lens(0.05, 0.05 / 0.4e-3, 2.0, stop, ((4, -2, 2e-7),), "stigmatic")
    camera = Camera(Panel((12, 13), 8e-6, 0.7), lens, separation=0.03)
    modulations = [np.exp(1j * np.random.default_rng(1).uniform(0, 6, (12, 13))), np.ones((12, 13))]
    chain, places = ImagingChain(camera, 0.4, 550e-9, (1e-4, 2e-4)), np.linspace(-6e-5, 6e-5, 3)
    coarse = chain_field(chain, modulations, places, places)
    dense = chain_field(chain, modulations, places, places, margin=2.0)
    assert np.linalg.norm(coarse - dense) <= 1e-11 * np.linalg.norm(dense)
    alone = chain_field(chain, modulations[1:], places, places)[0]
    assert np.linalg.norm(alone - coarse[1]) <= 1e-11 * np.linalg.norm(alone)


def test_lines_that_share_their_cells_give_what_every_node_gives(monkeypatch):
    """A lens without aberrations is summed cell by cell, where there is room for the sums."""
    stop = Stop(Circle(), (Circle(0.3, (0.2, 0.1)),))
    camera = Camera(Panel((20, 23), 8e-6), Lens(0.05, 0.05 / 0.4e-3, 2.0, stop), separation=0.01)
    modulations = [np.exp(1j * np.random.default_rng(1).uniform(0, 6, (20, 23))), np.ones((20, 23))]
    chain, places = ImagingChain(camera, 0.4, 550e-9), np.linspace(-6e-5, 6e-5, 5)
    cells = chain_field(chain, modulations, places, places)
    monkeypatch.setattr(chain_integral, "_MAX_SUMS", 0)
    nodes = chain_field(chain, modulations, places, places)
    assert not np.array_equal(cells, nodes)
    assert np.linalg.norm(cells - nodes) <= 1e-12 * np.linalg.norm(nodes)


def test_a_panel_that_comes_near_becomes_one_plane_with_the_lens():
    """Against the judge of panels at the lens; the difference is proportional to z1."""
    lens = Lens(0.05, 0.05 / 0.3e-3, 2.0, aberrations=((3, 1, 150e-9),))
    panel = Panel((10, 12), 16e-6, 0.8, unmodulated=0.1)
    phase = np.random.default_rng(0).uniform(0, 6, panel.shape)
    pixels, light = Plane((5, 5), (40e-6, 40e-6)), np.ones((5, 5))
    truth = ChainProblem(Camera(panel, lens), 1.2, 550e-9, pixels, True, 1e-3, phase)
    truth = truth.build_reference(light).exact_samples
    errors = []
    for z1 in (2.4e-3, 1.2e-3):
        camera = Camera(panel, lens, separation=z1)
        problem = ChainProblem(camera, 1.2, 550e-9, pixels, True, 1e-3, phase)
        errors.append(
            np.linalg.norm(problem.build_reference(light).exact_samples - truth)
            / np.linalg.norm(truth)
        )
    assert errors[1] < 0.3
    assert errors[1] < 0.65 * errors[0]


def test_shares_of_light_are_those_of_the_lobes_in_a_window():
    """In focus, behind a stop that cuts nothing: sinc², as that of a slit on either axis."""
    lens = Lens(0.05, 0.05 / 2e-3, 2.0)
    camera = Camera(Panel((8, 8), 20e-6, 1.0), lens, separation=0.05)
    lobe, step = 550e-9 * camera.ray_matrix_b / 160e-6, 4 / 20
    places = step * (np.arange(20) - 9.5)
    density = chain_density(
        ImagingChain(camera, 1.95, 550e-9), [np.ones((8, 8))], lobe * places, lobe * places
    )[0]
    truth = (np.sinc(places) ** 2).sum() * step
    assert density.sum() * (lobe * step) ** 2 == pytest.approx(truth**2, rel=0.01)


def test_the_diagram_of_a_chain(labapp, tmp_path, monkeypatch):
    monkeypatch.setattr("labapp.accuracy.chain.TOLERANCES", (1e-1, 1e-3))
    monkeypatch.setattr("labapp.accuracy.work_precision._REPEATS", 1)
    monkeypatch.setattr("labapp.accuracy.work_precision._LEAST_S", 1e-3)
    files = ["--json", "--plot", tmp_path / "front.png"]
    code, printed, _ = labapp("accuracy", "chain", *SMALL, *files)
    assert code == 0
    rows = json.loads(printed)["rows"]
    assert set(rows[0]) == {field.name for field in fields(Row)}
    methods = {"collapsed", "chain", "chain, quadrature", "chain, direct"}
    assert [row["tol"] for row in rows] == 4 * [1e-1, 1e-3]
    assert {row["method"] for row in rows} == methods
    good = [row for row in rows if not row["failure"]]
    assert {row["tol"] for row in good} == {1e-1, 1e-3}
    assert all(row["error_achieved"] <= row["tol"] for row in good)
    assert cv2.imread(str(tmp_path / "front.png")).std() > 5


def test_a_chain_whose_panel_stands_at_the_lens(labapp, monkeypatch):
    """The same question to the methods of a panel; all that fail say why."""
    monkeypatch.setattr("labapp.accuracy.chain.TOLERANCES", (1e-2,))
    monkeypatch.setattr("labapp.accuracy.work_precision._REPEATS", 1)
    monkeypatch.setattr("labapp.accuracy.work_precision._LEAST_S", 1e-3)
    code, printed, _ = labapp("accuracy", "chain", *SMALL, "--separation-mm", "0", "--json")
    assert code == 0
    good = [row for row in json.loads(printed)["rows"] if not row["failure"]]
    assert any("matrix DFT" in row["method"] for row in good)
    assert all(row["error_achieved"] <= 1e-2 for row in good)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--separation-mm", "-1"], "separation"),
        (["--panel", "12x8"], "--panel 12x8"),
        (["--panel", "0x8x8"], "--panel 0x8x8"),
        (["--pattern", "waves"], "--pattern waves"),
        (["--field", "1"], "--field 1"),
        (["--panel", "1080x1920x8", "--f-number", "2"], "takes too long"),
    ],
)
def test_bad_questions_about_a_chain_are_refused_by_name(labapp, words, said):
    code, _, complaint = labapp("accuracy", "chain", *SMALL, *words)
    assert code == 1
    assert said in complaint


def test_a_cameras_file_has_a_panel_of_its_own():
    camera = Camera(Panel((12, 14)), Lens(), separation=0.02)
    case = LensCase(camera.lens, 1.5, 550e-9, Plane((8, 8), (3e-6, 3e-6)), camera)
    asked = {"pattern": "neutral", "field": (0.0, 1e-4), "sphere": True}
    found = chain_case_from_options(case, panel=None, separation_mm=None, **asked)
    assert found.problem.camera == camera
    assert "20 mm before" in found.name
    assert found.name.endswith("field 0, 0.1 mm, sphere")
    moved = chain_case_from_options(case, panel=None, separation_mm=30.0, **asked)
    assert moved.problem.camera == replace(camera, separation=0.03)
    with pytest.raises(UserError, match="has a panel"):
        chain_case_from_options(case, panel="12x14x8", separation_mm=None, **asked)


def test_what_is_seen_of_an_answer_is_weighed_as_the_truth():
    lens = Lens(0.05, 100.0, 2.0)
    case = LensCase(lens, 1.5, 550e-9, Plane((6, 7), (3e-6, 3e-6)))
    asked = {"pattern": "cubic", "field": (0.0, 0.0), "sphere": False}
    problem = chain_case_from_options(case, panel="12x14x8", separation_mm=20.0, **asked).problem
    judge = build_reference(problem)
    y, x = (np.arange(n) - n // 2 for n in (6, 7))
    chain, share = problem.chain, problem.camera.panel.unmodulated
    both = [np.exp(1j * problem.phase), np.ones((12, 14))]
    mixed = chain_density(chain, both, 3e-6 * y, 3e-6 * x) * 9e-12
    whole = (1 - share) * mixed[0] + share * mixed[1]
    assert np.linalg.norm(
        judge.weighted_samples(whole) - judge.exact_samples
    ) <= 1e-12 * np.linalg.norm(whole)
