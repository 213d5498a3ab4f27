"""Spectral cubes on the disk: HDF5 that describes itself, and ENVI for other programs."""

from labapp.files.cubes.cube import SpectralCube
from labapp.files.cubes.cube_file import read_cube, write_cube

__all__ = ["SpectralCube", "read_cube", "write_cube"]
