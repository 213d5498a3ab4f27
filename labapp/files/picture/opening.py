"""Open a picture of any format by what its bytes are, or say what it is instead."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.picture.headers import find_header
from labapp.files.picture.netpbm import count_netpbm_pages, is_netpbm, read_netpbm
from labapp.files.picture.stored import StoredPicture
from labapp.files.raw import is_raw, read_raw
from labapp.files.tiff_directories import is_tiff

FORMATS = (
    "JPEG, PNG, TIFF, DNG and other RAW, OpenEXR, Radiance HDR, FITS, JPEG 2000, JPEG XL, AVIF, "
    "WebP, GIF, BMP, PGM, PPM, PFM, QOI, JPEG XR, JPEG-LS and .npy"
)
"""Formats of pictures that are read, in words."""

_FITS, _OPEN_EXR = b"SIMPLE  =", b"\x76\x2f\x31\x01"
_RADIANCE = (b"#?RADIANCE", b"#?RGBE", b"#?AUTOPANO")
"""First bytes of FITS (section 4.4.1.1), of OpenEXR ("File Layout") and of Radiance HDR."""


def read_stored(path: Path, data: bytes, page: int = 0) -> StoredPicture:
    """Read bytes of any format as numbers, with all that they say of themselves.

    page: counts the file's pictures from 0.
    Raises UserError, which says what the file is, if it can't be read rightly.
    """
    if is_raw(data, path):
        # What is wrong with the file comes first.
        kind = read_raw(path, data).kind
        raise UserError(
            f"{path}: is a RAW file ({kind}). labapp reconstruct and labapp merge take it; here, "
            "give a picture that was developed from it, such as a 16-bit TIFF."
        )
    if is_tiff(data):
        from labapp.files.picture.tiff_file import read_tiff

        return read_tiff(path, data, page)
    header = find_header(data)
    if header is not None:
        from labapp.files.picture.coded_file import read_coded

        return read_coded(path, data, header)
    reader = _find_reader(data)
    if reader is None:
        raise UserError(
            f"{path}: is not a picture that can be read: it is {name_format(data, path.suffix)}. "
            f"Give a {FORMATS}."
        )
    return reader[0](path, data, page)


def count_pages(path: Path, data: bytes) -> int:
    """Return how many pictures there are that can be named one by one."""
    if is_tiff(data):
        from labapp.files.picture.tiff_file import count_tiff_pages

        return count_tiff_pages(data)
    reader = _find_reader(data)
    return 1 if reader is None else reader[1](path, data)


def _find_reader(
    data: bytes,
) -> tuple[Callable[[Path, bytes, int], StoredPicture], Callable[[Path, bytes], int]] | None:
    """Return what reads and what counts pictures of light or plain numbers; None for others."""
    if data.startswith(_OPEN_EXR):
        from labapp.files.picture.open_exr import count_exr_pages, read_open_exr

        return read_open_exr, count_exr_pages
    if data.startswith(_RADIANCE):
        from labapp.files.picture.radiance import read_radiance

        return read_radiance, lambda path, data: 1
    if data.startswith(_FITS):
        from labapp.files.picture.fits import count_fits_pages, read_fits

        return read_fits, count_fits_pages
    return (read_netpbm, count_netpbm_pages) if is_netpbm(data) else None


_STARTS = (
    (b"\xff\xd8\xff", "a damaged JPEG"),
    (b"\x89PNG", "a damaged PNG"),
    (b"8BPS", "a Photoshop document (PSD)"),
    (b"%PDF", "a PDF"),
    (b"%!PS", "PostScript"),
    (b"gimp xcf", "a GIMP document (XCF)"),
    (b"DDS ", "a DirectDraw surface (DDS)"),
    (b"\0\0\1\0", "an icon (ICO)"),
    (b"\x0a\x05\x01", "a PCX picture"),
    (b"\x01\xda", "an SGI picture"),
    (b"BPG\xfb", "a BPG picture"),
    (b"FLIF", "a FLIF picture"),
    (b"\0\0\0\x0cJXS ", "a JPEG XS picture"),
    (b"AT&TFORM", "a DjVu document"),
    (b"\x8aMNG", "an MNG animation"),
    (b"\x8bJNG", "a JNG picture"),
    (b"XISF0100", "a picture of PixInsight (XISF)"),
    (b"LUCAM-RECORDER", "a video of planets (SER)"),
    (b"\x93NUMPY", "an array of NumPy; its name must end in .npy"),
    (b"PK\x03\x04", "a ZIP archive, such as .npz"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"\x89HDF", "an HDF5 file"),
    (b"MATLAB 5.0", "a MATLAB file"),
    (b"OggS", "a video"),
    (b"\x1aE\xdf\xa3", "a video"),
    (b"<?xml", "XML text"),
    (b"<html", "an HTML page"),
    (b"<!DOCTYPE", "an HTML page"),
)
"""First bytes of formats that aren't read, and their names."""

_BRANDS = {
    b"heic": "an HEIC picture", b"heix": "an HEIC picture", b"hevc": "an HEIC sequence",
    b"mif1": "an HEIF picture", b"msf1": "an HEIF sequence", b"crx ": "a Canon RAW picture (CR3)",
}  # fmt: skip
"""Brands of files in the ISO base format (ISO 14496-12) that aren't read; others are videos."""


def name_format(data: bytes, suffix: str) -> str:
    """Say in words what isn't read as a picture, by its bytes and its ending."""
    if not data:
        return "empty"
    if b"<svg" in data[:4096]:
        return "a drawing (SVG)"
    for start, name in _STARTS:
        if data.startswith(start):
            return name
    if data[4:8] == b"ftyp":
        return _BRANDS.get(data[8:12], "a video")
    if data[:4] == b"RIFF" and data[8:12] == b"AVI ":
        return "a video"
    if data[128:132] == b"DICM":
        return "a DICOM picture"
    if data[344:348] in (b"n+1\0", b"ni1\0"):
        return "a NIfTI volume"
    if suffix.lower() == ".tga" or data[-18:-2] == b"TRUEVISION-XFILE":
        return "a Targa picture (TGA)"
    if b"\0" not in data[:4096] and data[:4096].isascii():
        return "text, and no picture"
    return "of no kind of picture that labapp knows, or damaged"
