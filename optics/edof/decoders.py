"""Restore captures of an unknown depth, or of a known one, by linear filters.

What a decoder may know is in its type. A blind decoder is built from transfer functions at the
depths of design, which are the same for every capture, and is then called with a capture alone. A
decoder that knows the depth is built from the transfer function of that depth. It is an oracle.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import torch

from optics.edof.capture_border import extend_antisymmetrically
from optics.edof.detector_psf import compute_transfer
from optics.edof.protocol import EdofProtocol
from optics.edof.protocol_psfs import DepthPSFs
from optics.edof.spectral_criterion import blind_filter
from optics.fourier import fast_fft_length, irfft2, rfft2
from optics.plane import centred_crop

Restore = Callable[[torch.Tensor], torch.Tensor]
"""Restores a capture (rows, columns), to which nothing else is added."""

Spectrum = Callable[[int], torch.Tensor]
"""Gives the power spectrum of pictures, (n, n // 2 + 1), on the grid of rfft2 for n x n pixels:
|DFT|² per pixel of pictures without their means. A spectrum of `optics.edof.picture_spectrum`."""


@dataclass(frozen=True, eq=False)
class BlindDecoder:
    """Describe a decoder that doesn't know the depth.

    Parameters
    ----------
    name : str
        Name in tables.
    build : callable
        Builds the function that restores captures, from transfer functions at the depths of design,
        (depths, rows, columns // 2 + 1), and the noise's standard deviation. It is called once for
        each noise level, before anything is captured.
    """

    name: str
    build: Callable[[torch.Tensor, float], Restore]


@dataclass(frozen=True, eq=False)
class KnownDepthDecoder:
    """Describe a decoder that is given the PSF of each capture's true depth: an oracle.

    Parameters
    ----------
    name : str
        Name in tables.
    build : callable
        Builds the function that restores captures of one depth, from its transfer function,
        (rows, columns // 2 + 1), and the noise's standard deviation.
    """

    name: str
    build: Callable[[torch.Tensor, float], Restore]


Decoder = BlindDecoder | KnownDepthDecoder


def no_decoder() -> BlindDecoder:
    """Return the decoder that gives back the capture, scaled to the brightness of the scene.

    Returns
    -------
    BlindDecoder
        The decoder.
    """

    def build(design: torch.Tensor, noise: float) -> Restore:
        brightness = float(design[:, 0, 0].real.mean())
        return lambda capture: capture / brightness

    return BlindDecoder("capture", build)


def blind_wiener(spectrum: Spectrum) -> BlindDecoder:
    """Return the linear decoder of least expected squared error for all depths.

    It is one filter for all captures of a noise level (see `optics.edof.spectral_criterion`).

    Parameters
    ----------
    spectrum : callable
        Gives the power spectrum of pictures like those that are captured, but not of those.

    Returns
    -------
    BlindDecoder
        The decoder.
    """

    on_grid = functools.cache(spectrum)

    def build(design: torch.Tensor, noise: float) -> Restore:
        response = blind_filter(design, on_grid(design.shape[-2]), noise)
        return restore_by_filter(response, noise)

    return BlindDecoder("blind Wiener", build)


def known_depth_wiener(spectrum: Spectrum) -> KnownDepthDecoder:
    """Return the linear decoder of least expected squared error for each known depth.

    Parameters
    ----------
    spectrum : callable
        Gives the power spectrum of pictures like those that are captured, but not of those.

    Returns
    -------
    KnownDepthDecoder
        The decoder.
    """

    on_grid = functools.cache(spectrum)

    def build(transfer: torch.Tensor, noise: float) -> Restore:
        response = blind_filter(transfer[None], on_grid(transfer.shape[-2]), noise)
        return restore_by_filter(response, noise)

    return KnownDepthDecoder("known-depth Wiener", build)


def decoding_period(protocol: EdofProtocol) -> tuple[int, int]:
    """Return the rows and columns of the period in which a protocol's captures are decoded.

    It is the crop if the scene is periodic. If the border is true it is twice as large, because the
    capture is extended.

    Parameters
    ----------
    protocol : EdofProtocol
        Its crop and border.

    Returns
    -------
    tuple of int
        Rows and columns, even if the border is true.
    """
    side = protocol.crop
    if protocol.border == "true":
        # The capture can be extended to twice its size at most.
        side = min(fast_fft_length(2 * side - 2), 2 * side)
        side -= side % 2
    return side, side


def decoding_transfers(psfs: DepthPSFs, protocol: EdofProtocol) -> torch.Tensor:
    """Compute the transfer functions of PSFs in the period in which captures are decoded.

    Parameters
    ----------
    psfs : DepthPSFs
        PSFs at some depths.
    protocol : EdofProtocol
        Its crop and border decide the period.

    Returns
    -------
    torch.Tensor, (depths, rows, columns // 2 + 1), complex
        On the grid of rfft2.
    """
    period = decoding_period(protocol)
    return torch.stack([compute_transfer(one, period) for one in psfs.kernels])


def restore_by_filter(response: torch.Tensor, noise: float) -> Restore:
    """Return the function that restores captures by a filter, given on the grid of rfft2.

    A capture that is smaller than the filter's period is extended beyond its border first.
    """
    response = response.to(torch.complex64)
    period = (response.shape[-2], response.shape[-2])

    def restore(capture: torch.Tensor) -> torch.Tensor:
        shape = (int(capture.shape[0]), int(capture.shape[1]))
        whole = capture if shape == period else extend_antisymmetrically(capture, period, noise)
        return centred_crop(irfft2(rfft2(whole) * response, period), shape)

    return restore
