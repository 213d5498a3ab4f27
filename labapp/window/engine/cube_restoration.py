"""Spectral cubes: restore a record's snapshot, show it in a light, and save it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.cubes import SpectralCube, write_cube
from labapp.files.picture.photograph_writing import encode_srgb
from labapp.files.writing import write_atomically
from labapp.runs.record.reader import Record
from labapp.spectral.band_list import parse_bands
from labapp.spectral.colour import colour_difference
from labapp.spectral.drawing import encode_colours, srgb_levels
from labapp.spectral.lights import ViewingLight, find_light
from labapp.spectral.problem import WHITE_PERCENTILE, SpectralProblem
from labapp.spectral.request import SpectralRequest
from labapp.spectral.restoration import RestoredCube, restore_snapshot
from labapp.spectral.roles import choose_roles
from labapp.spectral.snapshot import recorded_wavelengths
from labapp.window.engine.band_maps import list_maps
from labapp.window.spectral_messages import (
    CubeColours,
    CubeQuality,
    RecordBands,
    RestoreCube,
    SpectralResult,
)
from optics.progress import Progress

_MOST_PIXELS = 1000
"""Most rows or columns of a cube that are sent to the window: about what a screen has room for."""

_MOST_VALUES = 2**24
"""Most values of a cube that are sent to the window: 64 MiB, which take some 0.1 s."""

_PICTURE = ".png"


@dataclass(frozen=True, eq=False)
class CubeRestoration:
    """A restored cube, kept until another restoration replaces it.

    path: the record.
    light: light in which the cube is shown.
    """

    path: Path
    problem: SpectralProblem
    restored: RestoredCube
    light: ViewingLight

    @property
    def result_message(self) -> SpectralResult:
        """Return the restored cube as a message to the window."""
        problem, restored, step = self.problem, self.restored, self._step
        cube, truth = self._shown_pixels(restored.cube), self._shown_truth
        image = restored.image
        return SpectralResult(
            path=self.path,
            source=problem.source.removeprefix(f"{self.path}, "),
            wavelengths=cube.wavelengths,
            values=np.asarray(cube.values),
            truth=None if truth is None else np.asarray(truth.values),
            error=None if cube.error is None else np.asarray(cube.error),
            grey=encode_srgb(np.asarray(cube.values)),
            true_grey=None if truth is None else encode_srgb(np.asarray(truth.values)),
            snapshot=_snapshot_levels(problem.rate)[::step, ::step].copy(),
            maps=list_maps(cube, truth, restored.residual_map[::step, ::step]),
            pixel_step=step,
            colours=self.colours,
            quality=self._quality,
            white=problem.response.source,
            method=image.method,
            noise=image.noise,
            iterations=image.iterations,
            residual=image.residual,
            verdict=str(restored.verdict),
            notes=(*problem.notes, *([restored.doubts] if restored.doubts else [])),
            cpu_seconds=restored.cpu_seconds,
        )

    @property
    def colours(self) -> CubeColours:
        """Return the colours of the restored cube and of the true one.

        The colour difference is that over the whole frame, as `labapp reconstruct` prints it.
        """
        truth, mean, most = self._shown_truth, None, None
        if self.restored.truth is not None:
            apart = colour_difference(self.restored.cube, self.restored.truth, self.light)
            # Where the true cube lacks a value, there is none.
            mean, most = float(np.nanmean(apart)), float(np.nanpercentile(apart, 95))
        return CubeColours(
            light=self.light.name,
            restored=srgb_levels(self._shown_pixels(self.restored.cube), self.light),
            true=None if truth is None else srgb_levels(truth, self.light),
            difference=mean,
            largest_difference=most,
        )

    def with_light(self, name: str) -> CubeRestoration:
        """Return the cube as shown in another light; UserError if there is none of that name."""
        return replace(self, light=find_light(name))

    def save(self, path: Path) -> None:
        """Save the restored cube, or its colours if the file's name ends in .png.

        Raises UserError if the ending isn't known, or the file is the record.
        """
        if path.resolve() == self.path.resolve():
            raise UserError(f"{path}: is the record of the run. Choose another name for the cube.")
        if not path.parent.is_dir():
            raise UserError(f"{path.parent}: is not a folder. Choose another place.")
        if path.suffix.lower() == _PICTURE:
            write_atomically(path, encode_colours(path, self.restored.cube, self.light))
        else:
            write_cube(path, self.restored.cube)

    @property
    def _step(self) -> int:
        """Return the step between the rows and columns of the cube that are sent."""
        bands, rows, columns = self.restored.cube.shape
        by_side = max(rows, columns) / _MOST_PIXELS
        by_size = math.sqrt(bands * rows * columns / _MOST_VALUES)
        return max(math.ceil(by_side), math.ceil(by_size), 1)

    def _shown_pixels(self, cube: SpectralCube) -> SpectralCube:
        """Return the pixels of a cube that are sent."""
        at = slice(None, None, self._step)
        error = None if cube.error is None else cube.error[:, at, at].copy()
        return replace(cube, values=cube.values[:, at, at].copy(), error=error)

    @property
    def _shown_truth(self) -> SpectralCube | None:
        """Return the pixels of the true cube that are sent; None if it isn't known."""
        truth = self.restored.truth
        return None if truth is None else self._shown_pixels(truth)

    @property
    def _quality(self) -> CubeQuality | None:
        """Return the scores of the restored cube; None without a truth."""
        scores = self.restored.scores
        if scores is None:
            return None
        return CubeQuality(
            tuple(one.psnr for one in scores.bands),
            tuple(one.ssim for one in scores.bands),
            scores.psnr,
            scores.ssim,
            scores.angle,
            self.problem.truth_source,
        )


def restore_cube(command: RestoreCube, progress: Progress) -> CubeRestoration:
    """Restore the spectral cube of a record's snapshot.

    Raises UserError if the record has no snapshot of two bands or more, or no star in one of them.
    """
    try:
        light = find_light(command.light)
        request = SpectralRequest(command.path, parse_bands(command.bands))
        problem = request.read_problem(progress.part(0, 0.4))
        restored = restore_snapshot(problem, light, progress=progress.part(0.4, 1))
    except UserError as error:
        # The window has a field where the command has an option.
        raise UserError(str(error).replace("--bands", "Bands")) from error
    except ValueError as error:
        raise UserError(f"{command.path}: {error}.") from error
    return CubeRestoration(command.path, problem, restored, light)


def list_bands(path: Path) -> RecordBands:
    """List the wavelengths of a record's coded photograph.

    There are none for a file that can't be read; its restoration says why.
    """
    try:
        with Record(path) as record:
            roles = choose_roles(record, None, None, None)
            found = recorded_wavelengths(record, roles.photograph, roles.coded)
    except (UserError, OSError):
        found = ()
    return RecordBands(path, found)


def _snapshot_levels(rate: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return a snapshot's bare pixels with the values of a screen, (rows, columns)."""
    known = np.nan_to_num(rate)
    bright = float(np.percentile(known, WHITE_PERCENTILE))
    return encode_srgb(known / max(bright, 1e-300))
