"""Cameras' RAW files: the numbers of the sensor's mosaic, and what the file says of them."""

from labapp.files.raw.photograph import CameraColour, RawPhotograph
from labapp.files.raw.reading import read_raw
from labapp.files.raw.recognition import is_raw

__all__ = ["CameraColour", "RawPhotograph", "is_raw", "read_raw"]
