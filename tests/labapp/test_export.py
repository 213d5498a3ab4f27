"""Exports: what other programs read is what the record holds, bit for bit."""

from __future__ import annotations

import csv
import json
import resource
import zlib
from xml.etree import ElementTree

import cv2
import h5py
import numpy as np
import pytest
import tifffile

from drivers.interfaces import Frame, Identity
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile
from labapp.files.frame_list import format_frame_list, read_frame_list
from labapp.files.reading import bundled_path, read_file
from labapp.runs.export import KINDS, FrameSelection, export_frames, export_job, ome_tiff
from labapp.runs.export.ome_tiff import NAMESPACE
from labapp.runs.record import layout
from labapp.runs.record.creation import RecordContents, create_record
from labapp.runs.record.reader import Record
from labapp.runs.record.writer import RecordWriter
from labapp.runs.shots import Shot
from optics.progress import Cancelled, Progress

SHOTS = [
    Shot(0, 0, 0, "dark", "neutral", 550e-9, 1e-3, role="dark"),
    Shot(1, 1, 0, "star", "ring/80 µm: a?", 550e-9, 1e-3),
    Shot(2, 2, 0, "star", "ring/80 µm: a?", 632.8e-9, 20e-6),
    Shot(3, 3, 0, "star", "neutral", 632.8e-9, 8e-3),
    Shot(4, 3, 1, "star", "neutral", 632.8e-9, 8e-3),
    Shot(5, 4, 0, "star", "neutral", 632.8e-9, 12.5),
]

SHAPE = (64, 96)


def image(index: int) -> np.ndarray:
    """Digital numbers of all 16 bits, so that nothing is scaled or cut unseen."""
    return np.random.default_rng(index).integers(0, 1 << 16, SHAPE, dtype=np.uint16)


def take(path, indices=range(6)) -> None:
    patterns = {"neutral": np.zeros((4, 6), np.uint8), SHOTS[1].pattern: np.ones((4, 6), np.uint8)}
    contents = RecordContents(
        title="Stars & rings",
        seed=1,
        plan={"title": "Stars & rings"},
        bench=read_file(bundled_path("bench.toml"), BenchFile).model_dump(mode="json"),
        scene=None,
        effect_plan=None,
        identities={"camera": Identity("<camera>", "42", simulated=True)},
        targets=("dark", "star"),
        patterns=patterns,
        shots=SHOTS,
        frame_shape=SHAPE,
        pixel_pitch=3.45e-6,
    )
    with RecordWriter(path, create_record(path, contents)) as writer:
        for index in indices:
            shot, pixels = SHOTS[index], image(index)
            frame = Frame(pixels, shot.exposure, 2.6, 0.0, index, zlib.crc32(pixels))
            writer.store(shot, frame, shot.wavelength, start_time=0.1 + index)


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run.h5"
    take(path)
    return path


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "deep" / "out"


def names(folder) -> list[str]:
    return sorted(item.name for item in folder.iterdir())


