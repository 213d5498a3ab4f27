"""The picture by a recipe with everything in it, against the same integral as plain loops."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import relative
from judges.picture import Finest, reference
from optical_situations import colour_curve, pattern, situation
from scipy import constants
from sweeps import some

from optics.accuracy import ToleranceError
from optics.caching import ByteCache
from optics.camera import Camera, Lens, Panel, Sensor
from optics.light import Band, Waveform, halogen
from optics.polarisation import PathEffect
from optics.psf import PSFOperator
from optics.sensor import Mosaic
from optics.slm import PanelMap, PhaseResponse
from simulator.formation.kernels import Kernels, PointSource
from simulator.formation.mean_picture import expected_electrons
from simulator.formation.windows import Windows, rendering_windows
from simulator.ledger import Ledger
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.recipe import Recipe
from simulator.scene import Flat, PhotographPrint, Star
from simulator.scene.polygons import Polygons, rectangle
from simulator.scene.sheets import Sheet, Sheets

PANEL = Panel(shape=(8, 10), pitch=60e-6, fill_factor=0.81, unmodulated=0.05)
CAMERA = Camera(PANEL, Lens(0.05, 50.0, 1.0), Sensor(shape=(9, 10), pitch=40e-6))
"""Orders of its panel are 12 pixels apart, and fall on its sensor."""

STAR = Star(40e-6, 1.0, 2e12, (2e-4, 1e-4))
GREY = pattern(np.random.default_rng(5), PANEL)
FULL = Recipe(
    PANEL, 18, 3, diffraction=True, orders=1, wavelengths=7, dispersion=True, pixel_aperture=True,
    vignetting=True, depths=9,
)  # fmt: skip
FINEST = Finest(band=16, leak=24, times=12, finer=3)
VIDEO = PanelContent.of(np.stack([GREY, GREY[::-1], 200 - GREY]).astype(np.uint8), 1 / 300)
EVEN = Band(550e-9, 10e-9, "open")
QUICK = Finest(band=4, times=6, finer=3)
"""Enough for a band that ends at once."""

LAMP = Waveform("sine", 100.0, 0.3, 0.4)


def taken(target=STAR, camera=CAMERA, **options):
    options.setdefault("shown", PanelContent.of(GREY[None], math.inf))
    return situation(target, camera, **options)


def error(s, recipe, finest=FINEST):
    (found,) = errors(s, [recipe], finest)
    return found


def errors(s, recipes, finest=FINEST):
    """Of pictures by several recipes, from one that is summed in loops."""
    truth, found = reference(s, finest=finest).numpy(), []
    for recipe in recipes:
        light = expected_electrons(s, recipe, ByteCache(), Ledger())
        assert light.dtype == torch.float32
        assert light.shape == s.camera.sensor.shape
        found.append(relative(light.double().numpy(), truth))
    return found


def test_a_star():
    assert error(taken(), FULL) <= 1e-5


def test_a_star_out_of_focus_behind_a_turned_panel():
    s = taken(replace(STAR, distance=0.8), mount=Mount(0.3, True, False))
    assert error(s, FULL.with_changes(window=20)) <= 1e-5


def test_a_photograph_in_a_lamps_light_through_a_mosaic():
    colour = Mosaic(
        ("RG", "GB"),
        {"R": colour_curve(600e-9, 50e-9), "G": colour_curve(550e-9, 40e-9),
         "B": colour_curve(450e-9, 50e-9)},
    )  # fmt: skip
    camera = replace(CAMERA, sensor=replace(CAMERA.sensor, colour=colour))
    image = torch.from_numpy(np.random.default_rng(2).random((12, 14, 3)).astype(np.float32))
    s = taken(PhotographPrint(image, 0.9, 1e9, cover=0.8, light=halogen()), camera, band=EVEN)
    assert error(s, FULL.with_changes(mosaic=True), QUICK) <= 1e-5


def test_windows_are_no_larger_than_light_can_go():
    """And the picture is the same as by loops over everything."""
    image = torch.from_numpy(np.random.default_rng(2).random((12, 14, 3)).astype(np.float32))
    # Its orders are too far apart to meet the sensor.
    panel = replace(PANEL, shape=(12, 16), pitch=12e-6)
    sensor = replace(CAMERA.sensor, shape=(10, 22), pitch=20e-6)
    camera = replace(CAMERA, panel=panel, sensor=sensor)
    grey = pattern(np.random.default_rng(5), panel)
    s = taken(
        PhotographPrint(image, 1.1, 1e9, cover=0.5),
        camera,
        shown=PanelContent.of(grey[None], math.inf),
    )
    recipe = FULL.with_changes(panel=panel, orders=0, window=128)
    windows = rendering_windows(s, recipe.window)
    rows, columns = windows.psf
    assert rows < columns < 128
    assert windows.picture < (10 + 128, 22 + 128)
    # But for what rings beside a picture that is drawn by samples.
    assert error(s, recipe, replace(FINEST, orders=0)) <= 5e-5


@pytest.mark.parametrize("target", some([STAR, "photograph"]))
def test_orders_close_together_are_one_psf(target, monkeypatch):
    """The same light as a PSF for each, and less work."""
    image = torch.from_numpy(np.random.default_rng(2).random((12, 14, 3)).astype(np.float32))
    target = PhotographPrint(image, 1.1, 1e9, cover=0.5) if target == "photograph" else target
    s, recipe = taken(target, band=Band(550e-9, 10e-9, leak=1e-3)), FULL.with_changes(leak=4)
    windows = rendering_windows(s, recipe.window, orders=1, samples=(3, 3))
    assert windows.merged_orders == 1
    together, work = render(s, recipe), Ledger()
    expected_electrons(s, recipe, ByteCache(), work)
    side = windows.psf[0]
    apart = Windows((18, 18), (18, 18), (side + 40, side + 40))
    monkeypatch.setattr("simulator.formation.mean_picture.rendering_windows", lambda *a, **b: apart)
    ledger = Ledger()
    each = expected_electrons(s, recipe, ByteCache(), ledger).numpy()
    assert relative(together, each) <= 1e-4
    assert work.operations < ledger.operations


def render(s, recipe):
    return expected_electrons(s, recipe, ByteCache(), Ledger()).numpy()


@pytest.mark.parametrize(("kind", "most"), [("photograph", 0.01), ("star", 0.1)])
def test_orders_on_cells_are_those_by_psfs(kind, most):
    """But for detail that cells of two pixels don't hold: of a small star there is much."""
    panel = Panel(shape=(90, 120), pitch=20e-6, fill_factor=0.7, unmodulated=0.1)
    camera = Camera(panel, Lens(0.05, 20.0, 1.0), Sensor(shape=(240, 300), pitch=10e-6))
    image = torch.from_numpy(np.random.default_rng(2).random((12, 14, 3)).astype(np.float32))
    targets = {
        "photograph": PhotographPrint(image, 1.0, 1e9, cover=1.2),
        "star": Star(2e-3, 1.0, 1e10, (1e-2, 5e-3)),
    }
    y, x = np.mgrid[-1:1:90j, -1:1:120j]
    grey = (40 + 90 * x + 60 * (x * x + y * y) + 25 * y**3) % 120
    shown = PanelContent.of(grey.astype(np.uint8)[None], math.inf)
    s = taken(targets[kind], camera, shown=shown, numerics=1e-3)
    recipe = Recipe(panel, 512, s.coarsest_sampling, diffraction=True, vignetting=True)
    off, coarse, exact = (
        render(s, recipe.with_changes(**orders)).astype(np.float64)
        for orders in ({}, {"coarse_orders": True}, {"orders": 2})
    )
    ghosts = exact - off
    assert np.linalg.norm(ghosts) > 0.03 * np.linalg.norm(exact)
    assert np.linalg.norm(coarse - exact) <= most * np.linalg.norm(ghosts)
    assert (coarse - off).sum() == pytest.approx(ghosts.sum(), rel=0.01)


