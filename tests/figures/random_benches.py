"""Benches by chance, with each effect or without it, small enough to compute everything."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from figures.problems import log_uniform, random_aberrations, random_stop
from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.stop import Stop
from optics.light import Band, Spectrum
from optics.patterns import axicon, binary_grating, blazed_grating, fresnel_lens
from optics.polarisation import PathEffect
from optics.sensor import Mosaic
from optics.slm import PanelMap, PhaseResponse, phase_to_grey
from simulator.mount import Mount
from simulator.panel_content import PanelContent

_FOCAL_LENGTH = 0.05
_LETTERS = {"R": 600e-9, "G": 540e-9, "B": 460e-9}


@dataclass(frozen=True)
class RandomBench:
    """What a picture is taken with; SI units. distance: about where a target is looked for."""

    camera: Camera
    mount: Mount
    band: Band
    shown: PanelContent
    path: PathEffect | None
    distance: float


def random_bench(rng: np.random.Generator, most_pixels: int = 40) -> RandomBench:
    """A panel of up to 32 x 40 pixels and a sensor of up to `most_pixels` a side."""
    band = _band(rng)
    lens = _lens(rng, band.centre)
    panel = _panel(rng, band.centre)
    spot = band.centre * lens.image_distance / (max(panel.shape) * panel.pitch)
    sensor = _sensor(rng, spot, most_pixels)
    separation = log_uniform(rng, 1e-3, 3e-2) if rng.random() < 0.15 else 0.0
    camera = Camera(panel, lens, sensor, separation=separation)
    mount = Mount()
    if rng.random() < 0.2:
        flips = (bool(one) for one in rng.integers(0, 2, 2))
        mount = Mount(float(rng.choice([0.1, 1.5, math.pi])), *flips)
    return RandomBench(
        camera, mount, band, _shown(rng, camera, band.centre), _path(rng, panel),
        lens.focus_distance * float(rng.choice([1.0, 1.0, 0.85, 1.2])),
    )  # fmt: skip


def _band(rng: np.random.Generator) -> Band:
    shape = str(rng.choice(["gaussian", "lyot", "interference", "open"]))
    leak = float(rng.choice([0.0, 0.0, 1e-5, 1e-3]))
    centre, width = rng.uniform(460e-9, 660e-9), log_uniform(rng, 1e-9, 40e-9)
    return Band(float(centre), width, shape, leak)  # type: ignore[arg-type]


def _lens(rng: np.random.Generator, wavelength: float) -> Lens:
    plain = rng.random() < 0.6
    return Lens(
        _FOCAL_LENGTH,
        log_uniform(rng, 20.0, 60.0),
        float(rng.uniform(0.5, 2.0)),
        Stop() if plain else random_stop(rng),
        () if plain else random_aberrations(rng, wavelength),
    )


def _panel(rng: np.random.Generator, wavelength: float) -> Panel:
    shape = (int(rng.integers(16, 33)), int(rng.integers(20, 41)))
    y, x = np.mgrid[-1:1:5j, -1:1:6j]
    data: dict[str, Any] = {
        "illumination": PanelMap(np.exp(-(x**2) - y**2) * rng.uniform(0.5, 2) + 0.1),
        "front_reflection": log_uniform(rng, 1e-4, 0.05),
        "response": PhaseResponse.from_curve(
            wavelength, rng.uniform(0.9, 1.1) * (np.arange(256) / 255) ** rng.uniform(0.8, 1.3)
        ),
        "coupling": log_uniform(rng, 5e-7, 15e-6),
        "flicker": log_uniform(rng, 1e-3, 0.1),
        "jitter": log_uniform(rng, 3e-3, 0.3),
        "gap_reflection": rng.uniform(0.05, 0.7),
        "flatness": PanelMap((x**2 - y + x * y) * log_uniform(rng, 1e-9, 60e-9)),
        "unmodulated": log_uniform(rng, 1e-4, 0.1),
        "response_time": log_uniform(rng, 5e-4, 8e-3),
    }
    bare = Panel(shape, 40e-6, float(rng.choice([1.0, 0.81, 0.6])), unmodulated=0.0)
    share = rng.choice([0.0, 0.2, 0.5])
    chosen = {name: value for name, value in data.items() if rng.random() < share}
    return replace(bare, **chosen)


def _sensor(rng: np.random.Generator, spot: float, most: int) -> Sensor:
    """With 0.3 to 2 pixels in a diffraction spot; converters and wells large and small."""
    bits, gain = int(rng.integers(6, 15)), log_uniform(rng, 0.2, 10.0)
    read_noise = log_uniform(rng, 0.1, 10.0)
    data: dict[str, Any] = {
        "prnu": log_uniform(rng, 1e-4, 0.03),
        "dsnu": log_uniform(rng, 1e-2, 5.0),
        "dead": 2e-3,
        "hot": 2e-3,
        "hot_current": log_uniform(rng, 1.0, 1e4),
        "dark_current": log_uniform(rng, 1e-2, 1e3),
        "line_time": 2e-5,
        "colour": _mosaic(rng),
    }
    share = rng.choice([0.0, 0.3, 0.6])
    chosen = {name: value for name, value in data.items() if rng.random() < share}
    return Sensor(**{
        "shape": (int(rng.integers(16, most + 1)), int(rng.integers(16, most + 1))),
        "pitch": spot / log_uniform(rng, 0.3, 2.0),
        "bits": bits,
        "gain": gain,
        "full_well": gain * 2**bits * log_uniform(rng, 0.3, 3.0) + 20 * read_noise,
        "black_level": float(rng.choice([0.0, 2.0, 2.0 ** (bits - 4)])),
        "read_noise": read_noise,
        "dark_current": 0.0,
        "fixed_seed": int(rng.integers(1000)),
        "shutter": "rolling" if "line_time" in chosen else "global",
    } | chosen)  # fmt: skip


def _mosaic(rng: np.random.Generator) -> Mosaic:
    def curve(centre: float) -> Spectrum:
        width = rng.uniform(40e-9, 90e-9)
        nodes = (300e-9, centre - width, centre, centre + width, 1100e-9)
        return Spectrum(nodes, (0.02, 0.1, rng.uniform(0.3, 0.8), 0.1, 0.02))

    return Mosaic(("RG", "GB"), {name: curve(centre) for name, centre in _LETTERS.items()})


def _path(rng: np.random.Generator, panel: Panel) -> PathEffect | None:
    """Light that the pattern doesn't turn may beat with the rest, up to what Cauchy allows."""
    u = panel.unmodulated
    if not u or rng.random() < 0.5:
        return None
    strength = rng.uniform(0, 1) * 2 * math.sqrt(u * (1 - u))
    beat = strength * np.exp(1j * rng.uniform(0, 2 * np.pi))
    return PathEffect(torch.tensor(1.0), torch.tensor(u), torch.tensor(complex(beat)))


