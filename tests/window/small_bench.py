"""Files of a virtual bench whose pictures are computed in no time."""

from __future__ import annotations

from pathlib import Path

from labapp.bench import BenchFiles
from labapp.files.reading import bundled

_BENCH = """
version = 1
name = "Small bench"
transmission = 0.5

[panel]
model = "small"
width = 192
height = 108
pitch_um = 80.0
fill_factor = 0.9
unmodulated = 0.05
reflectivity = 0.6
settling_ms = 50.0
max_phase_pi = { 452 = 9.0, 532 = 6.7, 633 = 5.4 }

[lens]
focal_length_mm = 125.0
f_number = 5.0
focus_distance_m = 2.0

[sensor]
model = "small"
width = 96
height = 64
pitch_um = 3.45
bits = 12
full_well_electrons = 10500.0
gain_electrons_per_dn = 2.6
read_noise_electrons = 2.4
dark_current_electrons_per_s = 1.0
black_level_dn = 64.0
quantum_efficiency = 0.62
shortest_exposure_us = 20.0
longest_exposure_s = 30.0

[devices.slm]
driver = "simulated-slm"
[devices.filter]
driver = "simulated-filter"
[devices.camera]
driver = "simulated-camera"
[devices.targets]
driver = "simulated-targets"
"""

_SCENE = """
version = 1
title = "Small scene"
tol = 0.01

[effects] # what takes longest is left out, whatever it changes
"panel orders" = false
"PSF reach" = false

[targets.dark]
kind = "dark"

[targets.flat]
kind = "flat"
distance_m = 2.0
radiance = 0.5

[targets.star]
kind = "star"
diameter_um = 70.0
distance_m = 2.0
radiance = 20.0

[targets.photograph]
kind = "photograph"
file = "{photograph}"
distance_m = 2.0
radiance = 0.1
cover = 1.05
"""


def write_bench(folder: Path) -> BenchFiles:
    """A bench and a scene of four targets, two effects of it forced off."""
    files = BenchFiles(folder / "bench.toml", folder / "scene.toml")
    files.bench.write_text(_BENCH)
    files.scene.write_text(_SCENE.format(photograph=bundled("photograph.jpg")))
    return files
