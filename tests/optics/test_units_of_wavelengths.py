"""A wavelength in nanometres or micrometres, where metres are meant, is asked about in words.

Free space knows no unit: there, all lengths may be scaled (tests/hard_cases/propagation_laws.py).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from optics import edof, multispectral, patterns, psf, retrieval, slm, targets
from optics.camera import Camera
from optics.light import Spectrum, monochromatic
from optics.plane import Plane
from optics.slm import Panel, PhaseResponse

PANEL = Panel((24, 32), 8e-6)
CAMERA = Camera(PANEL)
PLANE = Plane((16, 16), (8e-6, 8e-6))
FLAT = torch.zeros(24, 32)

FACES = {
    "spectrum": lambda w: Spectrum((w, 2 * w), (1.0, 1.0)),
    "line": monochromatic,
    "psf": lambda w: psf.psf(CAMERA, FLAT, distance=math.inf, wavelength=w, pixels=PLANE),
    "stack": lambda w: psf.PSFStack(CAMERA, [2.0], [w], PLANE),
    "lens": lambda w: patterns.fresnel_lens(PANEL, 1.0, w),
    "axicon": lambda w: patterns.axicon(PANEL, 1e-5, 0.1, w),
    "grating": lambda w: patterns.steering_grating(PANEL, (1e-5, 0), 0.1, w),
    "Zernike": lambda w: patterns.zernike_pattern(PANEL, [(2, 0, 1e-7)], 1e-4, w),
    "retrieval": lambda w: retrieval.design_plane(CAMERA, w, (16, 16)),
    "range": lambda w: slm.max_phase(PANEL, w),
    "response": lambda w: PhaseResponse.from_curve(w, np.linspace(0, 1, 256)),
    "prism": lambda w: targets.dispersed_positions([w, 2 * w], w, 1000.0),
    "ring": lambda w: multispectral.ring_psfs(PLANE, [w, 1.5 * w], 3.0),
    "protocol": lambda w: edof.EdofProtocol("a", wavelength=w),
    "bound": lambda w: edof.rms_transfer_limit(CAMERA, w, None),
}


@pytest.mark.parametrize("name", FACES)
@pytest.mark.parametrize("wavelength", [550, 0.55, 0.55e-9])
def test_another_unit_than_metres_is_asked_about(name, wavelength):
    wanted = "longer than a millimetre" if wavelength > 1e-3 else "shorter than ten nanometres"
    told = f"wavelength is .* m, {wanted}; give metres.*5(50|\\.5).*\\?"
    with pytest.raises(ValueError, match=told):
        FACES[name](wavelength)