def test_orders_far_apart_have_a_psf_each():
    """Where one with all of them takes more work; and behind a panel apart from the lens, whose
    stop lets another part of each pass."""
    fine = replace(PANEL, shape=(40, 50), pitch=4e-6)
    far = taken(Flat(1.0, 1e9), replace(CAMERA, panel=fine))
    assert rendering_windows(far, 32, orders=2, samples=(3, 3)).merged_orders == 0
    assert rendering_windows(taken(), 32, orders=1, samples=(3, 3)).merged_orders == 1
    apart = taken(camera=replace(CAMERA, separation=0.01))
    assert rendering_windows(apart, 32, orders=1, samples=(3, 3)).merged_orders == 0


def test_a_window_is_no_larger_than_the_orders_that_it_holds():
    """12 pixels for each, and those over which it fades; more behind a turned panel."""
    s = taken(Flat(1.0, 1e9))
    period = 550e-9 * CAMERA.lens.image_distance / PANEL.pitch / CAMERA.sensor.pitch
    for orders in (0, 1, 2):
        side = max(rendering_windows(s, 512, orders=orders).psf)
        assert (2 * orders + 1) * period <= side <= (2 * orders + 1) * period * 1.1 + 8
    turned = rendering_windows(taken(Flat(1.0, 1e9), mount=Mount(0.7, False, False)), 512).psf
    assert max(turned) > 1.2 * max(rendering_windows(s, 512).psf)
    assert max(rendering_windows(s, 512, wave=False).psf) > side


