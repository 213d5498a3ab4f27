"""Open a picture of any format by what its bytes are, whatever its name ends in."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.picture.headers import find_header
from labapp.files.picture.netpbm import is_netpbm
from labapp.files.picture.other_formats import name_format
from labapp.files.picture.stored import StoredPicture
from labapp.files.raw.recognition import is_raw
from labapp.files.tiff_directories import is_tiff

FORMATS = (
    "JPEG, PNG, TIFF, DNG and other RAW, OpenEXR, Radiance HDR, FITS, JPEG 2000, JPEG XL, AVIF, "
    "WebP, GIF, BMP, PGM, PPM, PFM, QOI, JPEG XR, JPEG-LS and .npy"
)
"""Formats of pictures that are read, in words."""

_FITS, _OPEN_EXR = b"SIMPLE  =", b"\x76\x2f\x31\x01"
_RADIANCE = (b"#?RADIANCE", b"#?RGBE", b"#?AUTOPANO")


def read_stored(path: Path, data: bytes, page: int = 0) -> StoredPicture:
    """Read bytes of any format as numbers, with all that they say of themselves.

    page: counts the file's pictures from 0.
    Raises UserError, which says what the file is, if it can't be read rightly.
    """
    if is_raw(data, path):
        raise _mosaic_refused(path, data)
    if is_tiff(data):
        from labapp.files.picture.tiff_file import read_tiff

        return read_tiff(path, data, page)
    header = find_header(data)
    if header is not None:
        from labapp.files.picture.coded_file import read_coded

        return read_coded(path, data, header)
    read = _other_reader(data)
    if read is None:
        raise UserError(
            f"{path}: is not a picture that can be read: it is {name_format(data, path.suffix)}. "
            f"Give a {FORMATS}."
        )
    return read(path, data, page)


def _mosaic_refused(path: Path, data: bytes) -> UserError:
    """Return the error that says what a RAW file is, where a developed picture is meant."""
    from labapp.files.raw import read_raw

    # What is wrong with the file comes first.
    kind = read_raw(path, data).kind
    return UserError(
        f"{path}: is a RAW file ({kind}). labapp reconstruct and labapp merge take it; here, give "
        "a picture that was developed from it, such as a 16-bit TIFF."
    )


def count_pages(path: Path, data: bytes) -> int:
    """Return how many pictures there are that can be named one by one."""
    if is_tiff(data):
        from labapp.files.picture.tiff_file import count_tiff_pages

        return count_tiff_pages(data)
    if data.startswith(_OPEN_EXR):
        from labapp.files.picture.open_exr import count_exr_pages

        return count_exr_pages(path, data)
    if data.startswith(_FITS):
        from labapp.files.picture.fits import count_fits_pages

        return count_fits_pages(path, data)
    if is_netpbm(data):
        from labapp.files.picture.netpbm import count_netpbm_pages

        return count_netpbm_pages(path, data)
    return 1


def _other_reader(data: bytes) -> Callable[[Path, bytes, int], StoredPicture] | None:
    """Return the reader of a format that has light or plain numbers; None if it is none of them."""
    if data.startswith(_OPEN_EXR):
        from labapp.files.picture.open_exr import read_open_exr

        return read_open_exr
    if data.startswith(_RADIANCE):
        from labapp.files.picture.radiance import read_radiance

        return read_radiance
    if data.startswith(_FITS):
        from labapp.files.picture.fits import read_fits

        return read_fits
    if is_netpbm(data):
        from labapp.files.picture.netpbm import read_netpbm

        return read_netpbm
    return None
