"""Names of formats that labapp doesn't read, so that a refusal says what a file is."""

from __future__ import annotations

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
