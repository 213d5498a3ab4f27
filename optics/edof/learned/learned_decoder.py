"""Learned decoders for evaluations of extended depth of field: blind, and told the depth."""

from __future__ import annotations

import functools

import torch

from optics.edof.decoders import (
    BlindDecoder,
    Decoder,
    KnownDepthDecoder,
    Restore,
    Spectrum,
    restore_by_filter,
)
from optics.edof.learned.decoder_network import DecoderNetwork
from optics.edof.spectral_criterion import blind_filter
from optics.fourier import irfft2
from optics.plane import centred_crop, centred_pad, origin_to_centre


def learned_decoder(network: DecoderNetwork, spectrum: Spectrum, name: str = "learned") -> Decoder:
    """Return the learned decoder of a trained network for an evaluation.

    Parameters
    ----------
    network : DecoderNetwork
        The network.
    spectrum : callable
        Gives the power spectrum of pictures like those that are captured, but not of those, for the
        filter before the network; see `optics.edof.decoders`.
    name : str, optional
        Name in tables.

    Returns
    -------
    BlindDecoder or KnownDepthDecoder
        The first if nothing but the capture tells the network of its depth.
    """
    on_grid = functools.cache(spectrum)

    def build(transfer: torch.Tensor, noise: float) -> Restore:
        return _build_restore(network, transfer, on_grid, noise)

    if network.settings.is_blind:
        return BlindDecoder(name, build)
    return KnownDepthDecoder(name, lambda transfer, noise: build(transfer[None], noise))


def _build_restore(
    network: DecoderNetwork, transfer: torch.Tensor, spectrum: Spectrum, noise: float
) -> Restore:
    """Build the function that decodes captures, from transfer functions at some depths."""
    settings = network.settings
    filtering: Restore | None = None
    if settings.front != "none":
        response = blind_filter(transfer, spectrum(transfer.shape[-2]), noise)
        filtering = restore_by_filter(response, noise)
    psf = _centred_psf(transfer[0]) if settings.psf_channel else None

    def restore(capture: torch.Tensor) -> torch.Tensor:
        filtered = None if filtering is None else filtering(capture)
        shape = (int(capture.shape[0]), int(capture.shape[1]))
        channel = None if psf is None else fit_psf(psf, shape)
        return network.restore(capture, noise, filtered, channel)

    return restore


def _centred_psf(transfer: torch.Tensor) -> torch.Tensor:
    """Return the PSF of a transfer function on its period, centred."""
    side = int(transfer.shape[-2])
    return origin_to_centre(irfft2(transfer, (side, side))).to(torch.float32)


def fit_psf(psf: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Bring a centred PSF to a picture's size and a peak of 1, as a channel for the decoder.

    psf: (..., rows, columns). It is cut, or continued by zeros.
    """
    cut = tuple(min(n, m) for n, m in zip(psf.shape[-2:], shape, strict=True))
    fitted = centred_pad(centred_crop(psf, (cut[0], cut[1])), shape)
    return fitted / fitted.amax((-2, -1), keepdim=True)
