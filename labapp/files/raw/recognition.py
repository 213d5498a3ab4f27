"""Telling RAW files, which hold what a camera's sensor gave, from other pictures."""

from __future__ import annotations

from pathlib import Path

from labapp.files.tiff_directories import is_tiff_like, read_directories

DNG_VERSION, PHOTOMETRIC, MAKE, COMPRESSION = 50706, 262, 271, 259
"""Tags of TIFF and DNG, by their names in the specifications."""

CFA, LINEAR_RAW = 32803, 34892
"""Values of PhotometricInterpretation: a mosaic of colour filters (TIFF/EP), and RAW numbers that
are no mosaic (DNG)."""

_MAGICS = (
    b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"FOVb", b"\0MRM",
    b"II\x1a\0\0\0HEAPCCDR", b"II*\0\x10\0\0\0CR",
)  # fmt: skip
"""First bytes of makers' files: Fujifilm, Olympus (three), Panasonic and Leica, Sigma, Minolta, and
Canon's CRW and CR2."""

_CANON_3 = b"ftypcrx "
"""Bytes 4 to 12 of Canon's CR3."""

_PHASE_ONE = (b"IIII", b"MMMM")
"""Bytes 8 to 12 of Phase One's IIQ, which begins as TIFF does."""

_MAKERS_COMPRESSIONS = {32767, 32769, 34713, 65000, 65535}
"""Compressions that makers have for themselves: Sony, Epson, Nikon, Kodak and Pentax."""

_ENDINGS = {
    ".3fr", ".arw", ".cr2", ".dcr", ".dng", ".erf", ".fff", ".iiq", ".kdc", ".mef", ".mos", ".nef",
    ".nrw", ".orf", ".pef", ".ptx", ".rw2", ".rwl", ".sr2", ".srf", ".srw",
}  # fmt: skip
"""Endings by which a TIFF, whose first page is mostly a preview, or an empty file is a RAW."""


def is_raw(data: bytes, path: Path) -> bool:
    """Return whether a file is a camera's RAW, by its content.

    Parameters
    ----------
    data : bytes
        The whole file.
    path : Path
        Its path, whose ending counts only for files that begin as TIFF does, and for empty ones.

    Returns
    -------
    bool
        True for DNG, makers' RAW files, and TIFF files with a mosaic of colour filters.
    """
    if data.startswith(_MAGICS) or data[4:12] == _CANON_3:
        return True
    if path.suffix.lower() in _ENDINGS and (is_tiff_like(data) or not data):
        return True
    pages = read_directories(data)
    return bool(pages and data[8:12] in _PHASE_ONE) or any(
        page.has(DNG_VERSION)
        or page.number(PHOTOMETRIC, 0) in (CFA, LINEAR_RAW)
        or page.number(COMPRESSION, 0) in _MAKERS_COMPRESSIONS
        for page in pages
    )
