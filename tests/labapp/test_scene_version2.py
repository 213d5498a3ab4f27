import gc
import weakref
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import torch

from labapp.common.errors import UserError
from labapp.files.file_lookup import bundled_scenes, find_scene
from labapp.files.number_file import read_numbers
from labapp.files.picture.colour_picture import cached_picture, read_scene_picture
from labapp.files.reading import bundled_path, read_file, validate
from labapp.files.scene_file import SceneFile
from optics.camera import Camera, Sensor
from optics.plane import Plane
from optics.speckle import RoughSurface
from simulator.scene import Cube, Display, PhotographPrint, Relief, Sheets, Star

CAMERA = Camera(sensor=Sensor(shape=(60, 80)))
LIGHTS = {"lamp": {"kind": "halogen", "flicker": {"depth": 0.1}}}
FLAT = {"kind": "flat", "distance_m": 2.0, "radiance": 0.5}


def scene(target, **more):
    data = {"version": 2, "title": "t", "lights": LIGHTS, "targets": {"one": target}, **more}
    return validate(data, SceneFile, "scene.toml")


def built(target, folder=Path("/")):
    return scene(target).with_files_in(folder).build().targets["one"]


def test_the_ready_scenes_are_there_and_can_be_drawn():
    """Each target of each, in all of its parts, on a small sensor."""
    plane = Plane((64, 80), (3.45e-5, 3.45e-5))
    names = {"star", "pinhole", "photograph", "cube", "colorchecker", "charts", "bricks",
             "motorcycle", "display", "moving", "flicker"}  # fmt: skip
    assert set(bundled_scenes()) == names
    for path in bundled_scenes().values():
        file = read_file(path, SceneFile).with_files_in(path.parent)
        assert all(picture.is_file() for picture in file.input_files)
        for target in file.build().targets.values():
            target = target.for_camera(CAMERA)
            for layer in target.layers:
                scale = CAMERA.magnification(layer.distance)
                light = sum(
                    float(part.spectrum.at(550e-9)) * part.picture.light(plane, scale).double()
                    for part in layer.parts
                )
                # A small sensor's coarse plane may see nothing of what lies off its middle.
                assert torch.isfinite(light).all()
                assert light.min() > -1e-3 * light.max() - 1e-12
            assert any(layer.parts for layer in target.layers)


def test_the_first_version_is_still_read():
    file = read_file(bundled_path("scene.toml"), SceneFile)
    assert file.version == 1
    again = SceneFile.model_validate_json(file.model_dump_json())
    assert again == file


def test_a_record_gives_the_scene_back():
    for path in bundled_scenes().values():
        file = read_file(path, SceneFile).with_files_in(path.parent)
        assert SceneFile.model_validate_json(file.model_dump_json()) == file


def test_a_scene_is_found_by_its_name_or_its_path(tmp_path):
    assert find_scene("bricks").name == "bricks.toml"
    mine = tmp_path / "mine.toml"
    mine.write_text("")
    assert find_scene(mine) == mine
    with pytest.raises(UserError, match=r"no such file.*ready scene: bricks, charts"):
        find_scene("brick")


def test_light_motion_and_polarisation_reach_the_target():
    star = built(
        {"kind": "star", "diameter_um": 70, "distance_m": 1.72, "radiance": 2.0, "light": "lamp",
         "motion": {"velocity_mm_s": [1.0, -2.0]}, "polarised_deg": 90.0, "offset_um": [3.0, 4.0],
         "speckle": {"roughness_um": 20, "depolarises": False, "patterns": 3}}
    )  # fmt: skip
    assert isinstance(star, Star)
    assert star.name == "one"
    assert star.velocity == pytest.approx((1e-3, -2e-3))
    assert star.polarisation_angle == pytest.approx(np.pi / 2)
    assert star.lamp.depth == 0.1
    assert star.light.at(720e-9) == pytest.approx(1.0)
    assert star.layers[0].parts[0].spectrum.at(720e-9) == pytest.approx(2e9)
    assert star.offset == pytest.approx((3e-6, 4e-6))
    assert star.speckle == RoughSurface(20 * 1e-6, False, 3)


