"""Removal of small isolated parts from an estimated blur kernel."""

from __future__ import annotations

import numpy as np
import scipy.ndimage
import torch

_TOUCHING = np.ones((3, 3))


def without_specks(kernel: torch.Tensor, faint: float, small: float) -> torch.Tensor:
    """Remove faint pixels and small isolated parts from a blindly estimated blur kernel.

    Pixels below the share `faint` of the peak are set to 0, and so are connected parts with less
    than the share `small` of the light. The result sums to 1.
    """
    kept = torch.where(kernel >= faint * kernel.max(), kernel, 0.0)
    if small > 0:
        parts, count = scipy.ndimage.label(kept.numpy() > 0, _TOUCHING)
        light = scipy.ndimage.sum_labels(kept.numpy(), parts, np.arange(count + 1))
        weak = light < small * min(float(kept.sum()), float(light.max()))
        kept = torch.where(torch.from_numpy(weak[parts]), 0.0, kept)
    return kept / kept.sum()
