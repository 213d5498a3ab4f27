"""Registers of the simulated camera, as GenICam describes them, and what its features do.

The registers below 0x3d0 are those of Aravis' fake camera; the others are those of `gige_process`
and of FEATURES.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.pixel_formats import FORMATS


class CameraFeature(NamedTuple):
    """Where the camera keeps a feature.

    kind: its type in GenICam. scale: what the register holds for a value of 1. start: the value
    after power-up.
    """

    address: int
    kind: Literal["switch", "choice", "integer", "float"]
    scale: int = 1
    start: float = 0


FEATURES = {
    "ReverseX": CameraFeature(0x8000, "switch"),
    "ReverseY": CameraFeature(0x8004, "switch"),
    "GammaEnable": CameraFeature(0x8008, "switch"),
    "Gamma": CameraFeature(0x800C, "float", 100, 1.0),
    "LUTEnable": CameraFeature(0x8010, "switch"),
    "TestPattern": CameraFeature(0x8014, "choice"),
    "DecimationHorizontal": CameraFeature(0x8018, "integer", 1, 1),
    "DecimationVertical": CameraFeature(0x801C, "integer", 1, 1),
    "DigitalShift": CameraFeature(0x8020, "integer"),
    "BlackLevel": CameraFeature(0x8024, "float", 100),
    "BlackLevelClampingEnable": CameraFeature(0x8028, "switch"),
    "SharpeningEnable": CameraFeature(0x802C, "switch"),
    "TestPattern[ImageProcessor]": CameraFeature(0x8054, "choice"),
}
"""Features of the camera by their names in GenICam's SFNC, with the entry of the selector behind
which they lie, if it isn't the first."""

SELECTORS = {"TestPattern": ("TestPatternGeneratorSelector", ("Sensor", "ImageProcessor"), 0x8060)}
"""Selectors of the camera's features, their entries and their registers."""

_OTHERS = {
    "Gain": CameraFeature(0x110, "float", 10),
    "OffsetX": CameraFeature(0x130, "integer"),
    "OffsetY": CameraFeature(0x134, "integer"),
    "BinningHorizontal": CameraFeature(0x108, "integer"),
    "BinningVertical": CameraFeature(0x10C, "integer"),
    "GainAuto": CameraFeature(0x114, "choice"),
    "ExposureAuto": CameraFeature(0x3E0, "choice"),
}


def register_of(name: str, value: float) -> tuple[int, int]:
    """Return the address and the number that set a feature."""
    feature = (FEATURES | _OTHERS)[name]
    return feature.address, round(value * feature.scale)


def apply_features(
    image: NDArray[np.uint16], registers: Sequence[int], full_scale: int
) -> NDArray[np.uint16]:
    """Return what a camera with its features set so makes of its sensor's picture.

    registers: those of FEATURES first, in their order.
    """
    value = dict(zip(FEATURES, registers, strict=False))
    if all(value[name] == round(one.start * one.scale) for name, one in FEATURES.items()):
        return image
    numbers = image.astype(float)[
        :: max(1, value["DecimationVertical"]), :: max(1, value["DecimationHorizontal"])
    ]
    if value["SharpeningEnable"]:
        numbers[:, 1:-1] += numbers[:, 1:-1] - (numbers[:, 2:] + numbers[:, :-2]) / 2
    numbers = (numbers + value["BlackLevel"] / 100) * 2 ** value["DigitalShift"]
    share = np.clip(numbers / full_scale, 0, 1)
    if value["GammaEnable"]:
        share = share ** (value["Gamma"] / 100)
    if value["LUTEnable"]:
        share = np.sqrt(share)
    numbers = np.rint(share * full_scale)
    if value["TestPattern"] or value["TestPattern[ImageProcessor]"]:
        rows, columns = np.indices(numbers.shape)
        numbers = (rows + columns) % (full_scale + 1)
    across, down = (-1 if value[name] else 1 for name in ("ReverseX", "ReverseY"))
    return numbers[::down, ::across].astype(np.uint16)


