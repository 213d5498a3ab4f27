"""OME-XML, the description of pictures that microscopy programs read (schema 2016-06)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

NAMESPACE = "http://www.openmicroscopy.org/Schemas/OME/2016-06"

_DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>'
"""Of ASCII, too; readers look for it in these letters."""

_ANNOTATIONS = "labapp/frame"
"""The name space of what is told of each plane beyond exposure and time."""


@dataclass(frozen=True)
class Plane:
    """One picture of a series. Seconds; notes: whatever else is known of it, as text."""

    exposure: float
    time: float
    notes: Mapping[str, str]


@dataclass(frozen=True)
class Series:
    """Pictures of one size after each other, uint16.

    date: ISO 8601. shape: (rows, columns). pitch: of the pixels (y, x) in metres, bits: of
    the digital numbers, wavelength: of all planes in metres; each None if unknown.
    """

    name: str
    description: str
    date: str
    shape: tuple[int, int]
    pitch: tuple[float, float] | None
    bits: int | None
    wavelength: float | None
    model: str
    serial: str
    planes: Sequence[Plane]


def ome_xml(series: Series) -> str:
    """The description as ASCII, for the first page of a TIFF file with axes TYX.

    Every plane has its exposure, its time, and a map annotation with its notes.
    """
    schema = "http://www.w3.org/2001/XMLSchema-instance"
    root = ElementTree.Element("OME", {"xmlns": NAMESPACE, "xmlns:xsi": schema})
    root.set("xsi:schemaLocation", f"{NAMESPACE} {NAMESPACE}/ome.xsd")
    root.set("Creator", "labapp")
    instrument = _add(root, "Instrument", ID="Instrument:0")
    _add(
        instrument,
        "Detector",
        Model=_legal(series.model),
        SerialNumber=_legal(series.serial),
        ID="Detector:0",
    )
    image = _add(root, "Image", ID="Image:0", Name=_legal(series.name))
    _add(image, "AcquisitionDate").text = series.date
    _add(image, "Description").text = _legal(series.description)
    _add(image, "InstrumentRef", ID="Instrument:0")
    _add_pixels(image, series)
    annotations = _add(root, "StructuredAnnotations")
    for number, plane in enumerate(series.planes):
        _add_notes(annotations, number, plane.notes)
    body = ElementTree.tostring(root, encoding="us-ascii", xml_declaration=False)
    return _DECLARATION + body.decode()


def _add_pixels(image: ElementTree.Element, series: Series) -> None:
    rows, columns = series.shape
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
        SizeT=len(series.planes),
    )
    if series.bits is not None:
        pixels.set("SignificantBits", str(series.bits))
    for axis, pitch in zip("YX", series.pitch or (), strict=False):
        pixels.set(f"PhysicalSize{axis}", f"{pitch * 1e6:.12g}")
        pixels.set(f"PhysicalSize{axis}Unit", "µm")
    channel = _add(pixels, "Channel", ID="Channel:0:0", SamplesPerPixel=1)
    if series.wavelength is not None:
        channel.set("EmissionWavelength", f"{series.wavelength * 1e9:.12g}")
        channel.set("EmissionWavelengthUnit", "nm")
    _add(channel, "DetectorSettings", ID="Detector:0")
    _add(pixels, "TiffData", IFD=0, PlaneCount=len(series.planes))
    for number, plane in enumerate(series.planes):
        _add_plane(pixels, number, plane)


def _add_plane(pixels: ElementTree.Element, number: int, plane: Plane) -> None:
    added = _add(
        pixels,
        "Plane",
        TheZ=0,
        TheT=number,
        TheC=0,
        DeltaT=plane.time,
        DeltaTUnit="s",
        ExposureTime=plane.exposure,
        ExposureTimeUnit="s",
    )
    _add(added, "AnnotationRef", ID=f"Annotation:{number}")


def _add_notes(parent: ElementTree.Element, number: int, notes: Mapping[str, str]) -> None:
    annotation = _add(parent, "MapAnnotation", ID=f"Annotation:{number}", Namespace=_ANNOTATIONS)
    value = _add(annotation, "Value")
    for key, text in notes.items():
        _add(value, "M", K=key).text = _legal(text)


def _add(parent: ElementTree.Element, name: str, **attributes: object) -> ElementTree.Element:
    values = {key: str(value) for key, value in attributes.items()}
    return ElementTree.SubElement(parent, name, values)


def _legal(text: str) -> str:
    """Text without the control characters that XML has no way to write."""
    return "".join(
        one if one.isprintable() or one in "\t\n" else "\N{REPLACEMENT CHARACTER}" for one in text
    )
