"""A bench whose panel stands apart from its lens: patterns, views and pictures stay true."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from small_bench.files import SmallFiles, scene_text

from labapp.files.bench_file import read_bench
from labapp.files.phase_table import AxiconPattern, BlazePattern, ZernikePattern
from labapp.refining.sensor_view import nominal_registration
from labapp.runs.record.reader import Record
from optics.camera import Camera

Z1 = 0.05
WAVELENGTH = 550e-9


def moved_apart(files: SmallFiles) -> SmallFiles:
    """A bench with its panel before its lens, so that the star's in focus."""
    text = files.bench.read_text()
    lens = "focus_distance_m = 2.05\nseparation_mm = 50.0"
    files.bench.write_text(text.replace("focus_distance_m = 2.0", lens))
    return files


@pytest.fixture
def apart(small) -> SmallFiles:
    return moved_apart(small)


@pytest.fixture
def camera(apart) -> Camera:
    return read_bench(apart.bench).build_camera()


def landing(camera: Camera, slope: float) -> float:
    """Metres on the sensor by which light moves for a phase slope in rad/m on the panel, by a
    ray that is traced through the space, the lens, and the space behind it."""
    angle = slope * WAVELENGTH / (2 * math.pi)
    at_lens = camera.separation * angle
    return at_lens + camera.lens.image_distance * (angle - at_lens / camera.lens.focal_length)


def test_a_blaze_sends_light_where_it_says(camera):
    blaze = BlazePattern(kind="blaze", wavelength_nm=550.0, shift_um=(30.0, -50.0))
    phase = blaze.phase(camera, torch.Generator())
    for axis, shift in ((0, 30e-6), (1, -50e-6)):
        slope = float(phase.diff(dim=axis).mean()) / camera.panel.pitch
        assert landing(camera, slope) == pytest.approx(shift, rel=1e-9)


def test_an_axicon_makes_a_ring_of_its_radius(camera):
    axicon = AxiconPattern(kind="axicon", wavelength_nm=550.0, radius_um=40.0)
    phase = axicon.phase(camera, torch.Generator())
    row = phase[camera.panel.shape[0] // 2]
    assert landing(camera, float(row.diff()[-1]) / camera.panel.pitch) == pytest.approx(40e-6)


def test_a_zernike_pattern_covers_what_the_stop_lets_pass(camera):
    """Defocus is zero at the disc's radius over the square root of two."""
    camera = replace(camera, lens=replace(camera.lens, f_number=10.0))
    defocus = ZernikePattern(kind="zernike", wavelength_nm=550.0, terms=[(2, 0, 40.0)])
    phase = defocus.phase(camera, torch.Generator())
    rows, columns = camera.panel.shape
    half = phase[rows // 2, columns // 2 :].numpy()
    order = np.argsort(half)
    zero = np.interp(0, half[order], (np.arange(len(half)) * camera.panel.pitch)[order])
    stop = camera.lens.stop_diameter / 2 * 2.0 / 2.05
    assert zero == pytest.approx(stop / math.sqrt(2), rel=1e-3)


def test_a_view_without_a_registration_is_where_gratings_send_light(camera):
    registration = nominal_registration(camera, WAVELENGTH)
    cycles = np.array([[0.0, 0.0], [0.02, -0.03]])
    straight, steered = registration.to_pixels(cycles, WAVELENGTH)
    slope = 2 * math.pi * cycles[1] / camera.panel.pitch
    moved = [landing(camera, s) / camera.sensor.pitch for s in slope]
    assert np.allclose(steered - straight, moved, rtol=1e-9)


PLAN = """
version = 1
title = "Blaze"
seed = 1
[patterns.neutral]
kind = "constant"
[patterns.blaze]
kind = "blaze"
shift_um = [40.0, -60.0]
[[acquire]]
targets = ["star"]
patterns = ["neutral", "blaze"]
wavelengths_nm = [550]
exposures_ms = [8]
"""


NO_MORE = """
tol = 0.05
[effects] # what takes longest is left out, whatever it changes
"panel orders" = false
"PSF reach" = false
"filter bandwidth" = false
"field position" = false
"""


def test_the_virtual_bench_has_the_separation(labapp, apart, tmp_path):
    """A star in focus is as sharp as it was, and moves by what the blaze says."""
    apart.scene.write_text(scene_text(settings=NO_MORE))
    apart.plan.write_text(PLAN)
    run = tmp_path / "run.h5"
    code, _, said = labapp("run", apart.plan, *apart.arguments(), "--out", run, "--json")
    assert code == 0, said
    with Record(run) as record:
        assert record.bench.lens.separation_mm == 50.0
        neutral, blazed = (record.image(k).astype(float) - 64 for k in (0, 1))
    assert brightest(neutral) == (32, 48)
    assert neutral.max() > 0.02 * neutral.sum()
    y, x = brightest(blazed)
    assert (y - 32, x - 48) == pytest.approx((40 / 3.45, -60 / 3.45), abs=0.75)


def brightest(picture: np.ndarray) -> tuple[int, int]:
    y, x = np.unravel_index(picture.argmax(), picture.shape)
    return int(y), int(x)


def test_a_pattern_that_is_designed_for_it_makes_its_ring(labapp, apart, tmp_path):
    """The design believes in one Fourier integral; the PSF is that of the whole chain."""
    pattern, psf = tmp_path / "ring.png", tmp_path / "psf.npy"
    ring = ["ring", "radius_um=60", "width_um=12", "--bench", apart.bench, "--budget", "0.2"]
    code, _, said = labapp("retrieve", *ring, "--out", pattern)
    assert code == 0, said
    asked = ["--camera", apart.bench, "--pattern", pattern, "--distance", "2", "--size", "64"]
    code, _, said = labapp("psf", *asked, "--out", psf)
    assert code == 0, said
    light = np.load(psf)
    y, x = np.mgrid[-32:32, -32:32] * 3.45
    radius = np.hypot(y, x)
    near = np.abs(radius - 60) < 9
    # An even band has its mean 0.2 µm beyond its middle; a design for a panel in the lens would
    # be 2.4 % smaller.
    assert (light * radius)[near].sum() / light[near].sum() == pytest.approx(60.2, abs=0.4)
    assert light[near].sum() > 0.4
