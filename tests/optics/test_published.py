"""Patterns that the thesis' authors published, against the PSFs that they published with them.

The data lie beside the checkout, if at all (github.com/cgtuebingen, MIT licence).
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from optics.fourier import FourierGeometry, valid_transforms
from optics.plane import Plane, centred_crop

FOLDER = (
    Path(__file__).parents[3]
    / "shared/data/thesis/phase_retrieval/results/phase_pattern_images/r_30p"
)


@pytest.mark.shared
@pytest.mark.skipif(not FOLDER.is_dir(), reason="the published patterns aren't beside the checkout")
@pytest.mark.parametrize("iteration", ["1", "569(min_constraint)"])
def test_a_published_pattern_gives_its_published_psf(iteration):
    """The authors transformed the 1920x1080 phase within 1920x1920 samples: step 1/1920.

    Their files of iterations 10 and 100 are left out: pattern and PSF don't belong
    together there, by a plain FFT too.
    """
    grey, published = (
        cv2.imread(str(FOLDER / f"slm{kind}_gaussianRing_iter_{iteration}.png"), 0)
        for kind in ("Phase", "PSF")
    )
    pitch, window = 8e-6, (200, 200)
    plane = Plane(window, (1e-6, 1e-6))
    geometry = FourierGeometry(Plane(grey.shape, (pitch, pitch)), plane, 1920 * pitch * 1e-6)
    phase = torch.from_numpy(grey).to(torch.float64) * (2 * np.pi / 255)
    wanted = centred_crop(torch.from_numpy(published), window).numpy().ravel()
    for transform in valid_transforms(geometry, torch.complex64):
        field = transform(torch.polar(torch.ones_like(phase), phase))
        intensity = (field.real**2 + field.imag**2).numpy().ravel()
        correlation = np.corrcoef(intensity, wanted)[0, 1]
        assert correlation >= 0.999, transform.name
