"""A photograph with a distance for each pixel, as a target."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from optics.light.spectrum import Spectrum
from optics.validation import require_positive
from simulator.scene.colours import Basis, primaries
from simulator.scene.framed import FramedPicture, colour_planes, require_colours
from simulator.scene.target import Layer


def distances_of(
    disparity: NDArray[np.floating], baseline: float, focal: float, offset: float = 0.0
) -> NDArray[np.float64]:
    """Return distances from the disparity of a stereo pair.

    Each distance is baseline times focal, divided by the sum of disparity and offset.

    Parameters
    ----------
    disparity : ndarray
        Disparity in pixels, of any shape; NaN where it is unknown.
    baseline, focal : float
        Distance between the cameras in metres, and focal length in pixels, positive.
    offset : float, default 0.0
        Number of pixels that is added to the disparity.

    Returns
    -------
    ndarray
        Distances in metres, of the same shape; NaN where the disparity is.

    Raises
    ------
    ValueError
        If a disparity with its offset isn't positive: the object isn't before the cameras.
    """
    require_positive("baseline", baseline, "m")
    require_positive("focal", focal, "pixels")
    whole = np.asarray(disparity, dtype=np.float64) + offset
    if (whole <= 0).any() or np.isinf(whole).any():
        raise ValueError(
            f"disparity and offset come to {np.nanmin(whole):g} pixels somewhere; they must be "
            "positive and finite (NaN where nothing is known)"
        )
    return baseline * focal / whole


@dataclass(frozen=True, eq=False)
class Relief(FramedPicture):
    """Photograph in depth layers, with a distance for each pixel.

    The blurred edge of a near layer reveals parts of farther layers that the photograph doesn't
    show. They are filled with the nearest pixel in the picture that is farther away.

    Parameters
    ----------
    image : torch.Tensor
        Linear red, green and blue, shape (rows, columns, 3), 1 = white.
    depths : torch.Tensor
        Distances from the panel in metres, shape (rows, columns), positive. NaN takes the distance
        of the nearest pixel in the picture that has one.
    radiance : float
        Spectral radiance of white, W / (sr m² m), not negative.
    levels : int, default 8
        Number of depth layers, 1 to 64, at even steps of the inverse distance.
    basis : tuple of Spectrum, optional
        See `PhotographPrint`.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    cover, height, offset, side : optional
        See `PhotographPrint`.

    Raises
    ------
    ValueError
        For an image, `depths` or `levels` other than these.
    """

    image: torch.Tensor
    depths: torch.Tensor
    radiance: float
    levels: int = 8
    basis: Basis = field(default_factory=primaries)

    def __post_init__(self) -> None:
        require_colours(self.image)
        if self.depths.shape != self.image.shape[:2]:
            raise ValueError(
                f"depths is {tuple(self.depths.shape)}; it must be as the image, "
                f"{tuple(self.image.shape[:2])}"
            )
        if not 1 <= self.levels <= 64:
            raise ValueError(f"levels is {self.levels}; give 1 to 64 layers")
        known = self.depths[~torch.isnan(self.depths)]
        if not len(known) or not (known > 0).all() or torch.isinf(known).any():
            raise ValueError("depths must be positive and finite, and known somewhere")
        object.__setattr__(self, "distance", float(known.min()))
        super().__post_init__()

    @property
    def images(self) -> tuple[tuple[Spectrum, torch.Tensor], ...]:
        """The reflectances of the primaries, and their pictures, without the distances."""
        return colour_planes(self.basis, self.image)

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        depths = self.depths.numpy()
        known = ~np.isnan(depths)
        if not known.all():
            depths = depths[_nearest(known)]
        owner, distances = _assign_layers(depths, self.levels)
        colours = self.image.to(torch.float32).numpy()
        shown = [np.where((owner == k)[..., None], colours, 0) for k in range(len(distances))]
        covers = [(owner == k).astype(np.float32) for k in range(len(distances))]
        for k in range(len(distances) - 1):
            # Each pass fills the parts of farther layers that the layers up to k hide. Where three
            # layers meet, one pixel may have to be filled in two of them.
            near, where = owner <= k, _nearest(owner > k)
            behind = owner[where]
            for far in range(k + 1, len(distances)):
                filled = near & (behind == far) & (covers[far] == 0)
                covers[far][filled] = 1
                shown[far][filled] = colours[where][filled]
        found = []
        for distance, picture, cover in zip(distances, shown, covers, strict=True):
            planes = colour_planes(self.basis, torch.from_numpy(picture))
            hidden = self.place_image(torch.from_numpy(cover))
            found.append(replace(self.painted_layer(distance, planes), cover=hidden))
        return tuple(found)


def _nearest(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return row and column of the nearest pixel in a mask, for each pixel."""
    rows, columns = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return rows, columns


def _assign_layers(
    depths: NDArray[np.floating], levels: int
) -> tuple[NDArray[np.int64], list[float]]:
    """Assign pixels to depth layers; return each pixel's layer and the layers' distances.

    Layer 0 is the nearest, and no layer is empty. Their steps of vergence are even.
    """
    vergence = 1 / depths
    near, far = float(vergence.max()), float(vergence.min())
    step = (near - far) / levels
    if step <= 1e-9 * near:
        return np.zeros(depths.shape, dtype=np.int64), [1 / near]
    level = np.minimum(((near - vergence) / step).astype(np.int64), levels - 1)
    used, owner = np.unique(level, return_inverse=True)
    distances = [1 / (near - (k + 0.5) * step) for k in used.tolist()]
    return owner.reshape(depths.shape), distances
