"""The ghosts of a lens: scaled, defocused copies of a picture about the axis."""

from __future__ import annotations

import math

import torch

from optics.camera import Ghost
from optics.formation import rfft2_frequencies, spectrum_of_disc
from optics.fourier import ChirpTransform, FourierGeometry, rfft_column_weights
from optics.plane import Plane
from simulator.formation.windows import transform_operations

# Real Fourier transforms of a picture that take as long as one of its ghosts; measured.
_TRANSFORMS = 6.0


def ghost_operations(shape: tuple[int, int]) -> float:
    """Return the operations that one copy of a picture of (rows, columns) samples takes."""
    return _TRANSFORMS * transform_operations(*shape)


def ghost_on_pixels(
    spectrum: torch.Tensor, plane: Plane, frame: Plane, ghost: Ghost, *, aperture: bool
) -> torch.Tensor:
    """Return a ghost's light on the pixels of `frame`, without its share.

    spectrum: of the picture on the samples of `plane`, by rfft2 with the axis in the corner; a
    sample has the light of a whole pixel. aperture: whether light is averaged over each pixel. At
    the height r on the sensor lies the ghost of what the picture has at r / magnification, where
    its light is denser by the square of that: pixels and disc are smaller there. A chirped Fourier
    transform sums all detail.
    """
    scale = abs(ghost.magnification)
    # The transfer function of the ghost's disc and of pixels, in the picture's size.
    transfer = spectrum_of_disc(plane, ghost.blur_diameter / scale).real
    if aperture:
        fy, fx = rfft2_frequencies(plane)
        y, x = (side / scale for side in frame.pitch)
        transfer = transfer * torch.sinc(fy * y) * torch.sinc(fx * x)
    passed = spectrum * transfer.to(torch.float32)
    # Columns between the first and the last count twice, for their mirror images.
    passed = passed * rfft_column_weights(plane.shape[1])
    if ghost.magnification > 0:
        passed = passed.conj()  # The transform's exponent is negative.
    rows, columns = passed.shape
    steps = tuple(1 / (n * p) for n, p in zip(plane.shape, plane.pitch, strict=True))
    frequencies = Plane((rows, columns), (steps[0], steps[1]), (0.0, columns // 2 * steps[1]))
    places = Plane(frame.shape, (frame.pitch[0] / scale, frame.pitch[1] / scale))
    transform = ChirpTransform(FourierGeometry(frequencies, places, 1.0), torch.complex64)
    centred = torch.roll(passed, rows // 2, 0).to(torch.complex64)
    light = transform(centred).real
    return light / (scale**2 * math.prod(plane.shape))
