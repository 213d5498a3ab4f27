"""Patterns and predicted PSFs, computed and cached."""

from __future__ import annotations

import json
import threading
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from labapp.patterns.grey_levels import compute_pattern
from labapp.prediction.pattern_psf import USUAL_TOLERANCE, predicted_psf
from labapp.window.commands import PatternTable
from labapp.window.engine.plan_building import validate_pattern
from labapp.window.messages import PatternPreview
from optics.camera import Camera
from optics.progress import Progress


@dataclass(frozen=True)
class PatternDesignerSettings:
    """Tune the sizes of pattern previews and of the cache of patterns.

    cached_patterns: most patterns that are kept. Chosen.
    psf_window: side of the PSF shown, sensor pixels. Chosen so that a ring of 250 µm fits.
    preview_columns: columns of the grey-level preview. Chosen; the panel has more than the window
        can show.
    """

    cached_patterns: int = 8
    psf_window: int = 160
    preview_columns: int = 512


SETTINGS = PatternDesignerSettings()


class PatternDesigner:
    """Compute patterns for a camera, and their previews.

    Two threads may use it at the same time.
    seed: that of the random start, the same as in a run.
    tol: relative error of predicted PSFs.
    """

    def __init__(self, camera: Camera, seed: int = 1) -> None:
        self._camera, self._seed = camera, seed
        self.tol = USUAL_TOLERANCE
        self._cached_patterns: OrderedDict[str, NDArray[np.uint8]] = OrderedDict()
        self._lock = threading.Lock()

    def grey_levels(self, table: PatternTable, progress: Progress) -> NDArray[np.uint8]:
        """Return a pattern's grey levels, (rows, columns); raises what compute_pattern() does."""
        key = json.dumps(table, sort_keys=True)
        with self._lock:
            if key in self._cached_patterns:
                return self._cached_patterns[key]
        grey = compute_pattern(validate_pattern(table), self._camera, self._seed, progress, Path())
        if not _names_a_file(table):
            with self._lock:
                self._cached_patterns[key] = grey
                while len(self._cached_patterns) > SETTINGS.cached_patterns:
                    self._cached_patterns.popitem(last=False)
        return grey

    def preview(self, table: PatternTable, wavelength: float, progress: Progress) -> PatternPreview:
        """Compute a pattern's preview, and its PSF at a wavelength in metres."""
        grey = self.grey_levels(table, progress.part(0, 0.9))
        progress.report(0.9, "computing the PSF")
        psf = self._psf(grey, wavelength)
        peak = float(psf.max())
        columns = SETTINGS.preview_columns
        rows = round(columns * grey.shape[0] / grey.shape[1])
        small = cv2.resize(grey, (columns, rows), interpolation=cv2.INTER_NEAREST)
        name = validate_pattern(table).label
        return PatternPreview(table, name, np.asarray(small), psf / peak, peak)

    def _psf(self, grey: NDArray[np.uint8], wavelength: float) -> NDArray[np.float32]:
        """Predict the PSF of an object in focus, on the part of the sensor that is shown."""
        pixels = self._camera.sensor.window_plane((SETTINGS.psf_window, SETTINGS.psf_window))
        greys = torch.from_numpy(grey)[None]
        psf = predicted_psf(self._camera, greys, wavelength, pixels, tol=self.tol)
        return psf[0].to(torch.float32).numpy()


def _names_a_file(table: PatternTable) -> bool:
    """Return whether a pattern depends on a file, which may change while its table doesn't."""
    return "file" in table or "file" in table.get("target", {})