def test_endless_light_has_whole_windows():
    s = taken(Flat(1.0, 1e9))
    windows = rendering_windows(s, 64, wave=False)
    assert windows.psf == (64, 64)
    assert windows.picture >= (9 + 64, 10 + 64)


def test_light_beside_the_band_also_beyond_the_panels_table():
    band = Band(550e-9, 20e-9, leak=2e-3, leak_range=(390e-9, 740e-9))
    s = taken(band=band)
    recipe = FULL.with_changes(leak=16, window=22)
    all_of_it, none = errors(s, [recipe, recipe.with_changes(leak=0)])
    assert all_of_it <= 2e-5
    assert none > 1e-2


def test_everything_that_a_panel_does():
    y, x = np.mgrid[-1:1:6j, -1:1:8j]
    panel = replace(
        PANEL,
        coupling=15e-6,
        flicker=0.05,
        jitter=0.2,
        front_reflection=0.02,
        gap_reflection=0.3,
        flatness=PanelMap((x * x - y) * 40e-9),
        illumination=PanelMap(np.exp(-x * x - y * y)),
        response=PhaseResponse.from_curve(550e-9, (np.arange(256) / 255) ** 1.2),
    )
    s = taken(camera=replace(CAMERA, panel=panel))
    assert error(s, FULL.with_changes(panel=panel)) <= 2e-5


def test_unmodulated_light_that_interferes():
    path = PathEffect(torch.tensor(0.5), torch.tensor(0.05), torch.tensor(0.1 + 0.2j))
    s = taken(path=path)
    on, off = errors(s, [FULL.with_changes(interference=True), FULL])
    assert on <= 1e-5
    assert off > 1e-2


def test_a_video_under_a_flickering_lamp():
    lit = replace(STAR, lamp=LAMP)
    s = taken(lit, shown=VIDEO, exposure=0.008, moment=0.001, band=EVEN)
    assert error(s, FULL.with_changes(lamp=True), QUICK) <= 1e-5


def test_a_crystal_on_its_way():
    panel = replace(PANEL, response_time=0.004)
    camera = replace(CAMERA, panel=panel)
    s = taken(camera=camera, shown=VIDEO, exposure=0.008, moment=0.001, band=EVEN)
    assert error(s, FULL.with_changes(panel=panel, crystal=True), QUICK) <= 2e-5


