"""Extend a capture beyond its frame, where the scene is unknown, before a filter restores it."""

from __future__ import annotations

import math

import torch

_EDGE_NOISE = 0.02
"""Noise, relative to white, of the value at the edge: it is a mean over so many pixels.

Measured: 0.02 comes within 0.1 dB of the best of 1, 4, 8 and 16 pixels from the edge inwards, for
noise of 0.008, 0.035, 0.08, 0.3 and 1.4."""

_MOST_DEPTH = 16
"""Most pixels from the edge inwards whose mean is the value at the edge. Measured: with 32, as much
is lost as with plain mirroring."""


def extend_antisymmetrically(
    capture: torch.Tensor, shape: tuple[int, int], noise: float = 0.0
) -> torch.Tensor:
    """Extend a capture to a larger period by mirroring it in points on its edges.

    Beyond an edge the capture goes on as twice the value at the edge minus the mirrored capture, so
    that a slope goes on. The extension fades to the capture's mean by a raised cosine, so that
    opposite edges of the period meet. A filter loses less near the edge than with the usual
    mirroring, which makes kinks that a filter sharpens, and about as little where there is much
    noise.

    Parameters
    ----------
    capture : torch.Tensor, (rows, columns)
        The capture.
    shape : tuple of int
        Rows and columns of the period, at least those of the capture and at most twice as many.
    noise : float, optional
        Standard deviation of a pixel, relative to white. The value at the edge is a mean over the
        more pixels, the more noise there is.

    Returns
    -------
    torch.Tensor, (rows, columns) of `shape`
        The extension, with the capture in its middle: the origin stays at n // 2.

    Raises
    ------
    ValueError
        If the period is smaller than the capture, or more than twice as large, or the noise is
        negative or infinite.

    Notes
    -----
    Measured on three photographs of 512 x 512 pixels with one filter for all depths behind
    multi-focus rings, in dB of the whole frame against a scene that is periodic: with a noise of
    0.008 it loses 0.6, and plain mirroring 2.0; with 0.035 it loses 0.5 and mirroring 1.6. With the
    noise of 1.4 of a hole of 1 mm, neither loses anything. In the central quarter all lose less
    than 0.03.
    """
    for name, n, period in zip(("rows", "columns"), capture.shape, shape, strict=True):
        if not n <= period <= 2 * n:
            raise ValueError(
                f"shape has {period} {name}; a capture of {n} can be extended to {n} to {2 * n}"
            )
    if not 0 <= noise < math.inf:
        raise ValueError(f"noise is {noise:g}; give its standard deviation, where white is 1")
    depth = min(max(math.ceil(noise / _EDGE_NOISE), 1), _MOST_DEPTH)
    mean = capture.mean()
    across = _extend_rows(capture - mean, shape[1], depth)
    return _extend_rows(across.T, shape[0], depth).T + mean


def _extend_rows(values: torch.Tensor, period: int, depth: int) -> torch.Tensor:
    """Extend the rows of a capture without its mean to a period, before and after them."""
    before = period // 2 - values.shape[1] // 2
    after = period - values.shape[1] - before
    first = _continue_rows(values.flip(1), before, depth).flip(1)
    return torch.cat([first, values, _continue_rows(values, after, depth)], 1)


def _continue_rows(values: torch.Tensor, count: int, depth: int) -> torch.Tensor:
    """Return what follows the rows of a capture without its mean, (rows, count), fading to zero.

    depth: pixels from the edge inwards whose mean is the value at the edge. Along the edge it is a
    mean over 2 depth - 1 pixels.
    """
    n = values.shape[1]
    depth = min(depth, n)
    reach = min(depth, values.shape[0]) - 1
    edge = torch.nn.functional.avg_pool1d(
        values[:, n - depth :].mean(1)[None, None],
        2 * reach + 1,
        stride=1,
        padding=reach,
        count_include_pad=False,
    )[0, 0]
    away = torch.arange(1, count + 1)
    # The point of the mirroring is the middle of the pixels whose mean is taken.
    mirrored = values[:, (n - depth - away).clamp(min=0)]
    fade = 0.5 * (1 + torch.cos(torch.pi * away / (count + 1))).to(values)
    return (2 * edge[:, None] - mirrored) * fade
