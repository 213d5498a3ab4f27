"""Measure the power spectrum of training pictures as a protocol prepares them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import torch

from optics.edof.decoders import Spectrum
from optics.edof.picture_spectrum import FrequencyGrid, fit_spectrum_model, mean_spectrum
from optics.edof.protocol import EdofProtocol, prepare_scene


def measure_training_spectrum(
    pictures: Iterable[torch.Tensor], protocol: EdofProtocol, size: int = 512
) -> Spectrum:
    """Measure the power spectrum that linear decoders of a protocol take pictures to have.

    A spectrum depends on how pictures are brought to size and on the light in which they are
    simulated. That of photographs at their own size is far too strong at high frequencies for
    photographs that were enlarged to 2048 pixels.

    Parameters
    ----------
    pictures : iterable of torch.Tensor
        Photographs in sRGB values, as for `prepare_scene`, that no evaluation uses.
    protocol : EdofProtocol
        How pictures are brought to size, and in which light they are.
    size : int, default 512
        Pixels along a side of the tiles whose spectra are measured; even.

    Returns
    -------
    callable
        Gives the spectrum for pictures of n x n pixels, n even, from a smooth model.

    Raises
    ------
    ValueError
        If there is no picture, or one is invalid.
    """
    model = fit_spectrum_model(mean_spectrum(_prepare_all(pictures, protocol), size))
    return lambda side: model.on_grid(FrequencyGrid(side))


def _prepare_all(
    pictures: Iterable[torch.Tensor], protocol: EdofProtocol
) -> Iterator[torch.Tensor]:
    """Bring pictures to the protocol's size and light, without its crop."""
    for one in pictures:
        side = protocol.shortest_edge or int(min(one.shape[:2]))
        yield prepare_scene(one, side, protocol.light, protocol.shortest_edge)