def _shown(rng: np.random.Generator, camera: Camera, wavelength: float) -> PanelContent:
    """One picture, or a video of two to four."""
    if rng.random() < 0.75:
        return PanelContent.of(_pattern(rng, camera, wavelength)[None], math.inf)
    count = int(rng.integers(2, 5))
    frames = [_pattern(rng, camera, wavelength) for _ in range(count)]
    return PanelContent.of(np.stack(frames), 1 / camera.panel.frame_rate)


def _pattern(rng: np.random.Generator, camera: Camera, wavelength: float) -> NDArray[np.uint8]:
    panel, z = replace(camera.panel, response=None, flatness=None), camera.lens.image_distance
    waves = wavelength * z / (max(panel.shape) * panel.pitch)
    kinds: tuple[Callable[[], torch.Tensor], ...] = (
        lambda: torch.zeros(panel.shape, dtype=torch.float64),
        lambda: fresnel_lens(panel, rng.choice([-1, 1]) * log_uniform(rng, 0.5, 20), wavelength),
        lambda: axicon(panel, rng.uniform(1, 5) * waves, z, wavelength),
        lambda: blazed_grating(panel, rng.uniform(4, 20), rng.uniform(0, 6)),
        lambda: binary_grating(panel, int(rng.integers(2, 12)), rng.uniform(0.5, math.pi)),
        lambda: torch.from_numpy(rng.uniform(0, rng.uniform(0.3, 6.28), panel.shape)),
    )
    phase = kinds[rng.integers(len(kinds))]()
    return np.asarray(phase_to_grey(panel, phase, wavelength).numpy(), dtype=np.uint8)
