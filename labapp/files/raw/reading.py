"""RAW files of any camera: DNG by its tags, and makers' own files by LibRaw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.exif import Exif, read_exif
from labapp.files.guarded_reading import read_bytes
from labapp.files.raw.dng import read_dng
from labapp.files.raw.dng_page import require_whole
from labapp.files.raw.libraw import LibRawPicture, decode_by_libraw, require_undamaged
from labapp.files.raw.photograph import CameraColour, RawPhotograph, order_channels
from labapp.files.raw.recognition import CFA, DNG_VERSION, MAKE, PHOTOMETRIC
from labapp.files.tiff_directories import PANASONIC_OFFSET, Directory, read_directories

_MODEL = 272
_NOT_MOSAIC = (
    "Take a RAW file of the camera's full resolution, or save it as a 16-bit TIFF and give that."
)


def read_raw(path: Path, data: bytes | None = None) -> RawPhotograph:
    """Read the numbers of a sensor's mosaic, and what the file says of them.

    Parameters
    ----------
    path : Path
        A file that `is_raw`.
    data : bytes, optional
        Its contents, if they were read already.

    Returns
    -------
    RawPhotograph
        The photograph in the sensor's order.

    Raises
    ------
    UserError
        For a file that is cut, damaged or empty, or that doesn't hold what the sensor gave:
        interpolated colours (linear), floating-point numbers, or numbers compressed with loss. The
        message names which, and what to do.

    References
    ----------
    Adobe, Digital Negative Specification 1.7.1; ISO 12234-2 (TIFF/EP).
    """
    data = read_bytes(path) if data is None else data
    if not data:
        raise UserError(f"{path}: is empty: it has no bytes. Copy it from the camera again.")
    pages = read_directories(data)
    # A TIFF that names no camera may have a mosaic of colour filters, too.
    is_mosaic = any(page.number(PHOTOMETRIC, 0) == CFA for page in pages)
    if pages and (pages[0].has(DNG_VERSION) or (is_mosaic and not pages[0].has(MAKE))):
        found = read_dng(path, data, pages)
    else:
        found = _read_makers_file(path, data, pages)
    if not found.mosaic.any():
        raise UserError(
            f"{path}: is a RAW file whose numbers are all zero: it is empty, or a sample without "
            "its picture. Copy it from the camera again."
        )
    return found


def _read_makers_file(path: Path, data: bytes, pages: list[Directory]) -> RawPhotograph:
    """Read a maker's own file, for which LibRaw's word is taken."""
    for page in pages:
        if page.number(PHOTOMETRIC, 0) == CFA or page.has(PANASONIC_OFFSET):
            require_whole(path, page)
    found = decode_by_libraw(path, data)
    if isinstance(found, str):
        raise UserError(
            f"{path}: is a RAW file that can't be decoded ({found}). It is cut, damaged, or of a "
            "camera that LibRaw doesn't know. Copy it again, or convert it to DNG."
        )
    require_undamaged(path, found)
    if found.mosaic is None:
        raise UserError(
            f"{path}: is a RAW file of several colours a pixel: they were interpolated already, or "
            f"the sensor has layers instead of filters. {_NOT_MOSAIC}"
        )
    mosaic = found.mosaic[found.visible].copy()
    if not mosaic.size or not found.black.max() < found.white:
        raise UserError(
            f"{path}: is a RAW file of {mosaic.shape[0]} x {mosaic.shape[1]} pixels between levels "
            f"{found.black.max():g} and {found.white:g}. It is damaged; copy it again."
        )
    filters = "grey" if found.pattern is None else "/".join(found.pattern)
    time, f_number, iso = (value if value > 0 else None for value in found.exposure)
    told = (read_exif(data, pages[0].offset) if pages else None) or Exif()
    return RawPhotograph(
        path,
        f"RAW of {mosaic.shape[0]} x {mosaic.shape[1]} pixels, {filters}",
        mosaic,
        found.pattern,
        found.black,
        found.white,
        linear_limit=found.linear_limit,
        colour=_camera_colour(found),
        exposure=replace(
            told,
            exposure_time=told.exposure_time or time,
            f_number=told.f_number or f_number,
            iso=told.iso or iso,
        ),
        orientation=found.orientation,
        maker=pages[0].text(MAKE) if pages else "",
        model=pages[0].text(_MODEL) if pages else "",
    )


def _camera_colour(found: LibRawPicture) -> CameraColour:
    """Return what LibRaw knows of a camera's colours, in the order of the photograph's channels."""
    order = [found.letters.index(letter) for letter in order_channels(found.pattern or ())]
    matrix, balance = found.matrix[order], found.balance[order]
    return CameraColour(
        matrix if order and matrix.any(1).all() else None,
        "D65" if order and matrix.any(1).all() else "",
        1 / balance if order and (balance > 0).all() else None,
    )
