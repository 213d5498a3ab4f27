"""Design files: one HDF5 file of a pattern, its predicted PSF, and everything it was made from.

/entry  (NXentry)        title, definition "labapp_design", start_time
    settings             the pattern as a plan file writes it, and the seed (JSON)
    bench                the bench file (JSON)
    versions             of the programs that made it (JSON)
    wavelength           metres
    pattern/ (NXcollection)
        grey             (frames, rows, columns) uint8: what the SLM shows
        phase            (frames, rows, columns) float32, radians; absent for grey levels
        orders           number of whole waves of the panel's range that the phase uses
        frame_time       seconds for which a frame of a video is shown
        pixel_pitch      metres
    psf/     (NXdata)    predicted (moment, y, x): share of the light on each sensor pixel
    target/  (NXdata)    image (moment, y, x), sum one; absent where there is none
    quality/ (NXcollection)
        efficiency, steered_share, contrast, nrmse    by moment
        method, iterations, cpu_seconds
        seen_nrmse                     by picture of the bench's camera; of refined designs only
    decoder/ (NXcollection)  what was trained to decode photographs behind the pattern, if it was
        settings             of the decoder, its training and its data (JSON)
        weights/             of its network, float16, by name
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

import labapp
from labapp.common.errors import UserError
from labapp.files.hdf5_output import create_group, create_hdf5, program_versions
from labapp.files.plain_data import parse_json
from labapp.files.plain_hdf5 import open_plain_hdf5
from labapp.files.reading import bundled_path
from labapp.files.writing import draft_of

if TYPE_CHECKING:
    import torch

    from optics.plane import Plane

DEFINITION = "labapp_design"
_GREY = "entry/pattern/grey"


def bundled_trained_design() -> Path:
    """Return the path of the bundled pattern with its trained decoder."""
    return bundled_path("edof.h5")


@dataclass(frozen=True, eq=False)
class Grid:
    """Pictures with the positions of their samples, y and x in metres."""

    images: NDArray[Any]
    y: NDArray[np.float64]
    x: NDArray[np.float64]

    @classmethod
    def from_tensor(cls, images: torch.Tensor, plane: Plane) -> Grid:
        return cls(images.numpy(), *(plane.coordinates(axis).numpy() for axis in (0, 1)))


@dataclass(frozen=True, eq=False)
class DecoderContents:
    """A decoder: its settings as plain data, and its network's weights."""

    settings: Mapping[str, Any]
    weights: Mapping[str, NDArray[np.float16]]


@dataclass(frozen=True, eq=False)
class DesignContents:
    """All that a design holds; the module's docstring gives shapes and units."""

    title: str
    settings: Mapping[str, Any]
    bench: Mapping[str, Any]
    wavelength: float
    grey: NDArray[np.uint8]
    phase: NDArray[np.float32] | None
    orders: int
    frame_time: float
    pixel_pitch: float
    psf: Grid
    target: Grid | None
    quality: Mapping[str, Any]
    decoder: DecoderContents | None = None


def write_design(path: Path, contents: DesignContents) -> None:
    """Write a design atomically; raise UserError if it can't be written."""
    try:
        with draft_of(path) as draft, draft.open("w+b") as out, create_hdf5(out.fileno()) as file:
            _write_contents(file, contents)
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written: {error.strerror or error}. Choose another place."
        ) from error


def read_design_frame(path: Path, frame: int) -> NDArray[np.uint8]:
    """Return the grey levels of one frame, (rows, columns).

    Raises UserError if there is no such frame.
    """
    with _open_design(path) as file:
        grey = file[_GREY]
        if frame >= len(grey):
            raise UserError(f"{path}: has no frame {frame}. Choose 0 to {len(grey) - 1}.")
        return np.asarray(grey[frame])


