"""What the figures of the virtual bench are made of, on fewer pixels."""

from dataclasses import replace

import pytest
from figures import edge_mtf, live, sensor_emva
from figures.work_saved import simple_picture

from labapp.common.errors import UserError
from labapp.files.file_lookup import bundled_scenes
from labapp.files.reading import bundled_path
from labapp.prediction.simulating.all_effects import render_all_effects, render_by_plan
from labapp.prediction.simulating.picture_request import (
    PictureRequest,
    prepare_bench_scene,
    small_bench_setup,
)
from optics.progress import Progress
from simulator.world import World


@pytest.fixture(scope="module")
def star():
    with prepare_bench_scene(
        small_bench_setup(None), PictureRequest(target="star"), Progress()
    ) as staged:
        return staged.situation


def test_every_bundled_scene_stands_before_the_small_bench():
    files = [bundled_path("scene.toml"), *bundled_scenes().values()]
    assert len(files) > 5
    for path in files:
        setup = small_bench_setup(path)
        assert setup.scene is not None
        assert setup.scene.targets
        sensor = setup.bench.build_camera().sensor
        # The bundled bench's field of view: 768 x 512 pixels of 3.45 um.
        sides = [n * sensor.pitch for n in sensor.shape]
        assert sides == pytest.approx([512 * 3.45e-6, 768 * 3.45e-6], rel=0.02)


def test_a_scene_that_is_not_there_is_named(tmp_path):
    with pytest.raises(UserError, match="none"):
        small_bench_setup(tmp_path / "none.toml")


@pytest.mark.sweep
def test_everything_on_leaves_nothing_out_and_a_plan_tells_its_work(star):
    whole, planned = render_all_effects(star), render_by_plan(star, 1e-2)
    assert planned.plan is not None
    assert planned.plan.relative_error <= 1e-2
    assert 0 < planned.operations <= 1.001 * whole.operations
    assert 0 < planned.planning_cpu < planned.cpu
    assert whole.picture.mean.shape == star.camera.sensor.shape
    change = (planned.picture.mean - whole.picture.mean).norm() / whole.picture.mean.norm()
    assert change <= 1e-2


def test_the_simple_picture_is_bright_in_focus_and_of_one_wavelength():
    with prepare_bench_scene(
        small_bench_setup(None), PictureRequest(target="photograph"), Progress()
    ) as staged:
        s = simple_picture(staged.situation)
    assert s.target.distance == s.camera.lens.focus_distance
    assert s.band.fwhm <= 1e-10
    filled = s.picture_probe.brightest * s.exposure / s.camera.sensor.full_well
    assert filled == pytest.approx(0.8, rel=0.05)


def test_live_frames_are_counted_by_the_wall_and_the_processor():
    setup = small_bench_setup(None)
    world = World(setup.bench.build_camera(), setup.scene.build())
    found = live.measured(world, 5)
    assert 0 < found.rate < 1e5
    assert 0 < found.cpu < 1
    # A new pattern's first frame needs its picture; the same pattern's next one doesn't.
    assert len(found.firsts) == 7
    assert all(seconds > found.again > 0 for seconds in found.firsts.values())
    assert found.very_first > 1 / found.rate


@pytest.mark.sweep
def test_emva_figures_are_those_of_any_sensor(monkeypatch):
    """Of one with other figures than the goal was set for."""
    other = replace(
        sensor_emva.SENSOR, gain=1.3, full_well=4800.0, read_noise=4.0, prnu=0.02, dsnu=3.0
    )
    monkeypatch.setattr(sensor_emva, "SENSOR", other)
    (figure,) = sensor_emva.emva_figures(None)
    assert figure.met, figure.measured


@pytest.mark.sweep
def test_an_edge_out_of_focus_is_not_taken_for_one_in_focus(monkeypatch):
    """The formula's own distance matters: the deviation isn't small whatever is compared."""
    sensor = replace(edge_mtf.CAMERA.sensor, shape=(96, 104))
    monkeypatch.setattr(edge_mtf, "CAMERA", replace(edge_mtf.CAMERA, sensor=sensor))
    monkeypatch.setattr(edge_mtf, "_FRAMES", 100)
    # A smaller frame cuts the edge's tails: a hundredth is for the figure's own.
    assert edge_mtf.mtf_error(2.0, horizontal=False) <= 0.02
    right = edge_mtf.system_mtf
    monkeypatch.setattr(
        edge_mtf, "system_mtf", lambda camera, w, f, angle, d: right(camera, w, f, angle, 1.7)
    )
    assert edge_mtf.mtf_error(2.0, horizontal=False) >= 0.05