_HEAD = """<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="Fake" VendorName="Aravis" StandardNameSpace="None"
  SchemaMajorVersion="1" SchemaMinorVersion="0" SchemaSubMinorVersion="1" MajorVersion="1"
  MinorVersion="0" SubMinorVersion="0" ToolTip="Virtual bench" ProductGuid="0" VersionGuid="0"
  xmlns="http://www.genicam.org/GenApi/Version_1_0">
"""

_RATE = (
    '<Float Name="AcquisitionFrameRate"><pValue>Rate</pValue></Float><Converter Name="Rate">'
    "<FormulaTo>(1000000 / FROM)</FormulaTo><FormulaFrom>(1000000 / TO)</FormulaFrom>"
    "<pValue>AcquisitionFramePeriod</pValue></Converter>"
)

_TEXTS = {
    "DeviceVendorName": (0x48, 32),
    "DeviceModelName": (0x68, 32),
    "DeviceVersion": (0x88, 32),
    "DeviceManufacturerInfo": (0xA8, 48),
    "DeviceID": (0xD8, 16),
}

# Registers of whole numbers, and their limits.
_NUMBERS = {
    "SensorHeight": (0x118, ""),
    "SensorWidth": (0x11C, ""),
    "OffsetX": (0x130, "<Min>0</Min><pMax>SensorWidth</pMax>"),
    "OffsetY": (0x134, "<Min>0</Min><pMax>SensorHeight</pMax>"),
    "Width": (0x100, "<Min>1</Min><pMax>WidthMax</pMax><Inc>1</Inc>"),
    "Height": (0x104, "<Min>1</Min><pMax>HeightMax</pMax><Inc>1</Inc>"),
    "BinningHorizontal": (0x108, "<Min>1</Min><Max>4</Max>"),
    "BinningVertical": (0x10C, "<Min>1</Min><Max>4</Max>"),
    "AcquisitionFramePeriod": (0x138, "<Min>1000</Min><Max>100000000</Max>"),
}

# Names of the features, each once; the entries of a selector lie 64 bytes apart.
_FEATURES = [name for name in FEATURES if "[" not in name]


def genicam_xml(pixel_formats: Iterable[str], exposure_us: tuple[int, int]) -> str:
    """Return the GenICam XML of a camera with these pixel formats and this exposure range."""
    names = [
        *_TEXTS, *_NUMBERS, "PixelFormat", "AcquisitionMode", "AcquisitionStart",
        "AcquisitionStop", "AcquisitionFrameRate", "TriggerSelector", "TriggerMode",
        "TriggerSource", "TriggerActivation", "TriggerSoftware", "ExposureTime", "Gain",
        "ExposureAuto", "GainAuto", "DeviceTemperature", "PayloadSize", *_FEATURES,
        *(selector for selector, *_ in SELECTORS.values()),
    ]  # fmt: skip
    listed = "".join(f"<pFeature>{name}</pFeature>" for name in names)
    parts = [_HEAD, f'<Category Name="Root">{listed}</Category>']
    for name, (address, length) in _TEXTS.items():
        parts.append(
            f'<StringReg Name="{name}"><Address>{address:#x}</Address><Length>{length}</Length>'
            "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>"
        )
    for name, (address, limits) in _NUMBERS.items():
        parts.append(f'<Integer Name="{name}"><pValue>{name}Reg</pValue>{limits}\n</Integer>')
        parts.append(_integer_register(f"{name}Reg", address))
    size = {"W": "Width", "H": "Height", "P": "PixelFormatReg", "M": "MoreBytesReg"}
    payload = "(W * H * ((P &gt;&gt; 16) &amp; 0xFF) + 7) / 8 + M"
    parts += [
        _swiss_knife("WidthMax", {"S": "SensorWidth", "B": "BinningHorizontal"}, "S / B"),
        _swiss_knife("HeightMax", {"S": "SensorHeight", "B": "BinningVertical"}, "S / B"),
        _swiss_knife("PayloadSize", size, payload),
        _integer_register("MoreBytesReg", 0x3DC),
        *(_feature(name) for name in _FEATURES),
    ]
    for selector, entries, address in SELECTORS.values():
        parts.append(_enumeration(selector, address, {one: n for n, one in enumerate(entries)}))
    modes = {"Continuous": 1, "SingleFrame": 2, "MultiFrame": 3}
    low, high = exposure_us
    parts += [
        _enumeration("PixelFormat", 0x128, {n: FORMATS[n].code for n in pixel_formats}),
        _enumeration("AcquisitionMode", 0x12C, modes),
        _enumeration("TriggerMode", 0x300, {"Off": 0, "On": 1}),
        _enumeration("TriggerSource", 0x3F4, {"Line0": 0, "Software": 1}),
        _enumeration("TriggerActivation", 0x308, {"RisingEdge": 0}),
        _enumeration("TriggerSelector", 0x3F8, {"FrameStart": 0}),
        _enumeration("GainAuto", 0x114, {"Off": 1, "Continuous": 2}),
        _enumeration("ExposureAuto", 0x3E0, {"Off": 0, "Continuous": 1}),
        _command("AcquisitionStart", "RunningReg", 1),
        _command("AcquisitionStop", "RunningReg", 0),
        _integer_register("RunningReg", 0x124),
        _command("TriggerSoftware", "TriggerReg", 1),
        _integer_register("TriggerReg", 0x3F0),
        _scaled_float("ExposureTime", 0x120, "FROM", "TO", low, high),
        _scaled_float("Gain", 0x110, "FROM * 10", "TO / 10", 0, 48),
        _scaled_float("DeviceTemperature", 0x3D0, "FROM * 100", "TO / 100", -50, 150),
        _RATE,
        '<Integer Name="TLParamsLocked"><Value>0</Value></Integer>',
        '<Port Name="Device"/></RegisterDescription>\n',
    ]
    return "\n".join(parts)


