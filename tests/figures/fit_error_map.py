"""Fit the error map of spectral restorations: `python -m figures.fit_error_map FOLDER`.

Scenes whose spectra are known are restored from simulated photographs, and a line is fitted to the
0.9 quantile of the error's logarithm. The coefficients that are printed stand in
`optics.multispectral.error_map`. Beside them stands how the intervals of each scene cover the truth
where the other scenes alone were fitted.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import minimize

from figures.error_map_scenes import fitted_scenes
from figures.spectral_scenes import (
    SIX_BANDS,
    Array,
    add_peak,
    observe,
    published_rings,
    typical_spectra,
)
from labapp.common.threads import use_one_thread
from optics.multispectral import dot_psfs, restore_spectra, spiral_psfs
from optics.multispectral.error_map import error_features
from optics.plane import Plane
from optics.targets import ring_positions

_NOISES = (0.0, 0.01, 0.005, 0.03)
_PIXEL = 1e-6
_PLANE = Plane((47, 47), (_PIXEL, _PIXEL))
_RADIUS = 20 * _PIXEL
_UNMODULATED = 0.2

_PIXELS = 400
"""Number of random pixels taken from each restoration."""
_SHARE = 0.9
_LEAST_COVERAGE, _LARGEST_COVERAGE = 0.85, 0.95
_RIDGE = 1e-3
"""Weight of the squared coefficients of features with a standard deviation of 1."""
_ROUNDING = 0.02
"""Difference of logarithms within which the corner of the loss is rounded."""
_LEAST_ERROR = 1e-5
_LIT = 0.1
_FEWEST = 20
"""Least number of pixels that count as a group."""


@dataclass(frozen=True, eq=False)
class _Group:
    """Lit or dark pixels of a band of a restoration: features (pixels, features), errors (pixels,)
    relative to the scale of the scene's light, and what they are of."""

    features: Array
    errors: Array
    scene: str
    case: str
    band: int
    is_lit: bool


