"""Scenes with known spectra to which the errors of spectral restorations are fitted.

None of them serves to judge. Few measured scenes are at hand, so that most are photographs whose
colours are replaced by measured reflectances, or random disks of them.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import scipy.io
import torch

from figures.spectral_scenes import SIX_BANDS, Array, laboratory_scene, lego_scene
from optics.multispectral import draw_dead_leaves

_SHARED = Path(__file__).parents[3] / "shared/data"
_SURFACES = _SHARED / "spectral/sfu/Surface_Reflectances_SimonFraser.mat"

SIDE = 256
"""Rows and columns of all but the measured scenes, which have 128."""
_MEASURED_SCENES = ("OSO_FULL", "fullFlor")

_PHOTOGRAPHS = {
    "kodim02": (200, 150, 1),
    "kodim03": (200, 200, 1),
    "kodim07": (100, 250, 1),
    "kodim15": (100, 200, 1),
    "kodim23": (0, 150, 2),
}
"""Row and column of the first pixel, and the step between those taken."""

_ON_DARK_GROUND = {"kodim05": (0, 200, 2), "kodim25": (150, 300, 1)}

_FINE = np.arange(400, 701, 10)
_GAIN = 0.9
_BASIS = ((605, 35), (545, 38), (450, 25))
"""Middle and standard deviation in nm of the red, green and blue light of a photograph."""
_NEAR, _FAR = 0.02, 0.1
"""Differences of chromaticity over which reflectances are mixed, and where there is none near."""
_FAR_WEIGHT = 1e-9
_DARKEST_SURFACE = 0.05
_OBJECTS = 6
_GROUND = (0.01, 0.03)
"""Least and largest reflectance of a dark ground."""
_LEAVES = 150
"""Number of reflectances in a scene of random disks."""


def fitted_scenes() -> dict[str, Array]:
    """All scenes by name, (bands, rows, columns); FileNotFoundError where one isn't there."""
    scenes = {"lego": lego_scene(), **{name: laboratory_scene(name) for name in _MEASURED_SCENES}}
    found = {name: scene for name, scene in scenes.items() if scene is not None}
    if len(found) < len(scenes):
        raise FileNotFoundError("the measured scenes aren't beside the checkout")
    found |= {name: _photograph(name, *at) for name, at in _PHOTOGRAPHS.items()}
    for seed, (name, at) in enumerate(_ON_DARK_GROUND.items()):
        found[f"{name} on dark ground"] = _put_on_dark_ground(_photograph(name, *at), seed)
    found["disks"], disks = _disks(0), _disks(1)
    found["disks on dark ground"] = _put_on_dark_ground(disks, len(_ON_DARK_GROUND))
    return found


def _reflectances() -> Array:
    """Measured reflectances of surfaces, (samples, wavelengths of _FINE)."""
    stored = scipy.io.loadmat(str(_SURFACES))
    own = stored["wavelength"].ravel()
    samples = np.stack([np.interp(_FINE, own, one) for one in stored["data"].T])
    return samples[samples.max(1) > _DARKEST_SURFACE]


def _at_bands(samples: Array) -> Array:
    return np.stack([np.interp(SIX_BANDS, _FINE, one) for one in samples])


def _photograph(name: str, row: int, column: int, step: int) -> Array:
    """A photograph whose colours are mixtures of reflectances of nearly the same chromaticity."""
    read = cv2.imread(str(_SHARED / f"natural/kodak/{name}.png"))
    if read is None:
        raise FileNotFoundError(f"the photograph {name} isn't beside the checkout")
    stored = read[row : row + SIDE * step : step, column : column + SIDE * step : step, ::-1] / 255
    light = np.where(stored < 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    colours = light.reshape(-1, 3)
    samples = _reflectances()
    basis = np.stack([np.exp(-0.5 * ((_FINE - middle) / wide) ** 2) for middle, wide in _BASIS])
    seen = samples @ (basis / basis.sum(1, keepdims=True)).T
    sums = colours.sum(1, keepdims=True)
    spectra = [
        _mix(part, seen, _at_bands(samples))
        for part in np.array_split(colours / np.maximum(sums, 1e-6), 8)
    ]
    scene = np.concatenate(spectra) * sums * _GAIN
    return np.clip(scene.T.reshape(-1, SIDE, SIDE), 0, 1)


def _mix(chromaticities: Array, seen: Array, samples: Array) -> Array:
    """Spectra of some chromaticities, whose red, green and blue light sums to 1."""
    own = seen / seen.sum(1, keepdims=True)
    squares = ((chromaticities[:, None] - own) ** 2).sum(-1)
    near, far = (np.exp(-squares / (2 * wide**2)) for wide in (_NEAR, _FAR))
    shares = near + _FAR_WEIGHT * far
    return (shares @ samples) / (shares @ seen.sum(1))[:, None]


def _disks(seed: int) -> Array:
    samples = _reflectances()
    chosen = np.random.default_rng(seed).choice(len(samples), _LEAVES, replace=False)
    generator = torch.Generator().manual_seed(seed)
    spectra = torch.from_numpy(_at_bands(samples[chosen]))
    return np.asarray(draw_dead_leaves(spectra, SIDE, generator).numpy())


def _put_on_dark_ground(scene: Array, seed: int) -> Array:
    """Keep a scene within a few ellipses, on a dark ground that is slightly uneven."""
    rng = np.random.default_rng(seed)
    inside = np.zeros((SIDE, SIDE), np.uint8)
    for _ in range(_OBJECTS):
        middle = [int(n) for n in rng.integers(10, SIDE - 10, 2)]
        axes = [int(n) for n in rng.integers(8, SIDE // 4, 2)]
        cv2.ellipse(inside, middle, axes, float(rng.uniform(0, 180)), 0.0, 360.0, 1, -1)
    uneven = cv2.GaussianBlur(rng.random((SIDE, SIDE)), (0, 0), 2.0)
    colour = rng.normal(1, 0.1, len(scene)).clip(0.5, 1.5)
    ground = rng.uniform(*_GROUND) * colour[:, None, None] * uneven / uneven.mean()
    return np.where(inside > 0, scene, ground)
