"""Kinds of arrays in files, and of files that hold no picture."""

from __future__ import annotations

import gzip
import io
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from judges.picture_files.tiff_page_kinds import DAMAGED
from judges.picture_files.truth import (
    Maker,
    Numbers,
    PictureFile,
    add_kind,
    last,
    quantised,
    save,
    scene,
)


def _npy(turn: Callable[[Numbers], Any], bands: int = 1, *, words: tuple[str, ...] = ()) -> Maker:
    """An array of light, changed, as numpy.save writes it."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        light = scene(rng, bands)
        array = turn(light)
        out = io.BytesIO()
        np.save(out, array, allow_pickle=True)
        path = save(path, ".npy", out.getvalue())
        if words:
            return PictureFile(path, None, valid=False, must_name=words)
        numbers = np.asarray(array)
        numbers = numbers[None] if numbers.ndim == 2 else np.moveaxis(numbers, -1, 0)
        return PictureFile(path, numbers, must_name=("array", "dtype", str(numbers.dtype)))

    return make


def _structured(light: Numbers) -> Numbers:
    out = np.zeros(light.shape[1:], [("light", "f4"), ("noise", "f4")])
    out["light"] = light[0]
    return out


def _npz(count: int) -> Maker:
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = scene(rng, count).astype(np.float32)
        out = io.BytesIO()
        np.savez(out, **{f"a{i}": n for i, n in enumerate(numbers)})
        path = save(path, ".npz", out.getvalue())
        return PictureFile(path, numbers[:1], must_name=(".npz", "npz", "zip"), must_tell=())

    return make


def _matlab(rng: np.random.Generator, path: Path) -> PictureFile:
    numbers = scene(rng, 1)
    out = io.BytesIO()
    scipy.io.savemat(out, {"psf": numbers[0]})
    words = (".mat", "matlab")
    return PictureFile(save(path, ".mat", out.getvalue()), numbers, must_name=words)


def _hdf5(rng: np.random.Generator, path: Path) -> PictureFile:
    path = path.with_name(path.name + ".h5")
    with h5py.File(path, "w") as file:
        file["data"] = scene(rng, 1)[0]
    words = ("hdf5", ".h5", "record")
    return PictureFile(path, None, valid=False, must_name=words)


def _nothing(data: bytes, ending: str, *words: str) -> Maker:
    """Bytes that are no picture, or one of a format that isn't for photographs."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        return PictureFile(save(path, ending, data), None, valid=False, must_name=words)

    return make


def _zip() -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as file:
        file.writestr("mimetype", "image/openraster")
    return out.getvalue()


_NONE = ("no picture", "not a picture", "isn't a picture", "no image", "not an image", "text")
_SVG = b'<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>'
_HEIC = struct.pack(">I4s4sI4s4s", 24, b"ftyp", b"heic", 0, b"mif1", b"heic") + bytes(400)
_CR3 = struct.pack(">I4s4sI4s4s", 24, b"ftyp", b"crx ", 1, b"crx ", b"isom") + bytes(400)
_MP4 = struct.pack(">I4s4sI4s4s", 24, b"ftyp", b"isom", 0, b"isom", b"mp42") + bytes(400)
_NOT_DAMAGED = ("empty", "0 bytes", "no bytes", "nothing")

for _name, _maker in {
    "NPY, float": _npy(lambda a: a[0].astype(np.float32)),
    "NPY, doubles": _npy(lambda a: a[0]),
    "NPY, half": _npy(lambda a: a[0].astype(np.float16)),
    "NPY, RGB": _npy(lambda a: last(a).astype(np.float32), 3),
    "NPY, bytes": _npy(lambda a: quantised(a, 8)[0]),
    "NPY, 16 bits": _npy(lambda a: quantised(a, 16)[0]),
    "NPY, signed": _npy(lambda a: quantised(a, 12)[0].astype(np.int32) - 99),
    "NPY, big endian": _npy(lambda a: a[0].astype(">f4")),
    "NPY, Fortran's order": _npy(lambda a: np.asfortranarray(a[0])),
    "NPY, RGB in Fortran's order": _npy(lambda a: np.asfortranarray(last(quantised(a, 16))), 3),
    "NPY, yes and no": _npy(lambda a: a[0] > 0.5, words=("bool",)),
    "NPY, complex": _npy(lambda a: a[0] * (1 + 1j), words=("complex",)),
    "NPY, structured": _npy(_structured, words=("structured", "fields", "light", "record")),
    "NPY, objects": _npy(lambda a: a[0].astype(object), words=("object", "pickle")),
    "NPY, letters": _npy(lambda a: a[0].astype("U4"), words=("<u4", "str", "text", "letters")),
    "NPY, four dimensions": _npy(lambda a: a[None], words=("dimension", "shape", "1 x 1", "axes")),
    "NPY, no pixels": _npy(lambda a: a[0][:0], words=("empty", "no pixel", "shape", "0 x", "0,")),
    "NPZ of one array": _npz(1),
    "NPZ of three arrays": _npz(3),
    "MATLAB": _matlab,
    "HDF5": _hdf5,
    "HEIC": _nothing(_HEIC, ".heic", "heic", "heif"),
    "HEIC named .jpg": _nothing(_HEIC, ".jpg", "heic", "heif"),
    "Canon CR3": _nothing(_CR3, ".cr3", "raw", "cr3", *DAMAGED),
    "video": _nothing(_MP4, ".mp4", "video", "mp4", "film"),
    "SVG": _nothing(_SVG, ".svg", "svg", "xml"),
    "SVG named .png": _nothing(_SVG, ".png", "svg", "xml"),
    "PDF": _nothing(b"%PDF-1.7\n" + bytes(300), ".pdf", "pdf"),
    "PDF named .tif": _nothing(b"%PDF-1.7\n" + bytes(300), ".tif", "pdf"),
    "PostScript": _nothing(b"%!PS-Adobe-3.0 EPSF-3.0\n" + bytes(99), ".eps", "postscript", "eps"),
    "DICOM": _nothing(bytes(128) + b"DICM" + bytes(200), ".dcm", "dicom"),
    "ZIP": _nothing(_zip(), ".ora", "zip"),
    "gzip named .tif": _nothing(gzip.compress(b"II*\0", mtime=0), ".tif", "gzip", "compressed"),
    "text named .tif": _nothing(b"exposure 5 ms\n" * 9, ".tif", *_NONE, "not a tiff", "no tiff"),
    "HTML named .jpg": _nothing(b"<!DOCTYPE html><html>404</html>", ".jpg", *_NONE, "html"),
    "Git LFS pointer": _nothing(
        b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", ".tif", "lfs", *_NONE
    ),
    "zeros named .png": _nothing(bytes(5000), ".png", *_NONE, "not a png", "no png", "zero"),
    "empty": _nothing(b"", ".png", *_NOT_DAMAGED),
    "empty .tif": _nothing(b"", ".tif", *_NOT_DAMAGED),
    "empty .npy": _nothing(b"", ".npy", *_NOT_DAMAGED),
    "one byte": _nothing(b"\xff", ".jpg", *_NONE, *DAMAGED, "1 byte"),
    "XCF": _nothing(b"gimp xcf v011\0" + bytes(200), ".xcf", "xcf", "gimp"),
    "ENVI's numbers": _nothing(bytes(range(256)) * 9, ".raw", *_NONE, "envi", ".hdr", ".raw"),
}.items():
    add_kind(_name, _maker)
