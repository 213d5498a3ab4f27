"""Export frames as one OME-TIFF file, which microscopy programs read (OME schema 2016-06)."""

from __future__ import annotations

import errno
import math
import os
import shutil
import struct
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from labapp.runs.export.export_job import ExportJob, column_heading, format_decimal
from labapp.runs.export.single_files import tiff_tags

NAMESPACE = "http://www.openmicroscopy.org/Schemas/OME/2016-06"

_DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>'
"""The XML declaration, spelled as readers expect it; ASCII text is valid UTF-8."""

_MARK = "frames"

_HERE = f"<!--{_MARK}-->"
"""Mark for where the elements of each frame belong. No text holds it: < is written as an entity."""

_ANNOTATIONS = "labapp/frame"
"""Namespace of the annotations of each plane beyond exposure and time."""


def ome_xml(work: ExportJob) -> Iterator[str]:
    """Yield the OME-XML as ASCII in parts, for the first page of a TIFF file.

    The file's axes are TYX. Every plane has its exposure, its time, and a map annotation with the
    record's columns.
    """
    begin, between, end = _frame(work).split(_HERE)
    yield _DECLARATION + begin
    for number, row in enumerate(work.rows):
        yield _text(_plane(number, row))
    yield between
    for number, row in enumerate(work.rows):
        yield _text(_notes(number, row))
    yield end


def _frame(work: ExportJob) -> str:
    """Return the OME-XML with marks where each frame's elements belong."""
    record, simulated = work.record, ", ".join(work.record.simulated_devices)
    camera = record.devices.get("camera", {"model": "", "serial": ""})
    schema = "http://www.w3.org/2001/XMLSchema-instance"
    root = ElementTree.Element("OME", {"xmlns": NAMESPACE, "xmlns:xsi": schema})
    root.set("xsi:schemaLocation", f"{NAMESPACE} {NAMESPACE}/ome.xsd")
    root.set("Creator", "labapp")
    instrument = _add(root, "Instrument", ID="Instrument:0")
    _add(
        instrument,
        "Detector",
        Model=_xml_safe(camera["model"]),
        SerialNumber=_xml_safe(camera["serial"]),
        ID="Detector:0",
    )
    image = _add(root, "Image", ID="Image:0", Name=_xml_safe(record.text("title")))
    _add(image, "AcquisitionDate").text = record.text("start_time")
    taken = f"SIMULATED: {simulated}" if simulated else "taken with real devices"
    _add(image, "Description").text = _xml_safe(taken)
    _add(image, "InstrumentRef", ID="Instrument:0")
    _add_pixels(image, work)
    _add(root, "StructuredAnnotations").append(ElementTree.Comment(_MARK))
    return _text(root)


def _text(element: ElementTree.Element) -> str:
    return ElementTree.tostring(element, encoding="us-ascii", xml_declaration=False).decode()


def _add_pixels(image: ElementTree.Element, work: ExportJob) -> None:
    rows, columns = work.shape
    pixels = _add(
        image,
        "Pixels",
        ID="Pixels:0",
        DimensionOrder="XYCZT",
        Type="uint16",
        SizeX=columns,
        SizeY=rows,
        SizeC=1,
        SizeZ=1,
        SizeT=len(work.frames),
    )
    if work.bits is not None:
        pixels.set("SignificantBits", str(work.bits))
    for axis, pitch in zip("YX", work.pitch or (), strict=False):
        pixels.set(f"PhysicalSize{axis}", f"{pitch * 1e6:.12g}")
        pixels.set(f"PhysicalSize{axis}Unit", "µm")
    channel = _add(pixels, "Channel", ID="Channel:0:0", SamplesPerPixel=1)
    wavelengths = work.rows.distinct("wavelength")
    if len(wavelengths) == 1:
        channel.set("EmissionWavelength", f"{wavelengths[0] * 1e9:.12g}")
        channel.set("EmissionWavelengthUnit", "nm")
    _add(channel, "DetectorSettings", ID="Detector:0")
    _add(pixels, "TiffData", IFD=0, PlaneCount=len(work.frames))
    pixels.append(ElementTree.Comment(_MARK))


