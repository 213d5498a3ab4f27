"""What isn't a regular file, and texts, numbers and pictures that aren't what they look like."""

from __future__ import annotations

import io
import os
import socket
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import tifffile
from scipy.io import savemat

CANARY = "canary"


def pipe(folder: Path) -> Path:
    """Nobody writes on it."""
    path = folder / CANARY
    if not path.exists():
        os.mkfifo(path)
    return path


def device(folder: Path) -> Path:
    """Without end."""
    return Path("/dev/zero")


def directory(folder: Path) -> Path:
    path = folder / "directory"
    path.mkdir(exist_ok=True)
    return path


def listener(folder: Path) -> Path:
    """A socket's name in the file system stays when the socket is closed."""
    path = folder / "socket"
    if not path.exists():
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(str(path))
    return path


def missing(folder: Path) -> Path:
    return folder / "missing"


def endless_name(folder: Path) -> Path:
    """Longer than the 255 bytes of a name."""
    return folder / ("n" * 300)


def empty(folder: Path) -> Path:
    return _write(folder, "empty", b"")


def deep_toml(folder: Path) -> Path:
    return _write(folder, "deep.toml", b"a = " + b"[" * 100_000)


def dotted_toml(folder: Path) -> Path:
    """Python's parser needs a time that grows with the square of the parts of a key."""
    return _write(folder, "dotted.toml", b"a" + b".a" * 400_000 + b" = 1")


def long_toml(folder: Path) -> Path:
    return _write(folder, "long.toml", b"a = [" + b"{b.c.d.e=1}," * 2_000_000 + b"]")


def large_number_toml(folder: Path) -> Path:
    """Python doesn't write numbers of more than 4300 digits, not even in an error."""
    return _write(folder, "number.toml", b"version = 0x" + b"F" * 20_000)


def digits_toml(folder: Path) -> Path:
    return _write(folder, "digits.toml", b"version = " + b"9" * 20_000)


def nul_toml(folder: Path) -> Path:
    return _write(folder, "nul.toml", b'version = 1\ntitle = "a\0b"\n')


def utf16_toml(folder: Path) -> Path:
    return _write(folder, "utf16.toml", "version = 1\n".encode("utf-16"))


def latin1_toml(folder: Path) -> Path:
    return _write(folder, "latin1.toml", 'version = 1\ntitle = "é"\n'.encode("latin-1"))


def deep_json(folder: Path) -> Path:
    return _write(folder, "deep.json", b'{"a":' * 200_000)


def nested_json(folder: Path) -> Path:
    """Not too deep for Python's parser, but for much that follows."""
    return _write(folder, "nested.json", b'{"a":' + b"[" * 400 + b"]" * 400 + b"}")


def many_lists_json(folder: Path) -> Path:
    return _write(folder, "lists.json", b'{"a":[' + b"[]," * 8_000_000 + b"[]]}")


def half_character_json(folder: Path) -> Path:
    return _write(folder, "half.json", b'{"version": 1, "title": "\\ud800"}')


def nul_path_scene(folder: Path) -> Path:
    """A path with a NUL, which TOML can spell."""
    return _write(folder, "nul-path.toml", _scene('file = "a\\u0000b.png"'))


def picture_scene(folder: Path, picture: Path) -> Path:
    """A scene of a picture file."""
    return _write(folder, f"scene-of-{picture.name}.toml", _scene(f'file = "{picture}"'))


def endless_plan(folder: Path) -> Path:
    """A plan of 10¹² frames."""
    text = (
        'version = 1\ntitle = ""\n[patterns.neutral]\nkind = "constant"\n[[acquire]]\n'
        'targets = ["dark"]\npatterns = ["neutral"]\nwavelengths_nm = [550]\n'
        "exposures_ms = [1]\nrepeats = 10000\n"
    )
    between = '[[acquire.interleave]]\nrole = "dark"\nevery = 1\nframes = 10000\n'
    return _write(folder, "endless-plan.toml", (text + between).encode())


def quoted_table(folder: Path) -> Path:
    """A cell whose quotes don't end on its line."""
    return _write(folder, "quoted.csv", b'nm,a\n400,"1\n500,2"\n')


def long_cell_table(folder: Path) -> Path:
    return _write(folder, "cell.csv", b"nm,a\n400," + b"1" * 1_000_000 + b"\n")


def nan_table(folder: Path) -> Path:
    return _write(folder, "nan.csv", b"400,1\n500,nan\n600,1\n")


def many_bands_header(folder: Path) -> Path:
    """10¹⁵ bands, beside a few bytes."""
    _write(folder, "bands.raw", bytes(8))
    head = (
        "ENVI\nsamples = 1\nlines = 1\nbands = 1000000000000000\ndata type = 4\n"
        "interleave = bsq\nwavelength = {500}\nwavelength units = Nanometers\n"
    )
    return _write(folder, "bands.hdr", head.encode())


def blank_header(folder: Path) -> Path:
    """A line of blanks on which a regular expression can search for ever."""
    return _write(folder, "blank.hdr", b"ENVI\n" + b" " * 1_000_000)


def huge_npy(folder: Path) -> Path:
    """The header asks for a terabyte."""
    return _write(folder, "huge.npy", _npy_header((1_000_000, 250_000)) + bytes(64))