def _feature(name: str) -> str:
    address, kind, scale, _ = FEATURES[name]
    if kind == "choice":
        choices = {"Off": 0, "GreyDiagonalRamp": 1}
        selector = f"{SELECTORS[name][0]}Reg" if name in SELECTORS else ""
        return _enumeration(name, address, choices, selector)
    if kind == "float":
        return _scaled_float(name, address, f"FROM * {scale}", f"TO / {scale}", 0, 1000)
    form = "Boolean" if kind == "switch" else "Integer"
    values = "<OnValue>1</OnValue><OffValue>0</OffValue>" if kind == "switch" else ""
    head = f'<{form} Name="{name}"><pValue>{name}Reg</pValue>{values}</{form}>'
    return head + _integer_register(f"{name}Reg", address)


def _integer_register(name: str, address: int, selector: str = "") -> str:
    """Return a register; with a selector's register, that of its entry."""
    index = f'<pIndex Offset="64">{selector}</pIndex>' if selector else ""
    return (
        f'<IntReg Name="{name}"><Address>{address:#x}</Address>{index}<Length>4</Length>'
        "<AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign>"
        "<Endianess>BigEndian</Endianess></IntReg>"
    )


def _swiss_knife(name: str, variables: dict[str, str], formula: str) -> str:
    given = "".join(f'<pVariable Name="{k}">{v}</pVariable>' for k, v in variables.items())
    return f'<IntSwissKnife Name="{name}">{given}<Formula>{formula}</Formula></IntSwissKnife>'


def _enumeration(name: str, address: int, entries: dict[str, int], selector: str = "") -> str:
    rows = "".join(
        f'<EnumEntry Name="{entry}"><Value>{value}</Value></EnumEntry>'
        for entry, value in entries.items()
    )
    head = f'<Enumeration Name="{name}">{rows}<pValue>{name}Reg</pValue></Enumeration>'
    return head + _integer_register(f"{name}Reg", address, selector)


def _command(name: str, register: str, value: int) -> str:
    return (
        f'<Command Name="{name}"><pValue>{register}</pValue>'
        f"<CommandValue>{value}</CommandValue></Command>"
    )


def _scaled_float(name: str, address: int, to: str, back: str, low: float, high: float) -> str:
    limits = f"<Min>{low}</Min><Max>{high}</Max>"
    return (
        f'<Float Name="{name}"><pValue>{name}Converter</pValue>{limits}</Float>'
        f'<Converter Name="{name}Converter"><FormulaTo>{to}</FormulaTo>'
        f"<FormulaFrom>{back}</FormulaFrom><pValue>{name}Reg</pValue></Converter>"
        + _integer_register(f"{name}Reg", address)
    )
