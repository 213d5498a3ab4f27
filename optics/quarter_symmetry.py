"""Mirror a quarter of a plane's samples about the samples' centre, bit for bit.

The centre of the samples of an axis lies at index (n - 1) / 2. For odd n it is the plane's origin,
which is sample n // 2; for even n it lies half a pitch before the origin. A quarter is what lies at
or behind the centre along both axes: ``array[..., rows // 2 :, columns // 2 :]``, ceil(n / 2)
samples along each axis, with the sample that is nearest to the centre first.
"""

from __future__ import annotations

import torch

__all__ = ["crop_quarter", "mirror_quarter", "quarter_distances", "quarter_shape"]


def quarter_shape(shape: tuple[int, int]) -> tuple[int, int]:
    """Return the (rows, columns) of a quarter of a plane of (rows, columns) samples.

    The middle line of an odd number of samples belongs to the quarter.
    """
    return (shape[0] + 1) // 2, (shape[1] + 1) // 2


def quarter_distances(
    shape: tuple[int, int], pitch: tuple[float, float]
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the distances (y, x) of a quarter's samples from the centre of all samples.

    shape: (rows, columns) of the whole plane. pitch: metres. The result is a column and a row,
    float64, metres, which broadcast to the quarter's shape.
    """
    y, x = (
        (torch.arange(n // 2, n, dtype=torch.float64) - (n - 1) / 2) * step
        for n, step in zip(shape, pitch, strict=True)
    )
    return y[:, None], x[None, :]


def crop_quarter(array: torch.Tensor) -> torch.Tensor:
    """Crop the last two axes to the quarter that lies at or behind the samples' centre on both."""
    rows, columns = array.shape[-2:]
    return array[..., rows // 2 :, columns // 2 :]


def mirror_quarter(quarter: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Mirror a quarter of a plane's samples about their centre into the whole plane.

    The result equals its mirror images in both axes bit for bit. The gradient at a sample of the
    quarter is the sum of those at its images.

    Parameters
    ----------
    quarter : torch.Tensor, (..., ceil(rows / 2), ceil(columns / 2))
        Samples, the nearest to the centre first; the middle line of an odd number isn't doubled.
    shape : tuple of (int, int)
        (rows, columns) of the whole plane.

    Returns
    -------
    torch.Tensor, (..., rows, columns)

    Raises
    ------
    ValueError
        If the quarter's shape isn't that of a quarter of the plane.
    """
    if tuple(quarter.shape[-2:]) != quarter_shape(shape):
        raise ValueError(
            f"quarter is {tuple(quarter.shape[-2:])} samples; a quarter of {shape} has "
            f"{quarter_shape(shape)}"
        )
    for axis, count in ((-2, shape[0]), (-1, shape[1])):
        doubled = quarter.narrow(axis, count % 2, count // 2)
        quarter = torch.cat([doubled.flip(axis), quarter], dim=axis)
    return quarter
