"""Patterns and the PSFs that they give, computed once and kept."""

from __future__ import annotations

import json
import threading
from collections import OrderedDict
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from labapp.light.pattern_psf import predicted_psf
from labapp.patterns.grey_levels import compute_pattern
from labapp.window.engine.plan_building import validate_pattern
from labapp.window.messages import PatternPreview, PatternTable
from optics.camera import Camera
from optics.progress import Progress

_CACHE_SIZE = 8
_PSF_WINDOW = 160
"""Sensor pixels across the PSF shown: holds a ring of 250 µm."""

_THUMBNAIL = 512
"""Columns of the grey picture that the window gets; the panel's own don't fit there."""


class PatternDesigner:
    """Computes patterns for a camera; safe to use from two threads.

    seed: of the random start, the same as in a run.
    """

    def __init__(self, camera: Camera, seed: int = 1) -> None:
        self._camera, self._seed = camera, seed
        self._cached_patterns: OrderedDict[str, NDArray[np.uint8]] = OrderedDict()
        self._lock = threading.Lock()

    def grey_levels(self, table: PatternTable, progress: Progress) -> NDArray[np.uint8]:
        """Grey levels of the panel, (rows, columns); errors as compute_pattern's."""
        key = json.dumps(table, sort_keys=True)
        with self._lock:
            if key in self._cached_patterns:
                return self._cached_patterns[key]
        grey = compute_pattern(validate_pattern(table), self._camera, self._seed, progress, Path())
        if not _names_a_file(table):
            with self._lock:
                self._cached_patterns[key] = grey
                while len(self._cached_patterns) > _CACHE_SIZE:
                    self._cached_patterns.popitem(last=False)
        return grey

    def preview(self, table: PatternTable, wavelength: float, progress: Progress) -> PatternPreview:
        """The pattern made small, and its PSF at a wavelength in metres."""
        grey = self.grey_levels(table, progress.part(0, 0.9))
        progress.report(0.9, "computing the PSF")
        psf = self._psf(grey, wavelength)
        peak = float(psf.max())
        rows = round(_THUMBNAIL * grey.shape[0] / grey.shape[1])
        small = cv2.resize(grey, (_THUMBNAIL, rows), interpolation=cv2.INTER_NEAREST)
        name = validate_pattern(table).label
        return PatternPreview(table, name, np.asarray(small), psf / peak, peak)

    def _psf(self, grey: NDArray[np.uint8], wavelength: float) -> NDArray[np.float32]:
        """Of an object in focus; what falls beyond the window isn't shown."""
        pixels = self._camera.sensor.window_plane((_PSF_WINDOW, _PSF_WINDOW))
        greys = torch.from_numpy(grey)[None]
        return predicted_psf(self._camera, greys, wavelength, pixels)[0].to(torch.float32).numpy()


def _names_a_file(table: PatternTable) -> bool:
    """Whether it may mean another pattern though its text is the same: files change."""
    return "file" in table or "file" in table.get("target", {})