def read_design(path: Path) -> DesignContents:
    """Read a whole design; raise UserError if the file is of another kind or damaged."""
    with _open_design(path) as file:
        entry = file["entry"]
        pattern, decoder = entry["pattern"], None
        quality = {name: value[()] for name, value in entry.get("quality", {}).items()}
        if "decoder" in entry:
            stored = entry["decoder/weights"].items()
            weights = {name: np.asarray(value[()]) for name, value in stored}
            decoder = DecoderContents(_json(file, path, "entry/decoder/settings"), weights)
        return DesignContents(
            title=_text(file, "entry/title"),
            settings=_json(file, path, "entry/settings"),
            bench=_json(file, path, "entry/bench"),
            wavelength=float(entry["wavelength"][()]),
            grey=pattern["grey"][()],
            phase=pattern["phase"][()] if "phase" in pattern else None,
            orders=int(pattern["orders"][()]),
            frame_time=float(pattern["frame_time"][()]),
            pixel_pitch=float(pattern["pixel_pitch"][()]),
            psf=_read_grid(entry["psf"], "predicted"),
            target=_read_grid(entry["target"], "image") if "target" in entry else None,
            quality={
                name: value.decode() if isinstance(value, bytes) else value.tolist()
                for name, value in quality.items()
            },
            decoder=decoder,
        )


@contextmanager
def _open_design(path: Path) -> Iterator[h5py.File]:
    """Open a design for reading; turn failures within the block into UserErrors."""
    with open_plain_hdf5(path) as file:
        if _GREY not in file or _text(file, "entry/definition") != DEFINITION:
            raise UserError(
                f"{path}: is no design file. Give one that labapp pattern or retrieve wrote."
            )
        yield file


def _read_grid(group: h5py.Group, signal: str) -> Grid:
    return Grid(group[signal][()], group["y"][()], group["x"][()])


def _text(file: h5py.File, name: str) -> str:
    return file[name][()].decode() if name in file else ""


def _json(file: h5py.File, path: Path, name: str) -> dict[str, Any]:
    """Return the plain data in a JSON text; raise UserError if they are no table."""
    data = parse_json(file[name][()].decode(), f"{path}: {name}")
    if not isinstance(data, dict):
        raise UserError(f"{path}: {name} is no table of settings. Make the design again.")
    return data


def _write_contents(file: h5py.File, contents: DesignContents) -> None:
    file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": "labapp"})
    file.attrs["creator_version"] = labapp.__version__
    entry = create_group(file, "entry", "NXentry")
    entry.attrs["default"] = "psf"
    texts = {
        "title": contents.title,
        "definition": DEFINITION,
        "start_time": datetime.now(UTC).isoformat(timespec="seconds"),
        "settings": json.dumps(contents.settings),
        "bench": json.dumps(contents.bench),
        "versions": json.dumps(program_versions()),
    }
    for name, text in texts.items():
        entry[name] = np.bytes_(text.encode())
    _number(entry, "wavelength", contents.wavelength, "m")
    pattern = create_group(entry, "pattern", "NXcollection")
    # Chunks of one frame let frames be read one by one. Phases aren't compressed, because that
    # hardly makes them smaller.
    one = (1, *contents.grey.shape[1:])
    pattern.create_dataset(
        "grey", data=contents.grey, chunks=one, compression="gzip", compression_opts=1
    )
    if contents.phase is not None:
        pattern["phase"] = contents.phase
        pattern["phase"].attrs["units"] = "rad"
    pattern["orders"] = contents.orders
    _number(pattern, "frame_time", contents.frame_time, "s")
    _number(pattern, "pixel_pitch", contents.pixel_pitch, "m")
    _grid(entry, "psf", "predicted", contents.psf)
    if contents.target is not None:
        _grid(entry, "target", "image", contents.target)
    if contents.quality:
        quality = create_group(entry, "quality", "NXcollection")
        for name, value in contents.quality.items():
            quality[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
    if contents.decoder is not None:
        group = create_group(entry, "decoder", "NXcollection")
        group["settings"] = np.bytes_(json.dumps(contents.decoder.settings).encode())
        weights = create_group(group, "weights", "NXcollection")
        for name, value in contents.decoder.weights.items():
            weights[name] = value


def _grid(entry: h5py.Group, name: str, signal: str, grid: Grid) -> None:
    data = create_group(entry, name, "NXdata")
    axes = ["moment", "y", "x"][3 - grid.images.ndim :]
    data.attrs.update({"signal": signal, "axes": axes})
    data[signal] = grid.images
    data[signal].attrs["interpretation"] = "image"
    if grid.images.ndim == 3:
        data["moment"] = np.arange(len(grid.images))
    _number(data, "y", grid.y, "m")
    _number(data, "x", grid.x, "m")


def _number(group: h5py.Group, name: str, value: Any, unit: str) -> None:
    group[name] = value
    group[name].attrs["units"] = unit
