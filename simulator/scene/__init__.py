"""Scenes before the simulated camera: targets with distance, size, spectrum and radiance."""

from simulator.scene.colours import basis_of, mix_reflectances, primaries
from simulator.scene.cube import Cube
from simulator.scene.disc import Pinhole, Star
from simulator.scene.display import Display, display_primaries
from simulator.scene.drawable import Drawable, UniformLight
from simulator.scene.framed import PhotographPrint
from simulator.scene.relief import Relief, distances_of
from simulator.scene.sheets import Sheet, Sheets
from simulator.scene.target import Dark, Flat, Layer, Part, Scene, Target

__all__ = [
    "Cube",
    "Dark",
    "Display",
    "Drawable",
    "Flat",
    "Layer",
    "Part",
    "PhotographPrint",
    "Pinhole",
    "Relief",
    "Scene",
    "Sheet",
    "Sheets",
    "Star",
    "Target",
    "UniformLight",
    "basis_of",
    "display_primaries",
    "distances_of",
    "mix_reflectances",
    "primaries",
]