def test_effects_may_be_forced_to_a_level():
    file = scene(FLAT, effects={"shot noise": "Gaussian", "read noise": False})
    assert file.effects == {"shot noise": "Gaussian", "read noise": False}


def picture(folder, name="p.png", shape=(6, 8, 3)):
    import cv2

    values = np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)
    cv2.imwrite(str(folder / name), values)
    return name


def test_a_photograph_by_cover_or_by_height(tmp_path):
    table = {"kind": "photograph", "file": picture(tmp_path), "distance_m": 2.0, "radiance": 0.1}
    photo = built({**table, "height_mm": 30.0, "offset_mm": [1.0, 2.0]}, tmp_path)
    assert isinstance(photo, PhotographPrint)
    drawn = photo.layers[0].parts[0].picture
    assert drawn.side == pytest.approx(30e-3 / 6)
    assert drawn.offset == pytest.approx((1e-3, 2e-3))
    assert np.allclose(photo.image, read_scene_picture(tmp_path / "p.png"))
    smooth = built({**table, "spectra": "mallett"}, tmp_path)
    assert smooth.basis != photo.basis


def test_prints_of_one_picture_share_it_and_it_goes_with_the_last_of_them(tmp_path):
    table = {"kind": "photograph", "file": picture(tmp_path), "distance_m": 2.0, "radiance": 0.1}
    one, two = built(table, tmp_path), built({**table, "distance_m": 3.0}, tmp_path)
    assert one.image.data_ptr() == two.image.data_ptr()
    kept = weakref.ref(cached_picture(str(tmp_path / "p.png")))
    del one, two
    gc.collect()
    assert kept() is None


@pytest.mark.parametrize("kind", ["npy", "npz", "mat", "h5"])
def test_a_cube_is_read_from_any_of_its_formats(tmp_path, kind):
    values = np.random.default_rng(0).uniform(0, 200, (4, 5, 3))
    path = tmp_path / f"cube.{kind}"
    if kind == "npy":
        np.save(path, values)
    elif kind == "npz":
        np.savez(path, cube=values, other=np.ones(2))
    elif kind == "mat":
        scipy.io.savemat(path, {"cube": values, "other": np.ones(2)})
    else:
        with h5py.File(path, "w") as file:
            file["group/cube"] = values
            file["other"] = np.ones(2)
    table = {"kind": "cube", "file": path.name, "distance_m": 2.0, "radiance": 0.1,
             "wavelengths_nm": [450.0, 650.0], "white": 200.0}  # fmt: skip
    if kind != "npy":
        table["variable"] = "group/cube" if kind == "h5" else "cube"
    cube = built(table, tmp_path)
    assert isinstance(cube, Cube)
    assert cube.wavelengths == pytest.approx((450e-9, 550e-9, 650e-9))
    assert np.allclose(cube.image, values / 200.0)


def test_a_matlab_file_of_version_7_3_has_its_axes_back(tmp_path):
    values = np.arange(24.0).reshape(2, 3, 4)
    with h5py.File(tmp_path / "new.mat", "w", userblock_size=512) as file:
        file["cube"] = values.T
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    with (tmp_path / "new.mat").open("r+b") as raw:
        raw.write(header)
    assert np.array_equal(read_numbers(tmp_path / "new.mat"), values)