def table(folder) -> list[dict[str, str]]:
    with (folder / "frames.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


PICTURES = [
    "00000_dark_neutral_550nm_1ms",
    "00001_star_ring-80-µm--a-_550nm_1ms",
    "00002_star_ring-80-µm--a-_632.8nm_0.02ms",
    "00003_star_neutral_632.8nm_8ms",
    "00004_star_neutral_632.8nm_8ms",
    "00005_star_neutral_632.8nm_12500ms",
]


@pytest.mark.parametrize("kind", ["tiff", "png"])
def test_every_frame_is_a_picture_with_the_raw_numbers(labapp, run, folder, kind):
    code, printed, _ = labapp("export", run, "--to", kind, "--out", folder)
    assert code == 0
    assert "wrote 6 frames" in printed
    assert "12 bits" in printed
    assert names(folder) == [*(f"{name}.{kind}" for name in PICTURES), "frames.csv"]
    for index, name in enumerate(PICTURES):
        path = folder / f"{name}.{kind}"
        read = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
        assert read.dtype == np.uint16
        np.testing.assert_array_equal(read, image(index))
    assert [row["file"] for row in table(folder)] == [f"{name}.{kind}" for name in PICTURES]


def test_a_tiff_says_what_it_shows(run, folder):
    export_frames(run, "tiff", folder)
    with tifffile.TiffFile(folder / f"{PICTURES[2]}.tiff") as file:
        page = file.pages[0]
        np.testing.assert_array_equal(page.asarray(), image(2))
        told = json.loads(page.description)
        resolution = page.tags["XResolution"].value
        assert page.tags["ResolutionUnit"].value.name == "CENTIMETER"
    assert told["pattern"] == "ring/80 µm: a?"
    assert told["exposure"] == 20e-6
    assert told["simulated"] == ["camera"]
    assert resolution[0] / resolution[1] == pytest.approx(1e-2 / 3.45e-6, rel=1e-6)


def test_an_array_comes_with_all_that_is_known_of_it(run, folder):
    export_frames(run, "npy", folder)
    assert names(folder) == ["frames.csv", "frames.json", "frames.npy"]
    array = np.load(folder / "frames.npy")
    np.testing.assert_array_equal(array, np.stack([image(index) for index in range(6)]))
    data = json.loads((folder / "frames.json").read_text())
    assert data["columns"].keys() == (layout.PLANNED | layout.MEASURED).keys()
    assert data["columns"]["target"] == ["dark", *["star"] * 5]
    assert data["columns"]["role"] == ["dark", *["light"] * 5]
    assert data["columns"]["exposure"] == [shot.exposure for shot in SHOTS]
    assert data["plan"] == {"title": "Stars & rings"}
    assert data["pixel_pitch_m"] == [3.45e-6, 3.45e-6]
    assert (data["bits"], data["simulated"]) == (12, ["camera"])
    assert [row["place"] for row in table(folder)] == list("012345")


def test_the_table_has_every_column_as_it_is_in_the_record(run, folder):
    export_frames(run, "png", folder)
    rows = table(folder)
    heads = {name: name for name in layout.PLANNED | layout.MEASURED}
    heads |= {name: f"{name}_s" for name in ("exposure", "exposure_asked", "time", "timestamp")}
    heads |= {"wavelength": "wavelength_m", "wavelength_asked": "wavelength_asked_m"}
    heads |= {"gain": "gain_electron_per_DN"}
    with Record(run) as record:
        for name, head in heads.items():
            if name not in ("target", "pattern", "role", "readout"):
                assert [float(row[head]) for row in rows] == record.column(name).tolist(), name
    assert [row["pattern"] for row in rows] == [shot.pattern for shot in SHOTS]
    assert {row["readout"] for row in rows} == {"whole frame"}
    assert {row["simulated"] for row in rows} == {"camera"}


def ome(path) -> ElementTree.Element:
    with tifffile.TiffFile(path) as file:
        assert file.is_ome
        assert file.series[0].axes == "TYX"
        return ElementTree.fromstring(file.ome_metadata)


def test_microscopy_programs_find_exposure_time_and_wavelength(run, folder):
    export_frames(run, "ome-tiff", folder, FrameSelection(target="star"))
    path = folder / "frames.ome.tiff"
    expected = np.stack([image(index) for index in range(1, 6)])
    np.testing.assert_array_equal(tifffile.imread(path), expected)
    root, ns = ome(path), {"o": NAMESPACE}
    pixels = root.find("o:Image/o:Pixels", ns)
    sizes = {axis: int(pixels.get(f"Size{axis}")) for axis in "XYZCT"}
    assert sizes == {"X": 96, "Y": 64, "Z": 1, "C": 1, "T": 5}
    assert pixels.get("SignificantBits") == "12"
    assert (pixels.get("PhysicalSizeX"), pixels.get("PhysicalSizeXUnit")) == ("3.45", "µm")
    planes = pixels.findall("o:Plane", ns)
    assert [int(plane.get("TheT")) for plane in planes] == [0, 1, 2, 3, 4]
    assert [float(plane.get("ExposureTime")) for plane in planes] == [1e-3, 20e-6, 8e-3, 8e-3, 12.5]
    assert [float(plane.get("DeltaT")) for plane in planes] == [1.1, 2.1, 3.1, 4.1, 5.1]
    assert {plane.get("ExposureTimeUnit") for plane in planes} == {"s"}
    notes = {
        one.get("ID"): {m.get("K"): m.text for m in one.findall("o:Value/o:M", ns)}
        for one in root.findall("o:StructuredAnnotations/o:MapAnnotation", ns)
    }
    own = [notes[plane.find("o:AnnotationRef", ns).get("ID")] for plane in planes]
    wavelengths = [float(one["wavelength_m"]) for one in own]
    assert wavelengths == [550e-9, 632.8e-9, 632.8e-9, 632.8e-9, 632.8e-9]
    assert own[0]["pattern"] == "ring/80 µm: a?"
    assert root.find("o:Instrument/o:Detector", ns).get("Model") == "<camera>"
    assert root.find("o:Image", ns).get("Name") == "Stars & rings"
    assert "SIMULATED: camera" in root.find("o:Image/o:Description", ns).text


def test_one_wavelength_is_the_channels(run, folder):
    export_frames(run, "ome-tiff", folder, FrameSelection(frames="2-4"))
    channel = ome(folder / "frames.ome.tiff").find(f".//{{{NAMESPACE}}}Channel")
    assert float(channel.get("EmissionWavelength")) == 632.8
    assert channel.get("EmissionWavelengthUnit") == "nm"


def test_elements_are_in_the_order_of_the_schema(run, folder):
    """The schema has sequences; readers that validate refuse any other order."""
    export_frames(run, "ome-tiff", folder)
    root = ome(folder / "frames.ome.tiff")

    def children(path: str) -> list[str]:
        found = root.find("/".join(f"{{{NAMESPACE}}}{one}" for one in path.split("/")))
        tags = [one.tag.removeprefix(f"{{{NAMESPACE}}}") for one in found]
        return list(dict.fromkeys(tags))

    assert [one.tag.rpartition("}")[2] for one in root] == [
        "Instrument",
        "Image",
        "StructuredAnnotations",
    ]
    assert children("Image") == ["AcquisitionDate", "Description", "InstrumentRef", "Pixels"]
    assert children("Image/Pixels") == ["Channel", "TiffData", "Plane"]


def test_much_data_is_a_bigtiff(run, folder, monkeypatch):
    monkeypatch.setattr(ome_tiff, "_TIFF_LIMIT", 10_000)
    export_frames(run, "ome-tiff", folder)
    with tifffile.TiffFile(folder / "frames.ome.tiff") as file:
        assert file.is_bigtiff
        np.testing.assert_array_equal(file.asarray()[5], image(5))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], [0, 1, 2, 3, 4, 5]),
        (["--frames", "0-1, 3,3"], [0, 1, 3]),
        (["--target", "dark"], [0]),
        (["--pattern", "ring/80 µm: a?"], [1, 2]),
        (["--frames", "1-5", "--target", "star", "--pattern", "neutral"], [3, 4, 5]),
    ],
)
def test_only_what_was_asked_for_is_exported(labapp, run, folder, options, expected):
    code, _, _ = labapp("export", run, "--to", "npy", "--out", folder, *options)
    assert code == 0
    array = np.load(folder / "frames.npy")
    np.testing.assert_array_equal(array, np.stack([image(index) for index in expected]))
    assert [int(row["frame"]) for row in table(folder)] == expected


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--frames", "0-6"], ["no frame 6", "0-5"]),
        (["--frames", "5-2"], ["5-2", "Write 2-5"]),
        (["--frames", "a"], ["'a'", "0-9,12"]),
        (["--frames", ""], ["''", "0-9,12"]),
        (["--frames", "-3"], ["'-3'"]),
        (["--frames", "1,,2"], ["''"]),
        (["--target", "moon"], ["--target", "'moon'", "dark, star"]),
        (["--pattern", "axicon"], ["--pattern", "'axicon'", "neutral"]),
        (["--frames", "0", "--target", "star"], ["no frame is all", "Ask for less"]),
    ],
)
def test_a_bad_choice_is_explained_and_writes_nothing(labapp, run, folder, options, words):
    code, _, error = labapp("export", run, "--to", "png", "--out", folder, *options)
    assert code == 1
    assert all(word in error for word in words), error
    assert not folder.exists()


