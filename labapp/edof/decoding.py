"""Decode photographs behind a trained pattern, on the camera that took them."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import torch

from labapp.common.errors import UserError
from labapp.edof.trained_pattern import TrainedPattern
from optics.camera import Camera
from optics.edof.dioptres import midpoint_dioptres
from optics.edof.learned import CaptureFilter, WienerFront
from optics.edof.protocol import EdofProtocol
from optics.edof.protocol_psfs import CameraPSFs, PupilPattern, compute_depth_psfs, compute_transfer
from optics.progress import Progress
from optics.slm import grey_to_phase

_DEPTHS = 32
"""Depths of whose PSFs the filter is made. Measured: with 16 the filter of rings is the same to
0.01 dB."""

_FILTER_SIDE = 1024
"""Pixels along a side of the filter's grid; it reaches half as far. Chosen: a PSF reaches 450
pixels."""


@dataclass(frozen=True, eq=False)
class PhotographDecoder:
    """Decodes photographs of all depths, taken behind a trained pattern.

    front: the filter before the network, for the camera that takes the photographs.
    """

    pattern: TrainedPattern
    front: WienerFront

    def decode(self, picture: torch.Tensor, noise: float) -> torch.Tensor:
        """Return the sharp picture's light, (rows, columns).

        picture: (rows, columns), light, where white is 1.
        noise: standard deviation of a pixel's noise, where white is 1; above 0.
        """
        filtered = self._filter(noise)(picture.to(torch.float32))
        return self.pattern.network.restore(picture, noise, filtered)

    @functools.lru_cache(maxsize=1)  # noqa: B019
    def _filter(self, noise: float) -> CaptureFilter:
        """Return the filter for a noise level, and keep the last one."""
        return CaptureFilter(self.front, noise)


def build_decoder(
    pattern: TrainedPattern, camera: Camera | None = None, progress: Progress | None = None
) -> PhotographDecoder:
    """Build what decodes photographs behind a trained pattern.

    The decoder mustn't be told the depth, which a photograph doesn't say. Raises UserError if it
    is, or if the camera's panel or pixels are other ones.

    camera: the one that takes the photographs; that of the training by default.
    """
    if not pattern.network.settings.is_blind:
        raise UserError(
            f"{pattern.path}: its decoder is told the depth of each photograph, so that it can't "
            'decode one of unknown depth. Train a blind one: front = "blind", psf_channel = false.'
        )
    camera = camera or pattern.camera
    _require_same_scale(pattern, camera)
    progress = progress or Progress()
    phase = grey_to_phase(camera.panel, torch.from_numpy(pattern.grey), pattern.wavelength)
    shown = PupilPattern("trained", phase)
    protocol = EdofProtocol(
        "photographs",
        wavelength=pattern.wavelength,
        pixel_pitch=camera.sensor.pitch,
        binning=pattern.binning,
    )
    dioptres = midpoint_dioptres(_DEPTHS, pattern.depth_range)
    transfers, source = [], CameraPSFs(camera, protocol)
    for number, one in enumerate(dioptres):
        progress.report(number / len(dioptres), f"PSF at {one:.2f} dioptres")
        found = compute_depth_psfs(shown, (one,), camera, protocol, source)
        transfers.append(compute_transfer(found.kernels[0], (_FILTER_SIDE, _FILTER_SIDE)))
    spectrum = pattern.spectrum_on_grid(_FILTER_SIDE)
    return PhotographDecoder(pattern, WienerFront.of_transfers(torch.stack(transfers), spectrum))


def _require_same_scale(pattern: TrainedPattern, camera: Camera) -> None:
    """Raise UserError if a camera's panel or pixels aren't those a trained pattern is made for."""
    own = pattern.camera
    if camera.panel.shape != own.panel.shape or camera.panel.pitch != own.panel.pitch:
        raise UserError(
            f"{pattern.path}: is for a panel of {own.panel.shape[1]}x{own.panel.shape[0]} pixels "
            f"of {1e6 * own.panel.pitch:g} µm, and the bench has another. Train a pattern for it: "
            "labapp train edof."
        )
    scales = [one.lens.focal_length / one.sensor.pitch for one in (camera, own)]
    if abs(scales[0] / scales[1] - 1) > _MOST_SCALE:
        raise UserError(
            f"{pattern.path}: is for a lens of {1e3 * own.lens.focal_length:g} mm before pixels of "
            f"{1e6 * own.sensor.pitch:g} µm, and this camera has {1e3 * camera.lens.focal_length:g}"
            f" mm and {1e6 * camera.sensor.pitch:g} µm. Train a decoder for it: labapp train edof."
        )


_MOST_SCALE = 0.1
"""Most that the PSFs' size in pixels may differ from that of the training. Chosen: the filter is
made for the camera itself, and the network has seen PSFs of one size."""