def test_rows_in_turn_under_a_lamp():
    sensor = replace(CAMERA.sensor, shutter="rolling", line_time=5e-4)
    s = taken(replace(STAR, lamp=LAMP), replace(CAMERA, sensor=sensor), band=EVEN)
    assert error(s, FULL.with_changes(lamp=True, rolling=True), QUICK) <= 1e-5


def test_a_moving_star_is_smeared():
    s = taken(replace(STAR, velocity=(0.2, 0.1)), band=EVEN)
    finest = replace(QUICK, times=30)
    smeared, sharp = errors(s, [FULL.with_changes(motion=2), FULL], finest)
    assert smeared <= 1e-5
    assert sharp > 0.1


def test_a_moving_star_under_a_lamp_converges():
    s = taken(replace(STAR, velocity=(0.2, 0.1), lamp=LAMP), exposure=0.013, band=EVEN)
    recipe, finest = FULL.with_changes(lamp=True), replace(QUICK, times=30)
    few, many = errors(s, [recipe.with_changes(motion=n) for n in (4, 16)], finest)
    assert many <= few / 8
    assert many <= 1e-3


def layers():
    square, stripe = rectangle((0, 0), (0.003, 0.0015)), rectangle((0.001, 0.001), (0.001, 0.003))
    things = (
        rectangle((-0.001, 0.0005), (0.003, 0.002)),
        rectangle((0.002, -0.001), (0.004, 0.001)),
    )
    near = Sheet(0.8, ((None, Polygons((square,), (0.9,))),), Polygons((square,), (1.0,)))
    middle = Sheet(1.0, ((None, Polygons((stripe,), (0.5,))),), Polygons((stripe,), (1.0,)))
    far = Sheet(1.5, ((None, Polygons(things, (0.8, 0.6), 0.3)),))
    return Sheets((near, middle, far), 1e9)


def test_layers_that_hide_each_other():
    # A wide panel: depths that are blurred alike would be one.
    panel = replace(PANEL, shape=(12, 16))
    camera = replace(CAMERA, panel=panel, sensor=Sensor(shape=(14, 16), pitch=20e-6))
    grey = pattern(np.random.default_rng(5), panel)
    s = taken(layers(), camera, band=EVEN, shown=PanelContent.of(grey[None], math.inf))
    full = FULL.with_changes(panel=panel, window=36, wavelengths=3)
    recipe = full.with_changes(occlusion=True)
    recipes = [recipe, full, *(recipe.with_changes(depths=n) for n in (1, 2))]
    true, seen_through, one, two = errors(s, recipes, replace(QUICK, band=4))
    assert true <= 2e-5
    assert seen_through > 0.02
    assert one > two > 1e-5


def test_fewer_wavelengths_are_worse():
    s = taken(band=Band(550e-9, 60e-9))
    one, three, nine = errors(s, [FULL.with_changes(wavelengths=n, window=22) for n in (1, 3, 9)])
    assert one > 3 * three > 9 * nine


def test_an_even_field_is_the_camera_equation():
    """All light that leaves the panel arrives, but for orders beyond the second."""
    panel = replace(PANEL, fill_factor=1.0)
    plain = PanelContent.of(np.zeros((1, *PANEL.shape), np.uint8), math.inf)
    wide = replace(CAMERA, panel=panel, lens=replace(CAMERA.lens, f_number=30.0))
    s = taken(Flat(1.0, 1e9), wide, exposure=0.02, shown=plain)
    recipe = FULL.with_changes(panel=panel, vignetting=False, orders=2)
    light = expected_electrons(s, recipe, ByteCache(), Ledger())
    z = 1 / (1 / 0.05 - 1 / 1.0)
    width = 20e-9 * math.sqrt(math.pi / math.log(2)) / 2
    area = 8 * 60e-6 * 10 * 60e-6  # the panel's, which is smaller than the stop
    watts = 1e9 * width * area / z**2 * (40e-6) ** 2 * 0.6 * 0.6
    electrons = watts * 550e-9 / (constants.h * constants.c) * 0.62 * 0.02
    assert float(light.mean()) == pytest.approx(electrons, rel=0.01)
    assert float(light.mean()) < electrons * 1.001


