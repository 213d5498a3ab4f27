"""Specks that a kernel has beside its stroke."""

from __future__ import annotations

import numpy as np
import scipy.ndimage
import torch

_TOUCHING = np.ones((3, 3))


def without_specks(kernel: torch.Tensor, faint: float, small: float) -> torch.Tensor:
    """With a sum of 1, and without what is fainter than a share of the peak, and without connected
    parts that have less than a share of its light."""
    kept = torch.where(kernel >= faint * kernel.max(), kernel, 0.0)
    if small > 0:
        parts, count = scipy.ndimage.label(kept.numpy() > 0, _TOUCHING)
        light = scipy.ndimage.sum_labels(kept.numpy(), parts, np.arange(count + 1))
        weak = light < small * min(float(kept.sum()), float(light.max()))
        kept = torch.where(torch.from_numpy(weak[parts]), 0.0, kept)
    return kept / kept.sum()