def object_npy(folder: Path) -> Path:
    """Python objects, which run programs when they are read."""
    buffer = io.BytesIO()
    np.save(buffer, np.array([{}], dtype=object), allow_pickle=True)
    return _write(folder, "object.npy", buffer.getvalue())


def hole_npy(folder: Path) -> Path:
    """A gigabyte of zeros of which nothing is stored."""
    path = _write(folder, "hole.npy", _npy_header((16_384, 16_384)))
    os.truncate(path, path.stat().st_size + 4 * 16_384**2)
    return path


def nan_npy(folder: Path) -> Path:
    path = folder / "nan.npy"
    np.save(path, np.full((16, 16), np.nan, np.float32))
    return path


def bomb_npz(folder: Path) -> Path:
    """A megabyte that grows to 210 MB."""
    path = folder / "bomb.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("a.npy", "w") as member,
    ):
        member.write(_npy_header((10_240, 5_120)))
        for _ in range(50):
            member.write(bytes(4 * 1024**2))
    return path


def broken_npz(folder: Path) -> Path:
    return _write(folder, "broken.npz", b"PK\x03\x04" + bytes(100))


def bomb_mat(folder: Path) -> Path:
    """A MATLAB file of zeros that grows by a factor of a thousand."""
    path = folder / "bomb.mat"
    savemat(path, {"a": np.zeros((10_000, 10_000), np.uint8)}, do_compression=True)
    return path


def png_header(folder: Path) -> Path:
    """3.6 gigapixels by its header, and no pixel."""
    return _write(folder, "header.png", _png(60_000, 60_000, b""))


def png_bomb(folder: Path) -> Path:
    """A complete picture of 900 megapixels in 112 kB."""
    rows, machine = 30_000, zlib.compressobj(9)
    line = bytes(1 + rows // 8)
    data = b"".join(machine.compress(line) for _ in range(rows)) + machine.flush()
    return _write(folder, "bomb.png", _png(rows, rows, data, depth=1))


def png_cut(folder: Path) -> Path:
    return _write(folder, "cut.png", _png(64, 64, b"\x78")[:60])


def jpeg_header(folder: Path) -> Path:
    """4 gigapixels by its header."""
    frame = struct.pack(">BHHBBBB", 8, 65_500, 65_500, 1, 1, 0x11, 0)
    return _write(folder, "header.jpg", b"\xff\xd8" + _jpeg_part(0xC0, frame) + b"\xff\xd9")


def jpeg_scans(folder: Path) -> Path:
    """A progressive picture of 16 megapixels with ten thousand scans."""
    frame = struct.pack(">BHHBBBB", 8, 4000, 4000, 1, 1, 0x11, 0)
    scan = _jpeg_part(0xDA, bytes((1, 1, 0, 0, 0, 0))) + bytes(4)
    return _write(folder, "scans.jpg", b"\xff\xd8" + _jpeg_part(0xC2, frame) + scan * 10_000)


def bmp_header(folder: Path) -> Path:
    head = b"BM" + struct.pack("<IHHI", 54, 0, 0, 54)
    size = struct.pack("<IiiHHIIiiII", 40, 60_000, -60_000, 1, 24, 0, 0, 0, 0, 0, 0)
    return _write(folder, "header.bmp", head + size)


def webp_header(folder: Path) -> Path:
    part = b"VP8X" + struct.pack("<I", 10) + bytes(4) + b"\xff\xff\x00" * 2
    return _write(folder, "header.webp", b"RIFF" + struct.pack("<I", 22) + b"WEBP" + part)


def tiff_header(folder: Path) -> Path:
    """A small page whose tags say that it has 3.6 gigapixels."""
    data = bytearray(_tiff())
    (first,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, first)
    for at in range(first + 2, first + 2 + 12 * count, 12):
        (tag,) = struct.unpack_from("<H", data, at)
        if tag in (256, 257):
            struct.pack_into("<HII", data, at + 2, 4, 1, 60_000)
    return _write(folder, "header.tiff", bytes(data))


def tiff_circle(folder: Path) -> Path:
    """A page that is followed by itself."""
    data = bytearray(_tiff())
    (first,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, first)
    struct.pack_into("<I", data, first + 2 + 12 * count, first)
    return _write(folder, "circle.tiff", bytes(data))


def gif(folder: Path) -> Path:
    """4 gigapixels by its header."""
    return _write(folder, "picture.gif", b"GIF89a" + struct.pack("<HH", 65_535, 65_535) + bytes(20))


def _write(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def _scene(picture: str) -> bytes:
    return (
        'version = 1\ntitle = ""\n[targets.dark]\nkind = "dark"\n[targets.photograph]\n'
        f'kind = "photograph"\n{picture}\ndistance_m = 2.0\nradiance = 0.05\n'
    ).encode()


def _npy_header(shape: tuple[int, int]) -> bytes:
    text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def _png(width: int, height: int, pixels: bytes, depth: int = 8) -> bytes:
    """A grey picture of one part with its pixels, compressed already."""
    head = struct.pack(">IIBBBBB", width, height, depth, 0, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", pixels), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_png_part(*part) for part in parts)


def _png_part(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _jpeg_part(marker: int, data: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(data) + 2) + data


def _tiff() -> bytes:
    """A page of 8 x 8 pixels."""
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, np.zeros((8, 8), np.uint8), metadata=None, byteorder="<")
    return buffer.getvalue()