def test_nothing_is_dark():
    s = taken(Flat(1.0, 0.0))
    ledger = Ledger()
    assert not expected_electrons(s, FULL, ByteCache(), ledger).any()
    assert not ledger.effects_called


def test_longer_exposures_take_nothing_but_the_weight():
    cache, ledger = ByteCache(), Ledger()
    short = expected_electrons(taken(exposure=0.01), FULL, cache, ledger)
    work = ledger.operations
    long = expected_electrons(taken(exposure=0.03), FULL, cache, ledger)
    assert torch.allclose(long, 3 * short, rtol=1e-6)
    assert work > 0


def test_the_same_situation_again_takes_no_work():
    cache, s = ByteCache(), taken()
    first = expected_electrons(s, FULL, cache, Ledger())
    ledger = Ledger()
    assert torch.equal(expected_electrons(s, FULL, cache, ledger), first)
    assert ledger.operations == 0


def test_what_is_off_isnt_entered():
    ledger = Ledger()
    bare = Recipe(PANEL, 24, 3)
    expected_electrons(taken(layers()), bare, ByteCache(), ledger)
    assert ledger.effects_called == {"picture"}
    ledger = Ledger()
    expected_electrons(
        taken(layers()), bare.with_changes(diffraction=True, wavelengths=3), ByteCache(), ledger
    )
    assert ledger.effects_called == {"picture", "diffraction", "filter bandwidth"}


def test_a_check_may_stop_it_on_the_way():
    class Enough(Exception):
        pass

    left = iter(range(5))

    def check():
        if next(left, None) is None:
            raise Enough

    with pytest.raises(Enough):
        expected_electrons(taken(), FULL, ByteCache(), Ledger(), check)


@pytest.mark.parametrize(
    "change",
    [{"window": 0}, {"samples_per_pixel": 0}, {"wavelengths": 0}, {"orders": -1}, {"leak": -1}],
)
def test_recipes_that_no_picture_follows_from_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        expected_electrons(taken(), FULL.with_changes(**change), ByteCache(), Ledger())


def test_the_reference_has_no_panel_apart_from_its_lens():
    with pytest.raises(ValueError, match="separation"):
        reference(taken(camera=replace(CAMERA, separation=0.01)), finest=FINEST)


def test_an_order_that_gets_hardly_any_light_may_be_less_exact(monkeypatch):
    """Its PSF, where the engine can't keep the picture's tolerance; the middle one's must be."""
    s, asked = taken(), []

    class Refusing(PSFOperator):
        def __init__(self, *args, tol, **options):
            asked.append(tol)
            super().__init__(*args, tol=tol, **options)

        def __call__(self, *args, **options):
            if asked[-1] < 1e-3:
                raise ToleranceError("tol can't be kept")
            return super().__call__(*args, **options)

    def kernels():
        windows = Windows((20, 20), (20, 20), (60, 60))
        return Kernels(s, FULL, windows, ByteCache(), Ledger(), lambda: None)

    seen, point = s.panel_content.picture_shares(0.0, 1.0), PointSource(550e-9, 1.0)
    exact = kernels().psf(seen, point, "panel orders", (0, 1))
    monkeypatch.setattr("simulator.formation.kernels.PSFOperator", Refusing)
    light = kernels().psf(seen, point, "panel orders", (0, 1))
    assert asked[-1] >= 1e-3 > asked[0]
    assert relative(light.numpy(), exact.numpy()) <= asked[-1]
    with pytest.raises(ToleranceError):
        kernels().psf(seen, point, "diffraction", (0, 0))