def main() -> None:
    asked = _arguments()
    use_one_thread()
    asked.folder.mkdir(parents=True, exist_ok=True)
    if not asked.fit_only:
        _restore_all(asked.folder)
    groups, names = _read_groups(asked.folder)
    _print_left_out(groups)
    print("_COEFFICIENTS = {")
    for name, value in zip(names, _fit(groups), strict=True):
        print(f'    "{name}": {value:.3f},')
    print("}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="figures.fit_error_map", description=__doc__)
    parser.add_argument("folder", type=Path, help="where restorations are kept; those there stay")
    parser.add_argument("--fit-only", action="store_true", help="restore nothing more")
    return parser.parse_args()


def _designs() -> dict[str, Array]:
    """PSFs of six bands by name."""
    metres = [float(nm) * 1e-9 for nm in SIX_BANDS]
    dots = ring_positions(7, _RADIUS, 0.3)
    return {
        "published rings": published_rings(len(SIX_BANDS)),
        "rings": add_peak(published_rings(len(SIX_BANDS)), _UNMODULATED),
        "dots": dot_psfs(_PLANE, metres, dots, unmodulated=_UNMODULATED).numpy(),
        "spiral": spiral_psfs(_PLANE, metres, _RADIUS, unmodulated=_UNMODULATED).numpy(),
    }


def _restore_all(folder: Path) -> None:
    """Restore each scene with each design once and keep the results; noises take turns."""
    spectra, designs = typical_spectra(SIX_BANDS), _designs()
    for row, (name, scene) in enumerate(fitted_scenes().items()):
        for column, (design, psfs) in enumerate(designs.items()):
            file = folder / f"{name}, {design}.npz"
            if file.exists():
                continue
            noise = _NOISES[(row + column + row // len(_NOISES)) % len(_NOISES)]
            observation = observe(scene, psfs, noise=noise, seed=row)
            image = restore_spectra(observation, spectra).image
            np.savez(file, truth=scene, image=image, noise=noise, seed=row, scene=name)
            print(file.name, flush=True)


def _read_groups(folder: Path) -> tuple[list[_Group], list[str]]:
    """All groups of pixels of the restorations in a folder, and the names of the features."""
    designs, spectra, rng = _designs(), typical_spectra(SIX_BANDS), np.random.default_rng(0)
    groups: list[_Group] = []
    names: list[str] = []
    for file in sorted(folder.glob("*.npz")):
        stored = np.load(file)
        truth, image, scene = stored["truth"], stored["image"], str(stored["scene"])
        psfs = designs[file.stem.removeprefix(f"{scene}, ")]
        noise = float(stored["noise"])
        observation = observe(truth, psfs, noise=noise, seed=int(stored["seed"]))
        found = error_features(observation, torch.from_numpy(image), spectra)
        names = list(found.logarithms)
        shape = image.shape
        table = np.stack([value.expand(shape).flatten(1) for value in found.logarithms.values()])
        errors = np.abs(image - truth).reshape(len(truth), -1) / found.scale
        lit = np.linalg.norm(truth, axis=0).ravel() > _LIT
        taken = rng.permutation(lit.size)[:_PIXELS]
        for band in range(len(truth)):
            for is_lit in (True, False):
                own = taken[lit[taken] == is_lit]
                if len(own) >= _FEWEST:
                    case = f"{file.stem}, noise {noise:g}"
                    values = table[:, band, own].T, errors[band, own]
                    groups.append(_Group(*values, scene, case, band, is_lit))
    return groups, names


def _fit(groups: Sequence[_Group]) -> Array:
    """Coefficients of the 0.9 quantile of the error's logarithm; each group has the same weight."""
    features = np.concatenate([group.features for group in groups])
    wanted = np.log(np.concatenate([group.errors for group in groups]) + _LEAST_ERROR)
    weights = np.concatenate(
        [np.full(len(group.errors), 1 / len(group.errors) / len(groups)) for group in groups]
    )
    spread = features.std(0)
    constant = spread < 1e-9
    middle = np.where(constant, 0.0, features.mean(0))
    spread = np.where(constant, 1.0, spread)
    scaled = (features - middle) / spread

    def loss(coefficients: Array) -> tuple[float, Array]:
        left = wanted - scaled @ coefficients
        side = np.where(left > 0, _SHARE, 1 - _SHARE)
        corner = np.abs(left) < _ROUNDING
        size = np.where(corner, left**2 / _ROUNDING / 2, np.abs(left) - _ROUNDING / 2)
        slope = weights * side * np.where(corner, left / _ROUNDING, np.sign(left))
        ridge = _RIDGE * np.where(constant, 0.0, coefficients)
        value = (weights * side * size).sum() + ridge @ coefficients
        return float(value), 2 * ridge - slope @ scaled

    start = np.where(constant, np.quantile(wanted, _SHARE), 0.0)
    found = minimize(loss, start, jac=True, method="L-BFGS-B").x / spread
    found[constant] -= (found * middle).sum() / constant.sum()
    return np.asarray(found)


def _print_left_out(groups: Sequence[_Group]) -> None:
    """Print the coverage of each scene's intervals where the other scenes were fitted."""
    shares_of: dict[str, list[float]] = {"lit": [], "dark": []}
    for scene in sorted({group.scene for group in groups}):
        fitted = _fit([group for group in groups if group.scene != scene])
        own = [group for group in groups if group.scene == scene]
        for is_lit, word in ((True, "lit"), (False, "dark")):
            for case in sorted({group.case for group in own}):
                shares = [_coverage(group, fitted) for group in own
                          if group.is_lit is is_lit and group.case == case]  # fmt: skip
                shares_of[word] += shares
                if shares:
                    print(f"{case}, {word}: " + " ".join(f"{share:.2f}" for share in shares))
    for word, found in shares_of.items():
        values = np.array(found)
        within = np.mean((values >= _LEAST_COVERAGE) & (values <= _LARGEST_COVERAGE))
        print(f"{word}: mean {values.mean():.3f}, standard deviation {values.std():.3f}, "
              f"{100 * within:.0f} % of bands covered as wanted")  # fmt: skip


def _coverage(group: _Group, coefficients: Array) -> float:
    return float(np.mean(group.errors <= np.exp(group.features @ coefficients)))


if __name__ == "__main__":
    main()