def test_a_relief_has_the_distances_of_its_disparities(tmp_path):
    import cv2

    disparity = np.full((6, 8), 320, dtype=np.uint16)
    disparity[0, 0], disparity[:, 4:] = 0, 160
    cv2.imwrite(str(tmp_path / "d.png"), disparity)
    table = {"kind": "relief", "file": picture(tmp_path), "disparity": "d.png", "radiance": 0.1,
             "per_value": 1 / 16, "baseline_mm": 100.0, "focal_px": 500.0, "offset_px": 5.0,
             "levels": 2, "height_mm": 20.0}  # fmt: skip
    relief = built(table, tmp_path)
    assert isinstance(relief, Relief)
    # 0.1 x 500 / (20 + 5) = 2 m, and 0.1 x 500 / (10 + 5).
    assert float(relief.depths[3, 0]) == pytest.approx(2.0)
    assert float(relief.depths[3, 7]) == pytest.approx(50 / 15)
    assert torch.isnan(relief.depths[0, 0])
    assert len(relief.layers) == 2


def test_a_relief_from_a_file_of_metres(tmp_path):
    np.save(tmp_path / "z.npy", np.full((6, 8), 3.0))
    table = {"kind": "relief", "file": picture(tmp_path), "depth": "z.npy", "radiance": 0.1}
    assert built(table, tmp_path).distance == 3.0


def test_layers_and_charts_and_a_display(tmp_path):
    red = {"kind": "brick", "reflectance": "red", "offset_mm": [0, -40]}
    layers = [
        {"distance_m": 1.2, "picture": red},
        {"distance_m": 1.5, "picture": {"kind": "usaf", "groups": [0, 2]}},
        {"distance_m": 2.0, "picture": {"kind": "patch", "reflectance": [0.1, 0.2, 0.3]}},
    ]
    bricks = built({"kind": "layers", "radiance": 0.1, "layers": layers, "light": "lamp"})
    assert isinstance(bricks, Sheets)
    assert [layer.distance for layer in bricks.layers] == [1.2, 1.5, 2.0]
    assert all(layer.cover is not None for layer in bricks.layers)
    alone = built({"kind": "siemens", "diameter_mm": 20.0, "distance_m": 2.0, "radiance": 0.1})
    assert alone.layers[0].cover is None
    display = built(
        {"kind": "display", "file": picture(tmp_path), "distance_m": 2.0, "pixel_um": 55.0,
         "radiance": 0.1}, tmp_path,
    )  # fmt: skip
    assert isinstance(display, Display)
    assert display.polarisation_angle == pytest.approx(np.pi / 2)


BRICK = {"kind": "brick"}


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ({"kind": "hologram"}, "one"),
        ({**FLAT, "light": "sun"}, "in the light of 'sun', which isn't in the table 'lights'"),
        ({**FLAT, "radiance": -1.0}, "radiance"),
        ({**FLAT, "motion": {"velocity_mm_s": [0.0, float("inf")]}}, "velocity_mm_s"),
        ({**FLAT, "colour": "red"}, "colour.* is unknown"),
        ({"kind": "layers", "radiance": 0.1, "layers": []}, "layers"),
        ({"kind": "layers", "radiance": 0.1, "layers": [
            {"distance_m": 2.0, "picture": {"kind": "brick", "reflectance": "pink"}}]},
         "choose among white, grey"),
        ({"kind": "layers", "radiance": 0.1, "layers": [
            {"distance_m": 2.0, "picture": {"kind": "brick", "reflectance": 1.5}}]}, "reflectance"),
        ({"kind": "siemens", "diameter_mm": 0.0, "distance_m": 2.0, "radiance": 0.1}, "diameter"),
        ({"kind": "usaf", "groups": [3, 1], "distance_m": 2.0, "radiance": 0.1}, "coarser first"),
        ({"kind": "slanted-edge", "size_mm": 9.0, "angle_deg": 60.0, "distance_m": 2.0,
          "radiance": 0.1}, "angle_deg"),
        ({"kind": "slanted-edge", "size_mm": 9.0, "dark": 0.9, "bright": 0.1, "distance_m": 2.0,
          "radiance": 0.1}, "the darker first"),
        ({"kind": "relief", "file": "p.png", "radiance": 0.1}, "either depth or disparity"),
        ({"kind": "relief", "file": "p.png", "disparity": "d.png", "radiance": 0.1},
         "needs baseline_mm"),
        ({"kind": "display", "file": "p.png", "distance_m": 2.0, "pixel_um": 0.0,
          "radiance": 0.1}, "pixel_um"),
        ({"kind": "display", "file": "p.png", "distance_m": 2.0, "pixel_um": 9.0,
          "radiance": 0.1, "light": "lamp"}, "light"),
        ({"kind": "cube", "file": "p.npy", "distance_m": 2.0, "radiance": 0.1, "white": 1.0,
          "wavelengths_nm": [500.0]}, "wavelengths_nm"),
    ],
)  # fmt: skip
def test_a_target_that_cannot_be_is_refused_by_its_file(target, words):
    with pytest.raises(UserError, match=words) as caught:
        scene(target)
    assert "scene.toml" in str(caught.value)