def test_an_unknown_kind_is_explained(labapp, run, folder):
    code, _, error = labapp("export", run, "--to", "jpeg", "--out", folder)
    assert code == 1
    assert "'jpeg'" in error
    assert "tiff, png, ome-tiff, npy" in error


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_replaced_without_leave(labapp, run, folder, kind):
    export_frames(run, kind, folder)
    victim = folder / names(folder)[0]
    victim.write_text("mine")
    others = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    code, _, error = labapp("export", run, "--to", kind, "--out", folder)
    assert code == 1
    assert "--force" in error
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == others
    code, _, _ = labapp("export", run, "--to", kind, "--out", folder, "--force")
    assert code == 0
    assert victim.read_bytes() != b"mine"


@pytest.mark.parametrize("kind", KINDS)
def test_whoever_cancels_finds_no_half_export(run, folder, kind):
    progress = Progress(lambda share, text: text == "export frame 3" and progress.cancel())
    with pytest.raises(Cancelled):
        export_frames(run, kind, folder, progress=progress)
    assert not folder.exists()


@pytest.mark.parametrize("kind", KINDS)
def test_a_disk_that_refuses_is_named_and_keeps_nothing(run, folder, kind):
    folder.mkdir(parents=True)
    (folder / "mine.txt").write_text("mine")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    # A frame has 12 kB.
    resource.setrlimit(resource.RLIMIT_FSIZE, (8000, limits[1]))
    try:
        with pytest.raises(UserError, match=r"out: cannot be written.*Nothing was exported"):
            export_frames(run, kind, folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert names(folder) == ["mine.txt"]


def test_a_folder_that_cannot_be_is_explained(labapp, run, tmp_path):
    (tmp_path / "file").write_text("")
    code, _, error = labapp("export", run, "--to", "png", "--out", tmp_path / "file")
    assert code == 1
    assert "is a file" in error
    code, _, error = labapp("export", run, "--to", "png", "--out", tmp_path / "file" / "out")
    assert code == 1
    assert "cannot be written: Not a directory" in error


@pytest.mark.parametrize("kind", KINDS)
def test_frames_that_are_missing_are_named_and_the_others_exported(labapp, tmp_path, folder, kind):
    run = tmp_path / "run.h5"
    take(run, [0, 2, 3])
    with h5py.File(run, "r+") as file:
        file["entry/data/images"][2, 5, 7] ^= 1
    code, printed, error = labapp("export", run, "--to", kind, "--out", folder)
    assert code == 1
    assert "wrote 2 frames" in printed
    for words in ("4 frames are missing", "stored: 1, 4-5", "damaged since: 2", "labapp resume"):
        assert words in error, error
    assert [int(row["frame"]) for row in table(folder)] == [0, 3]


def test_a_record_without_a_frame_exports_nothing(labapp, tmp_path, folder):
    run = tmp_path / "run.h5"
    take(run, [])
    code, printed, error = labapp("export", run, "--to", "tiff", "--out", folder)
    assert (code, printed) == (1, "")
    assert "6 frames are missing" in error
    assert not folder.exists()


def test_long_names_are_cut():
    name = export_job._plain("µ" * 200)
    assert name == "µ" * 30


def test_lists_of_frames_are_written_as_they_are_read():
    assert format_frame_list([]) == ""
    assert format_frame_list([3, 1, 2, 7, 9, 10, 1]) == "1-3, 7, 9-10"
    assert (
        format_frame_list(range(0, 40, 2)) == "0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22 and 8 more"
    )
    assert read_frame_list("1-3, 7,9-10", 11) == [1, 2, 3, 7, 9, 10]


@pytest.mark.parametrize("is_big", [False, True])
def test_pages_that_are_written_in_several_goes_are_one_file(
    labapp, run, folder, monkeypatch, is_big
):
    monkeypatch.setattr(ome_tiff, "_PAGES_AT_ONCE", 2)
    monkeypatch.setattr(ome_tiff, "_TIFF_PAGES", 5 if is_big else 6)
    assert labapp("export", run, "--to", "ome-tiff", "--out", folder)[0] == 0
    assert names(folder) == ["frames.csv", "frames.ome.tiff"]
    with tifffile.TiffFile(folder / "frames.ome.tiff") as file:
        assert file.is_bigtiff == is_big
        (series,) = file.series
        assert (series.axes, series.shape) == ("TYX", (6, *SHAPE))
        np.testing.assert_array_equal(series.asarray(), [image(index) for index in range(6)])
        root = ElementTree.fromstring(file.ome_metadata)
    planes = root.findall(".//{*}Plane")
    assert [plane.get("TheT") for plane in planes] == [f"{n}" for n in range(6)]
    assert len(root.findall(".//{*}MapAnnotation")) == 6