def _plane(number: int, row: dict[str, Any]) -> ElementTree.Element:
    values = {
        "TheZ": 0,
        "TheT": number,
        "TheC": 0,
        "DeltaT": row["time"],
        "DeltaTUnit": "s",
        "ExposureTime": row["exposure"],
        "ExposureTimeUnit": "s",
    }
    plane = ElementTree.Element("Plane", {key: str(value) for key, value in values.items()})
    _add(plane, "AnnotationRef", ID=f"Annotation:{number}")
    return plane


def _notes(number: int, row: dict[str, Any]) -> ElementTree.Element:
    annotation = ElementTree.Element(
        "MapAnnotation", {"ID": f"Annotation:{number}", "Namespace": _ANNOTATIONS}
    )
    value = _add(annotation, "Value")
    name = f"{row['target']}, {row['pattern']}, {format_decimal(row['wavelength'] * 1e9)} nm"
    for key, told in {
        "name": name,
        **{column_heading(key): told for key, told in row.items()},
    }.items():
        _add(value, "M", K=key).text = _xml_safe(str(told))
    return annotation


def _add(parent: ElementTree.Element, name: str, **attributes: object) -> ElementTree.Element:
    values = {key: str(value) for key, value in attributes.items()}
    return ElementTree.SubElement(parent, name, values)


def _xml_safe(text: str) -> str:
    """Replace the control characters that XML can't represent."""
    return "".join(
        one if one.isprintable() or one in "\t\n" else "\N{REPLACEMENT CHARACTER}" for one in text
    )


_TIFF_LIMIT = 2**32 - 2**25
"""Largest size in bytes of a TIFF file's pictures and description, with 32 MiB left for its
directories of pages. Larger exports are written as BigTIFF."""

_TIFF_PAGES = 1 << 16
"""Pages whose directories take less than that. Chosen."""

_PAGES_AT_ONCE = 1 << 10
"""Pages whose directories are in memory at once: some hundred kilobytes. Chosen."""

_DESCRIPTION = 270
"""Tag of a page's description: TIFF 6.0, section 8."""

_PLACEHOLDER = "OME-XML follows the pictures"
"""Stands for the description until it is written. Chosen: too long to be kept in the tag itself."""


def write_ome_tiff(work: ExportJob, draft: Path) -> None:
    """Write the frames as one OME-TIFF file.

    The description of a million frames is as large as small frames are, so that it is written part
    by part, and comes last in the file.
    """
    import tifffile

    path = draft / work.first_name
    described = path.with_suffix(".xml")
    with described.open("w", encoding="ascii") as text:
        text.writelines(ome_xml(work))
    count = len(work.frames)
    size = 2 * count * math.prod(work.shape) + described.stat().st_size
    is_big = size > _TIFF_LIMIT or count > _TIFF_PAGES
    images = work.images()
    with tifffile.TiffWriter(path, byteorder="<", bigtiff=is_big, ome=False) as file:
        for first in range(0, count, _PAGES_AT_ONCE):
            pages = min(_PAGES_AT_ONCE, count - first)
            file.write(
                islice(images, pages),
                shape=(pages, *work.shape),
                dtype=np.uint16,
                photometric="minisblack",
                contiguous=False,
                **tiff_tags(work, "" if first else _PLACEHOLDER),
            )
    try:
        with tifffile.TiffFile(path) as written:
            at = written.pages.first.tags[_DESCRIPTION].offset
    except tifffile.TiffFileError as error:
        # It has just been written; tifffile hides why it can't be read.
        reason = f"{os.strerror(errno.EIO)}: it doesn't read back as it was written"
        raise OSError(errno.EIO, reason) from error
    _append_description(path, described, at, is_big)
    described.unlink()


def _append_description(path: Path, described: Path, tag: int, is_big: bool) -> None:
    """Append a text to a TIFF file, and let the tag at a position tell where it is.

    A tag has number, type, count and offset: TIFF 6.0, section 2; counts and offsets have 8 bytes
    in BigTIFF.
    """
    with path.open("r+b") as file, described.open("rb") as text:
        begin = file.seek(0, os.SEEK_END)
        begin += file.write(b"\0" * (begin % 2))
        shutil.copyfileobj(text, file, 1 << 20)
        length = file.tell() - begin + file.write(b"\0")
        file.seek(tag + 4)
        file.write(struct.pack("<QQ" if is_big else "<II", length, begin))
