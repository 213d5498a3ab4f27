"""The share that each rendered angle at the filter has of the light of every point in the field."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from optics.camera import Camera
from optics.plane import Plane
from simulator.filter_angles import squared_sines
from simulator.formation.nodes import interpolation_weights

_TABLE = 1025
"""Values between which shares are interpolated linearly, right to 1e-5. Chosen."""


def angle_share(squared: Sequence[float], angle: int, camera: Camera, plane: Plane) -> torch.Tensor:
    """Return the weight of one of the rendered angles at each place of a plane, float32.

    squared: sin² of all angles, between which bands are interpolated by a polynomial. Beyond the
    outermost, its value there is kept.
    """
    table = np.linspace(0, squared[-1], _TABLE)
    share = interpolation_weights(squared, table)[angle]
    found = np.interp(squared_sines(camera, plane).numpy(), table, share)
    return torch.from_numpy(found.astype(np.float32))