def test_new_kinds_need_the_second_version():
    pinhole = {"kind": "pinhole", "distance_m": 2.0, "radiance": 1.0}
    for data in (
        {"version": 1, "title": "t", "targets": {"one": pinhole}},
        {"version": 1, "title": "t", "targets": {"one": FLAT}, "lights": LIGHTS},
    ):
        with pytest.raises(UserError, match="needs version = 2"):
            validate(data, SceneFile, "scene.toml")
    with pytest.raises(UserError, match="version"):
        validate({"version": 3, "title": "t", "targets": {"one": FLAT}}, SceneFile, "scene.toml")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"kind": "cube", "file": "none.npy", "white": 1.0}, "there is no such file"),
        ({"kind": "cube", "file": "flat.npy", "white": 1.0}, "give rows, columns and bands"),
        ({"kind": "cube", "file": "cube.npy", "white": 1.0}, "4 bands and 3 wavelengths"),
        ({"kind": "cube", "file": "two.npz", "white": 1.0}, "holds a, b; name one"),
        ({"kind": "cube", "file": "two.npz", "variable": "c", "white": 1.0}, "has no 'c'"),
        ({"kind": "cube", "file": "text.npy", "white": 1.0}, "cannot be read as a NumPy array"),
        ({"kind": "cube", "file": "words.npz", "white": 1.0}, "holds <U1 values"),
        ({"kind": "cube", "file": "text.xyz", "white": 1.0}, "is not a picture"),
        ({"kind": "cube", "file": "text.mat", "white": 1.0}, "cannot be read as .mat"),
        ({"kind": "cube", "file": "text.h5", "white": 1.0}, "cannot be read as HDF5"),
        ({"kind": "cube", "file": "minus.npy", "white": 1.0}, "reflectances down to -1"),
        ({"kind": "photograph", "file": "none.png"}, "cannot be read"),
        ({"kind": "relief", "file": "p.png", "depth": "flat.npy"}, "depths is"),
    ],
)
def test_a_file_that_does_not_hold_what_it_should_is_told(tmp_path, table, words):
    np.save(tmp_path / "flat.npy", np.ones((3, 4)))
    np.save(tmp_path / "cube.npy", np.ones((3, 4, 4)))
    np.save(tmp_path / "minus.npy", -np.ones((3, 4, 3)))
    np.savez(tmp_path / "two.npz", a=np.ones(2), b=np.ones(2))
    np.savez(tmp_path / "words.npz", a=np.array(["x"]))
    for kind in ("npy", "xyz", "mat", "h5"):
        (tmp_path / f"text.{kind}").write_text("not numbers")
    picture(tmp_path)
    full = {"radiance": 0.1, **table}
    if full["kind"] == "cube":
        full |= {"wavelengths_nm": [400.0, 500.0, 600.0]}
    if full["kind"] != "relief":
        full |= {"distance_m": 2.0}
    with pytest.raises(UserError, match=words):
        built(full, tmp_path)


def test_layers_that_are_not_in_order_are_told():
    layers = [{"distance_m": 2.0, "picture": BRICK}, {"distance_m": 1.0, "picture": BRICK}]
    with pytest.raises(UserError, match="the nearest first"):
        built({"kind": "layers", "radiance": 0.1, "layers": layers})
