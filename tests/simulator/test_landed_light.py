"""Estimates are judged against the light that lands in the frame, wherever a pattern sends it."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from figures.random_pictures import Case, deviation, everything
from optical_situations import before_lens

from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.stop import Polygon, Stop
from optics.light import Band
from optics.patterns import blazed_grating
from optics.slm import phase_to_grey
from simulator.effects.landed_light import landed_light
from simulator.imaging import Imaging
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.probing.far_field import FarField, order_kernel
from simulator.scene import Star
from simulator.situation import Situation

PANEL = Panel((24, 32), 40e-6, 0.9, unmodulated=0.0)
CAMERA = Camera(PANEL, Lens(0.05, 40.0, 1.0), Sensor(shape=(24, 32), pitch=10e-6, full_well=1e6))


def steered(period, direction=0.0, mount=None, band=None):
    """A star in the middle of the frame, whose light a grating sends aside."""
    phase = blazed_grating(PANEL, period, direction)
    grey = np.asarray(phase_to_grey(PANEL, phase, 550e-9).numpy(), dtype=np.uint8)
    return Situation(
        CAMERA, mount or Mount(), Star(4e-4, 1.0, 1e4), band or Band(550e-9, 8e-9, "lyot"),
        PanelContent.of(grey[None], math.inf), 0.0, 0.01,
    )  # fmt: skip


BRIGHT = Star(4e-4, 1.0, 1e9)

MOUNTS = (Mount(), Mount(math.pi / 2), Mount(0.3, flip_x=True))


@pytest.mark.parametrize(("mount", "direction"), list(zip(MOUNTS, (0.0, 0.4, 1.0), strict=True)))
def test_light_in_cells_is_that_of_the_picture(mount, direction):
    """Where the light goes, with mirrored and turned panels; cells are pixels here."""
    s = steered(9.0, direction, mount)
    everything_on = everything(Case(0, s)).electrons.double().numpy()
    Imaging(1e-2, decide_by="estimate").plan(s)
    found = landed_light(s).cells * s.exposure
    assert found.sum() == pytest.approx(everything_on.sum(), rel=0.05)
    for axis in (0, 1):
        place = np.arange(found.shape[axis])
        middles = [light.sum(1 - axis) @ place / light.sum() for light in (found, everything_on)]
        assert middles[0] == pytest.approx(middles[1], abs=0.3)


def test_a_plan_looks_at_the_pattern_behind_the_stop_where_it_lies_on_the_panel():
    """That of a turned and shifted panel, by the map of points that the mount is told by."""
    half = Polygon(((-1.0, 0.0), (0.0, -1.0), (0.0, 1.0)))
    mount = Mount(0.5, flip_x=True, shift=(1e-4, -3e-4))
    camera = replace(CAMERA, lens=replace(CAMERA.lens, stop=Stop(half)))
    s = replace(steered(9.0, mount=mount), camera=camera)
    Imaging(1e-2, decide_by="estimate").plan(s)
    panel_y, panel_x = np.meshgrid(
        *(PANEL.plane.coordinates(k).numpy() for k in (0, 1)), indexing="ij"
    )
    y, x = (2 * one / camera.lens.stop_diameter for one in before_lens(mount, panel_y, panel_x))
    open_pixels = (y <= 0) & (abs(x) <= 1 + y)
    found = s.pattern_probe.aperture_share.numpy() > 0.5
    assert (found == open_pixels).mean() > 0.98


def test_estimates_keep_tol_of_what_little_light_lands():
    """The grating sends the star's image beside the frame, which keeps far side lobes, and what
    the filter's side lobes pass."""
    s = replace(steered(2.2), target=BRIGHT)
    assert found_worst(s, 1e-2) <= 1e-2


def test_estimates_see_light_that_cancels_only_at_the_centre_of_the_band():
    """A checkerboard leaves hardly any of the image there, and more at the filter's side lobes."""
    grey = np.uint8(45 * (np.indices(PANEL.shape).sum(0) % 2))
    s = replace(steered(9.0), target=BRIGHT, panel_content=PanelContent.of(grey[None], math.inf))
    assert found_worst(s, 1e-2) <= 1e-2


def found_worst(s, tol):
    return deviation(Case(0, s), tol, everything(Case(0, s)), "estimate")[0].worst


def test_light_between_two_orders_belongs_half_to_each_where_they_fade():
    """Fine lines send all light half an order to both sides, none of it nearer to the middle."""
    lines = torch.from_numpy(1.0 - 2.0 * (np.indices((16, 16))[1] % 2)).to(torch.complex64)
    far, period, cell = FarField(lines, 0.9), 64.0, 1.0
    kernel = order_kernel(far, period, cell, 0, fade=8.0)
    middle, side = kernel.shape[1] // 2, kernel.sum(0)
    np.testing.assert_allclose(side, side[::-1], atol=1e-6)
    assert side[middle - 20 : middle + 21].sum() < 0.05
    assert side[middle + 30 : middle + 35].sum() > 0.08
